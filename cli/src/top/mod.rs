//! The live screen: what the service tells, five times a second, until somebody wants no more.
//!
//! It reads the status stream and, of the IMU that is selected, the increments; both are emptied at every tick, and nothing else of the
//! service is touched. Everything that is drawn comes from a [`Model`], so that the drawing can be tried without a terminal.

mod details;
mod increments;
mod model;
mod numbers;
mod overview;
mod screen;
mod source;
mod style;

use increments::Increments;
use isotherm_client::Options;
use isotherm_failure::{Exit, Failure};
use model::Model;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::disable_raw_mode;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level;
use source::Source;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};
pub use style::Theme;

/// How often is read and drawn.
const TICK: Duration = Duration::from_millis(200);
/// How long an end that was asked for by a signal may take.
const LAST: Duration = Duration::from_secs(1);

/// Shows the service of a domain until a key or a signal ends it. The terminal is left as it was, after a panic too.
///
/// # Errors
/// If the domain cannot be joined, or the terminal is gone.
pub fn run(options: Options, look: Theme) -> Result<(), Failure> {
    let mut source = Source::connect(options.domain.clone())?;
    let ended = end_on_signals()?;
    let shown = match ratatui::try_init() {
        Ok(mut terminal) => show(&mut terminal, &mut source, options, look, &ended),
        Err(error) => Err(error),
    };
    ratatui::restore();
    shown.map_err(|error| Failure::new(Exit::Io, format!("drawing on the terminal: {error}")))
}

/// Set by a signal that asks for the end. It comes a second later even if the terminal takes nothing any more, or is gone: reading from
/// one that is gone does not return.
fn end_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let failed = |error: io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(failed)?;
    let ended = Arc::<AtomicBool>::default();
    let told = Arc::clone(&ended);
    let body = move || {
        for signal in signals.forever() {
            told.store(true, Relaxed);
            thread::sleep(LAST);
            let _ = disable_raw_mode();
            let _ = low_level::emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(body).map_err(failed)?;
    Ok(ended)
}

fn show(
    terminal: &mut DefaultTerminal,
    source: &mut Source,
    options: Options,
    look: Theme,
    ended: &AtomicBool,
) -> io::Result<()> {
    let mut model = Model::new(options.domain.name(), look);
    let mut increments = Increments::new(options);
    let mut next = Instant::now();
    while !ended.load(Relaxed) {
        let now = Instant::now();
        if now >= next {
            next = now + TICK;
            let (news, waiting) = source.look(now);
            if waiting.is_some() {
                increments.forget();
            }
            let point = increments.read(model.selected_id(), now);
            // Paused, everything is read all the same, so that nothing piles up.
            if !model.paused {
                model.take(news, waiting, point);
            }
        }
        terminal.draw(|frame| screen::draw(frame, &mut model))?;
        if event::poll(next.saturating_duration_since(Instant::now()))? {
            match event::read()? {
                Event::Key(key) if key.kind != KeyEventKind::Release && !obey(&mut model, key) => return Ok(()),
                // What else there is, a new size above all, is drawn.
                _ => {}
            }
        }
    }
    Ok(())
}

/// Does what a key asks for; false if that is to end.
fn obey(model: &mut Model, key: KeyEvent) -> bool {
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
