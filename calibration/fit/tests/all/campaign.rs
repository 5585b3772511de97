//! Simulated campaigns, from their rows to their tables.

mod accuracy;
mod batch;
mod causes;
mod checks;
mod common;
mod coverage;
mod few_set_points;
mod laboratories;
mod report;
