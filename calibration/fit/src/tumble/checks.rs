//! What is refused before the fit, and what is warned of after it.

use super::choice::TumbleFit;
use super::estimates::Ranges;
use super::groups::Groups;
use super::model::{Ellipsoid, ellipsoid};
use super::reading::Reading;
use super::recording::TumbleRecording;
use super::weighted::WeightedFit;
use isotherm_campaign::{Campaign, joint_range};
use isotherm_recording::{Continuity, share_rows};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::{AXES, RawSample, device};
use isotherm_statistics::student_quantile;
use isotherm_support::finding::{Finding, Location, name};

/// A bias beyond this is an offset of the counts, not of a sensor \[g0\].
const MAX_BIAS: f64 = 1.0;
/// Condition number of the ellipsoid up to which its centre is believed.
const MAX_CONDITION: f64 = 30.0;
/// Its readings are beyond this share of gravity on both sides.
const AROUND: f64 = 0.5;
/// A bias by so much more or less than gravity is gravity \[g0\].
const ABOUT_GRAVITY: f64 = 0.2;
/// A table's range that is as many times what was measured rests on what nobody measured.
const MUCH_WIDER: f64 = 1.5;
/// No IMU is warmer in a calibration \[degC\].
const NO_CELSIUS: f64 = 150.0;
/// No IMU is as hot \[K\]: thousandths of a degree are larger.
const NO_KELVIN: f64 = 1000.0;
/// Probability that a static pose is named as off by chance.
const OUTLIER: f64 = 0.01;

/// What is wrong with the recordings, before a static pose is searched.
pub(super) fn of_recordings(
    campaign: &Campaign,
    recordings: &[TumbleRecording],
    continuity: &[Continuity],
) -> Vec<Finding> {
    let mut found: Vec<Finding> = other_device(campaign, recordings).into_iter().collect();
    found.extend(twice(recordings));
    found.extend(recordings.iter().flat_map(|recording| recording.findings.clone()));
    found.extend(recordings.iter().zip(continuity).filter_map(|(recording, found)| interval(recording, found)));
    found
}

/// Samples of another device than the campaign's serial number says. Samples without a device, and campaigns without a
/// serial number, pass.
fn other_device(campaign: &Campaign, recordings: &[TumbleRecording]) -> Option<Finding> {
    let serial = campaign.serial.as_deref()?;
    let ours = device(serial);
    let other = |row: &RawSample| row.device != 0 && ours != 0 && row.device != ours;
    let recording = recordings.iter().find(|recording| recording.rows.iter().any(other))?;
    let message = format!(
        "samples of another device than serial number {serial}; correct the serial number, or accept them: --other-device"
    );
    Some(Finding::fault(name::OTHER_DEVICE, message).at(recording.place()))
}

/// A recording that is there twice: it would count as new data.
fn twice(recordings: &[TumbleRecording]) -> Option<Finding> {
    let same = |(index, one): (usize, &TumbleRecording)| {
        let other =
            recordings[..index].iter().find(|other| other.rows == one.rows || share_rows(&other.rows, &one.rows))?;
        let message = format!(
            "{} and {} are the same recording, as rows of both are equal; name every recording once",
            other.name, one.name
        );
        Some(Finding::fault(name::SAME_RECORDING, message))
    };
    recordings.iter().enumerate().find_map(same)
}

/// Intervals that are not the time from row to row.
fn interval(recording: &TumbleRecording, continuity: &Continuity) -> Option<Finding> {
    Some(continuity.interval()?.finding().at(recording.place()))
}

