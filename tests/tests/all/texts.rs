//! Every text that Isotherm reads, with a megabyte of something else in its place: refused at once, in few words, and
//! with little memory. A table that is replaced by a recording must not stop a service.

use isotherm_acquire::Description;
use isotherm_automation::plan::Plan;
use isotherm_autopilot::{Autopilot, Parameters};
use isotherm_client::ImuId;
use isotherm_documents::{load_table, read_text};
use isotherm_files::{Trust, source};
use isotherm_fit::TableFile;
use isotherm_pipeline::{CampaignFile, no_bar};
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::read::{ImuChoice, Samples};
use isotherm_service::config::Config;
use isotherm_shared::table::MAX_TABLE_BYTES;
use isotherm_support::failure::Failure;
use isotherm_tests::{RUN, TABLE, TestDomain, text};
use rustix::time::{ClockId, clock_gettime};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Size of every text: the largest that is read.
const SIZE: usize = 1 << 20;
/// Bound of the processor time for a text.
const BOUND: Duration = match cfg!(debug_assertions) {
    // The parser is optimised in this build, too (Cargo.toml). What reads its result, and every check of a number, is
    // not: that takes five times as long.
    true => Duration::from_millis(500),
    false => Duration::from_millis(100),
};
/// Most lines of the messages: a hundred faults of a file that is TOML, and the count of the others. A syntax error has
/// two lines more, and there are eight.
const MAX_MESSAGES: usize = 101;
const MAX_SYNTAX_MESSAGES: usize = 9;

fn of(piece: &str) -> Vec<u8> {
    below("", piece)
}

/// The piece, again and again, below a beginning.
fn below(begin: &str, piece: &str) -> Vec<u8> {
    format!("{begin}{}", piece.repeat((SIZE - begin.len()) / piece.len())).into_bytes()
}

/// Lines or values with a number that grows.
fn numbered(begin: &str, piece: impl Fn(usize) -> String) -> Vec<u8> {
    let mut text = begin.to_owned();
    for index in 0.. {
        let next = piece(index);
        if text.len() + next.len() > SIZE {
            break;
        }
        text.push_str(&next);
    }
    text.into_bytes()
}

/// Bytes without meaning, the same in every run; `alphabet` is what they are taken from.
fn random(alphabet: impl Fn(u64) -> u8) -> Vec<u8> {
    let mut state = 88_172_645_463_325_252_u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    (0..SIZE).map(|_| alphabet(next())).collect()
}

