//! The section `[timing]`.

use super::columns::Names;
use crate::timeline::{Counter, DeviceClock};
use isotherm_shared::document::Section;

/// When rows were sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Timing {
    /// The nominal interval \[ns\].
    pub(crate) interval_ns: u64,
    /// The place of the counter in a row, and what it counts.
    pub(crate) counter: Option<(usize, Counter)>,
    /// The place of the latency in a row, and its unit \[ns\].
    pub(crate) latency: Option<(usize, f64)>,
    /// The place of the device's clock in a row, its unit \[ns\], and how it counts.
    pub(crate) clock: Option<(usize, u64, DeviceClock)>,
    /// The number of the source of pulses with which the second of that clock begins.
    pub(crate) pulses: Option<u32>,
}

const UNITS: [(u64, &str); 4] = [(1_000_000_000, "s"), (1_000_000, "ms"), (1_000, "us"), (1, "ns")];

pub(super) fn read(root: &Section<'_, '_>, names: &mut Names) -> Option<Timing> {
    let section = root.section("timing", "a section [timing]")?;
    let interval =
        section.number("interval_s", "the nominal interval of two samples in s").map(|seconds| seconds * 1e9);
    if names.are_channels() {
        section.forbid(
            &["counter", "latency", "time"],
            "is not for IIO, whose buffers have the time of each scan; leave it out",
        );
    }
    let right = interval.filter(|ns| (1e3..=3.6e12).contains(ns));
    let is_wrong = interval.is_some() && right.is_none();
    section.fault_if(is_wrong, "interval_s", "give a number of seconds from 0.000001 to 3600");
    let counter = section.optional_section("counter").and_then(|counter| {
        let column = names.of_section(&counter);
        let of_type = column.and_then(|column| names.width(column)).map(|(bits, _)| i64::from(bits));
        let bits = counter.optional_integer("bits", 1..=64).or(of_type.filter(|_| !counter.has("bits")));
        if !counter.has("bits") && bits.is_none() && !names.are_unknown() {
            counter.fault("bits", "missing; give the width of the counter, as in bits = 8 for one that turns at 256");
        }
        let step = counter.optional_integer("step", 1..=1_000_000).unwrap_or(1).cast_unsigned();
        let wider = bits.zip(of_type).filter(|(bits, of_type)| bits > of_type);
        counter.refuse(
            "bits",
            wider.map(|(bits, of_type)| format!("is {bits}, and the field has {of_type} bits; give its width")),
        );
        let bits = bits? as u32;
        let is_whole = bits == 64 || (1u64 << bits).is_multiple_of(step);
        counter.fault_if(!is_whole, "step", "give a step that divides the counter's turn");
        let is_turn = bits == 64 || 1u64 << bits > step;
        counter.fault_if(!is_turn, "bits", "give a width that holds more than one step");
        counter.finish();
        (is_whole && is_turn).then_some((column?, Counter { bits, step }))
    });
    let latency = section.optional_section("latency").and_then(|latency| {
        let column = names.of_section(&latency);
        let unit = latency.choice("unit", &UNITS);
        latency.finish();
        Some((column?, unit? as f64))
    });
    let mut pulses = None;
    let clock = section.optional_section("time").and_then(|time| {
        pulses = time.optional_integer("pps", 0..=1023).map(|number| number as u32);
        let column = names.of_section(&time);
        let unit = time.choice("unit", &UNITS);
        let of_type = column.and_then(|column| names.width(column));
        let scale = of_type.map_or(1.0, |(_, scale)| scale);
        let bits = time.optional_integer("bits", 1..=64).map(|bits| bits as u32).or(of_type.map(|(bits, _)| bits));
        time.finish();
        let unit_ns = unit?;
        let turn = bits.map(|bits| 2f64.powi(bits as i32) * scale * unit_ns as f64).filter(|turn| *turn < 1.8e19);
        Some((column?, unit_ns, DeviceClock { turn_ns: turn.map(|turn| turn.round() as u64) }))
    });
    if section.has("time") && section.has("latency") {
        section.fault("latency", "is given in addition to time, the device's own clock; leave one out");
    }
    section.finish();
    Some(Timing { interval_ns: right?.round() as u64, counter, latency, clock, pulses })
}
