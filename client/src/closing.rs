//! What an acquisition had lost when it closed. A file in the domain's folder informs the service, which may be away
//! just then.

use crate::clock::unix_s;
use crate::objects::Note;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::status::ClosedStatus;
use std::io;

/// What an [`Acquisition`](crate::Acquisition) had lost when it closed. Nothing was lost if both are 0.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct ClosingNote {
    /// Control periods, of all its sessions, that have a sequence and were not sent: loans that were dropped, sequences
    /// that were left out, samples whose sending has failed, and of what was kept each period.
    pub lost: u64,
    /// Samples that were sent and whose increments were not received. Other readers may have them.
    pub unanswered: u64,
}

fn note(domain: &Domain, imu: &ImuId) -> Note {
    Note::new(domain, &format!("closed-{imu}.json"))
}

/// Writes it down.
pub(crate) fn write(domain: &Domain, imu: &ImuId, session: u64, closing: ClosingNote) -> io::Result<()> {
    let ClosingNote { lost, unanswered } = closing;
    let status = ClosedStatus { session: format!("{session:016x}"), lost, unanswered, unix_s: unix_s() };
    note(domain, imu).write(&serde_json::to_vec(&status)?)
}

/// What the last acquisition of `imu` that closed with a loss had lost; `None` if there was none.
#[must_use]
pub fn last_closing(domain: &Domain, imu: &ImuId) -> Option<ClosedStatus> {
    serde_json::from_slice(&note(domain, imu).read()?).ok()
}