/// A megabyte of each kind of text that is in the wrong place, or meant to do harm.
pub(crate) fn generators() -> Vec<(&'static str, Vec<u8>)> {
    const MARKS: &[u8] = b"ab=[]{}\"'#.,\n 1-_\\\r\t";
    let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<_>>();
    let deep = |open: &str, close: &str| {
        let depth = (SIZE - 3) / (open.len() + close.len());
        format!("a={}{}\n", open.repeat(depth), close.repeat(depth)).into_bytes()
    };
    let recording = fs::read_to_string(RUN).unwrap();
    let rows: String = recording.lines().skip(1).take(100).fold(String::new(), |text, row| text + row + "\n");
    vec![
        ("letters in numbers", of("x1 = 1O1\n")),
        ("equals signs", of("=")),
        ("lines of equals signs", of("=\n")),
        ("quotes", of("\"")),
        ("lines of quotes", of("'\n")),
        ("brackets", of("[")),
        ("lines of brackets", of("[]\n")),
        ("dots", of(".")),
        ("a recording", below(recording.lines().next().unwrap(), &format!("\n{rows}"))),
        ("a recording under a title", below("Afternoon of the 3rd, at the window\n", &rows)),
        ("a recording under a comment", below("# Afternoon\n", &rows)),
        ("a recording without a header", of(&rows)),
        ("NMEA", of("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")),
        ("JSON", of("{\"imu\": [1, 2, {\"bias\": null}], \"t\": 1.5e3},\n")),
        ("UTF-16", utf16(&"format = 1\n".repeat(SIZE / 22))),
        ("ASCII with zeros", of("f\0 \0=\0 \x001\0\n\0")),
        ("zeros", vec![0; SIZE]),
        ("one line", of("x")),
        ("one line of words", of("x ")),
        ("arrays in arrays", deep("[", "]")),
        ("tables in tables", deep("{a=", "}")),
        ("arrays that do not end", below("a=", "[")),
        ("keys within keys", below("", "a.")),
        ("the same key", of("a = 1\n")),
        ("the same table", of("[a]\n")),
        ("the same table within another", of("[a.b]\n")),
        ("the same keys within keys", of("a.b.c.d=1\n")),
        ("the same inline table", of("a={b=1,c=2}\n")),
        ("an inline table of the same keys", below("a={", "b=1,")),
        ("many keys", numbered("", |index| format!("k{index}=1\n"))),
        ("many tables", numbered("", |index| format!("[t{index}]\n"))),
        ("many keys within keys", numbered("", |index| format!("a.b.c{index}=1\n"))),
        ("many inline tables", numbered("", |index| format!("t{index}={{a=1,b=[1]}}\n"))),
        ("many arrays of tables", of("[[a]]\nb=1\n")),
        ("many IMUs", numbered("", |index| format!("[[imu]]\nid=\"i{index}\"\ntable=\"t\"\n"))),
        ("many empty IMUs", of("[[imu]]\n")),
        ("many axes", of("[[axis]]\nname=\"A1\"\n")),
        ("many positions", numbered("", |index| format!("[[position]]\nnumber={index}\nspecific_force=[0,0,1]\n"))),
        ("many fields", numbered("", |index| format!("[[field]]\nname=\"f{index}\"\nat=1\n"))),
        ("many parameters", numbered("", |index| format!("TC_A0_X{index} 1.5\n"))),
        ("the same parameter", of("TC_A0_ID 1.5\n")),
        ("an array of numbers", below("a=[", "1,")),
        ("an array of tables", below("a=[", "{},")),
        ("commas", below("a=[", ",")),
        ("control characters in a comment", below("#", "\u{1}")),
        ("escapes", below("a=\"", "\\x")),
        ("underscores", below("a=1", "_")),
        ("digits", below("a=", "1")),
        ("accents", of("\u{e9}=1\n")),
        ("carriage returns", of("\r")),
        ("CRLF", of("\r\n")),
        ("lines with CRLF", of("a b\r\n")),
        ("spaces", of(" ")),
        ("comments", of("#\n")),
        ("no line end", of("format = 1 ")),
        ("random bytes", random(|word| (word >> 32) as u8)),
        ("random marks", random(|word| MARKS[(word >> 32) as usize % MARKS.len()])),
    ]
}

