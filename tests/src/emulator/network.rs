//! A device behind a network: datagrams, or connections that it takes.

use super::time::{FULL, LOOK, now_ns, wait, wait_to_hear};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// Sends datagrams.
pub(super) struct Datagrams {
    socket: UdpSocket,
    to: String,
}

impl Datagrams {
    pub(super) fn new(to: String) -> io::Result<Self> {
        Ok(Self { socket: UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?, to })
    }

    /// The address from which they come.
    pub(super) fn name(&self) -> io::Result<String> {
        Ok(self.socket.local_addr()?.to_string())
    }

    /// A datagram that nobody receives is sent all the same.
    pub(super) fn write(&self, bytes: &[u8]) -> usize {
        if bytes.is_empty() { 0 } else { self.socket.send_to(bytes, &self.to).unwrap_or(0) }
    }
}

/// Takes connections, one at a time.
pub(super) struct Connections {
    address: SocketAddr,
    /// Nobody can connect while there is none.
    listener: Option<TcpListener>,
    connection: Option<TcpStream>,
    /// Connections over which nothing comes any more.
    vanished: Vec<TcpStream>,
    /// When there will be a listener again \[ns\].
    away_until: u64,
}

impl Connections {
    pub(super) fn new(port: u16) -> io::Result<Self> {
        let listener = listen((Ipv4Addr::LOCALHOST, port).into())?;
        let address = listener.local_addr()?;
        Ok(Self { address, listener: Some(listener), connection: None, vanished: Vec::new(), away_until: 0 })
    }

    pub(super) fn name(&self) -> String {
        self.address.to_string()
    }

    pub(super) fn wait_for_reader(&mut self, seconds: f64, ended: &AtomicBool) -> bool {
        wait(seconds, ended, || {
            self.accept();
            self.connection.is_some()
        })
    }

    /// Takes a connection if there is none.
    fn accept(&mut self) {
        if self.listener.is_none() && now_ns() >= self.away_until {
            self.listener = listen(self.address).ok();
        }
        if self.connection.is_some() {
            return;
        }
        let accepted = self.listener.as_ref().and_then(|listener| listener.accept().ok());
        self.connection = accepted.map(|(stream, _)| stream).filter(|stream| {
            let _ = stream.set_nodelay(true);
            stream.set_nonblocking(true).is_ok()
        });
    }

    /// Ends the connection, with a word or without, and takes no other one for so long.
    pub(super) fn disconnect(&mut self, seconds: f64, closes: bool) {
        // First, so that nobody connects meanwhile.
        self.listener = None;
        self.vanished.extend(self.connection.take().filter(|_| !closes));
        self.away_until = now_ns() + (seconds * 1e9) as u64;
    }

    /// What the peer has said, for which it is waited until this moment and a little at most.
    pub(super) fn hear(&mut self, moment_ns: u64) -> Vec<u8> {
        let mut bytes = vec![0; 1024];
        let Some(stream) = &mut self.connection else {
            thread::sleep(Duration::from_nanos(moment_ns.saturating_sub(now_ns())).min(LOOK));
            return Vec::new();
        };
        let is_heard = wait_to_hear(&*stream, moment_ns);
        let count = if is_heard { stream.read(&mut bytes).unwrap_or(0) } else { 0 };
        if is_heard && count == 0 {
            self.connection = None;
        }
        bytes.truncate(count);
        bytes
    }

    pub(super) fn write(&mut self, bytes: &[u8], ended: &AtomicBool) -> usize {
        self.accept();
        let (mut taken, deadline) = (0, now_ns() + FULL.as_nanos() as u64);
        while let Some(stream) = &mut self.connection
            && taken < bytes.len()
            && !ended.load(Ordering::Relaxed)
        {
            match stream.write(&bytes[taken..]) {
                Ok(count) => taken += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock && now_ns() < deadline => {
                    thread::sleep(Duration::from_millis(1));
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => self.connection = None,
            }
        }
        taken
    }
}

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let listener = TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}
