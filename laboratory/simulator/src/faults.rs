//! Faults on demand: DIR/faults, a line each, read again whenever the file changes.
//!
//! `WHAT[:WHO][@WHEN]`: garbled, late, missing, duplicated, na, alarm, port-loss, no-settle, overshoot, never-there; `chamber` or
//! `table`, both unless given; `@3` the third request, `@3-5` the third to the fifth, `@100s-200s` simulated seconds, always unless
//! given. Requests are counted from when the file was read.

use super::Part;
use isotherm_files::Identity;
use std::fs;
use std::io::{self, Write as _};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The file that faults are written into, in a station's folder.
pub const FAULTS: &str = "faults";

/// What goes wrong.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum What {
    /// Bytes of a reply are destroyed.
    Garbled,
    /// A reply comes after the time-out.
    Late,
    /// A reply does not come.
    Missing,
    /// A reply comes twice.
    Duplicated,
    /// A request is refused, where the protocol has a way to say so, else unanswered.
    Na,
    /// The machine has an alarm: the chamber stops heating and cooling, the table stops and opens its interlocks.
    Alarm,
    /// The port is gone.
    PortLoss,
    /// The table swings.
    NoSettle,
    /// The chamber goes beyond its set point first.
    Overshoot,
    /// The chamber stays short of its set point.
    NeverThere,
}

impl What {
    /// Every fault with its name.
    pub const NAMES: [(Self, &'static str); 10] = [
        (Self::Garbled, "garbled"),
        (Self::Late, "late"),
        (Self::Missing, "missing"),
        (Self::Duplicated, "duplicated"),
        (Self::Na, "na"),
        (Self::Alarm, "alarm"),
        (Self::PortLoss, "port-loss"),
        (Self::NoSettle, "no-settle"),
        (Self::Overshoot, "overshoot"),
        (Self::NeverThere, "never-there"),
    ];
}

/// When it goes wrong.
#[derive(Clone, Debug, PartialEq)]
enum When {
    Always,
    Requests(RangeInclusive<u64>),
    Seconds(RangeInclusive<f64>),
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Injection {
    what: What,
    who: Option<Part>,
    when: When,
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let (rest, when) = line.split_once('@').map_or((line, None), |(rest, when)| (rest, Some(when)));
        let (what, who) = rest.split_once(':').map_or((rest, None), |(what, who)| (what, Some(who)));
        let names = || What::NAMES.map(|(_, name)| name).join(", ");
        let what = What::NAMES.iter().find(|(_, name)| *name == what);
        let (what, _) = *what.ok_or_else(|| format!("give one of {}", names()))?;
        let who = match who {
            None => None,
            Some("chamber") => Some(Part::Chamber),
            Some("table") => Some(Part::Turntable),
            Some(_) => return Err("after the colon give chamber or table".to_owned()),
        };
        let wrong = "after the @ give a request as 3, requests as 3-5, or seconds as 100s-200s";
        let when = when.map_or(Some(When::Always), when_of).ok_or(wrong)?;
        Ok(Self { what, who, when })
    }
}

fn when_of(text: &str) -> Option<When> {
    let (from, to) = text.split_once('-').unwrap_or((text, text));
    if let (Some(from), Some(to)) = (from.strip_suffix('s'), to.strip_suffix('s')) {
        let (from, to): (f64, f64) = (from.parse().ok()?, to.parse().ok()?);
        return (from <= to).then_some(When::Seconds(from..=to));
    }
    let (from, to) = (from.parse().ok()?, to.parse().ok()?);
    (1 <= from && from <= to).then_some(When::Requests(from..=to))
}

/// The faults of one machine.
pub struct Faults {
    path: PathBuf,
    read: Option<Identity>,
    who: Part,
    injections: Vec<Injection>,
    /// Requests since the file was read.
    requests: u64,
}

impl Faults {
    /// Those of `who` in the station's folder.
    pub fn new(folder: &Path, who: Part) -> Self {
        Self { path: folder.join(FAULTS), read: None, who, injections: Vec::new(), requests: 0 }
    }

    /// Counts a request.
    pub fn count(&mut self) {
        self.look();
        self.requests += 1;
    }

    /// What goes wrong at `now_s` and with the latest request.
    pub fn active(&mut self, now_s: f64) -> Vec<What> {
        self.look();
        let mine = self.injections.iter().filter(|injection| injection.who.is_none_or(|who| who == self.who));
        let now = mine.filter(|injection| match &injection.when {
            When::Always => true,
            When::Requests(range) => range.contains(&self.requests),
            When::Seconds(range) => range.contains(&now_s),
        });
        now.map(|injection| injection.what).collect()
    }

    /// Reads the file again if it is another. A line that is wrong is told of and passed over: the station goes on.
    fn look(&mut self) {
        let now = Identity::of(&self.path);
        if now != self.read {
            self.read = now;
            let text = fs::read_to_string(&self.path).unwrap_or_default();
            self.injections.clear();
            for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
                match line.trim().parse() {
                    Ok(injection) => self.injections.push(injection),
                    // Told once, though both machines read it.
                    Err(wrong) if self.who == Part::Chamber => {
                        let path = self.path.display();
                        let _ = writeln!(
                            io::stderr(),
                            "isotherm: the simulated station: {path}:{number}: {line:?}: {wrong}"
                        );
                    }
                    Err(_) => {}
                }
            }
            self.requests = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_who_and_when() {
        let parse = |line: &str| line.parse::<Injection>();
        let (what, who) = (What::Late, Some(Part::Turntable));
        assert_eq!(parse("late:table@3-5"), Ok(Injection { what, who, when: When::Requests(3..=5) }));
        assert_eq!(parse("late:table@7"), Ok(Injection { what, who, when: When::Requests(7..=7) }));
        let when = When::Seconds(100.0..=2e3);
        assert_eq!(parse("port-loss@100s-2000s"), Ok(Injection { what: What::PortLoss, who: None, when }));
        for wrong in ["", "lost", "late:imu", "late@0", "late@5-3", "late@1s-2", "late@", "late:table@x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn requests_count_from_when_the_file_was_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut faults = Faults::new(folder.path(), Part::Chamber);
        faults.count();
        assert_eq!(faults.active(0.0), []);
        fs::write(folder.path().join(FAULTS), "late@2\nna:table\nalarm:chamber@5s-6s\nnonsense\n").unwrap();
        faults.count();
        assert_eq!(faults.active(5.5), [What::Alarm]);
        faults.count();
        assert_eq!(faults.active(0.0), [What::Late]);
        fs::remove_file(folder.path().join(FAULTS)).unwrap();
        assert_eq!(faults.active(5.5), []);
    }
}
