//! The protocol between acquisition, service and readers, as values without ports, threads and clocks. The ports of the
//! client library and of the service call them; the tests of this module explore them in every order of steps and
//! faults.
//!
//! # Rules
//! **Sequences.** An acquisition has a session, a random number. Within a session the sequence rises, from any number
//! on; a step over 1 is a gap. Session and sequence name a sample for ever. A sample that is sent again is unchanged.
//!
//! **Numbers.** A sample gets its sequence when it is loaned: one above the highest that was loaned or sent in the
//! session. A sample that is then not sent leaves its number out, so **a control period that is dropped is a gap by
//! itself**. A full queue changes nothing: the sample keeps its number. What was never measured, or was merged into an
//! earlier sample, is cancelled, which takes the number of the last loan back, and of no other.
//!
//! **What waits** in the acquisition's own memory keeps its number, and is sent before all that is loaned later. A
//! period that is added to one that waits is cancelled, if its loan is the last, and otherwise waits by itself. A sum
//! that is dropped leaves out as many numbers as it has periods ([`AcquisitionState::leave_out`]).
//!
//! **Acquisition** ([`AcquisitionState`]). It keeps a copy of each sample until its answer leaves. Answers leave once,
//! in the order of sending: one that comes early waits. At most `depth` samples are in flight. Samples are sent again,
//! oldest first:
//!
//! - All that are in flight, when the publisher of the increments is another one than before: the service is a new one.
//!   Also those whose answers wait for an earlier answer: the new service has not seen them, and would report a gap.
//! - All that are in flight, when a later sample has its answer and an earlier one has not. The service answers in
//!   order, so the earlier one, or its answer, is lost.
//! - The newest, when no answer has come for a second; again after two seconds more, then four. If it gets an answer,
//!   the samples before it are overtaken, and the rule above holds.
//!
//! So **every resend ends with the newest sample and leaves none out before it**. Whenever a new service joins, also in
//! the middle of a resend that was meant for its predecessor, the highest sequence that it has seen is followed by the
//! next one.
//!
//! **The service's queue** has room for each sample in flight twice, and for a few more ([`queue_depth`]). The
//! acquisition counts the surplus that it may have put there: what was sent again, and sends that failed. The service
//! takes in order, so an answer shows that it has taken everything that was sent before its sample was first sent.
//! While the queue might overflow, a sample is handed back ([`Refusal::Full`]). So a queue that works loses nothing.
//!
//! **Service** ([`SequenceTracker`]). It answers what comes, in order, also what comes again. A sequence more than 1
//! above the highest of the session is a gap; a lower one is a repeat, never a gap. The first sample of a session that
//! it sees begins anywhere, so a new service reports no gap before it. It knows the last four sessions, so that samples
//! of an earlier one that come late, or again, are counted right. The first sample of a session that follows another
//! one is flagged. A service notes which session it has served last, for the next one, which goes on from there: it
//! flags a session that is another one, and not that one. Only a service that is killed before it has noted a new
//! session leaves the one before, so that the new one is flagged again; and if it was the first of all, the next
//! session is not flagged if the acquisition has died as well.
//!
//! **Reader** ([`ReaderState`]). It returns each session and sequence once, within a window of 1024 sequences and 4
//! sessions. It may come at any time, and its queue loses the oldest increments if it does not read.
//!
//! # What holds
//! - Each sample is answered once and in order, or handed back, or its user learns that the send has failed.
//! - No control period gets the number of one that was dropped, and no two samples on loan have the same.
//! - A gap is reported only before a sample of whose predecessors a fault, or the user, has left one out.
//! - A reader returns each sample once.
//! - The first increment of each session but the first of all has the flag, and no other increment has, but for the
//!   services that were killed before they had noted the session.
//! - When faults stop, every sample gets its answer, and the next one can be sent.
//!
//! The search (`search.rs`, with the queues and faults of `world.rs`) checks this in every state of small worlds, and
//! shows for each rule above what goes wrong without it. It does not cover a resend that the transport breaks off with
//! an error, which the user gets.

mod acquisition;
mod pending;
mod reader;
#[cfg(test)]
mod search;
mod service;
#[cfg(test)]
mod world;

pub use acquisition::{AcquisitionState, Refusal, Resend, depth_in_flight, queue_depth};
pub use reader::ReaderState;
pub use service::{Arrival, LastSession, SequenceTracker, SessionChange};
