//! Whether a recording is of the IMU that its table was made of, by what the logs of an autopilot say.

use super::origin::Origin;
use isotherm_recording::LogImu;
use isotherm_support::finding::{Finding, name};

impl Origin {
    /// What was found if a recording is of another IMU of a vehicle than the logs that made the table. `log_imu` is the
    /// IMU as its log names it, and `device` the device that its rows name. A log that names another IMU is a fault.
    /// The rows of a recording have only a device, which may be of another kind: that is a warning.
    ///
    /// Logs have no serial number: two boards of a model are not distinguished.
    #[must_use]
    pub fn other_device(&self, log_imu: Option<LogImu>, device: Option<u64>) -> Option<Finding> {
        let of_table = self.log_imu?;
        match log_imu {
            Some(of_log) => other_imu(&of_table, &of_log),
            None => device.and_then(|device| other_rows(&of_table, device)),
        }
    }
}

fn other_imu(of_table: &LogImu, of_log: &LogImu) -> Option<Finding> {
    let message = || {
        format!(
            "the rows are of {of_log}, and the table was made of {of_table}; give the table of that IMU, or choose the \
             IMU of the log with --instance"
        )
    };
    of_table.differs_from(of_log).then(|| Finding::fault(name::OTHER_DEVICE, message()))
}

fn other_rows(of_table: &LogImu, device: u64) -> Option<Finding> {
    let known = of_table.device();
    let message = || format!("the rows name another device than the log that made the table, which is of {of_table}");
    (known != 0 && known != device).then(|| Finding::warning(name::OTHER_DEVICE, message()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_support::finding::Severity;

    #[test]
    fn another_number_is_a_fault_and_another_device_of_rows_a_warning() {
        let imu = |instance, id| LogImu { instance, devices: [id, None] };
        let origin = |imu| Origin { log_imu: Some(imu), ..Origin::default() };
        let first = origin(imu(0, Some(7)));
        let severity = |found: Option<Finding>| found.map(|found| found.severity);
        assert_eq!(severity(first.other_device(Some(imu(0, Some(7))), None)), None);
        // The same device at another place.
        assert_eq!(severity(first.other_device(Some(imu(1, Some(7))), None)), None);
        assert_eq!(severity(first.other_device(Some(imu(0, Some(8))), None)), Some(Severity::Fault));
        assert_eq!(severity(origin(imu(0, None)).other_device(Some(imu(1, Some(7))), None)), Some(Severity::Fault));
        let of_rows = |id| imu(0, Some(id)).device();
        assert_eq!(severity(first.other_device(None, Some(of_rows(7)))), None);
        assert_eq!(severity(first.other_device(None, Some(of_rows(8)))), Some(Severity::Warning));
        assert_eq!(severity(first.other_device(None, None)), None);
        assert_eq!(severity(Origin::default().other_device(Some(imu(3, None)), Some(5))), None);
    }
}
