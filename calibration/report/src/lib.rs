//! What was found, as text, as JSON, and as self-contained HTML: one file with inline figures, without script, network
//! access or external font.
//!
//! [`Page`] appends escaped text, tables and figures to a document, [`Plot`] draws a figure as inline SVG. Both share
//! one embedded stylesheet, so a figure follows the light, dark or print palette of its page.
//!
//! ```
//! use isotherm_report::{Cell, Page, Plot, Style};
//!
//! let mut page = Page::new("Bias", "imu-a");
//! let rows = [vec![Cell::text("A1"), Cell::number(793.55, 2)]];
//! page.table("At 0 V", &["Axis", "Bias / ug0"], &rows);
//! let bias = (0..10).map(|i| f64::from(i) / 2.0).map(|temperature| (temperature, 793.55 - 1074.7 * temperature));
//! let plot = Plot::new("Bias", "Temperature / V", "Bias / ug0").series("A1", Style::Line, bias);
//! page.figure(&plot.svg(), "Bias over temperature");
//! let html = page.finish();
//! assert!(html.contains("<svg") && html.contains("793.55") && !html.contains("<script"));
//! ```

mod axis;
pub mod batch;
pub mod calibration;
pub mod comparison;
mod findings;
pub mod json;
mod loops;
pub mod magnitudes;
pub mod noise;
pub mod outcome;
mod page;
mod parts;
mod plot;
mod quantity;
pub mod ramps;
mod shown;
mod svg;
pub mod table;
pub mod text;
mod thin;
mod transients;
pub mod tumble;
pub mod vehicle;
pub mod verification;
mod view;
pub mod warm_up;

pub use page::{Cell, NoteKind, Page, first_screen, framed, with_files};
pub use plot::{Plot, Style};
