//! Reports as self-contained HTML: one file with inline figures, without script, network access or external font.
//!
//! [`page`] appends escaped text, tables and figures to a document, [`plot`] draws a figure as inline SVG. Both share
//! one embedded stylesheet, so a figure follows the light, dark or print palette of its page.

mod axis;
pub mod page;
pub mod plot;
mod svg;
mod thin;
