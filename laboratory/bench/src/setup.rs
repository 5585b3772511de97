//! A laboratory and its plan: which instruments, which IMUs, what goes wrong.

use crate::faults::FaultPlan;
use crate::script::ScriptStep;
use isotherm_automation::plan::Plan;
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{Chain, Noise, Truth};
use isotherm_station::{ChamberProtocol, SimulatedStation, StationImu, TurntableProtocol};
use std::path::Path;

/// What makes the plan of a station short.
const SHORT: [(&str, &str); 6] = [
    ("start_c = -25\nstop_c = 45\nstep_c = 5", "list_c = [20, 21]"),
    ("time_s = 3600\nstay_s = 4200\nwindow_s = 900", "time_s = 60\nstay_s = 0\nwindow_s = 60"),
    ("chamber_c_per_h = 2\n", "chamber_c_per_h = 60\n"),
    ("time_s = 300\nrow_s = 10", "time_s = 20\nrow_s = 5"),
    ("gap_s = 0.005\n", ""),
    ("pause_s = 0\n", ""),
];

/// A laboratory and its plan.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Seed of all that is drawn.
    pub seed: u64,
    /// What goes wrong at times.
    pub faults: FaultPlan,
    /// What happens one after the other.
    pub steps: Vec<ScriptStep>,
    /// The IMUs on the turntable.
    pub imus: Vec<&'static str>,
    /// More lines of what is true of each IMU; with gyroscopes it is a table of format 2.
    pub more_truth: &'static str,
    /// What the chamber speaks.
    pub chamber: ChamberProtocol,
    /// What the turntable speaks.
    pub table: TurntableProtocol,
    /// Whether the turntable takes angles modulo 360 degrees.
    pub wrap: bool,
    /// Whether chamber and turntable are on a network.
    pub tcp: [bool; 2],
    /// Interval of the samples \[ns\].
    pub interval_ns: u64,
    /// Changes of the plan: what stands there, and what in its place.
    pub changes: Vec<(String, String)>,
}

impl Setup {
    /// Two set points with the positions of a tumble, and these faults.
    #[must_use]
    pub fn short(seed: u64, faults: FaultPlan) -> Self {
        Self {
            seed,
            faults,
            steps: Vec::new(),
            imus: vec!["imu-a"],
            more_truth: "",
            chamber: ChamberProtocol::Espec,
            table: TurntableProtocol::Acutrol,
            wrap: false,
            // Half of the turntables are on a network: their replies have a header, and may end with a pause.
            tcp: [false, seed % 2 == 1],
            interval_ns: 500_000_000,
            changes: Vec::new(),
        }
        .with(&[("six-faces-two-headings", "four-point-tumble")])
    }

    /// A ramp there and back after the dwells at one set point.
    #[must_use]
    pub fn ramp(seed: u64, faults: FaultPlan) -> Self {
        let ramp = "[[ramp]]\nfrom_c = 20\nto_c = 24\nramp_c_per_h = 60\nhold_s = 60\n\n[safe]";
        Self { interval_ns: 1_000_000_000, ..Self::short(seed, faults) }
            .with(&[("list_c = [20, 21]", "list_c = [20]"), ("[safe]", ramp)])
    }

