//! The harness of the benches: their common arguments and child processes ([`run`]), a domain of their own with the
//! service as a child process ([`BenchDomain`]), the machine, statistics of series, and text tables.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

mod child;
mod domain;
mod harness;
mod machine;
mod sample;
mod series;
mod statistics;
mod text;

pub use child::{BenchResult, child_of};
pub use domain::{BenchDomain, BenchProcess, imu, served_by};
pub use harness::{Common, OtherBuild, no_role, own_folder, run};
pub use machine::{cores, pin, pin_apart, preemptions, shared_memory, status_number, stolen_ticks, worker_time};
pub use sample::{IMU, LAG_NS, Spin, TABLE, TIMEOUT, sample};
pub use series::{PathTimes, Series};
pub use statistics::{Random, figures, median, nanoseconds, nearest_rank, pooled_ratio, ratios};
