//! Where the bytes of an emulated device go.

use super::network::{Connections, Datagrams};
use super::plan::FrameTarget;
use super::terminal::Terminal;
use super::time::sleep_until;
use std::io;
use std::sync::atomic::AtomicBool;

/// Where the bytes of an emulated device go.
pub struct Output(Kind);

enum Kind {
    Terminal(Terminal),
    Udp(Datagrams),
    Tcp(Connections),
}

impl Output {
    /// Opens it.
    ///
    /// # Errors
    ///
    /// If the system has no terminal, or the port is another program's.
    pub fn new(place: &FrameTarget) -> io::Result<Self> {
        Ok(Self(match place {
            FrameTarget::Terminal(link) => Kind::Terminal(Terminal::new(link.clone())?),
            FrameTarget::Udp(to) => Kind::Udp(Datagrams::new(to.clone())?),
            FrameTarget::Tcp(port) => Kind::Tcp(Connections::new(*port)?),
        }))
    }

    /// The path of the terminal or of its link; the address to connect to, or from which datagrams come.
    ///
    /// # Errors
    ///
    /// If the system does not know it.
    pub fn name(&self) -> io::Result<String> {
        match &self.0 {
            Kind::Terminal(terminal) => Ok(terminal.name()),
            Kind::Udp(datagrams) => datagrams.name(),
            Kind::Tcp(connections) => Ok(connections.name()),
        }
    }

    /// Whether a reader came in time. Datagrams have none.
    pub fn wait_for_reader(&mut self, seconds: f64, ended: &AtomicBool) -> bool {
        match &mut self.0 {
            Kind::Terminal(terminal) => terminal.wait_for_reader(seconds, ended),
            Kind::Udp(_) => true,
            Kind::Tcp(connections) => connections.wait_for_reader(seconds, ended),
        }
    }

    /// What was said to the device until this moment, for which it waits. Returns early if there is something.
    pub fn hear(&mut self, moment_ns: u64, ended: &AtomicBool) -> Vec<u8> {
        match &mut self.0 {
            Kind::Terminal(terminal) => terminal.hear(moment_ns),
            Kind::Udp(_) => {
                sleep_until(moment_ns, ended);
                Vec::new()
            }
            Kind::Tcp(connections) => connections.hear(moment_ns),
        }
    }

    /// Writes, and returns how many bytes were taken: none without a reader.
    pub fn write(&mut self, bytes: &[u8], ended: &AtomicBool) -> usize {
        match &mut self.0 {
            Kind::Terminal(terminal) => terminal.write(bytes, ended),
            Kind::Udp(datagrams) => datagrams.write(bytes),
            Kind::Tcp(connections) => connections.write(bytes, ended),
        }
    }

    /// Ends a connection, with a word or without, and takes no other one for so many seconds.
    pub fn disconnect(&mut self, seconds: f64, closes: bool) {
        if let Kind::Tcp(connections) = &mut self.0 {
            connections.disconnect(seconds, closes);
        }
    }

    /// Waits until what was written is read, as far as its end would lose it.
    pub fn drain(&self, ended: &AtomicBool) {
        match &self.0 {
            Kind::Terminal(terminal) => terminal.drain(ended),
            Kind::Udp(_) => {}
            Kind::Tcp(_) => sleep_until(super::time::now_ns() + 100_000_000, ended),
        }
    }
}
