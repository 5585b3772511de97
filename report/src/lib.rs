//! What was found, as text, as JSON, and as self-contained HTML: one file with inline figures, without script, network access or external font.
//!
//! [`Page`] appends escaped text, tables and figures to a document, [`Plot`] draws a figure as inline SVG. Both share
//! one embedded stylesheet, so a figure follows the light, dark or print palette of its page.

mod axis;
pub mod batch;
pub mod calibration;
pub mod comparison;
pub mod gravity_only;
pub mod json;
pub mod lengths;
mod loops;
pub mod noise;
mod page;
mod parts;
mod plot;
pub mod ramps;
mod svg;
pub mod text;
mod thin;
mod transients;
pub mod verification;

pub use page::{Cell, NoteKind, Page};
pub use plot::{Plot, Style};
