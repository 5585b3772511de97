//! What the benches send, and how they wait for the answer.

use crate::BenchResult;
use isotherm_client::RawSample;
use isotherm_shared::wire::Triad;
use std::time::{Duration, Instant};

/// The table that the service starts with: that of a whole IMU, with everything that the kernel can have to do.
pub const TABLE: &str = include_str!("../../examples/tables/imu-whole.toml");
/// The IMU of [`TABLE`].
pub const IMU: &str = "imu-whole";
/// Time constant of [`TABLE`] \[ns\].
pub const LAG_NS: u64 = 240_000_000_000;
/// Longest wait for an answer; after it the bench fails.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// The sample that the benches send: an IMU at rest.
pub fn sample() -> RawSample {
    let temperature = Triad {
        head_temperature: [2.4, 2.41, 2.42],
        board_temperature: [2.5, 2.51, 2.52],
        head_lagged: [2.38, 2.39, 2.4],
        ..Triad::default()
    };
    RawSample {
        interval_ns: 2_500_000,
        lag_ns: LAG_NS,
        accelerometers: Triad { positive_pulses: [140, 0, 150], negative_pulses: [0, 110, 0], ..temperature },
        gyroscopes: Triad { positive_pulses: [20, 0, 3], negative_pulses: [0, 17, 4], ..temperature },
        ..RawSample::default()
    }
}

/// A busy wait with a time limit. The clock is read rarely.
#[derive(Debug, Default)]
pub struct Spin {
    turns: u32,
    since: Option<Instant>,
}

impl Spin {
    /// One turn of the busy wait.
    ///
    /// # Errors
    /// If the wait has been longer than [`TIMEOUT`].
    #[inline]
    pub fn turn(&mut self) -> BenchResult<()> {
        core::hint::spin_loop();
        self.turns = self.turns.wrapping_add(1);
        if self.turns.is_multiple_of(1 << 16) && self.since.get_or_insert_with(Instant::now).elapsed() > TIMEOUT {
            return Err("no answer; the other process has stopped".into());
        }
        Ok(())
    }
}
