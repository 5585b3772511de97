//! A web server for one page and few readers, in one thread.
//!
//! Everything a peer can make it hold is bounded: [`PEERS`] connections, [`REQUEST`] bytes of a request, one page each, and [`PATIENCE`]
//! for all of it. One connection more takes the place of the oldest: idle ones keep nobody out. Each connection gets one answer.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

/// Connections at once.
const PEERS: usize = 16;
/// Longest request.
const REQUEST: usize = 8 * 1024;
/// How long a connection may take from its beginning to its end.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often is looked whether anybody wants the server any more.
const LOOK: Duration = Duration::from_secs(1);
/// Pause after each turn, so that a flood of connections cannot have the processor for itself.
const PAUSE: Duration = Duration::from_millis(1);

/// The page's only place.
const PATH: &str = "/metrics";

/// A listener with the connections that came to it, the oldest first.
pub struct Server {
    listener: TcpListener,
    peers: Vec<Peer>,
    /// Until then nobody is let in: there were no descriptors left.
    closed_until: Instant,
}

impl Server {
    /// Of a listener.
    ///
    /// # Errors
    /// If it cannot be made not to block.
    pub fn new(listener: TcpListener) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, peers: Vec::with_capacity(PEERS), closed_until: Instant::now() })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Answers while it is `wanted`, with the `page` of the moment or, without one, that there is none.
    pub fn run(mut self, wanted: impl Fn() -> bool, page: impl Fn() -> Option<String>) {
        while wanted() {
            self.wait();
            self.accept();
            let now = Instant::now();
            self.peers.retain_mut(|peer| now < peer.deadline && peer.go_on(&page));
            thread::sleep(PAUSE);
        }
    }

    fn wait(&self) {
        let open = Instant::now() >= self.closed_until;
        let mut places: Vec<_> = self.peers.iter().map(|peer| PollFd::new(&peer.stream, peer.waits_for())).collect();
        if open {
            places.push(PollFd::new(&self.listener, PollFlags::IN));
        }
        let time = Timespec { tv_sec: LOOK.as_secs() as i64, tv_nsec: 0 };
        // Interrupted is as good as over: everybody is looked at anyway.
        let _ = poll(&mut places, Some(&time));
    }

    fn accept(&mut self) {
        // As many as there is room for, so that each gets a turn before it has to give way.
        for _ in 0..PEERS {
            match self.listener.accept() {
                Ok((stream, _)) if stream.set_nonblocking(true).is_ok() => {
                    if self.peers.len() == PEERS {
                        self.peers.remove(0);
                    }
                    self.peers.push(Peer::new(stream));
                }
                Ok(_) => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock) => return,
                Err(error) if matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::Interrupted) => {}
                Err(_) => {
                    self.closed_until = Instant::now() + LOOK;
                    return;
                }
            }
        }
    }
}

/// One connection.
struct Peer {
    stream: TcpStream,
    deadline: Instant,
    request: Vec<u8>,
    /// What is to be sent, once the request is complete.
    answer: Option<Vec<u8>>,
    sent: usize,
}

impl Peer {
    fn new(stream: TcpStream) -> Self {
        Self { stream, deadline: Instant::now() + PATIENCE, request: Vec::new(), answer: None, sent: 0 }
    }

    const fn waits_for(&self) -> PollFlags {
        if self.answer.is_some() { PollFlags::OUT } else { PollFlags::IN }
    }

    /// Reads and writes what can be without waiting. Whether there will be more to do.
    fn go_on(&mut self, page: &impl Fn() -> Option<String>) -> bool {
        match self.advance(page) {
            Ok(done) => !done,
            Err(error) => error.kind() == ErrorKind::WouldBlock,
        }
    }

    fn advance(&mut self, page: &impl Fn() -> Option<String>) -> io::Result<bool> {
        while self.answer.is_none() {
            let mut buffer = [0; 1024];
            let length = self.stream.read(&mut buffer)?;
            if length == 0 {
                return Ok(true);
            }
            self.request.extend_from_slice(&buffer[..length]);
            if is_complete(&self.request) {
                self.answer = Some(answer(&self.request, page));
            } else if self.request.len() > REQUEST {
                self.answer = Some(refusal("431 Request Header Fields Too Large", "the request is too long\n"));
            }
        }
        let answer = self.answer.as_deref().unwrap_or_default();
        while self.sent < answer.len() {
            self.sent += self.stream.write(&answer[self.sent..])?;
        }
        self.stream.shutdown(Shutdown::Write)?;
        Ok(true)
    }
}

