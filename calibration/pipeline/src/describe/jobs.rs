//! What a file is good for.

use super::model::{DescribedKind, FileDescription, JobFitness};
use super::rows::ImuSummary;
use super::toml::TUMBLE;
use crate::vehicle::INSTANCE;
use isotherm_analysis::MIN_ROWS;
use isotherm_autopilot::Autopilot;
use isotherm_fit::LEAST_WARM_UP_SPAN;
use isotherm_recording_formats::convert::Foreign;
use isotherm_shared::content::FileContent;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{quoted, quoted_path};
use std::path::Path;

/// Fewest attitudes of a tumble: three biases and three scale factors are unknown.
const LEAST_ATTITUDES: usize = 6;
/// A recording at rest turns for a smaller part of the time.
const MOST_TURNING: f64 = 0.2;

/// Why a job is not possible, or its command line.
type Judgement = Result<String, String>;

/// All jobs.
pub(super) fn of(description: &FileDescription, path: &Path, foreign: &Foreign) -> Vec<JobFitness> {
    let file = DescribedFile::new(description, path, foreign);
    let jobs = [
        ("calibrate warm-up", file.warm_up()),
        ("calibrate tumble", file.tumble()),
        ("calibrate turntable", file.turntable()),
        ("noise", file.noise()),
        ("verify", file.verify()),
        ("replay", file.replay()),
        ("convert", file.convert()),
        ("compare", file.compare()),
        ("export", file.export()),
        ("import", file.import()),
        ("check", file.check()),
    ];
    let jobs = jobs.into_iter().map(|(job, judged)| {
        let good = judged.is_ok();
        let (command, reason) = judged.map_or_else(|reason| (String::new(), reason), |line| (line, String::new()));
        JobFitness { job, good, reason, command }
    });
    jobs.collect()
}

struct DescribedFile<'a> {
    of: &'a FileDescription,
    /// The name in a command line, and a name for the IMU made of it.
    name: String,
    id: String,
    /// Options of data of other programs that were given.
    given: String,
}

impl<'a> DescribedFile<'a> {
    fn new(of: &'a FileDescription, path: &Path, foreign: &Foreign) -> Self {
        let stem: String = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let id: String = stem.chars().map(|it| if it.is_ascii_alphanumeric() { it } else { '-' }).collect();
        let id = id.trim_matches('-').to_owned();
        let id = if ImuId::new(&id).is_some() { id } else { "imu-a".to_owned() };
        let mapping = foreign.mapping.as_ref().map(|(path, _)| quoted_path(path));
        let mut given = mapping.map(|mapping| format!(" --mapping {mapping}")).unwrap_or_default();
        if let Some(instance) = foreign.settings.instance {
            given.push_str(&format!(" --instance {instance}"));
        }
        if let Some(temperature) = foreign.settings.temperature {
            given.push_str(&format!(" --temperature {temperature}"));
        }
        Self { of, name: quoted_path(Path::new(&of.file)), id, given }
    }

    fn is_samples(&self) -> bool {
        matches!(self.of.kind, DescribedKind::Recording | DescribedKind::Data)
    }

