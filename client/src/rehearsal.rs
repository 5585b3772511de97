//! Rehearsals: going through the motions of a sample before it comes, so that its way is in the caches.
//!
//! An IMU sends every few milliseconds. In between, other work takes the caches, and a sample then finds instructions
//! and data of its way cold: that is most of its latency. So a process that waits for a sample rehearses. A rehearsal
//! sends a sample through ports of its own, over a stream in which no other process has a port, and runs the same
//! functions as a real sample: an acquisition and the worker have no other way to the transport than those of
//! [`Payload`].
//!
//! A rehearsal has no effect that a peer can see. [`Rehearsal`] holds its ports and gives none of them away, so no
//! rehearsed sample can get into a real stream.

use crate::error::{ConnectError, shortage};
use crate::transport::ports::{Outgoing, Payload, Publisher, Subscriber};
use crate::transport::stream::IpcNode;
use core::fmt;

/// The ports of a process's rehearsals, at both ends of two streams: `I` is what the process receives, `O` what it
/// sends.
pub struct Rehearsal<I: Payload, O: Payload> {
    spare: Option<Outgoing<O>>,
    outgoing: Publisher<O>,
    incoming: Subscriber<I>,
    /// The other ends.
    source: Publisher<I>,
    sink: Subscriber<O>,
}

impl<I: Payload, O: Payload> Rehearsal<I, O> {
    /// Makes the streams and the ports. Only this node has them.
    ///
    /// # Errors
    /// [`ConnectError::Exhausted`] and [`ConnectError::Transport`].
    pub fn open(node: &IpcNode) -> Result<Self, ConnectError> {
        let (sender, sink) = ends::<O>(node)?;
        let (source, incoming) = ends::<I>(node)?;
        let mut rehearsal = Self { spare: O::loan(&sender).ok(), outgoing: sender, incoming, source, sink };
        // The first one makes the connections, with memory and system calls.
        rehearsal.go(&I::default(), |_, _| ());
        shortage().map_or(Ok(rehearsal), Err)
    }

    /// Goes through the motions once: receives `input`, makes the output from it, and sends that. Takes less than a
    /// microsecond in warm caches, some microseconds in cold ones; allocates nothing and makes no system call.
    ///
    /// A failure of the transport ends the rehearsal. It is no error: the next sample is only slower.
    pub fn go(&mut self, input: &I, make: impl FnOnce(&I, &mut O)) {
        let Ok(mut sample) = I::loan(&self.source) else { return };
        *sample.payload_mut() = *input;
        let _ = I::publish(sample);
        if let (Ok(Some(sample)), Some(mut spare)) = (I::receive(&self.incoming), self.spare.take()) {
            make(sample.payload(), spare.payload_mut());
            let _ = O::publish(spare);
            I::give_back(sample);
        }
        self.spare = self.spare.take().or_else(|| O::loan(&self.outgoing).ok());
        if let Ok(Some(sample)) = O::receive(&self.sink) {
            O::give_back(sample);
        }
    }
}

impl<I: Payload, O: Payload> fmt::Debug for Rehearsal<I, O> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Rehearsal").finish_non_exhaustive()
    }
}

/// Both ends of a stream that only this node has.
fn ends<T: Payload>(node: &IpcNode) -> Result<(Publisher<T>, Subscriber<T>), ConnectError> {
    let failed =
        |error: String| shortage().unwrap_or_else(|| ConnectError::transport("opening a stream of rehearsals", error));
    let stream = T::create_rehearsal(node).map_err(|error| failed(error.to_string()))?;
    let subscriber = T::subscriber(&stream, None).map_err(|error| failed(error.to_string()))?;
    let publisher = T::publisher(&stream, 2).map_err(|error| failed(error.to_string()))?;
    Ok((publisher, subscriber))
}
