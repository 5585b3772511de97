//! The live screen: shows the status of the service five times a second, until the user quits.
//!
//! It reads the status stream, whose queue is emptied at every tick; nothing else of the service is touched. Everything
//! that is drawn comes from a [`Model`], so that the drawing can be tested without a terminal.

mod details;
mod model;
mod numbers;
mod overview;
mod screen;
mod style;

use isotherm_client::Domain;
use isotherm_service::StatusSource;
use isotherm_support::failure::{Exit, Failure};
pub(crate) use model::STATES;
use model::{Model, TICK};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::disable_raw_mode;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use std::{io, thread};
pub(crate) use style::Theme;

/// A signal ends the process after this time, even if the screen does not end by itself.
const EXIT_DELAY: Duration = Duration::from_secs(1);

/// Shows the service of a domain until a key or a signal ends it. The terminal is left as it was, even after a panic.
///
/// # Errors
/// If the domain cannot be joined, or the terminal is gone.
pub(crate) fn run(domain: Domain, theme: Theme) -> Result<(), Failure> {
    let mut model = Model::new(domain.name(), theme);
    let mut source = StatusSource::connect(domain)?;
    let ended = end_on_signals()?;
    let shown = match ratatui::try_init() {
        Ok(mut terminal) => show(&mut terminal, &mut source, &mut model, &ended),
        Err(error) => Err(error),
    };
    ratatui::restore();
    shown.map_err(|error| Failure::new(Exit::Io, format!("drawing on the terminal: {error}")))
}

/// A flag that SIGTERM, SIGINT and SIGHUP set. [`EXIT_DELAY`] later the signal ends the process in any case: writing to
/// a blocked terminal, or reading from one that is gone, may never return.
fn end_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let failed = |error: io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(failed)?;
    let ended = Arc::<AtomicBool>::default();
    let flag = Arc::clone(&ended);
    let body = move || {
        for signal in signals.forever() {
            flag.store(true, Relaxed);
            thread::sleep(EXIT_DELAY);
            let _ = disable_raw_mode();
            let _ = low_level::emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(body).map_err(failed)?;
    Ok(ended)
}

fn show(
    terminal: &mut DefaultTerminal,
    source: &mut StatusSource,
    model: &mut Model,
    ended: &AtomicBool,
) -> io::Result<()> {
    let mut next = Instant::now();
    while !ended.load(Relaxed) {
        let now = Instant::now();
        if now >= next {
            next = now + TICK;
            let (newest, waiting) = source.poll(now);
            // While paused, everything is still read, so that the queue stays empty.
            if !model.paused {
                model.update(newest, waiting);
            }
        }
        terminal.draw(|frame| screen::draw(frame, model))?;
        if event::poll(next.saturating_duration_since(Instant::now()))? {
            match event::read()? {
                Event::Key(key) if key.kind != KeyEventKind::Release && !handle_key(model, key) => return Ok(()),
                // Other events, such as a new size, only need the next drawing.
                _ => {}
            }
        }
    }
    Ok(())
}

/// Handles a key. Returns false if it asks for the end.
fn handle_key(model: &mut Model, key: KeyEvent) -> bool {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('c') if control => return false,
        KeyCode::Esc | KeyCode::Char('q') if model.help => model.help = false,
        KeyCode::Esc | KeyCode::Char('q') => return false,
        KeyCode::Char('?' | 'h') => model.help = !model.help,
        KeyCode::Char('p' | ' ') => model.paused = !model.paused,
        KeyCode::Up | KeyCode::Char('k') => model.select_by(-1),
        KeyCode::Down | KeyCode::Char('j') => model.select_by(1),
        KeyCode::PageUp => model.select_by(-10),
        KeyCode::PageDown => model.select_by(10),
        KeyCode::Home | KeyCode::Char('g') => model.select_by(isize::MIN),
        KeyCode::End | KeyCode::Char('G') => model.select_by(isize::MAX),
        KeyCode::Tab => model.select_next(),
        KeyCode::BackTab => model.select_previous(),
        _ => {}
    }
    true
}

#[cfg(test)]
mod tests;
