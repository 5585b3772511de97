//! The paths that are measured next to each other: how they are started, how they take turns, and their ratios.
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
use isotherm_benches::{
    BenchDomain, BenchProcess, BenchResult, IMU, OtherBuild, PathTimes, Series, cores, imu, pin_apart, served_by,
};
use std::path::PathBuf;

/// Queue depth of the bare pairs, and of the service where the two are compared.
pub(crate) const SHORT: usize = 2;
/// Suffix of the name of a path with the default queue depth.
pub(crate) const DEFAULT_DEPTH: &str = "_default_depth";
/// Suffix of the name of a path whose service anticipates.
pub(crate) const ANTICIPATE: &str = "_anticipate";

/// Measures `KINDS` kinds of blocks in turns: `block` measures one of the kind that it is given.
pub(crate) fn alternate<const KINDS: usize>(
    rounds: usize,
    blocks: usize,
    start: impl Fn(&mut Pairs) -> BenchResult<()>,
    mut block: impl FnMut(&mut Pair, usize, &mut PathTimes) -> BenchResult<()>,
) -> BenchResult<[Series; KINDS]> {
    let core = pin_apart();
    let mut series = [(); KINDS].map(|()| Series::default());
    for round in 0..rounds {
        let mut pairs = Pairs { paths: Vec::new(), core, domains: Vec::new() };
        start(&mut pairs)?;
        series.iter_mut().for_each(|series| series.begin_round(pairs.paths.iter().map(|pair| pair.name.clone())));
        for turn in 0..blocks {
            for (kind, series) in series.iter_mut().enumerate() {
                for path in 0..pairs.paths.len() {
                    let path = (round + turn + path) % pairs.paths.len();
                    block(&mut pairs.paths[path], kind, series.path(path))?;
                }
            }
        }
    }
    series.iter_mut().for_each(Series::sort);
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
    pub(crate) fn add_floor(&mut self) -> BenchResult<()> {
        self.add("floor", |domain, core| {
            let lines = domain.shared_memory("floor");
            let floor = Floor::create(&lines)?;
            Ok((floor, Some(spawn_role(domain, core, &["floor", &lines.to_string_lossy()])?)))
        })
    }

    /// Adds a bare pair.
    pub(crate) fn add_bare(&mut self, name: &str) -> BenchResult<()> {
        self.add(name, |domain, core| {
            let echo = spawn_echo(domain, core, SHORT, 1)?;
            Ok((Bare::connect(domain.as_domain(), SHORT)?, Some(echo)))
        })
    }

    /// Adds a bare pair with a second one to get ready with.
    pub(crate) fn add_rehearsed(&mut self, name: &str) -> BenchResult<()> {
        self.add(name, |domain, core| {
            let echo = spawn_echo(domain, core, SHORT, 2)?;
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
        self.add(name, |domain, core| {
            let settings = depth + &served_by(strategy, core);
            let service = domain.serve(program.map(PathBuf::as_path), &settings)?;
            Ok((Isotherm(domain.acquisition(IMU)?), Some(service)))
        })
    }

    /// Adds `count` bare pairs that send together. One process answers them all.
    pub(crate) fn add_bare_together(&mut self, name: &str, count: usize) -> BenchResult<()> {
        self.add(name, |domain, core| {
            let echo = spawn_echo(domain, core, SHORT, count)?;
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
        self.add(name, |domain, core| {
            // A setting of the core holds for all workers. Two workers are left to the scheduler.
            let service = domain.serve_many(count, workers, &served_by(strategy, core.filter(|_| workers == 1)))?;
            let connect = |index| Ok(Isotherm(domain.acquisition(&imu(index))?));
            Ok((Together((0..count).map(connect).collect::<BenchResult<_>>()?), Some(service)))
        })
    }

    pub(crate) fn add_socket(&mut self) -> BenchResult<()> {
        self.add("unix_socket", |domain, core| {
            let path = domain.path("socket");
            let server = spawn_role(domain, core, &["socket", &path.to_string_lossy()])?;
            Ok((Socket::connect(&path)?, Some(server)))
        })
    }

    pub(crate) fn add_in_process(&mut self) -> BenchResult<()> {
        self.add("in_process", |_, _| Ok((InProcess::new()?, None)))
    }

    /// Starts a path in a domain of its own.
    fn add<P: Path + 'static>(
        &mut self,
        name: &str,
        start: impl FnOnce(&BenchDomain, Option<usize>) -> BenchResult<(P, Option<BenchProcess>)>,
    ) -> BenchResult<()> {
        let domain = BenchDomain::new()?;
        let (path, peer) = start(&domain, self.core)?;
        peer.iter().for_each(BenchProcess::pause);
        self.paths.push(Pair { name: name.to_owned(), path: Box::new(path), peer });
        self.domains.push(domain);
        Ok(())
    }
}

/// Starts this program in a role, on this core.
fn spawn_role(domain: &BenchDomain, core: Option<usize>, role: &[&str]) -> BenchResult<BenchProcess> {
    let core = core.map(|core| core.to_string()).unwrap_or_default();
    domain.spawn(&[&["child", &core], role].concat())
}

/// Starts the other end of `pairs` bare pairs.
pub(crate) fn spawn_echo(
    domain: &BenchDomain,
    core: Option<usize>,
    depth: usize,
    pairs: usize,
) -> BenchResult<BenchProcess> {
    let (name, root) = (domain.as_domain().name(), domain.as_domain().root_path());
    spawn_role(domain, core, &["echo", name, root, &depth.to_string(), &pairs.to_string()])
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
