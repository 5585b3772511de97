//! What the [helper thread](crate::helper) of an acquisition does, since it may wait: looking for what cuts the
//! acquisition off, leaving, joining, reading the status.

use super::ports::AcquisitionPorts;
use crate::connect::Options;
use crate::error::ConnectError;
use crate::helper::{Helper, MovedPorts};
use crate::loss::{Loss, OwnObjects};
use crate::peers::is_alive;
use crate::status::fetch_status;
use crate::warning::warn;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::status::ServiceStatus;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Pause between two attempts to join the streams anew.
const JOIN_PAUSE: Duration = Duration::from_millis(20);

/// What the helper thread is asked for.
#[derive(Debug)]
pub(super) enum Question {
    /// What has cut the ports off. `silence` is there if it has been long, with the node of the service: one that lives
    /// should have answered.
    Loss { objects: Arc<OwnObjects>, silence: Option<(Duration, u128)> },
    /// To give these ports up, and to join the streams anew as soon as a service is there.
    Ports(Option<MovedPorts<AcquisitionPorts>>),
    /// The status of the service.
    Status,
}

/// What it answers.
#[derive(Debug)]
pub(super) enum Answer {
    /// Whether the ports are cut off.
    Loss(bool),
    /// `None` if the acquisition is closing.
    Ports(Option<MovedPorts<AcquisitionPorts>>),
    /// `None` if it cannot be read.
    Status(Option<Box<ServiceStatus>>),
}

/// Starts the helper thread of an acquisition.
pub(super) fn start_helper(imu: &ImuId, domain: &Domain) -> Result<Helper<Question, Answer>, ConnectError> {
    let (imu, domain) = (imu.clone(), domain.clone());
    let helper = Helper::start(move |question, is_closing: &dyn Fn() -> bool| match question {
        Question::Loss { objects, silence } => Answer::Loss(is_cut_off(&imu, &domain, &objects, silence)),
        Question::Ports(old) => {
            drop(old);
            Answer::Ports(join(&imu, &domain, is_closing).map(MovedPorts::new))
        }
        Question::Status => {
            let status = fetch_status(&Options::new(domain.clone(), Duration::ZERO));
            Answer::Status(status.ok().map(Box::new))
        }
    });
    helper.map_err(|error| ConnectError::Exhausted(format!("starting the helper thread of an acquisition: {error}")))
}

fn is_cut_off(imu: &ImuId, domain: &Domain, objects: &OwnObjects, silence: Option<(Duration, u128)>) -> bool {
    let silent = || silence.filter(|(_, node)| is_alive(domain, *node)).map(|(silence, _)| Loss::Silence(silence));
    let loss = objects.loss(domain).or_else(silent);
    if let Some(loss) = &loss {
        warn(imu, format_args!("cut off from the service: {loss}; joining the streams again"));
    }
    loss.is_some()
}

fn join(imu: &ImuId, domain: &Domain, is_closing: &dyn Fn() -> bool) -> Option<AcquisitionPorts> {
    let (mut node, mut last_cause) = (None, String::new());
    while !is_closing() {
        match AcquisitionPorts::attach(&mut node, domain, imu) {
            Ok(ports) => {
                // Here, so that the first sample has nothing to connect.
                ports.connect();
                warn(imu, "the streams are joined again");
                return Some(ports);
            }
            Err(error) => {
                let cause = error.to_string();
                if cause != last_cause {
                    warn(imu, format_args!("joining the streams again: {cause}"));
                }
                last_cause = cause;
            }
        }
        thread::sleep(JOIN_PAUSE);
    }
    None
}