    /// With these changes of the plan.
    #[must_use]
    pub fn with(mut self, changes: &[(&str, &str)]) -> Self {
        self.changes.extend(changes.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())));
        self
    }

    pub(crate) fn truths(&self) -> Vec<Truth> {
        let table = include_str!("../../../tests/data/imu-a.toml");
        let table = if self.more_truth.contains("[[gyroscope]]") {
            table.replacen("format = 1", "format = 2", 1).replacen("[imu]", "[imu]\nserial = \"SN 42\"", 1)
        } else {
            table.to_owned()
        };
        let text = table.lines().map(linear).collect::<String>() + self.more_truth;
        let truth = |imu: &&str| {
            let text = text.replacen("\"imu-a\"", &format!("{imu:?}"), 1);
            Truth::of(CoefficientTable::from_toml(&text, None).unwrap_or_else(|error| panic!("{error}")))
        };
        self.imus.iter().map(truth).collect()
    }

    pub(crate) fn station(&self) -> SimulatedStation {
        let port = |name: &str, tcp| if tcp { format!("tcp://{name}:9888") } else { format!("/dev/{name}") };
        let truths = self.truths();
        let count = self.imus.len();
        let imus = self.imus.iter().enumerate();
        SimulatedStation {
            imus: imus.map(|(number, id)| StationImu::new(id, number, count, self.seed)).collect(),
            chamber: self.chamber,
            chamber_port: port("chamber", self.tcp[0]),
            table: self.table,
            table_port: port("table", self.tcp[1]),
            wrap: self.wrap,
            speed: 1.0,
            origin_ns: 0,
            interval_ns: self.interval_ns,
            seed: self.seed,
            ambient_c: 20.0,
            ramp_c_per_s: 0.02,
            tilt_rad: [0.0; 2],
            gravity_local: truths[0].gravity_local,
            latitude_deg: truths[0].latitude_deg,
            heading_deg: truths[0].heading_deg,
            // The temperature follows the air, so that short ramps are seen.
            chain: Chain { oscillation_c: 0.0, head_lag_s: 20.0, board_lag_s: 20.0, ..Chain::default() },
            noise: Noise::NONE,
            plays: Vec::new(),
        }
    }

    /// The plan in a folder.
    pub(crate) fn plan(&self, station: &SimulatedStation, truths: &[Truth], folder: &Path) -> Plan {
        let mut text = station.plan_toml(truths).unwrap_or_else(|| panic!("a station without an IMU"));
        // There is nobody to judge runs.
        let runs = text.find("\n[verify]").unwrap_or(text.len());
        text.truncate(runs);
        for (from, to) in SHORT {
            text = text.replacen(from, to, 1);
        }
        for (from, to) in &self.changes {
            assert!(text.contains(from.as_str()), "the plan has no {from}:\n{text}");
            text = text.replacen(from.as_str(), to, 1);
        }
        // The drift of the temperature takes longer than these soaks.
        let lines = text.lines().filter(|line| !line.starts_with("temperature_per_h"));
        let text: String = lines.map(|line| format!("{line}\n")).collect();
        Plan::from_toml(&text, folder).unwrap_or_else(|faults| panic!("{faults}\n{text}"))
    }
}

/// A line of a table without coefficients of the second and third order, and without the digest: of such a truth a few
/// set points are enough to choose the order.
#[must_use]
pub fn linear(line: &str) -> String {
    let parts = line.split_inclusive(", ").filter(|part| !part.starts_with("c2 =") && !part.starts_with("c3 ="));
    let line: String = parts.collect();
    if line.contains("c1 =") && !line.trim_end().ends_with('}') {
        format!("{} }}\n", line.trim_end().trim_end_matches(','))
    } else if line.starts_with("digest") {
        String::new()
    } else {
        line + "\n"
    }
}

/// Gyroscopes and an alignment for [`Setup::more_truth`], linear as the accelerometers are.
pub const GYROSCOPES: &str = r#"
[[gyroscope]]
name = "G1"
bias = { unit = "deg/h", range = [0.9, 4.2], c0 = 6.213, c1 = -1.871 }
positive_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = 1.05214, c1 = 0.00041 }
negative_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = -1.05391, c1 = 0.00036 }
g_sensitivity = { unit = "deg/h/g0", a1 = 0.731, a2 = -0.214, a3 = 0.0875 }
[[gyroscope]]
name = "G2"
bias = { unit = "deg/h", range = [0.9, 4.2], c0 = -2.4471, c1 = 0.9127 }
positive_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = 0.98761, c1 = -0.00022 }
negative_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = -0.98533, c1 = 0.00019 }
g_sensitivity = { unit = "deg/h/g0", a1 = -0.31, a2 = 0.52, a3 = 0.11 }
[[gyroscope]]
name = "G3"
bias = { unit = "deg/h", range = [0.9, 4.2], c0 = 0.5512, c1 = 1.7305 }
positive_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = 1.11873, c1 = -0.00057 }
negative_scale_factor = { unit = "pulse/arcsec", range = [0.9, 4.2], c0 = -1.11692, c1 = 0.00044 }
g_sensitivity = { unit = "deg/h/g0", a1 = -0.118, a2 = 0.306, a3 = -0.942 }
[gyroscope_alignment]
matrix = [[1.0, 0.00031, -0.00018], [-0.00027, 1.0, 0.00044], [0.00012, -0.00039, 1.0]]
[alignment]
matrix = [[1, 2.8e-4, -1e-4], [1.2e-4, 1, 2e-4], [0, -1.5e-4, 1]]
"#;