/// An empty line ends a request's head; a body is nothing that we would want.
fn is_complete(request: &[u8]) -> bool {
    let ends = |end: &[u8]| request.windows(end.len()).any(|bytes| bytes == end);
    ends(b"\r\n\r\n") || ends(b"\n\n")
}

fn answer(request: &[u8], page: &impl Fn() -> Option<String>) -> Vec<u8> {
    let line = request.split(|&byte| byte == b'\n').next().unwrap_or_default();
    let words: Vec<_> = str::from_utf8(line).unwrap_or_default().trim_end().split(' ').collect();
    let &[method, target, version] = words.as_slice() else {
        return refusal("400 Bad Request", "this is no HTTP request\n");
    };
    if !version.starts_with("HTTP/1.") {
        return refusal("400 Bad Request", "this is no HTTP/1 request\n");
    }
    if !matches!(method, "GET" | "HEAD") {
        return response("405 Method Not Allowed", "Allow: GET, HEAD\r\n", "GET or HEAD it\n", true);
    }
    let path = target.split_once('?').map_or(target, |(path, _)| path);
    if path != PATH {
        return refusal("404 Not Found", &format!("the metrics are at {PATH}\n"));
    }
    match page() {
        // The version of the text format, not ours.
        Some(page) => {
            response("200 OK", "Content-Type: text/plain; version=0.0.4; charset=utf-8\r\n", &page, method == "GET")
        }
        None => refusal("503 Service Unavailable", "the service does not tell how it does: it starts, or hangs\n"),
    }
}

fn refusal(status: &str, body: &str) -> Vec<u8> {
    response(status, "Content-Type: text/plain; charset=utf-8\r\n", body, true)
}

fn response(status: &str, headers: &str, body: &str, with_body: bool) -> Vec<u8> {
    let length = body.len();
    let body = if with_body { body } else { "" };
    format!("HTTP/1.1 {status}\r\n{headers}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}").into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status_of(request: &[u8]) -> String {
        let answer = String::from_utf8(answer(request, &|| Some("page".to_owned()))).unwrap();
        answer.lines().next().unwrap().to_owned()
    }

    #[test]
    fn requests_of_all_sorts_are_answered() {
        for request in [
            "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n",
            "GET /metrics?x=1 HTTP/1.0\n\n",
            "HEAD /metrics HTTP/1.1\r\n\r\n",
        ] {
            assert!(is_complete(request.as_bytes()) && status_of(request.as_bytes()).ends_with("200 OK"), "{request}");
        }
        for (request, status) in [
            ("GET / HTTP/1.1\r\n\r\n", "404"),
            ("GET /metrics/x HTTP/1.1\r\n\r\n", "404"),
            ("POST /metrics HTTP/1.1\r\n\r\n", "405"),
            ("GET /metrics\r\n\r\n", "400"),
            ("GET /metrics SPDY/3\r\n\r\n", "400"),
            ("\r\n\r\n", "400"),
            ("\n\n", "400"),
        ] {
            assert!(status_of(request.as_bytes()).contains(status), "{request}: {}", status_of(request.as_bytes()));
        }
        assert!(status_of(b"\xff\xfe\0 /metrics HTTP/1.1\r\n\r\n").contains("400"));
        assert!(!is_complete(b"GET /metrics HTTP/1.1\r\n") && !is_complete(b""));
    }

    #[test]
    fn a_head_has_the_length_of_the_page_and_no_page() {
        let page = || Some("page".to_owned());
        let text = |request: &str| String::from_utf8(answer(request.as_bytes(), &page)).unwrap();
        let (get, head) = (text("GET /metrics HTTP/1.1\r\n\r\n"), text("HEAD /metrics HTTP/1.1\r\n\r\n"));
        assert!(head.contains("Content-Length: 4\r\n") && head.ends_with("\r\n\r\n"));
        assert_eq!(get, head + "page");
        assert!(String::from_utf8(answer(b"GET /metrics HTTP/1.1\r\n\r\n", &|| None)).unwrap().contains("503"));
    }
}
