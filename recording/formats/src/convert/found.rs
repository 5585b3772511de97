//! A column of a text for which a mapping is proposed: its name and its first values.

use super::heading::ColumnHeading;
use super::{calendar, interval, unit};

/// Times since 1970 that recordings have \[s\]: from 2001 to 2100.
const EPOCH_S: std::ops::Range<f64> = 1e9..4.1e9;
/// How far a time may be off the rate that the text says.
const OFF: f64 = 0.05;

/// A column of the text.
pub(super) struct ProposedColumn {
    pub(super) heading: ColumnHeading,
    pub(super) values: Vec<f64>,
    pub(super) is_whole: bool,
    /// The times \[ns\] while all fields are times of ISO 8601.
    pub(super) times: Option<Vec<u64>>,
}

/// The unit of a time, its length \[s\], and where it comes from.
pub(super) struct UnitGuess {
    pub(super) name: &'static str,
    pub(super) factor: f64,
    pub(super) guess: Option<String>,
}

impl ProposedColumn {
    pub(super) fn new(name: &str) -> Self {
        Self { heading: ColumnHeading::new(name), values: Vec::new(), is_whole: true, times: Some(Vec::new()) }
    }

    pub(super) fn take(&mut self, field: &str) {
        let value = field.replacen(',', ".", 1).parse().unwrap_or(f64::NAN);
        self.is_whole &= !field.contains([',', '.', 'e', 'E']) && value.is_finite();
        self.values.push(value);
        match (calendar::time_ns(field), &mut self.times) {
            (Some((time_ns, _)), Some(times)) => times.push(time_ns),
            _ => self.times = None,
        }
    }

    /// Whether nearly all of its fields are numbers.
    pub(super) fn is_numeric(&self) -> bool {
        let finite = self.values.iter().filter(|value| value.is_finite()).count();
        finite > 0 && finite * 10 >= self.values.len() * 9
    }

    pub(super) fn rises(&self) -> bool {
        self.values.windows(2).all(|pair| pair[0] <= pair[1]) && self.values.first() < self.values.last()
    }

    /// Whether it counts rows: whole numbers that rise by 1.
    pub(super) fn counts_rows(&self) -> bool {
        self.is_whole && self.values.len() > 2 && self.values.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
    }

    pub(super) fn is_calendar(&self) -> bool {
        self.times.as_ref().is_some_and(|times| times.len() > 1)
    }

    pub(super) fn median(&self) -> Option<f64> {
        median(self.values.iter().copied().filter(|value| value.is_finite()).collect())
    }

    pub(super) fn largest(&self) -> f64 {
        self.values.iter().filter(|value| value.is_finite()).fold(0.0, |most, value| value.abs().max(most))
    }

    /// The nominal interval, if the numbers are times in this unit \[s\].
    pub(super) fn interval_s(&self, unit: f64) -> Option<f64> {
        let times = self.values.iter().filter(|value| **value >= 0.0);
        let numbers = || times.map(|value| (value * unit * 1e9).round() as u64).collect();
        let times = self.times.clone().unwrap_or_else(numbers);
        // What jitters or comes in bursts is found from more rows.
        let shape = interval::found(&times).filter(|shape| shape.is_even)?;
        interval::rounded(&shape).map(|ns| ns as f64 / 1e9)
    }

    /// The unit of the time: of the name; or that with which the rows have the stated interval \[s\]; otherwise a guess
    /// by size.
    pub(super) fn time_unit(&self, stated_s: Option<f64>) -> UnitGuess {
        if self.times.is_some() {
            return UnitGuess { name: "iso8601", factor: 1.0, guess: None };
        }
        let of = |name: &'static str, guess| {
            let factor = unit::TIMES.iter().find(|(unit, ..)| *unit == name).map_or(1.0, |(.., factor)| *factor);
            UnitGuess { name, factor, guess }
        };
        if let Some(name) = unit::of_time(&self.heading.name) {
            return of(name, None);
        }
        let first = self.values.first().copied().unwrap_or(0.0);
        let step = self.median_step().unwrap_or(0.0);
        let fits_stated = |factor: f64| stated_s.is_some_and(|seconds| (step * factor / seconds - 1.0).abs() < OFF);
        if let Some((name, ..)) = unit::TIMES.iter().find(|(.., factor)| fits_stated(*factor)) {
            return of(name, Some("by the rate that the text says".to_owned()));
        }
        let of_epoch = |factor: f64| EPOCH_S.contains(&(first * factor)) && step * factor < 2.0;
        if let Some((name, ..)) = unit::TIMES.iter().find(|(.., factor)| of_epoch(*factor)) {
            return of(name, Some("as a time since 1970".to_owned()));
        }
        let fits = unit::TIMES.iter().rev().find(|(.., factor)| step > 0.0 && step * factor < 2.0);
        match fits {
            Some((name, _, factor)) => of(name, Some(format!("rows are {} s apart then", shown(step * factor)))),
            None => of("s", Some("nothing says it".to_owned())),
        }
    }

    fn median_step(&self) -> Option<f64> {
        let steps = self.values.windows(2).map(|pair| pair[1] - pair[0]);
        median(steps.filter(|step| *step > 0.0).collect())
    }

    pub(super) fn is_around_32768(&self) -> bool {
        let middle = self.median().unwrap_or(0.0);
        let all = self.values.iter().all(|value| (0.0..=65535.0).contains(value));
        all && (8192.0..57344.0).contains(&middle)
    }
}

/// The median length of three columns.
pub(super) fn length(columns: [&ProposedColumn; 3]) -> Option<f64> {
    let [x, y, z] = columns;
    let rows = x.values.iter().zip(&y.values).zip(&z.values);
    let lengths = rows.map(|((x, y), z)| (x * x + y * y + z * z).sqrt());
    median(lengths.filter(|length| length.is_finite()).collect())
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// A number to four digits.
pub(super) fn shown(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}
