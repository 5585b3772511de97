//! The command line of the program `isotherm-ros2`, also for its manual page.

use crate::description::{NO_SIMULATED_TIME, NodeDescription};
use clap::{CommandFactory as _, Parser};
use isotherm_acquire::{Description, MessageQueue};
use isotherm_client::ImuId;
use isotherm_documents::{LoadError, read_text};
use isotherm_files::{StagedText, Trust, refuse_overlap};
use isotherm_service::commands;
use isotherm_service::logging::LogFormat;
use isotherm_support::failure::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Publish compensated IMUs in ROS 2
///
/// Each IMU is published as sensor_msgs/Imu on /IMU/imu/data_raw, with - written as _, and its temperature on
/// /IMU/imu/temperature. The status of the service is published on /diagnostics. The node can also acquire the topics
/// of drivers as samples of IMUs. It waits if no service is running. ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE and
/// ROS_LOCALHOST_ONLY apply unless the description overrides them. Ends on SIGTERM and SIGINT.
#[derive(Debug, Parser)]
#[command(
    name = "isotherm-ros2",
    version,
    after_help = "Examples:
  isotherm-ros2 --imu imu-a
  isotherm-ros2 node.toml --domain left
  isotherm-ros2 node.toml --nominal imu-a.toml
  isotherm check node.toml"
)]
pub struct NodeArguments {
    /// Read this description of the node
    #[arg(value_name = "NODE.toml", required_unless_present = "imus")]
    pub description: Option<PathBuf>,
    /// Publish this IMU with default settings
    ///
    /// Can be repeated. Takes the place of a description
    #[arg(long = "imu", value_name = "ID", conflicts_with = "description")]
    imus: Vec<ImuId>,
    /// Write the nominal table and end
    ///
    /// The table is for the IMU that the description makes of a driver's topic. With it, the increments are the
    /// readings of the driver
    #[arg(long, value_name = "TABLE", requires = "description")]
    pub nominal: Option<PathBuf>,
    /// Join this domain of the service
    ///
    /// Default: the domain that ISOTHERM_DOMAIN names, or "default". ROS 2 has a domain of its own: ROS_DOMAIN_ID
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Choose the format of log lines
    #[arg(long, value_enum, default_value_t, value_name = "FORMAT")]
    pub log_format: LogFormat,
    /// Take no arguments of ROS 2
    ///
    /// Take no arguments of ROS 2 behind this option, with which its launch files end each command line. Names of
    /// topics and frames are in the description, and simulated time (use_sim_time) is not followed
    #[arg(long, value_name = "ARGUMENT", num_args = 0.., allow_hyphen_values = true)]
    ros_args: Vec<String>,
}

impl NodeArguments {
    /// The description of the node.
    ///
    /// # Errors
    /// If its file cannot be read, and everything that is wrong with it; if there are arguments of ROS 2.
    pub fn description(&self) -> Result<NodeDescription, Failure> {
        if self.ros_args.iter().any(|argument| argument != "--") {
            let all = self.ros_args.join(" ");
            let message = format!(
                "--ros-args {all}: this node takes no arguments of ROS 2; names of topics and frames are in its \
                 description, and {NO_SIMULATED_TIME}"
            );
            return Err(Failure::new(Exit::Usage, message));
        }
        let Some(path) = &self.description else {
            let mut imus = self.imus.clone();
            imus.sort();
            imus.dedup();
            if imus.len() < self.imus.len() {
                return Err(Failure::new(Exit::Usage, "an IMU is given twice with --imu; give it once"));
            }
            return Ok(NodeDescription::of_imus(&self.imus));
        };
        let (text, _) = read_text(path, Trust::Any)?;
        let description = NodeDescription::from_toml(&text, path.parent().unwrap_or(Path::new("")));
        Ok(description.map_err(|faults| LoadError::Refused { path: path.clone(), faults })?)
    }
}

/// Writes the nominal table of the only driver of a node.
///
/// # Errors
/// If there is none or another one, or the table cannot be written.
pub fn write_nominal(arguments: &NodeArguments, node: &NodeDescription, output: &Path) -> Result<(), Failure> {
    let [input] = node.inputs.as_slice() else {
        let message = format!("--nominal: {} sections [[subscribe]]; give a description with one", node.inputs.len());
        return Err(Failure::new(Exit::Usage, message));
    };
    let inputs: Vec<_> = arguments.description.iter().map(|path| (path.as_path(), "the description")).collect();
    refuse_overlap(&inputs, &[Some(output)])?;
    let description = Description::of_messages(input.samples.clone(), &MessageQueue::default());
    let table = description.nominal(Path::new("/"))?;
    StagedText::create(Some(output))?.write(&table.to_toml())?.finish()
}

/// The command line of the program, also for its manual page. `--version` prints `long_version` after the name.
#[must_use]
pub fn command(long_version: &'static str) -> clap::Command {
    commands::finish(NodeArguments::command().long_version(long_version), "isotherm-ros2")
}
