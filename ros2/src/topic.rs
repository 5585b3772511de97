//! Names of topics.

use isotherm_client::ImuId;

/// Where the diagnostics of all nodes go.
pub(crate) const DIAGNOSTICS: &str = "/diagnostics";

/// The topics of an IMU, named as REP 145 has it.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct OutputTopics {
    /// `imu/data_raw` in the namespace.
    pub imu: String,
    /// `imu/temperature` in the namespace.
    pub temperature: String,
}

impl OutputTopics {
    /// In this namespace, which is `/` or begins and does not end with one.
    #[must_use]
    pub fn of_namespace(namespace: &str) -> Self {
        let namespace = namespace.trim_end_matches('/');
        Self { imu: format!("{namespace}/imu/data_raw"), temperature: format!("{namespace}/imu/temperature") }
    }

    /// All of them.
    pub(crate) fn all(self) -> [String; 2] {
        [self.imu, self.temperature]
    }
}

/// The name of an IMU as ROS 2 can have it: letters, digits and underscores, no digit first.
pub(crate) fn name_of(imu: &ImuId) -> String {
    let name = imu.as_str().replace('-', "_");
    if name.starts_with(|first: char| first.is_ascii_digit()) { format!("_{name}") } else { name }
}

/// Why this is no absolute name of a topic or namespace.
pub(crate) fn fault(name: &str) -> Option<&'static str> {
    if name == "/" {
        return None;
    }
    let Some(parts) = name.strip_prefix('/') else {
        return Some("does not begin with /; give the whole name, such as \"/driver/imu/data_raw\"");
    };
    let is_part = |part: &str| {
        let is_letter = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
        !part.is_empty() && part.chars().all(is_letter) && !part.starts_with(|first: char| first.is_ascii_digit())
    };
    let is_right = parts.split('/').all(is_part) && !name.contains("__");
    (!is_right)
        .then_some("has a part that is empty, begins with a digit, or has other than letters, digits and single _")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_ros_allows() {
        for right in ["/", "/a", "/imu_a/imu/data_raw", "/A1/_b2"] {
            assert_eq!(fault(right), None, "{right}");
        }
        for wrong in ["", "a", "a/b", "/a/", "//a", "/1a", "/a-b", "/a b", "/a__b", "/ä", "~/a", "/{node}"] {
            assert!(fault(wrong).is_some(), "{wrong}");
        }
        assert_eq!(name_of(&"imu-a".parse().unwrap()), "imu_a");
        assert_eq!(name_of(&"3dm".parse().unwrap()), "_3dm");
        assert_eq!(OutputTopics::of_namespace("/").imu, "/imu/data_raw");
        assert_eq!(OutputTopics::of_namespace("/left").temperature, "/left/imu/temperature");
    }
}