/// What is wrong with the static poses, before anything is fitted: readings about a centre that no bias explains.
pub(super) fn of_readings(readings: &[Reading], gravity: f64) -> Option<Finding> {
    let found @ Ellipsoid { bias, scale_factor, condition, is_closed } = ellipsoid(readings, gravity)?;
    if let Some(finding) = zeroed(&found, gravity) {
        return Some(finding);
    }
    // Few attitudes show a part of the ellipsoid, whose centre may be anywhere.
    let about = |axis: usize| {
        let off = |reading: &Reading| (reading.net(axis) / scale_factor[axis] - bias[axis]) / gravity;
        readings.iter().any(|reading| off(reading) > AROUND) && readings.iter().any(|reading| off(reading) < -AROUND)
    };
    let axis = (0..AXES).find(|axis| bias[*axis].abs() > MAX_BIAS && about(*axis));
    let axis = axis.filter(|_| is_closed && condition < MAX_CONDITION)?;
    let message = format!(
        "the rates of {} lie about {:.0} pulse/s, which is {:.1} g0: the offset of an unsigned count is left in; take it off with isotherm convert, \
         `offset` in the mapping file",
        AXIS_NAMES[axis],
        bias[axis] * scale_factor[axis],
        bias[axis]
    );
    Some(Finding::fault(name::COUNT_OFFSET, message))
}

/// Exactly one axis whose bias is gravity: a device that takes what it reads at one attitude for its bias.
fn zeroed(found: &Ellipsoid, gravity: f64) -> Option<Finding> {
    let is_gravity = |bias: f64| (bias.abs() - gravity).abs() < ABOUT_GRAVITY * gravity;
    let axis = (0..AXES).find(|axis| is_gravity(found.bias[*axis]))?;
    let others =
        (0..AXES).filter(|other| *other != axis).all(|other| found.bias[other].abs() < ABOUT_GRAVITY * gravity);
    (others && found.is_closed && found.condition < MAX_CONDITION).then(|| {
        let (name, bias) = (AXIS_NAMES[axis], found.bias[axis]);
        let up = if bias < 0.0 { '+' } else { '-' };
        let message = format!(
            "{name} has a bias of {bias:+.2} g0 and reads 0 with {up}{name} up: a self-calibration at that attitude took gravity for a bias; \
             undo it, or take {:.0} pulse/s off with isotherm convert, `offset` in the mapping file",
            bias * found.scale_factor[axis]
        );
        Finding::fault(name::GRAVITY_ZEROED, message)
    })
}

/// A range of the table far beyond the temperature of the static poses.
pub(super) fn unmeasured(ranges: &Ranges, measured: &Ranges) -> Option<Finding> {
    let joint = |all: &Ranges| joint_range(all.iter().flatten().copied());
    let [[low, high], [from, to]] = [joint(ranges), joint(measured)];
    (high - low > MUCH_WIDER * (to - from)).then(|| {
        let message = format!(
            "the table is for temperature from {low} to {high}, but the static poses have {from:.2} to {to:.2}: the \
             intervals hold only in that span, and nothing is known of the rest; tumble at other temperatures, too"
        );
        Finding::warning(name::UNMEASURED, message)
    })
}

/// A warning about temperature in kelvin with the label of degrees Celsius.
pub(super) fn kelvin(campaign: &Campaign, readings: &[Reading]) -> Option<Finding> {
    let lowest = readings.iter().flat_map(|reading| reading.head).fold(f64::INFINITY, f64::min);
    let is_kelvin = campaign.temperature_unit == "degC" && lowest > NO_CELSIUS;
    is_kelvin.then(|| {
        let cause = match lowest > NO_KELVIN {
            true => "it looks like milli-degC: convert it, or state its unit",
            false => "if it is in kelvin, say so: K",
        };
        let message = format!("the temperature is {lowest:.1} degC at least; {cause}");
        Finding::warning(name::TEMPERATURE_OFFSET, message)
    })
}

/// Static poses that were left out because the IMU turned in them: the mean of a specific force that turns by theta is
/// theta^2/24 too short.
pub(super) fn turned(turned: usize, used: usize) -> Option<Finding> {
    (turned > 0).then(|| {
        let message = format!(
            "{turned} of {} static poses are left out: the IMU turned by over 5 mrad in each; put it on firm ground",
            turned + used
        );
        Finding::warning(name::TURNED, message)
    })
}

