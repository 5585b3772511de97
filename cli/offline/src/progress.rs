//! Progress bars. They go to stderr, and only if it is a terminal.

use crate::messages::is_shown;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use isotherm_recording::{Observer, Progress};
use isotherm_support::failure::tell;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Before this time and this share the time that is left is not shown: it would be a guess.
const GUESS: (Duration, f32) = (Duration::from_secs(5), 0.05);

/// A bar that shows the reading.
struct Bar(ProgressBar);

impl Observer for Bar {
    fn advance(&self, bytes: u64) {
        self.0.inc(bytes);
    }

    fn restart(&self) {
        self.0.set_position(0);
    }

    fn finish(&self) {
        self.0.finish_and_clear();
    }

    fn warn(&self, message: &str) {
        tell("isotherm", message);
    }
}

/// A bar over the bytes of files, with a message. It is hidden if one of them is stdin or not a regular file.
pub fn bytes_bar(paths: &[PathBuf], message: &'static str) -> Progress {
    let bar = bar_over(paths, "{msg} {bar:40} {bytes} of {total_bytes}{left}").with_message(message);
    Progress::new(Bar(bar))
}

/// A bar over the bytes of a recording that is sent, with elapsed and remaining time.
pub fn playing_bar(paths: &[PathBuf]) -> Progress {
    Progress::new(Bar(bar_over(paths, "{bar:40} {percent:>3} %  {elapsed} elapsed{left}")))
}

/// A bar over a number of rows.
pub fn rows_bar(count: u64) -> ProgressBar {
    styled(ProgressBar::with_draw_target(Some(count), target()), "{bar:40} {percent:>3} %  {elapsed} elapsed{left}")
}

/// A spinner during long work whose duration is unknown.
pub fn spinner(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, target()).with_message(message);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

fn target() -> ProgressDrawTarget {
    if is_shown() { ProgressDrawTarget::stderr_with_hz(10) } else { ProgressDrawTarget::hidden() }
}

fn bar_over(paths: &[PathBuf], template: &str) -> ProgressBar {
    let size = |path: &PathBuf| {
        let metadata = fs::metadata(path).ok().filter(|metadata| metadata.is_file() && path != Path::new("-"));
        metadata.map(|metadata| metadata.len())
    };
    match paths.iter().map(size).sum::<Option<u64>>() {
        Some(total) => styled(ProgressBar::with_draw_target(Some(total), target()), template),
        None => ProgressBar::hidden(),
    }
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.with_style(style.with_key("left", |state: &ProgressState, text: &mut dyn Write| {
        let left = left(state.elapsed(), state.fraction(), state.eta());
        // What does not fit is not shown.
        let _ = text.write_str(&left);
    }))
}

/// The time that is left, for the end of a bar.
fn left(elapsed: Duration, share: f32, left: Duration) -> String {
    let is_known = elapsed >= GUESS.0 && share >= GUESS.1;
    if is_known { format!(", {:#} left", HumanDuration(left)) } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_shown_when_it_is_no_guess() {
        let after = |seconds, share| left(Duration::from_secs(seconds), share, Duration::from_secs(90));
        assert_eq!(after(4, 0.5), "");
        assert_eq!(after(60, 0.04), "");
        assert_eq!(after(5, 0.05), ", 2m left");
    }
}
