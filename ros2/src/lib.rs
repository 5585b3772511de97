//! What Isotherm says and hears in ROS 2, without the network: the description of a node, the messages, and how
//! increments become messages and messages become readings. The program `isotherm-ros2` carries it out, in a workspace
//! of its own, since only it links the transport of ROS 2.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_ros2::NodeDescription;
//! use std::path::Path;
//!
//! let text = "format = 1\n[[publish]]\nimu = \"imu-a\"\n";
//! let description = NodeDescription::from_toml(text, Path::new(""))?;
//! assert_eq!(description.outputs[0].topics().imu, "/imu_a/imu/data_raw");
//! # Ok(())
//! # }
//! ```

mod arguments;
mod covariance;
mod description;
mod diagnostics;
mod input;
mod message;
mod network;
mod output;
mod stamps;
mod topic;

pub use arguments::{NodeArguments, command, write_nominal};
pub use covariance::{NoiseDensities, TableErrors};
pub use description::{
    Discovery, InputSettings, InvalidPolicy, NodeDescription, OutputSettings, QueueSettings, TemperatureOrigin,
};
pub use diagnostics::{OutputReport, diagnostics};
pub use input::{InputCounts, InputGate};
pub use message::{
    DIAGNOSTIC_ARRAY, DiagnosticArrayMessage, DiagnosticLevel, DiagnosticMessage, HeaderMessage, IMU, KeyValueMessage,
    QuaternionMessage, SensorImu, SensorTemperature, TEMPERATURE, TimeMessage, VectorMessage,
};
pub use network::NetworkSettings;
pub use output::{ImuComposer, OutputCounts, TemperatureOutput};
pub use stamps::{StampClock, StampState};
pub use topic::OutputTopics;