/// Static poses that no chance explains: each is judged by what the others say under the fit's covariance and by their
/// scatter, at 1 % shared among all.
///
/// ```text
/// P = V^-1 - V^-1 J C J'V^-1,   off_i = (P f)_i / P_ii,   t_i^2 = off_i^2 P_ii (m - 1) / (f'P f - off_i^2 P_ii)
/// ```
pub(super) fn outliers(readings: &[Reading], weighted: &WeightedFit<'_>) -> Vec<Finding> {
    let unknowns = weighted.unknown.len();
    let Some(freedom) = readings.len().checked_sub(unknowns).filter(|freedom| *freedom > 2) else {
        return Vec::new();
    };
    let by_unknowns = weighted.inverse.solve(&weighted.fit.jacobian);
    let whole = weighted.inverse.diagonal();
    let Some(normal) = weighted.fit.jacobian.tr_mul(&by_unknowns).cholesky() else { return Vec::new() };
    let taken = normal.solve(&by_unknowns.transpose());
    let projected =
        weighted.inverse.solve_vector(&weighted.residual) - taken.tr_mul(&by_unknowns.tr_mul(&weighted.residual));
    let projector = |i: usize| whole[i] - by_unknowns.row(i).dot(&taken.column(i).transpose());
    let all = weighted.residual.dot(&projected);
    let limit = student_quantile(1.0 - OUTLIER / readings.len() as f64, freedom - 1);
    let shown = |(i, reading): (usize, &Reading)| {
        let left = projector(i);
        // A static pose that the others do not check has no residual.
        if left < 1e-6 * whole[i] {
            return None;
        }
        let off = projected[i] / left;
        let own = off * off * left;
        let ratio = (own * (freedom - 1) as f64 / (all - own).max(f64::MIN_POSITIVE)).sqrt();
        (ratio > limit).then(|| {
            let message = format!(
                "{:.0} s after the start, it is {:.1}e-6 g0 off, {ratio:.1} times what the others allow (limit {limit:.1}): look at it, or leave \
                 it out: --exclude {}",
                reading.start_s, off * 1e6, reading.number
            );
            Finding::warning(name::OUTLIER, message).at(Location::StaticPose(reading.number))
        })
    };
    readings.iter().enumerate().filter_map(shown).collect()
}

/// Nothing is left to judge the table by.
pub(super) fn no_freedom(poses: usize) -> Finding {
    let message = format!(
        "{poses} static poses for {poses} unknowns: nothing is left to judge the table by, so there are no standard errors; put the \
         IMU down in more attitudes"
    );
    Finding::warning(name::NO_FREEDOM, message)
}

/// Curves that take all that differs between groups.
pub(super) fn not_stated(fitted: &TumbleFit<'_>, groups: &Groups) -> Option<Finding> {
    let order = fitted.model.unknowns.order;
    (groups.count > 1 && groups.count <= order + 1).then(|| {
        let message = format!(
            "{} groups of static poses, by file, power-up and temperature, for order {order}: nothing is left to \
             separate what a group shares from temperature, so no errors of biases and scale factors are stated; \
             take one more group, or a lower order",
            groups.count
        );
        Finding::warning(name::NO_FREEDOM, message)
    })
}

/// Gaps and faults of time in the recordings.
pub(super) fn of_time(recordings: &[TumbleRecording], continuity: &[Continuity], poses: usize) -> Vec<Finding> {
    let mut found = Vec::new();
    // Stamps that jitter or come in bursts are no gaps.
    let gaps = continuity.iter().map(|found| found.losses().gaps).sum::<u64>();
    if gaps > poses as u64 {
        let message = format!("the recordings have {gaps} gaps; look for samples that were lost");
        found.push(Finding::warning(name::MISSING_ROWS, message));
    }
    let fault =
        |(recording, found): (&TumbleRecording, &Continuity)| Some(found.fault()?.finding().at(recording.place()));
    found.extend(recordings.iter().zip(continuity).filter_map(fault));
    found
}
