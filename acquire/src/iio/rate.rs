//! The sampling frequency.

use std::collections::BTreeSet;

use super::error::{IioError, IioFault};
use super::scale::{families, number};
use super::sysfs::Folder;

/// What the frequency of a device is called, with or without `in_..._` before it.
pub(super) const FREQUENCY: &str = "sampling_frequency";
/// By how much a frequency may differ from the wanted one, relative. The measured rate is judged elsewhere, closer.
const TOLERANCE: f64 = 0.01;

/// Sets the frequency that belongs to these channels to one scan in `interval_ns`.
///
/// A trigger that has a frequency of its own (hrtimer) decides; the device's is then left unchanged. Without any the
/// device has one rate.
pub(super) fn set(
    folder: &Folder,
    trigger: Option<&Folder>,
    channels: &[String],
    interval_ns: u64,
) -> Result<(), IioError> {
    let wanted = wanted(interval_ns);
    if let Some(trigger) = trigger.filter(|trigger| trigger.has(FREQUENCY)) {
        return set_one(trigger, FREQUENCY, wanted);
    }
    let files: BTreeSet<String> = channels.iter().filter_map(|channel| file(folder, channel)).collect();
    files.iter().try_for_each(|file| set_one(folder, file, wanted))
}

/// The frequency of an interval \[Hz\]; the whole one within 100 ppm, since an interval is rounded (3000 Hz are 333333
/// ns) and drivers may take only whole numbers.
fn wanted(interval_ns: u64) -> f64 {
    let exact = 1e9 / interval_ns as f64;
    let whole = exact.round();
    if (exact / whole - 1.0).abs() < 1e-4 { whole } else { exact }
}

/// The file with the frequency of a channel: its own, of its kind, of all inputs, of the device.
fn file(folder: &Folder, channel: &str) -> Option<String> {
    let of_kind = families(channel).into_iter().map(|family| format!("in_{family}_{FREQUENCY}"));
    of_kind.chain([format!("in_{FREQUENCY}"), FREQUENCY.to_owned()]).find(|file| folder.has(file))
}

fn set_one(folder: &Folder, file: &str, wanted: f64) -> Result<(), IioError> {
    let available = folder.read(&format!("{file}_available"))?.filter(|text| !text.is_empty());
    let choice = choice(available.as_deref(), wanted);
    let refused = |cause: String, remedy: String| {
        let phase = folder.phase(&format!("setting {file} to {} Hz (timing.interval_s)", plain(wanted)));
        let cause = match &available {
            Some(available) => format!("{cause}; there are {available}"),
            None => cause,
        };
        Err(IioError::new(IioFault::Description, phase, cause, remedy))
    };
    let interval = |hz: f64| format!("give timing.interval_s = {}, or another of the device's rates", plain(1.0 / hz));
    if !agrees(choice.1, wanted) {
        return refused(format!("the nearest rate is {} Hz", plain(choice.1)), interval(choice.1));
    }
    if current(folder, file)?.is_some_and(|now| (now / choice.1 - 1.0).abs() < 1e-4) {
        return Ok(());
    }
    if let Err(error) = folder.try_write(file, &choice.0) {
        if error.raw_os_error() == Some(rustix::io::Errno::INVAL.raw_os_error()) {
            return refused("the driver refuses it".to_owned(), "give timing.interval_s of a rate it has".to_owned());
        }
        return Err(folder.failed(file, &choice.0, &error));
    }
    match current(folder, file)? {
        Some(now) if !agrees(now, wanted) => refused(format!("the device takes {} Hz", plain(now)), interval(now)),
        _ => Ok(()),
    }
}

fn agrees(hz: f64, wanted: f64) -> bool {
    (hz / wanted - 1.0).abs() <= TOLERANCE
}

fn current(folder: &Folder, file: &str) -> Result<Option<f64>, IioError> {
    let Some(text) = folder.read(file)? else { return Ok(None) };
    Ok(Some(number(folder, file, &text)?).filter(|hz| *hz > 0.0))
}

/// What to write, and its frequency: the nearest of a list, the wanted one in a range `[lowest step highest]` or where
/// nothing is said.
fn choice(available: Option<&str>, wanted: f64) -> (String, f64) {
    let free = (plain(wanted), wanted);
    let Some(available) = available else { return free };
    let rates = |text: &str| -> Vec<(String, f64)> {
        let words = text.split_ascii_whitespace();
        words.filter_map(|word| Some((word.to_owned(), word.parse().ok().filter(|hz: &f64| *hz > 0.0)?))).collect()
    };
    if let Some(range) = available.strip_prefix('[').and_then(|text| text.strip_suffix(']')) {
        return match &rates(range)[..] {
            [lowest, .., highest] => {
                let inside = wanted.clamp(lowest.1, highest.1.max(lowest.1));
                (plain(inside), inside)
            }
            _ => free,
        };
    }
    let distance = |hz: f64| (hz - wanted).abs();
    rates(available).into_iter().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1))).unwrap_or(free)
}

/// The number with at most six decimals: drivers refuse decimals where they expect a whole number.
pub(super) fn plain(number: f64) -> String {
    let text = format!("{number:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
