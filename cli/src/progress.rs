//! Progress bars. They go to stderr, and only if it is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A bar over the bytes of files, with a message. It is hidden if one of them is stdin or not a regular file.
pub(crate) fn bytes_bar(paths: &[PathBuf], message: &'static str) -> ProgressBar {
    bar_over(paths, "{msg} {bar:40} {bytes} of {total_bytes}, {eta} left").with_message(message)
}

/// A bar over the bytes of a recording that is sent, with elapsed and remaining time.
pub(crate) fn playing_bar(paths: &[PathBuf]) -> ProgressBar {
    bar_over(paths, "{bar:40} {percent:>3} %  {elapsed} elapsed, {eta} left")
}

/// A bar over a number of rows.
pub(crate) fn rows_bar(count: u64) -> ProgressBar {
    styled(ProgressBar::new(count), "{bar:40} {percent:>3} %  {elapsed} elapsed, {eta} left")
}

/// A spinner during long work whose duration is unknown.
pub(crate) fn spinner(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10)).with_message(message);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

fn bar_over(paths: &[PathBuf], template: &str) -> ProgressBar {
    let size = |path: &PathBuf| {
        let metadata = fs::metadata(path).ok().filter(|metadata| metadata.is_file() && path != Path::new("-"));
        metadata.map(|metadata| metadata.len())
    };
    match paths.iter().map(size).sum::<Option<u64>>() {
        Some(total) => {
            styled(ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(10)), template)
        }
        None => ProgressBar::hidden(),
    }
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    bar.with_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()))
}
