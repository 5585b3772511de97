//! Counts the cache lines that a sample touches on its way through client, transport and worker, and whose they are.
//!
//! An IMU sends every few milliseconds, and other work takes the caches in between: then the latency of a sample is
//! mostly the number of lines that it finds cold. This program runs itself under valgrind's tool `lackey`, which prints
//! every access to memory, in the steps of [`subject`], and counts in each step the lines that it is the first of its
//! process to touch. An instruction is of the innermost of its inlined frames that is not the standard library's; data
//! are of the code that touches them first. Client and worker are one thread, but are counted as two processes.
//!
//! Not counted: the kernel, and the usual way to read the clock, which valgrind replaces by a system call.
//!
//! Needs `valgrind` and `addr2line`, and takes some minutes. CI only tests the counting.
#![allow(clippy::print_stdout, reason = "the table is the product")]

mod subject;
mod trace;

use clap::Parser;
use isotherm_benches::{BenchResult, child_of, run};
use isotherm_client::transport::stream::RAW_DEPTH;
use std::collections::HashMap;
use std::io::{BufReader, Seek as _, Write as _};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use subject::{COUNTED, STEPS};
use trace::{Kind, Owner, Source, Trace};

/// Counts the cache lines that a sample touches
#[derive(Debug, Parser)]
struct ColdLinesArguments;

fn main() -> ExitCode {
    run(traced, |ColdLinesArguments| [2, RAW_DEPTH].into_iter().try_for_each(measure))
}

fn traced(words: &[&str]) -> BenchResult<ExitCode> {
    let ["subject", depth] = words else { return Err("unknown words".into()) };
    subject::run(depth.parse()?)?;
    Ok(ExitCode::SUCCESS)
}

/// Traces samples in queues of this depth, and prints the counts.
fn measure(depth: usize) -> BenchResult<()> {
    let mut child = child_of(Path::new("valgrind"));
    child
        // Its pipes for debuggers would stay in the temporary folder when it is killed.
        .args(["--vgdb=no", "--tool=lackey", "--trace-mem=yes"])
        .arg(std::env::current_exe()?)
        .args(["subject", &depth.to_string()]);
    let mut child = child.stderr(Stdio::piped()).spawn().map_err(|error| format!("valgrind: {error}"))?;
    let trace = Trace::read(BufReader::new(child.stderr.take().ok_or("no trace")?))?;
    if !child.wait()?.success() || trace.samples.len() != COUNTED {
        return Err(format!("{} of {COUNTED} samples were traced", trace.samples.len()).into());
    }
    println!(
        "depth {depth:2}                    data: own  iceoryx2  other   code: own  iceoryx2  other   cold: data   code"
    );
    let (counts, mut way) = (trace.count(&sources(&trace)?), [0.0; 8]);
    for ((step, after), lines) in &counts {
        let (process, name) = STEPS[*step];
        let submits = counts.contains_key(&(*step, true));
        let part = ["", ", until submitted", ", the rest"][usize::from(submits) + usize::from(*after)];
        let [[own, iceoryx2, other], code] = lines.touched;
        let figures = [own, iceoryx2, other, code[0], code[1], code[2], lines.cold[0], lines.cold[1]];
        let figures = figures.map(|count| count as f64 / COUNTED as f64);
        row(&format!("{process} {name}{part}"), figures);
        if (submits && !after) || *step == STEPS.len() - 1 {
            way.iter_mut().zip(figures).for_each(|(sum, figure)| *sum += figure);
        }
    }
    row("from send() to the answer", way);
    Ok(())
}

fn row(name: &str, [own, iceoryx2, other, code_own, code_iceoryx2, code_other, cold, code_cold]: [f64; 8]) {
    println!(
        "{name:30} {own:9.1} {iceoryx2:9.1} {other:6.1} {code_own:11.1} {code_iceoryx2:9.1} {code_other:6.1} {cold:12.1} {code_cold:6.1}"
    );
}

/// The sources of all instructions, where they are known.
fn sources(trace: &Trace) -> BenchResult<HashMap<u64, Source>> {
    let executed = trace.samples.iter().flatten().filter(|access| access.kind == Kind::Instruction);
    let mut addresses: Vec<_> = executed.filter_map(|access| access.address.checked_sub(trace.base)).collect();
    addresses.sort_unstable();
    addresses.dedup();
    let mut list = tempfile::tempfile()?;
    addresses.iter().try_for_each(|address| writeln!(list, "{address:x}"))?;
    list.rewind()?;
    let output = Command::new("addr2line").args(["-a", "-i", "-e"]).arg(std::env::current_exe()?).stdin(list).output();
    let output = output.map_err(|error| format!("addr2line: {error}"))?;
    let (mut sources, mut address) = (HashMap::new(), None);
    // An address, then file and line of its frames, the innermost first.
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        if let Some(hex) = line.strip_prefix("0x") {
            address = Some(u64::from_str_radix(hex, 16)? + trace.base);
        } else if let (Some(at), Some(owner)) = (address, owner(line)) {
            let file = line.rsplit('/').next().and_then(|file| file.split(':').next()).unwrap_or_default();
            sources.insert(at, (owner, file.to_owned()));
            address = None;
        }
    }
    Ok(sources)
}

/// Whose a source file is; `None` for the standard library's, which is inlined into the next frame.
fn owner(path: &str) -> Option<Owner> {
    match path {
        _ if path.starts_with('?') || path.contains("/rustc/") || path.contains("/library/") => None,
        _ if path.contains("/iceoryx2-") => Some(Owner::Iceoryx2),
        _ if path.contains("/registry/") => Some(Owner::Other),
        _ => Some(Owner::Isotherm),
    }
}
