//! Input: any text as the service's configuration. Every refusal must name a line and a reason; an accepted
//! configuration must be within the documented limits.

use crate::check_faults;
use isotherm_client::transport::stream::RAW_DEPTH;
use isotherm_service::config::{Config, MAX_IMUS};
use isotherm_shared::names::ImuId;
use std::collections::BTreeSet;
use std::path::Path;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else { return };
    let config = match Config::from_toml(text, Path::new("")) {
        Ok(config) => config,
        Err(faults) => return check_faults(text, &faults),
    };
    assert!((1..=32).contains(&config.imus.len()) && MAX_IMUS == 32);
    let ids: BTreeSet<_> = config.imus.iter().map(|imu| imu.id.as_str()).collect();
    assert_eq!(ids.len(), config.imus.len());
    assert!(ids.iter().all(|id| ImuId::new(id).is_some()));
    for imu in &config.imus {
        assert!((1..=RAW_DEPTH).contains(&imu.depth));
        assert!(!imu.table.as_os_str().is_empty());
    }
    // The workers are numbered from 0 without gaps, and each has an IMU.
    let workers: BTreeSet<_> = config.imus.iter().map(|imu| imu.worker).collect();
    assert!(workers.iter().copied().eq(0..config.workers()));
    assert!(config.budget_us > 0.0 && config.budget_us <= 1e6);
    let realtime = &config.realtime;
    assert!(realtime.priority.is_none_or(|priority| (1..=99).contains(&priority)));
    assert!((1..=1_000_000_000).contains(&realtime.timer_slack_ns.get()));
    let cores: BTreeSet<_> = realtime.cores.iter().copied().collect();
    assert_eq!(cores.len(), realtime.cores.len());
    assert!(cores.is_empty() || cores.len() == config.workers());
    assert!(cores.iter().all(|core| *core < 1024));
}
