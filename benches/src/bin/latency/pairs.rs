//! The paths that are measured beside each other: how they are started, how they take turns, and their ratios.
//!
//! Paths are measured in blocks, one after the other, in an order that rotates. The children that are not being
//! measured are stopped. The round trip of a pair of processes depends on the cache slices that its memory falls into:
//! it changes by a tenth. So after some blocks all processes are started again; this is a round. Ratios are taken
//! within a round.

use crate::closed;
use crate::floor::Floor;
use crate::paced::{self, Pace};
use crate::paths::{Bare, InProcess, Isotherm, Path, Rehearsed, Together};
use crate::socket::Socket;
use isotherm_benches::statistics::{figures, pooled_ratios, ratios};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, IMU, OtherBuild, cores, imu, pin};
use isotherm_client::Acquisition;
use serde_json::{Map, Value};
use std::path::PathBuf;
use std::time::Duration;

/// Queue depth of the bare pairs, and of the service where the two are compared.
pub(crate) const SHORT: usize = 2;
/// Suffix of the name of a path with the default queue depth.
pub(crate) const DEFAULT_DEPTH: &str = "_default_depth";
/// Suffix of the name of a path whose service anticipates.
pub(crate) const ANTICIPATE: &str = "_anticipate";

/// What has been measured of a path.
#[derive(Default)]
pub(crate) struct PathTimes {
    /// Sorted round trips \[ns\] of each round.
    pub rounds: Vec<Vec<u32>>,
    /// Of these, the ones of undisturbed turns, where turns are told apart.
    pub undisturbed: Vec<Vec<u32>>,
    /// From the moment at which the sample was due to its answer, where samples are due \[ns\].
    pub from_due: Vec<u32>,
    pub turns: usize,
    pub disturbed: usize,
    /// Processor time of the service's worker while samples were counted, and how long they were.
    pub worker: Duration,
    pub counted: Duration,
}

impl PathTimes {
    /// Figures of all round trips.
    pub(crate) fn figures(&self) -> Map<String, Value> {
        figures(self.rounds.concat())
    }

    fn begin_round(&mut self) {
        self.rounds.push(Vec::new());
        self.undisturbed.push(Vec::new());
    }

    /// Adds the round trips of a turn to those of the round.
    pub(crate) fn add(&mut self, times: &[u32], disturbed: bool) {
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
pub(crate) struct Series {
    names: Vec<String>,
    times: Vec<PathTimes>,
}

impl Series {
    /// The paths with their names.
    pub(crate) fn paths(&self) -> impl Iterator<Item = (&String, &PathTimes)> {
        self.names.iter().zip(&self.times)
    }

    /// The sum over all paths.
    pub(crate) fn total(&self, of: impl Fn(&PathTimes) -> usize) -> usize {
        self.times.iter().map(of).sum()
    }

    /// Ratios of the first to the second path of each couple, if both have been measured.
    pub(crate) fn ratios(&self, couples: &[(String, String)]) -> Map<String, Value> {
        self.compare(couples, |upper, lower| ratios(&upper.rounds, &lower.rounds))
    }

    /// As [`ratios`](Self::ratios), of the round trips of undisturbed turns.
    pub(crate) fn undisturbed_ratios(&self, couples: &[(String, String)]) -> Map<String, Value> {
        self.compare(couples, |upper, lower| pooled_ratios(&upper.undisturbed, &lower.undisturbed))
    }

    fn compare(
        &self,
        couples: &[(String, String)],
        compared: impl Fn(&PathTimes, &PathTimes) -> Value,
    ) -> Map<String, Value> {
        let of = |name: &String| self.paths().find(|(path, _)| *path == name).map(|(_, times)| times);
        let couple =
            |(upper, lower): &(String, String)| Some((format!("{upper}/{lower}"), compared(of(upper)?, of(lower)?)));
        couples.iter().filter_map(couple).collect()
    }
}

/// Names as owned couples.
pub(crate) fn couples(names: &[(&str, &str)]) -> Vec<(String, String)> {
    names.iter().map(|(upper, lower)| ((*upper).to_owned(), (*lower).to_owned())).collect()
}

/// Measures `KINDS` kinds of blocks in turns: `block` measures one of the kind that it is given.
pub(crate) fn alternate<const KINDS: usize>(
    rounds: usize,
    blocks: usize,
    start: impl Fn(&mut Pairs) -> BenchResult<()>,
    mut block: impl FnMut(&mut Pair, usize, &mut PathTimes) -> BenchResult<()>,
) -> BenchResult<[Series; KINDS]> {
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));
    let mut series = [(); KINDS].map(|()| Series::default());
    for round in 0..rounds {
        let mut pairs = Pairs { paths: Vec::new(), core: theirs, domains: Vec::new() };
        start(&mut pairs)?;
        for series in &mut series {
            series.names = pairs.paths.iter().map(|pair| pair.name.clone()).collect();
            series.times.resize_with(pairs.paths.len(), PathTimes::default);
            series.times.iter_mut().for_each(PathTimes::begin_round);
        }
        for turn in 0..blocks {
            for (kind, series) in series.iter_mut().enumerate() {
                for path in 0..pairs.paths.len() {
                    let path = (round + turn + path) % pairs.paths.len();
                    block(&mut pairs.paths[path], kind, &mut series.times[path])?;
                }
            }
        }
    }
    series.iter_mut().flat_map(|series| &mut series.times).for_each(PathTimes::sort);
    Ok(series)
}

