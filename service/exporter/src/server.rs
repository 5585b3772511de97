//! A web server for one page and few readers, in one thread.
//!
//! The memory and the time that others can use are bounded: [`MAX_CONNECTIONS`] connections; for each of them
//! [`MAX_REQUEST`] bytes of request, one page and [`CONNECTION_TIMEOUT`]. A further connection replaces the oldest, so
//! idle ones keep nobody out. Each connection gets one answer.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

/// Most connections at the same time.
const MAX_CONNECTIONS: usize = 16;
/// Longest request \[bytes\].
const MAX_REQUEST: usize = 8 * 1024;
/// Most headers of a request.
const MAX_HEADERS: usize = 64;
/// How long a connection may last.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest turn, and how long the server accepts nobody after descriptors have run out.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Pause after each turn, so that a flood of connections cannot take the whole processor.
const PAUSE: Duration = Duration::from_millis(1);

/// The only path, the one of the page.
const PATH: &str = "/metrics";

/// A listener with its connections, the oldest first.
pub(crate) struct Server {
    listener: TcpListener,
    connections: Vec<Connection>,
    /// No connection is accepted until then, because no descriptor was left.
    closed_until: Instant,
}

impl Server {
    /// A server on this listener.
    ///
    /// # Errors
    /// If the listener cannot be made non-blocking.
    pub(crate) fn new(listener: TcpListener) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, connections: Vec::with_capacity(MAX_CONNECTIONS), closed_until: Instant::now() })
    }

    /// Waits for connections, for a second at most, and answers their requests. The answer is the current `page`, or an
    /// error status if there is none.
    pub(crate) fn turn(&mut self, mut page: impl FnMut() -> Option<String>) {
        self.wait();
        self.accept();
        let now = Instant::now();
        self.connections.retain_mut(|connection| now < connection.deadline && connection.progress(&mut page));
        thread::sleep(PAUSE);
    }

    fn wait(&self) {
        let open = Instant::now() >= self.closed_until;
        let mut places: Vec<_> = self
            .connections
            .iter()
            .map(|connection| PollFd::new(&connection.stream, connection.awaited_event()))
            .collect();
        if open {
            places.push(PollFd::new(&self.listener, PollFlags::IN));
        }
        let time = Timespec { tv_sec: CHECK_INTERVAL.as_secs() as i64, tv_nsec: 0 };
        // An error or an interruption changes nothing: all connections are served next in any case.
        let _ = poll(&mut places, Some(&time));
    }

    fn accept(&mut self) {
        // Accept at most MAX_CONNECTIONS at once, so that each is served before it can be replaced.
        for _ in 0..MAX_CONNECTIONS {
            match self.listener.accept() {
                Ok((stream, _)) if stream.set_nonblocking(true).is_ok() => {
                    if self.connections.len() == MAX_CONNECTIONS {
                        self.connections.remove(0);
                    }
                    self.connections.push(Connection::new(stream));
                }
                Ok(_) => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock) => return,
                Err(error) if matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::Interrupted) => {}
                Err(_) => {
                    self.closed_until = Instant::now() + CHECK_INTERVAL;
                    return;
                }
            }
        }
    }
}

/// One connection.
struct Connection {
    stream: TcpStream,
    deadline: Instant,
    request: Vec<u8>,
    /// The answer, once the request is complete.
    answer: Option<Vec<u8>>,
    sent: usize,
}

impl Connection {
    fn new(stream: TcpStream) -> Self {
        Self { stream, deadline: Instant::now() + CONNECTION_TIMEOUT, request: Vec::new(), answer: None, sent: 0 }
    }

    const fn awaited_event(&self) -> PollFlags {
        if self.answer.is_some() { PollFlags::OUT } else { PollFlags::IN }
    }

    /// Reads and writes as much as is possible without waiting. Returns whether the connection is still needed.
    fn progress(&mut self, page: &mut impl FnMut() -> Option<String>) -> bool {
        match self.advance(page) {
            Ok(done) => !done,
            Err(error) => error.kind() == ErrorKind::WouldBlock,
        }
    }

