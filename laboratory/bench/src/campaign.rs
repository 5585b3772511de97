//! A campaign in a folder of its own, with as many runners as it takes.

use crate::faults::FaultPlan;
use crate::world::VirtualWorld;
use isotherm_automation::journal::Journal;
use isotherm_automation::plan::Plan;
use isotherm_automation::runner::Runner;
use isotherm_automation::samples::write_campaign_file;
use isotherm_failure::Failure;
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{Chain, Noise, Truth};
use isotherm_simulator::{ChamberProtocol, SimulatedStation, StationImu, TurntableProtocol};
use std::path::Path;
use std::sync::Arc;
use std::{fs, io};
use tempfile::TempDir;

/// What makes the shipped plan short.
const SHORTER: [(&str, &str); 12] = [
    ("output = \"imu-a-campaign\"", "output = \".\""),
    ("install = \"imu-a.toml\"", "# "),
    ("positions = \"six-faces-two-headings\"", "positions = \"four-point-tumble\""),
    ("start_c = -25\nstop_c = 45\nstep_c = 5", "list_c = [20, 21]"),
    ("time_s = 3600 ", "time_s = 60 "),
    ("stay_s = 4200 ", "stay_s = 0 "),
    ("window_s = 900 ", "window_s = 60 "),
    ("chamber_c_per_h = 2 ", "chamber_c_per_h = 60 "),
    ("time_s = 300\n", "time_s = 20\n"),
    ("row_s = 10 ", "row_s = 5 "),
    ("/dev/ttyUSB0", "/dev/chamber"),
    ("tcp://192.0.2.10:9888", "/dev/table"),
];
/// Time between two runners \[s\]: the turntable comes back from anywhere meanwhile.
const BETWEEN_S: f64 = 60.0;
/// Most runners of a campaign.
const MOST_RUNNERS: usize = 40;
/// Interval of the IMU's samples \[ns\].
const INTERVAL_NS: u64 = 500_000_000;

/// A campaign in a folder of its own.
pub struct Campaign {
    folder: TempDir,
    /// Its plan.
    pub plan: Plan,
    /// The world that it runs in.
    pub world: VirtualWorld,
}

/// How a runner has ended.
pub struct Ended {
    /// When it began, and when it ended \[s\].
    pub times_s: [f64; 2],
    /// Its message; `None` if all is complete.
    pub failure: Option<String>,
    /// Whether it was killed.
    pub is_killed: bool,
}

impl Campaign {
    /// The shipped plan, made short, with these faults.
    ///
    /// # Panics
    /// If the shipped plan is another one than that which is made short here.
    #[must_use]
    pub fn new(seed: u64, faults: FaultPlan) -> Self {
        let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("a temporary folder: {error}"));
        let mut text = include_str!("../../../examples/plan.toml").to_owned();
        for (from, to) in SHORTER {
            assert!(text.contains(from), "the plan has no {from}");
            text = text.replacen(from, to, 1);
        }
        // Half of the tables are on a network: their replies have a header, and may end with a pause.
        if seed % 2 == 1 {
            text = text.replacen("\"/dev/table\"", "\"tcp://table:9888\"", 1);
        }
        // The drift of the telemetry takes longer than these soaks, and there is nobody to judge runs.
        let end = text.find("\n[verify]").unwrap_or(text.len());
        let lines = text[..end].lines().filter(|line| !line.starts_with("telemetry_per_h"));
        let text = lines.map(|line| format!("{line}\n")).collect::<String>();
        let plan = Plan::from_toml(&text, folder.path()).unwrap_or_else(|faults| panic!("{faults}"));
        let table = include_str!("../../../tests/data/imu-a.toml");
        let truth = Truth::of(CoefficientTable::from_toml(table, None).unwrap_or_else(|error| panic!("{error}")));
        let world = VirtualWorld::new(&station(seed, &truth), &truth, faults);
        Self { folder, plan, world }
    }

    /// Starts runners until one completes the campaign.
    pub fn run(&self) -> Vec<Ended> {
        let mut all = Vec::new();
        while all.len() < MOST_RUNNERS && all.last().is_none_or(|ended: &Ended| ended.failure.is_some()) {
            if let Some(ended) = all.last() {
                let is_beyond = |message: &String| message.contains("is outside limits.outer_deg");
                if ended.failure.as_ref().is_some_and(is_beyond) {
                    self.world.bring_back();
                }
                self.world.wait(BETWEEN_S);
            }
            all.push(self.run_once());
        }
        all
    }

    /// Starts a runner, and returns when it has ended.
    fn run_once(&self) -> Ended {
        let around = self.world.surroundings();
        let (output, copy) = (self.plan.output.clone(), self.folder.path().with_extension("killed"));
        let kept = copy.clone();
        self.world.at_kill(move || copy_folder(&output, &kept));
        let begun_s = self.world.now_s();
        let result = self.start(around);
        let is_killed = self.world.is_killed();
        if is_killed {
            // What it has done since then did not happen.
            let restored = copy_folder(&copy, &self.plan.output).and_then(|()| fs::remove_dir_all(&copy));
            restored.unwrap_or_else(|error| panic!("restoring the folder: {error}"));
        }
        let failure = if is_killed { Some("killed".to_owned()) } else { result.err().map(|failure| failure.message) };
        Ended { times_s: [begun_s, self.world.now_s()], failure, is_killed }
    }

    fn start(&self, around: isotherm_instruments::Surroundings) -> Result<(), Failure> {
        let (journal, history) = Journal::open_with(&self.plan, Arc::clone(&around.time))?;
        write_campaign_file(&self.plan)?;
        Runner::new(&self.plan, (journal, &history), &self.world, 1.0, around)?.run()
    }
}

fn station(seed: u64, truth: &Truth) -> SimulatedStation {
    SimulatedStation {
        imus: vec![StationImu::new("imu-a", 0, 1, seed)],
        chamber: ChamberProtocol::Espec,
        chamber_port: "/dev/chamber".to_owned(),
        table: TurntableProtocol::Acutrol,
        table_port: (if seed % 2 == 1 { "tcp://table:9888" } else { "/dev/table" }).to_owned(),
        wrap: false,
        speed: 1.0,
        origin_ns: 0,
        interval_ns: INTERVAL_NS,
        seed,
        ambient_c: 20.0,
        ramp_c_per_s: 0.02,
        tilt_rad: [0.0; 2],
        gravity_local: truth.gravity_local,
        latitude_deg: truth.latitude_deg,
        heading_deg: truth.heading_deg,
        chain: Chain { oscillation_c: 0.0, ..Chain::default() },
        noise: Noise::NONE,
        plays: Vec::new(),
    }
}

/// Makes `to` a copy of the files of `from`, and of nothing else.
fn copy_folder(from: &Path, to: &Path) -> io::Result<()> {
    if to.exists() {
        for entry in fs::read_dir(to)? {
            fs::remove_file(entry?.path())?;
        }
    } else {
        fs::create_dir(to)?;
    }
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        fs::copy(entry.path(), to.join(entry.file_name()))?;
    }
    Ok(())
}
