//! Stability of recordings whose truth is known, and what text, JSON and page say of it.
#![allow(clippy::panic, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod consumer;
mod heating;
mod stability;