    fn advance(&mut self, page: &mut impl FnMut() -> Option<String>) -> io::Result<bool> {
        while self.answer.is_none() {
            let mut buffer = [0; 1024];
            let length = self.stream.read(&mut buffer)?;
            if length == 0 {
                return Ok(true);
            }
            self.request.extend_from_slice(&buffer[..length]);
            self.answer = answer(&self.request, page);
        }
        let answer = self.answer.as_deref().unwrap_or_default();
        while self.sent < answer.len() {
            self.sent += self.stream.write(&answer[self.sent..])?;
        }
        self.stream.shutdown(Shutdown::Write)?;
        Ok(true)
    }
}

/// The answer to a request; `None` if more of its head is to come. A body is ignored.
fn answer(request: &[u8], page: &mut impl FnMut() -> Option<String>) -> Option<Vec<u8>> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut head = httparse::Request::new(&mut headers);
    let complete = match head.parse(request) {
        Ok(status) => status.is_complete(),
        Err(httparse::Error::TooManyHeaders) => return Some(too_long()),
        Err(_) => return Some(refusal("400 Bad Request", "this is not an HTTP/1 request\n")),
    };
    let (true, Some(method), Some(target)) = (complete, head.method, head.path) else {
        return (request.len() > MAX_REQUEST).then(too_long);
    };
    if !matches!(method, "GET" | "HEAD") {
        return Some(response("405 Method Not Allowed", "Allow: GET, HEAD\r\n", "GET or HEAD it\n", true));
    }
    if target.split('?').next() != Some(PATH) {
        return Some(refusal("404 Not Found", &format!("the metrics are at {PATH}\n")));
    }
    Some(match page() {
        // 0.0.4 is the version of Prometheus's text format.
        Some(page) => {
            response("200 OK", "Content-Type: text/plain; version=0.0.4; charset=utf-8\r\n", &page, method == "GET")
        }
        None => refusal("503 Service Unavailable", "the service has no current status: it is starting, or hangs\n"),
    })
}

fn too_long() -> Vec<u8> {
    refusal("431 Request Header Fields Too Large", "the request is too long\n")
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

    fn text(request: &[u8]) -> String {
        String::from_utf8(answer(request, &mut || Some("page".to_owned())).unwrap()).unwrap()
    }

    #[test]
    fn every_kind_of_request_is_answered() {
        for (request, status) in [
            (&b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"[..], "200 OK"),
            (b"GET /metrics?x=1 HTTP/1.0\n\n", "200 OK"),
            (b"HEAD /metrics HTTP/1.1\r\n\r\n", "200 OK"),
            (b"GET / HTTP/1.1\r\n\r\n", "404"),
            (b"GET /metrics/x HTTP/1.1\r\n\r\n", "404"),
            (b"POST /metrics HTTP/1.1\r\n\r\n", "405"),
            (b"GET /metrics\r\n\r\n", "400"),
            (b"GET /metrics SPDY/3\r\n\r\n", "400"),
            (b"\xff\xfe\0 /metrics HTTP/1.1\r\n\r\n", "400"),
            (b"\x16\x03\x01\x00", "400"),
            (&[b"GET /metrics HTTP/1.1\r\n", "X: y\r\n".repeat(65).as_bytes()].concat(), "431"),
            (&[b"GET /metrics HTTP/1.1\r\nX: ", "y".repeat(MAX_REQUEST).as_bytes()].concat(), "431"),
        ] {
            let text = text(request);
            assert!(text.lines().next().unwrap().contains(status), "{}: {text}", request.escape_ascii());
        }
        for begun in [&b""[..], b"GET /metrics HTTP/1.1\r\n", b"GET /metr"] {
            assert_eq!(answer(begun, &mut || None), None);
        }
    }

    #[test]
    fn a_head_has_the_length_of_the_page_and_no_page() {
        let (get, head) = (text(b"GET /metrics HTTP/1.1\r\n\r\n"), text(b"HEAD /metrics HTTP/1.1\r\n\r\n"));
        assert!(head.contains("Content-Length: 4\r\n") && head.ends_with("\r\n\r\n"));
        assert_eq!(get, head + "page");
        let without = answer(b"GET /metrics HTTP/1.1\r\n\r\n", &mut || None).unwrap();
        assert!(String::from_utf8(without).unwrap().contains("503"));
    }
}
