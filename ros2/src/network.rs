//! What a node is to reach in the network: what its description says, otherwise the variables of ROS 2.

use crate::description::{Discovery, NodeDescription};

/// Where a node is to be seen.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct NetworkSettings {
    /// The domain of ROS 2.
    pub domain_id: u16,
    /// How far it is seen.
    pub discovery: Discovery,
}

impl NetworkSettings {
    /// Of a description, and of variables of the environment.
    ///
    /// ```
    /// use isotherm_ros2::{Discovery, NetworkSettings, NodeDescription};
    ///
    /// let node = NodeDescription::of_imus(&[]);
    /// let variable = |name: &str| (name == "ROS_DOMAIN_ID").then(|| "42".to_owned());
    /// let network = NetworkSettings::of(&node, variable);
    /// assert_eq!(network, Ok(NetworkSettings { domain_id: 42, discovery: Discovery::Subnet }));
    /// ```
    ///
    /// # Errors
    /// If a variable is not one that can be followed.
    pub fn of(node: &NodeDescription, variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let variable = |name: &str| variable(name).filter(|value| !value.is_empty());
        let domain_id = match (node.domain_id, variable("ROS_DOMAIN_ID")) {
            (Some(domain_id), _) => domain_id,
            (None, Some(text)) => {
                let right = text.parse().ok().filter(|domain_id| *domain_id <= 232);
                right.ok_or_else(|| format!("ROS_DOMAIN_ID is {text:?}; give 0 to 232"))?
            }
            (None, None) => 0,
        };
        // The older variable goes before the newer one, as in ROS 2.
        let discovery = match (node.discovery, variable("ROS_LOCALHOST_ONLY").as_deref()) {
            (Some(discovery), _) => discovery,
            (None, Some("1")) => Discovery::Localhost,
            (None, _) => match variable("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
                None | Some("SUBNET" | "SYSTEM_DEFAULT") => Discovery::Subnet,
                Some("LOCALHOST") => Discovery::Localhost,
                Some(other) => {
                    return Err(format!(
                        "ROS_AUTOMATIC_DISCOVERY_RANGE is {other:?}, with which no other process would find this \
                         node; give LOCALHOST or SUBNET, or discovery in [ros2]"
                    ));
                }
            },
        };
        Ok(Self { domain_id, discovery })
    }

    /// A warning about a variable of ROS 2 that is not followed, for the start.
    #[must_use]
    pub fn warning(variable: impl Fn(&str) -> Option<String>) -> Option<String> {
        let peers = variable("ROS_STATIC_PEERS").filter(|peers| !peers.is_empty())?;
        Some(format!(
            "warning: ROS_STATIC_PEERS is {peers:?}, which this node does not follow: it is found by multicast, and by a \
             peer that names this machine among its own static peers"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(variables: &[(&str, &str)], node: &NodeDescription) -> Result<(u16, Discovery), String> {
        let find = |name: &str| variables.iter().find(|(own, _)| *own == name).map(|(_, value)| (*value).to_owned());
        NetworkSettings::of(node, find).map(|network| (network.domain_id, network.discovery))
    }

    #[test]
    fn static_peers_are_not_followed_and_that_is_said() {
        let warning = |peers: Option<&str>| {
            NetworkSettings::warning(|name| peers.filter(|_| name == "ROS_STATIC_PEERS").map(str::to_owned))
        };
        assert_eq!((warning(None), warning(Some(""))), (None, None));
        assert!(warning(Some("10.0.0.7")).unwrap().contains("ROS_STATIC_PEERS is \"10.0.0.7\""));
    }

    #[test]
    fn the_variables_of_ros_count_unless_the_description_says_otherwise() {
        const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
        let node = NodeDescription::of_imus(&[]);
        assert_eq!(network(&[], &node), Ok((0, Discovery::Subnet)));
        assert_eq!(network(&[("ROS_DOMAIN_ID", ""), (RANGE, "LOCALHOST")], &node), Ok((0, Discovery::Localhost)));
        let both = [("ROS_LOCALHOST_ONLY", "1"), (RANGE, "SUBNET"), ("ROS_DOMAIN_ID", "7")];
        assert_eq!(network(&both, &node), Ok((7, Discovery::Localhost)));
        assert_eq!(network(&[("ROS_LOCALHOST_ONLY", "0"), (RANGE, "SUBNET")], &node), Ok((0, Discovery::Subnet)));
        for wrong in [("ROS_DOMAIN_ID", "233"), ("ROS_DOMAIN_ID", "-1"), (RANGE, "OFF"), (RANGE, "x")] {
            assert!(network(&[wrong], &node).is_err(), "{wrong:?}");
        }
        let own = NodeDescription { domain_id: Some(3), discovery: Some(Discovery::Localhost), ..node };
        assert_eq!(network(&[("ROS_DOMAIN_ID", "x"), (RANGE, "OFF")], &own), Ok((3, Discovery::Localhost)));
    }
}