/// Whether the acquisition and the process behind a path have a core each.
pub(crate) fn pinned() -> bool {
    cores().len() > 1
}

/// A path, and the process behind it, which is stopped unless it is being measured.
pub(crate) struct Pair {
    pub name: String,
    pub path: Box<dyn MeasureBlock>,
    pub peer: Option<BenchProcess>,
}

/// All paths of a round.
pub(crate) struct Pairs {
    paths: Vec<Pair>,
    /// The core of the processes behind the paths.
    core: Option<usize>,
    // The last field: the paths must be dropped before the shared memory of their domains is removed.
    domains: Vec<BenchDomain>,
}

impl Pairs {
    fn pinned(&self) -> String {
        self.core.map(|core| core.to_string()).unwrap_or_default()
    }

    pub(crate) fn add_floor(&mut self) -> BenchResult<()> {
        let pinned = self.pinned();
        self.add("floor", |domain| {
            let lines = domain.shared_memory("floor");
            let floor = Floor::create(&lines)?;
            Ok((floor, Some(domain.spawn(&["child", &pinned, "floor", &lines.to_string_lossy()])?)))
        })
    }

    /// Adds a bare pair.
    pub(crate) fn add_bare(&mut self, name: &str) -> BenchResult<()> {
        let pinned = self.pinned();
        self.add(name, |domain| {
            let echo = spawn_echo(domain, &pinned, 1)?;
            Ok((Bare::connect(domain.as_domain(), SHORT)?, Some(echo)))
        })
    }

    /// Adds a bare pair with a second one to get ready with.
    pub(crate) fn add_rehearsed(&mut self, name: &str) -> BenchResult<()> {
        let pinned = self.pinned();
        self.add(name, |domain| {
            let echo = spawn_echo(domain, &pinned, 2)?;
            Ok((Rehearsed::connect(domain.as_domain(), SHORT)?, Some(echo)))
        })
    }

    /// Adds the service: that of this build, or that of `program`.
    pub(crate) fn add_service(
        &mut self,
        name: &str,
        program: Option<&PathBuf>,
        depth: Option<usize>,
        strategy: &str,
    ) -> BenchResult<()> {
        let depth = depth.map(|depth| format!("depth = {depth}\n")).unwrap_or_default();
        let realtime = self.core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
        self.add(name, |domain| {
            let settings = format!("{depth}[wait]\nstrategy = \"{strategy}\"\n{realtime}");
            let service = domain.serve_by(program.map(PathBuf::as_path), &settings)?;
            Ok((Isotherm(Acquisition::connect(&IMU.parse()?, &domain.options())?), Some(service)))
        })
    }

    /// Adds `count` bare pairs that send together. One process answers them all.
    pub(crate) fn add_bare_together(&mut self, name: &str, count: usize) -> BenchResult<()> {
        let pinned = self.pinned();
        self.add(name, |domain| {
            let echo = spawn_echo(domain, &pinned, count)?;
            Ok((Together(Bare::connect_all(domain.as_domain(), SHORT, count)?), Some(echo)))
        })
    }

