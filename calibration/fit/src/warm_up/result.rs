//! What recordings at one attitude give.

use super::options::WarmUpOptions;
use super::order::OrderChoice;
use super::order::TriedOrder;
use crate::ramps::RampCalibration;
use crate::rest::RowAccount;
use crate::sensor::TriadUnits;
use isotherm_autopilot::Autopilot;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::SweepBand;

/// A lag that nobody has measured is judged with this one \[s\].
pub const BEHIND_S: f64 = 60.0;

/// What is left of a bias over temperature: of the means of bins of 1 degC, about their mean \[g0 or deg/h\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Standard deviation.
    pub sd: f64,
    /// Largest distance.
    pub largest: f64,
}

/// The mean of a sweep's rows in a bin of 1 degC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// Index of the sweep.
    pub sweep: usize,
    /// Head temperature.
    pub temperature: f64,
    /// Time since the recording began \[s\].
    pub age_s: f64,
    /// Bias less the transient that is written, on the curve's constant \[g0 or deg/h\].
    pub value: f64,
    /// What the curve leaves \[g0 or deg/h\].
    pub residual: f64,
}

/// A sweep of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepSpan {
    /// Index of the recording.
    pub recording: usize,
    /// Whether the temperature rises.
    pub heating: bool,
    /// Head temperature at begin and end.
    pub temperature: [f64; 2],
    /// Begin and end since the recording began \[s\].
    pub age_s: [f64; 2],
}

/// The curve of one bias.
#[derive(Clone, Debug)]
pub struct BiasCurve {
    /// Accelerometer or gyroscope.
    pub kind: SensorKind,
    /// 0 to 2.
    pub axis: usize,
    /// The curve \[g0 or deg/h\].
    pub curve: Polynomial,
    /// What the bias does over temperature, with the bias curve of the nominal table taken off.
    pub before: Spread,
    /// What the curve, and the transient if one is written, leave.
    pub after: Spread,
    /// Largest half width of the 95 % interval that the noise of the rows gives the curve, over its range \[g0 or
    /// deg/h\]; of an accelerometer, whose constant is the nominal table's, that of the curve less its value at the
    /// reference temperature.
    pub interval: f64,
    /// How far the curve is off at most if the sensing element is [`BEHIND_S`] behind its temperature \[g0 or deg/h\].
    pub behind: f64,
    /// Half of the band between sweeps is the error of the curve \[g0 or deg/h\]; `None` where it is not known.
    pub band: Option<SweepBand>,
    /// Means by sweep.
    pub points: Vec<SweepPoint>,
    /// What the cubics of autopilots are on the same rows, and leave.
    pub beside: Vec<(Autopilot, Polynomial, Spread)>,
    /// What the parameters on board are, and leave.
    pub on_board: Vec<OnBoardCurve>,
}

/// What parameters that are on board make of a bias.
#[derive(Clone, Debug)]
pub struct OnBoardCurve {
    /// The name of the parameters.
    pub name: String,
    /// Temperature, and what the firmware subtracts there \[g0 or deg/h\], on the constant of the curve: their own is
    /// that of another attitude.
    pub points: Vec<(f64, f64)>,
    /// What they leave of the bias.
    pub after: Spread,
}

/// The result of a calibration at one attitude.
#[derive(Clone, Debug)]
pub struct WarmUpCalibration {
    /// The table, with the findings and the transients of its ramps; its `curves` are the nominal table.
    pub ramps: RampCalibration,
    /// The options it was made with.
    pub options: WarmUpOptions,
    /// Names of the recordings, or of the stretches of them that are used.
    pub recordings: Vec<String>,
    /// What was used of the rows of each recording, and what was left out.
    pub rows: Vec<RowAccount>,
    /// How the order was found.
    pub order: OrderChoice,
    /// The reference temperature.
    pub at: f64,
    /// Width of the bins that before and after are judged in, in the temperature's unit.
    pub bin: f64,
    /// The sweeps of all recordings.
    pub sweeps: Vec<SweepSpan>,
    /// A1, A2, A3, and G1, G2, G3 where table and recordings have gyroscopes.
    pub biases: Vec<BiasCurve>,
}

impl BiasCurve {
    /// Name of the sensor.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.kind.names()[self.axis]
    }
}

impl WarmUpCalibration {
    /// The table.
    #[must_use]
    pub const fn table(&self) -> &CoefficientTable {
        &self.ramps.table
    }

    /// What the table knows, in one line: how it was made, and the error of the curves.
    #[must_use]
    pub fn accuracy(&self) -> String {
        let gravity = self.table().content().gravity;
        let (count, stretches) = (self.rows.len(), self.recordings.len());
        let noun = if count == 1 { "recording" } else { "recordings" };
        let order = self.order.order;
        let of = if stretches == count { String::new() } else { format!("{stretches} stretches of ") };
        let made = format!("bias curves of order {order} from {of}{count} {noun} at one attitude");
        let known = self.biases.iter().filter_map(|it| Some((it, it.band.as_ref()?)));
        let bands: Vec<_> = known
            .map(|(it, band)| {
                let si = TriadUnits::of(it.kind).si_text(band.half_width, gravity);
                format!("{} {si}", it.name())
            })
            .collect();
        if bands.is_empty() {
            return format!(
                "{made}; their error is not known: no recordings heat and cool over half of the range; only noise gives 95 % intervals, at one temperature each, of {}, \
                 and elements that are {BEHIND_S} s behind their temperature would make them wrong by {}",
                self.sizes(|it| it.interval),
                self.sizes(|it| it.behind)
            );
        }
        format!(
            "{made}; their error, half of the band between heating and cooling: {}; 95 % intervals from noise, at one temperature each: {}",
            bands.join(", "),
            self.sizes(|it| it.interval)
        )
    }

    /// The value of 1 g0 \[m/s2\].
    #[must_use]
    pub fn gravity(&self) -> f64 {
        self.table().content().gravity
    }

    /// What an order leaves of sweeps left out, by bias, in m/s2 and rad/s.
    #[must_use]
    pub fn errors_of(&self, tried: &TriedOrder) -> Vec<f64> {
        let all = tried.errors.iter().zip(&self.biases);
        all.map(|(error, bias)| TriadUnits::of(bias.kind).si(*error, self.gravity()).0).collect()
    }

    /// A figure of each bias in m/s2 or rad/s.
    fn sizes(&self, of: impl Fn(&BiasCurve) -> f64) -> String {
        let gravity = self.gravity();
        let size = |it: &BiasCurve| format!("{} {}", it.name(), TriadUnits::of(it.kind).si_text(of(it), gravity));
        self.biases.iter().map(size).collect::<Vec<_>>().join(", ")
    }

    /// What the table does not know, in sentences.
    #[must_use]
    pub fn not_known(&self) -> Vec<String> {
        let unit = &self.table().content().temperature_unit;
        let has_gyroscopes = self.biases.iter().any(|it| it.kind == SensorKind::Gyroscope);
        let mut sentences = vec![
            "scale factors and misalignments: not measured; they are those of the nominal table, over the whole range"
                .to_owned(),
            format!(
                "the constant of each accelerometer: it contains the attitude (1 mrad is 1000 ug0); at {:.1} {unit} it is that of the nominal table",
                self.at
            ),
        ];
        if has_gyroscopes {
            sentences.push(
                "the constant of each gyroscope without Earth's rate (up to 15 deg/h), which is in it".to_owned(),
            );
        }
        sentences
            .push("a tilt with temperature, which looks like a bias (1 urad is 1 ug0 on a horizontal axis)".to_owned());
        sentences
    }
}
