//! An emulated IMU behind a pseudo-terminal or a network, for the tests of `isotherm acquire`. It prints the terminal's
//! path or its address, waits until a program has opened it, and sends frames in absolute time. Without a reader frames
//! are lost, as on a wire. A new emulator with the same link stands for a device that comes back.
#![allow(clippy::print_stderr, clippy::print_stdout, reason = "a program for tests")]

use isotherm_tests::emulator::arguments::USAGE;
use isotherm_tests::emulator::device::Device;
use isotherm_tests::emulator::output::Output;
use isotherm_tests::emulator::plan::Plan;
use isotherm_tests::emulator::time::now_ns;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{env, fs};

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let plan = match Plan::parse(&arguments) {
        Ok(plan) => plan,
        Err(reason) => {
            eprintln!("{reason}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    match run(plan) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("emulator: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(plan: Plan) -> io::Result<()> {
    let ended = Arc::<AtomicBool>::default();
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&ended))?;
    }
    let mut output = Output::new(&plan.place)?;
    println!("{}", output.name()?);
    io::stdout().flush()?;
    if !output.wait_for_reader(plan.wait_s, &ended) {
        return if ended.load(Ordering::Relaxed) { Ok(()) } else { Err(io::Error::other("nobody opened it")) };
    }
    let path = plan.log.clone();
    let log = send(plan, &mut output, &ended);
    output.drain(&ended);
    match path {
        Some(path) => fs::write(path, log),
        None => Ok(()),
    }
}

/// Sends all frames, or as many as there were before the signal. Returns the log.
fn send(mut plan: Plan, output: &mut Output, ended: &AtomicBool) -> String {
    let mut device = Device::new(&plan);
    let mut log = String::new();
    let mut lost = 0;
    let start = now_ns();
    for place in plan.numbers() {
        let number = plan.in_place_of(place);
        let moment = start + plan.written_ns(number);
        while now_ns() < moment && !ended.load(Ordering::Relaxed) {
            let answer = device.hear(&output.hear(moment, ended));
            output.write(&answer, ended);
        }
        if let Some(rate) = device.take_rate() {
            plan.change_rate.push((number, rate));
        }
        if plan.reset.contains(&number) {
            device.reset();
        }
        let bytes = device.frame(plan.bytes(number));
        if ended.load(Ordering::Relaxed) {
            break;
        }
        for (_, seconds, closes) in plan.disconnect.iter().filter(|(frame, ..)| *frame == number) {
            output.disconnect(*seconds, *closes);
        }
        let written = now_ns();
        lost += bytes.len() - output.write(&bytes, ended);
        if plan.log.is_some() && !plan.drop.contains(&number) && !bytes.is_empty() {
            let _ = writeln!(log, "{number} {written} {}", start + plan.due_ns(number));
        }
    }
    if lost > 0 {
        eprintln!("emulator: {lost} bytes were not taken");
    }
    log
}
