//! End-to-end tests: real processes, shared memory, files and signals.
//!
//! One program for all of them: these tests wait for processes, clocks and the simulated station far longer than they
//! compute, so they run at the same time.
#![allow(
    clippy::panic,
    clippy::print_stderr,
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "in a test the panic is the report"
)]

mod acquire;
mod c_interface;
mod convert;
mod daemon;
mod damage;
mod documents;
mod endings;
// The tracer knows the registers of this processor.
#[cfg(target_arch = "x86_64")]
mod exchange;
mod faults;
mod feed;
mod formats;
mod guard;
mod harness;
mod hostile;
mod hot_loop;
mod install;
mod installing;
mod kept;
mod laboratory;
mod lag;
mod lag_restarts;
mod life;
mod mems;
mod metrics;
mod namespaces;
mod neighbours;
mod outputs;
mod paced;
mod readers;
mod readings;
mod realtime;
mod record;
mod rehearsal;
mod relay;
mod reload;
mod removal;
mod resources;
mod rooms;
mod round_trip;
mod sessions;
mod tables;
mod terminal;
mod texts;
mod time_steps;
mod top;
mod two_users;
mod unix_time;
mod watchdog;
mod whole_imu;
mod whole_recordings;
mod whole_verification;
mod words;