/// The functions by which texts are loaded. Each returns what it says of a refused one.
type Loader = (&'static str, fn(&Path) -> Result<(), String>);

fn said<T, E: ToString>(result: Result<T, E>) -> Result<(), String> {
    result.map(drop).map_err(|error| error.to_string())
}

fn text_of(path: &Path) -> Result<String, String> {
    read_text(path, Trust::Any).map(|(text, _)| text).map_err(|error| error.to_string())
}

const LOADERS: [Loader; 12] = [
    ("coefficient table", |path| said(load_table(path, ImuId::new("imu-a").as_ref(), Trust::Owned))),
    ("table of a comparison", |path| said(TableFile::from_toml("table", &text_of(path)?))),
    ("service configuration", |path| said(Config::load(path, Trust::Owned))),
    ("campaign file", |path| said(CampaignFile::read(path).and_then(|file| file.campaigns()))),
    ("campaign plan", |path| said(Plan::load(path))),
    ("plan to run", |path| said(Plan::load_to_run(path))),
    ("description of a source", |path| said(Description::load(path, Trust::Owned))),
    ("parameters of PX4", |path| said(Parameters::read(&text_of(path)?, Autopilot::Px4, None))),
    ("parameters of ArduPilot", |path| said(Parameters::read(&text_of(path)?, Autopilot::ArduPilot, None))),
    ("mapping", |path| {
        said(
            read_text(path, Trust::Any)
                .map_err(Failure::from)
                .and_then(|(text, _)| Conversion::open(&source(RUN), Some((path, &text)), &Settings::default())),
        )
    }),
    ("foreign data", |path| said(convert(path))),
    ("recording", |path| said(recording(path))),
];

fn convert(path: &Path) -> Result<(), Failure> {
    Conversion::open(&source(path), None, &Settings::default())?.try_for_each(|row| row.map(drop))
}

fn recording(path: &Path) -> Result<(), Failure> {
    Samples::open(&[source(path)], ImuChoice::Any, &no_bar(&[], ""))?.try_for_each(|row| row.map(drop))
}

/// Processor time of this thread.
fn processor_time() -> Duration {
    clock_gettime(ClockId::ThreadCPUTime).try_into().unwrap()
}

/// Lines that begin with a place, as in `file:1: `, and whether they are about syntax.
fn messages(said: &str, file: &Path) -> (usize, bool) {
    let place = format!("{}:", file.display());
    let lines = said.lines().filter(|line| line.starts_with(&place));
    (lines.count(), said.contains(": not TOML: "))
}

#[test]
fn a_megabyte_of_anything_is_refused_at_once() {
    let domain = TestDomain::new();
    let file = domain.path("text");
    let mut slow = Vec::new();
    for (kind, bytes) in generators() {
        assert!(bytes.len() <= SIZE && bytes.len() > SIZE - 10_000, "{kind}: {}", bytes.len());
        // The first 128 KiB have few enough tokens for a tree, and are no larger than a table may be.
        let sizes = [&bytes[..], &bytes[..MAX_TABLE_BYTES as usize]];
        for (bytes, (name, load)) in sizes.into_iter().flat_map(|bytes| LOADERS.map(|loader| (bytes, loader))) {
            fs::write(&file, bytes).unwrap();
            let kind = format!("{} bytes of {kind}", bytes.len());
            let begun = processor_time();
            let result = load(&file);
            let mut took = processor_time() - begun;
            if took > BOUND {
                // Another process may have emptied the caches.
                let begun = processor_time();
                drop(load(&file));
                took = took.min(processor_time() - begun);
            }
            println!("{took:>12.3?} {name}, {kind}");
            if took > BOUND {
                slow.push(format!("{name}, {kind}: {took:?}"));
            }
            let Err(said) = result else {
                assert!(["foreign data", "recording"].contains(&name), "{name} takes {kind}");
                continue;
            };
            let (messages, syntax) = messages(&said, &file);
            let most = if syntax { MAX_SYNTAX_MESSAGES } else { MAX_MESSAGES };
            assert!(messages <= most, "{name}, {kind}: {messages} messages\n{said}");
            assert!(said.len() < 64 << 10, "{name}, {kind}: {} bytes", said.len());
        }
    }
    assert!(slow.is_empty(), "over {BOUND:?}:\n{}", slow.join("\n"));
}

/// The text of a file of up to 1 MiB takes at most this much memory, with all that the program has \[kB\].
const MEMORY_KB: u64 = 200_000;

#[test]
fn a_megabyte_of_anything_takes_little_memory() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let limited = |file: &str| {
        let mut command = domain.isotherm_after(&[], &format!("ulimit -v {MEMORY_KB}"), &["check", file]);
        command.env_remove("RUST_BACKTRACE");
        domain.finish(command)
    };
    let output = limited("imu-a.toml");
    assert!(output.status.success(), "{}", text(&output.stderr));
    for (kind, bytes) in generators() {
        fs::write(domain.path("text"), &bytes).unwrap();
        let output = limited("text");
        let said = text(&output.stderr) + &text(&output.stdout);
        // `check` reads recordings, too; the rows of this one come again.
        let code = if kind == "a recording" { 65 } else { 78 };
        assert_eq!(output.status.code(), Some(code), "{kind}: {said}");
        assert!(said.contains("text:"), "{kind}: {said}");
    }
}
