//! `isotherm-exporter`: its metrics are those of the list, and it waits for a service.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};

/// Dashboards and alert rules of users have these names: kind, name, labels and help of each, in the order of the page.
#[test]
fn the_metrics_are_those_of_the_list() {
    let metrics = isotherm_exporter::metrics();
    let lines =
        metrics.map(|metric| format!("{} {} [{}] {}", metric.kind, metric.name, metric.labels.join(", "), metric.help));
    let listed: Vec<_> = include_str!("data/metrics.txt").lines().collect();
    assert_eq!(lines.collect::<Vec<_>>(), listed);
}

fn exporter(root: &std::path::Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm-exporter"));
    command.args(arguments).env("ISOTHERM_DOMAIN", "exporter-test").env("ISOTHERM_ROOT", root);
    command.env_remove("ISOTHERM_LOG").stderr(Stdio::piped());
    command
}

#[test]
fn without_a_service_it_waits_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = exporter(folder.path(), &["--listen", "127.0.0.1:0"]).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let begun = lines.find(|line| line.contains("metrics at http://")).unwrap();
    let address = begun.split("http://").nth(1).unwrap().split('/').next().unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    assert!(lines.any(|line| line.contains("waiting for the service")));
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(folder.path().read_dir().unwrap().count(), 0);
}

#[test]
fn a_port_that_is_taken_ends_it_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = exporter(folder.path(), &["--listen", &address]).output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(74), "{told}");
    assert!(told.contains(&address) && told.contains("give a free port"), "{told}");
}
