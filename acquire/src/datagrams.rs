//! UDP: datagrams with the time at which the kernel received them.

use crate::description::{Peer, Udp};
use isotherm_client::monotonic_ns;
use nix::sys::socket::sockopt::ReceiveTimestampns;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt};
use rustix::time::{ClockId, clock_gettime};
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};
use std::time::Duration;

/// A time of the kernel that lies further back is none: the clock was set.
const LONGEST_NS: u64 = 60_000_000_000;
/// Datagrams of others that are skipped at once.
const SKIPPED: usize = 64;

/// A bound socket.
pub(crate) struct Datagrams {
    socket: UdpSocket,
    peer: Option<Peer>,
    /// Room for the kernel's time of a datagram.
    control: Vec<u8>,
    /// When the last datagram came \[ns, monotonic clock\].
    pub(crate) received_ns: Option<u64>,
    /// Datagrams of others than the peer.
    pub(crate) strangers: u64,
}

impl Datagrams {
    pub(crate) fn open(udp: &Udp) -> io::Result<Self> {
        let socket = UdpSocket::bind(&udp.address)?;
        socket.set_nonblocking(true)?;
        // Without it a datagram has the time at which it is read.
        let _ = setsockopt(&socket, ReceiveTimestampns, &true);
        let control = nix::cmsg_space!(nix::sys::time::TimeSpec);
        Ok(Self { socket, peer: udp.peer, control, received_ns: None, strangers: 0 })
    }

    /// Receives the next datagram of the peer, without waiting.
    pub(crate) fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        for _ in 0..SKIPPED {
            let mut room = [IoSliceMut::new(buffer)];
            let descriptor = self.socket.as_raw_fd();
            let flags = MsgFlags::MSG_DONTWAIT;
            let message = recvmsg::<SockaddrStorage>(descriptor, &mut room, Some(&mut self.control), flags)?;
            let stamp = message.cmsgs()?.find_map(|control| match control {
                ControlMessageOwned::ScmTimestampns(time) => Some(Duration::from(time)),
                _ => None,
            });
            let from = message.address.and_then(|address| {
                let v4 = address.as_sockaddr_in().map(|from| SocketAddr::from((from.ip(), from.port())));
                v4.or_else(|| address.as_sockaddr_in6().map(|from| SocketAddr::from((from.ip(), from.port()))))
            });
            if self.peer.is_none_or(|peer| from.is_some_and(|from| peer.is(from))) {
                self.received_ns = stamp.and_then(monotonic);
                return Ok(message.bytes);
            }
            self.strangers += 1;
        }
        Err(io::ErrorKind::WouldBlock.into())
    }
}

impl AsFd for Datagrams {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Peer {
    fn is(self, from: SocketAddr) -> bool {
        // A socket of both families has the addresses of the older one in those of the newer.
        let ip = |ip: IpAddr| ip.to_canonical();
        ip(self.ip) == ip(from.ip()) && self.port.is_none_or(|port| port == from.port())
    }
}

/// A time of the kernel's real-time clock on the monotonic clock \[ns\]; `None` if the clock was set since.
fn monotonic(stamp: Duration) -> Option<u64> {
    let now = clock_gettime(ClockId::Realtime);
    let now = Duration::new(now.tv_sec.try_into().ok()?, now.tv_nsec.try_into().ok()?);
    let ago = u64::try_from(now.checked_sub(stamp)?.as_nanos()).ok()?;
    monotonic_ns().checked_sub(ago).filter(|_| ago < LONGEST_NS)
}
