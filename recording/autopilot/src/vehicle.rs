//! The parameters of several IMUs of one vehicle, as one file.

use crate::autopilot::Autopilot;
use crate::export::{Difference, ExportedParameters};
use crate::px4;
use isotherm_shared::units::SensorKind;

/// The parameters of all IMUs of a vehicle, each with its name for messages; `None` of one that has no table.
///
/// PX4 compensates all accelerometers or none (`TC_A_ENABLE`), and the gyroscopes likewise. So what enables them is
/// written only if all IMUs have parameters; otherwise a note says which have none: on board may be old parameters of
/// these. ArduPilot enables each IMU by itself.
///
/// Of what was left out, and of the differences, the result has those of all; the range is that of all together. Its
/// notes are about the file; those of each IMU are not repeated.
#[must_use]
pub fn vehicle(autopilot: Autopilot, imus: &[(&str, Option<&ExportedParameters>)]) -> ExportedParameters {
    let all: Vec<_> = imus.iter().filter_map(|(_, exported)| *exported).collect();
    let (text, notes) = match autopilot {
        Autopilot::Px4 => px4_file(imus),
        Autopilot::ArduPilot => (all.iter().map(|exported| exported.text.as_str()).collect(), Vec::new()),
    };
    let largest = |values: &mut dyn Iterator<Item = f64>| values.reduce(f64::max);
    let accelerometers = largest(&mut all.iter().map(|it| it.difference.accelerometers));
    let gyroscopes = largest(&mut all.iter().filter_map(|it| it.difference.gyroscopes));
    let range = all.iter().map(|it| it.range).reduce(|[a, b], [low, high]| [a.min(low), b.max(high)]);
    ExportedParameters {
        text,
        lost: all.iter().flat_map(|exported| exported.lost.clone()).collect(),
        difference: Difference { accelerometers: accelerometers.unwrap_or(0.0), gyroscopes },
        range: range.unwrap_or_default(),
        notes,
    }
}

/// The text of PX4's file, and what it lacks.
fn px4_file(imus: &[(&str, Option<&ExportedParameters>)]) -> (String, Vec<String>) {
    let (mut text, mut notes) = (px4::HEAD.to_owned(), Vec::new());
    let kinds = [SensorKind::Accelerometer, SensorKind::Gyroscope];
    let enables = kinds.map(px4::enable_line);
    for (kind, enable) in kinds.into_iter().zip(&enables) {
        let has = |exported: &Option<&ExportedParameters>| exported.is_some_and(|it| it.text.contains(enable.as_str()));
        let without: Vec<_> = imus.iter().filter(|(_, exported)| !has(exported)).map(|(name, _)| *name).collect();
        match without.len() {
            0 => text += enable,
            count if count == imus.len() => {}
            _ => notes.push(format!(
                "{} is left out, because it holds for all IMUs, and {} has no parameters here; set it to 1 yourself \
                 to compensate only the others",
                px4::enable(kind),
                without.join(", ")
            )),
        }
    }
    for exported in imus.iter().filter_map(|(_, exported)| *exported) {
        let lines = exported.text.strip_prefix(px4::HEAD).unwrap_or(&exported.text);
        text.extend(lines.split_inclusive('\n').filter(|line| !enables.iter().any(|enable| enable == line)));
    }
    (text, notes)
}