    /// The IMUs with rows.
    ///
    /// # Errors
    /// If there are no samples, with the reason.
    fn samples(&self) -> Result<Vec<&'a ImuSummary>, String> {
        if !self.is_samples() {
            return Err(match self.of.kind {
                DescribedKind::Unknown => "it cannot be read".to_owned(),
                _ => format!("it has no samples: {}", self.of.format),
            });
        }
        if let Some(error) = &self.of.error {
            return Err(format!("it cannot be read: {error}"));
        }
        let imus: Vec<_> = self.of.imus.iter().filter(|imu| imu.rows.is_some_and(|rows| rows > 0)).collect();
        if imus.is_empty() { Err("it has no rows".to_owned()) } else { Ok(imus) }
    }

    /// As [`samples`](Self::samples), of those with a temperature.
    fn with_temperature(&self) -> Result<Vec<&'a ImuSummary>, String> {
        let imus = self
            .samples()?
            .into_iter()
            .filter(|imu| imu.temperature.as_ref().is_some_and(|temperature| !temperature.is_placeholder));
        let imus: Vec<_> = imus.collect();
        let none = "it has no temperature; give one for all rows with --temperature, or take a log that has it";
        if imus.is_empty() { Err(none.to_owned()) } else { Ok(imus) }
    }

    fn warm_up(&self) -> Judgement {
        let imus = self.with_temperature()?;
        let span = |imu: &ImuSummary| imu.temperature.as_ref().map_or(0.0, |of| of.high - of.low);
        let widest = imus.iter().map(|imu| span(imu)).fold(0.0, f64::max);
        if widest < LEAST_WARM_UP_SPAN {
            return Err(format!(
                "the temperature moves by {widest:.2}; a curve over temperature needs {LEAST_WARM_UP_SPAN} degC at least: warm up, or cool"
            ));
        }
        let several = self.of.imus.len() > 1;
        let output = if several { format!("'{}-{INSTANCE}.toml'", self.id) } else { format!("{}.toml", self.id) };
        let nominal = if imus.iter().all(|imu| imu.has_scale) { "" } else { " --nominal TABLE.toml" };
        let export = self.autopilot().map(|autopilot| match autopilot {
            Autopilot::Px4 => format!(" --export px4={}.params", self.id),
            Autopilot::ArduPilot => format!(" --export ardupilot={}.parm", self.id),
        });
        let (name, id, given, export) = (&self.name, &self.id, &self.given, export.unwrap_or_default());
        Ok(format!(
            "isotherm calibrate warm-up {name} --imu {id}{given}{nominal} -o {output} --report {id}.html{export}"
        ))
    }

    /// Whose log it is.
    fn autopilot(&self) -> Option<Autopilot> {
        let formats = [(FileContent::Ulog, Autopilot::Px4), (FileContent::DataFlash, Autopilot::ArduPilot)];
        formats.into_iter().find(|(content, _)| content.name() == self.of.format).map(|(_, autopilot)| autopilot)
    }

    fn tumble(&self) -> Judgement {
        if self.of.kind == DescribedKind::Campaign {
            return self.campaign("tumble");
        }
        let imus = self.with_temperature()?;
        let most = imus.iter().filter_map(|imu| imu.attitudes).max().unwrap_or(0);
        if most < LEAST_ATTITUDES {
            return Err(format!(
                "about {most} attitudes at rest are seen; a tumble has {LEAST_ATTITUDES} at least, better 12 or more; its recordings are \
                 named together"
            ));
        }
        let (name, id, given) = (&self.name, &self.id, &self.given);
        Ok(format!(
            "isotherm calibrate tumble {name} --imu {id}{given} --gravity-local G --gravity-reference 9.80665 \
             --temperature-unit degC -o {id}.toml --report {id}.html"
        ))
    }

    fn turntable(&self) -> Judgement {
        if self.of.kind == DescribedKind::Campaign {
            return self.campaign("turntable");
        }
        Err("a campaign file describes the positions: docs/calibrate.md".to_owned())
    }

    fn campaign(&self, job: &str) -> Judgement {
        if let Some(error) = &self.of.error {
            return Err(error.clone());
        }
        if (self.of.format == TUMBLE) != (job == "tumble") {
            return Err(format!("it is {}", self.of.format));
        }
        let (name, id) = (&self.name, &self.id);
        let output = if self.of.imus.len() > 1 { "'{imu}.toml'".to_owned() } else { format!("{id}.toml") };
        Ok(format!("isotherm calibrate {job} {name} -o {output} --report {id}.html"))
    }

    fn noise(&self) -> Judgement {
        let imus = self.samples()?;
        let most = imus.iter().filter_map(|imu| imu.rows).max().unwrap_or(0);
        if most < MIN_ROWS as u64 {
            return Err(format!("{most} rows; noise needs {MIN_ROWS} at least, at rest"));
        }
        let turning = imus.iter().filter_map(|imu| imu.turning).fold(f64::INFINITY, f64::min);
        if turning > MOST_TURNING {
            return Err(format!(
                "the IMU turns in {:.0} % of the time; noise needs rest: give the part at rest with --from and --to",
                turning * 100.0
            ));
        }
        let (name, id, given) = (&self.name, &self.id, self.chosen());
        Ok(format!("isotherm noise {name}{given} --report {id}.html"))
    }

    /// What was given, and the choice of an IMU, where there are several.
    fn chosen(&self) -> String {
        let several = self.of.imus.len() > 1;
        let first = self.of.imus.iter().find_map(|imu| imu.instance).filter(|_| several);
        self.given.clone() + &first.map(|instance| format!(" --instance {instance}")).unwrap_or_default()
    }

    fn verify(&self) -> Judgement {
        if self.of.kind == DescribedKind::Table {
            return self.table(|name| format!("isotherm verify --table {name} RECORDING --report verify.html"));
        }
        self.with_temperature()?;
        Ok(format!("isotherm verify --table TABLE.toml {}{} --report verify.html", self.name, self.chosen()))
    }

    fn replay(&self) -> Judgement {
        if self.of.kind == DescribedKind::Table {
            return self.table(|name| format!("isotherm replay --table {name} RECORDING -o increments.csv"));
        }
        self.with_temperature()?;
        Ok(format!("isotherm replay --table TABLE.toml {}{} -o increments.csv", self.name, self.chosen()))
    }

    fn convert(&self) -> Judgement {
        self.samples()?;
        if self.of.kind == DescribedKind::Recording {
            return Err("a recording needs no conversion".to_owned());
        }
        let several = if self.of.imus.len() > 1 { format!("-{INSTANCE}") } else { String::new() };
        let (name, id, given) = (&self.name, &self.id, &self.given);
        Ok(format!("isotherm convert {name}{given} -o {} --imu {id}", quoted(&format!("{id}{several}.csv"))))
    }

    fn table(&self, line: impl Fn(&str) -> String) -> Judgement {
        match (&self.of.error, self.of.kind) {
            (Some(error), _) => Err(error.clone()),
            (None, DescribedKind::Table) => Ok(line(&self.name)),
            _ => Err("it takes a coefficient table".to_owned()),
        }
    }

    fn compare(&self) -> Judgement {
        self.table(|name| format!("isotherm compare {name} NEW.toml --report compare.html"))
    }

    fn export(&self) -> Judgement {
        self.table(|name| format!("isotherm export {name} --to px4 -o {}.params", self.id))
    }

    fn import(&self) -> Judgement {
        if self.of.kind != DescribedKind::Parameters {
            return Err("it takes a file of parameters of PX4 or ArduPilot".to_owned());
        }
        if let Some(error) = &self.of.error {
            return Err(error.clone());
        }
        let known = Autopilot::NAMES.iter().find(|(autopilot, _)| self.of.format.ends_with(autopilot.title()));
        let (Some((_, from)), Some(imu)) = (known, self.of.imus.first()) else {
            return Err("it has no parameters of temperature compensation".to_owned());
        };
        let instance = imu.instance.map(|instance| format!(" --instance {instance}")).unwrap_or_default();
        let (name, id) = (&self.name, &self.id);
        Ok(format!("isotherm import {name} --from {from}{instance} --imu {id} --interval S -o {id}.toml"))
    }

    fn check(&self) -> Judgement {
        match self.of.kind {
            DescribedKind::Data => Err("data of another program have no checks of ours".to_owned()),
            DescribedKind::Parameters => Err("import reads parameters".to_owned()),
            DescribedKind::Unknown => Err("it cannot be read".to_owned()),
            _ => Ok(format!("isotherm check {}", self.name)),
        }
    }
}
