//! Series: the times of several paths that are measured in turns, round by round, and their ratios.

use crate::statistics::{figures, pooled_ratios, ratios};
use serde_json::{Map, Value};
use std::time::Duration;

/// What has been measured of a path.
#[derive(Default)]
pub struct PathTimes {
    /// Sorted round trips \[ns\] of each round.
    pub rounds: Vec<Vec<u32>>,
    /// Those of undisturbed turns, where turns are distinguished.
    pub undisturbed: Vec<Vec<u32>>,
    /// From the moment at which the sample was due to its answer, where samples are due \[ns\].
    pub from_due: Vec<u32>,
    /// Number of turns.
    pub turns: usize,
    /// The disturbed ones.
    pub disturbed: usize,
    /// Processor time of the service's worker while samples were counted.
    pub worker: Duration,
    /// How long they were counted.
    pub counted: Duration,
}

impl PathTimes {
    /// Figures of all round trips.
    pub fn figures(&self) -> Map<String, Value> {
        figures(self.rounds.concat())
    }

    fn begin_round(&mut self) {
        self.rounds.push(Vec::new());
        self.undisturbed.push(Vec::new());
    }

    /// Adds the round trips of a turn to those of the round.
    pub fn add(&mut self, times: &[u32], disturbed: bool) {
        self.turns += 1;
        self.disturbed += usize::from(disturbed);
        let undisturbed = self.undisturbed.last_mut().filter(|_| !disturbed);
        for round in self.rounds.last_mut().into_iter().chain(undisturbed) {
            round.extend_from_slice(times);
        }
    }

    fn sort(&mut self) {
        self.rounds.iter_mut().chain(&mut self.undisturbed).for_each(|round| round.sort_unstable());
    }
}

/// What has been measured of all paths.
#[derive(Default)]
pub struct Series {
    names: Vec<String>,
    times: Vec<PathTimes>,
}

impl Series {
    /// The paths with their names.
    pub fn paths(&self) -> impl Iterator<Item = (&String, &PathTimes)> {
        self.names.iter().zip(&self.times)
    }

    /// The sum over all paths.
    pub fn total(&self, of: impl Fn(&PathTimes) -> usize) -> usize {
        self.times.iter().map(of).sum()
    }

    /// Begins a round in which paths with these names are measured.
    pub fn begin_round(&mut self, names: impl IntoIterator<Item = String>) {
        self.names = names.into_iter().collect();
        self.times.resize_with(self.names.len(), PathTimes::default);
        self.times.iter_mut().for_each(PathTimes::begin_round);
    }

    /// The path with this number.
    pub fn path(&mut self, number: usize) -> &mut PathTimes {
        &mut self.times[number]
    }

    /// Sorts the times of all rounds, as the ratios need them.
    pub fn sort(&mut self) {
        self.times.iter_mut().for_each(PathTimes::sort);
    }

    /// Ratios of the two paths of each couple, `upper/lower`, if both have been measured.
    pub fn ratios(&self, couples: &[impl AsRef<str>]) -> Map<String, Value> {
        self.compare(couples, |upper, lower| ratios(&upper.rounds, &lower.rounds))
    }

    /// As [`ratios`](Self::ratios), of the round trips of undisturbed turns.
    pub fn undisturbed_ratios(&self, couples: &[impl AsRef<str>]) -> Map<String, Value> {
        self.compare(couples, |upper, lower| pooled_ratios(&upper.undisturbed, &lower.undisturbed))
    }

    fn compare(
        &self,
        couples: &[impl AsRef<str>],
        compared: impl Fn(&PathTimes, &PathTimes) -> Value,
    ) -> Map<String, Value> {
        let of = |name: &str| self.paths().find(|(path, _)| *path == name).map(|(_, times)| times);
        let couple = |couple: &str| {
            let (upper, lower) = couple.split_once('/')?;
            Some((couple.to_owned(), compared(of(upper)?, of(lower)?)))
        };
        couples.iter().filter_map(|names| couple(names.as_ref())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disturbed_turns_are_left_out_of_the_second_ratios_alone() {
        let mut series = Series::default();
        for _ in 0..6 {
            series.begin_round(["upper", "lower"].map(str::to_owned));
            for (path, turns) in [[(200, false), (900, true)], [(100, false), (100, false)]].iter().enumerate() {
                turns.iter().for_each(|(time, disturbed)| series.path(path).add(&[*time; 40], *disturbed));
            }
        }
        series.sort();
        let couples = ["upper/lower", "upper/not measured"];
        let ratio = |ratios: Map<String, Value>| (ratios.len(), ratios["upper/lower"]["p90"]["ratio"].as_f64());
        assert_eq!(ratio(series.ratios(&couples)), (1, Some(9.0)));
        assert_eq!(ratio(series.undisturbed_ratios(&couples)), (1, Some(2.0)));
        assert_eq!((series.total(|times| times.turns), series.total(|times| times.disturbed)), (24, 6));
    }
}