    /// Adds the service for `count` IMUs that send together.
    pub(crate) fn add_service_together(
        &mut self,
        name: &str,
        count: usize,
        workers: usize,
        strategy: &str,
    ) -> BenchResult<()> {
        // A setting of the core holds for all workers. Two workers are left to the scheduler.
        let core = self.core.filter(|_| workers == 1).map(|core| format!("[realtime]\ncore = {core}\n"));
        self.add(name, |domain| {
            let settings = format!("[wait]\nstrategy = \"{strategy}\"\n{}", core.unwrap_or_default());
            let service = domain.serve_many(count, workers, &settings)?;
            let connect = |index| Ok(Isotherm(Acquisition::connect(&imu(index).parse()?, &domain.options())?));
            Ok((Together((0..count).map(connect).collect::<BenchResult<_>>()?), Some(service)))
        })
    }

    pub(crate) fn add_socket(&mut self) -> BenchResult<()> {
        let pinned = self.pinned();
        self.add("unix_socket", |domain| {
            let path = domain.path("socket");
            let server = domain.spawn(&["child", &pinned, "socket", &path.to_string_lossy()])?;
            Ok((Socket::connect(&path)?, Some(server)))
        })
    }

    pub(crate) fn add_in_process(&mut self) -> BenchResult<()> {
        self.add("in_process", |_| Ok((InProcess::new()?, None)))
    }

    /// Starts a path in a domain of its own.
    fn add<P: Path + 'static>(
        &mut self,
        name: &str,
        start: impl FnOnce(&BenchDomain) -> BenchResult<(P, Option<BenchProcess>)>,
    ) -> BenchResult<()> {
        let domain = BenchDomain::new()?;
        let (path, peer) = start(&domain)?;
        peer.iter().for_each(BenchProcess::pause);
        self.paths.push(Pair { name: name.to_owned(), path: Box::new(path), peer });
        self.domains.push(domain);
        Ok(())
    }
}

/// Starts the other end of `pairs` bare pairs.
fn spawn_echo(domain: &BenchDomain, pinned: &str, pairs: usize) -> BenchResult<BenchProcess> {
    let (name, root) = (domain.as_domain().name(), domain.as_domain().root_path());
    domain.spawn(&["child", pinned, "echo", name, root, &SHORT.to_string(), &pairs.to_string()])
}

/// The services of all builds, this one first.
pub(crate) fn builds(others: &[OtherBuild]) -> impl Iterator<Item = (&str, Option<&PathBuf>)> {
    let own = [("isotherm", None)].into_iter();
    own.chain(others.iter().map(|build| (build.name.as_str(), Some(&build.program))))
}

/// Measures a block of a path. Only this call is dispatched dynamically; the round trips in the block are not.
pub(crate) trait MeasureBlock {
    fn closed(&mut self, peer: Option<&BenchProcess>, count: usize, times: &mut PathTimes) -> BenchResult<()>;
    fn paced(&mut self, peer: Option<&BenchProcess>, pace: &mut Pace, times: &mut PathTimes) -> BenchResult<()>;
}

impl<P: Path> MeasureBlock for P {
    fn closed(&mut self, peer: Option<&BenchProcess>, count: usize, times: &mut PathTimes) -> BenchResult<()> {
        closed::block(self, peer, count, times)
    }

    fn paced(&mut self, peer: Option<&BenchProcess>, pace: &mut Pace, times: &mut PathTimes) -> BenchResult<()> {
        paced::block(self, peer, pace, times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disturbed_turns_are_left_out_of_the_second_ratios_alone() {
        let mut series = Series { names: vec!["upper".to_owned(), "lower".to_owned()], times: Vec::new() };
        for turns in [[(200, false), (900, true)], [(100, false), (100, false)]] {
            let mut times = PathTimes::default();
            for _ in 0..6 {
                times.begin_round();
                turns.iter().for_each(|(time, disturbed)| times.add(&[*time; 40], *disturbed));
            }
            times.sort();
            series.times.push(times);
        }
        let couples = couples(&[("upper", "lower"), ("upper", "not measured")]);
        let ratio = |ratios: Map<String, Value>| (ratios.len(), ratios["upper/lower"]["p90"]["ratio"].as_f64());
        assert_eq!(ratio(series.ratios(&couples)), (1, Some(9.0)));
        assert_eq!(ratio(series.undisturbed_ratios(&couples)), (1, Some(2.0)));
        assert_eq!((series.total(|times| times.turns), series.total(|times| times.disturbed)), (24, 6));
    }
}
