//! Input: any text as a coefficient table. Every refusal must name a line and a reason. An accepted table that is
//! written and read again must be the same table with the same digest. `checked` must accept its answers to a plausible
//! sample and to samples within, at the ends of and outside its ranges. Compared with itself, whatever its provenance
//! says, nothing has changed.

use crate::{check_faults, checked};
use isotherm_analysis::compare;
use isotherm_fit::TableFile;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, Triad};

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else { return };
    let table = match CoefficientTable::from_toml(text, None) {
        Ok(table) => table,
        Err(faults) => return check_faults(text, &faults),
    };
    let written = table.to_toml();
    let again = CoefficientTable::from_toml(&written, Some(&table.content().imu));
    let again = again.unwrap_or_else(|faults| panic!("{faults}\n{written}"));
    assert_eq!(again.digest(), table.digest());
    assert_eq!(again, table);
    let file = TableFile::from_toml("table.toml", text).unwrap_or_else(|faults| panic!("{faults}"));
    let same = compare(vec![file.clone(), file], false).expect("the same ranges");
    assert!(same.changed().is_empty() && same.curves.iter().all(|curve| curve.largest().0 == 0.0), "{same:?}");

    let plausible = plausible(&table);
    checked(Some(&table), &plausible);
    let axes = &table.content().axes;
    let gyroscopes = table.content().gyroscopes.as_ref().map_or(axes, |gyroscopes| &gyroscopes.axes);
    for part in [0.0, 0.5, 1.0, -1.0, 2.0] {
        for of_board in [|axis: &Axis| axis.positive_scale_factor, |axis: &Axis| axis.negative_scale_factor] {
            let (accelerometers, gyroscopes) = (at(part, of_board, axes), at(part, of_board, gyroscopes));
            checked(Some(&table), &RawSample { interval_ns: MAX_INTERVAL_NS, accelerometers, gyroscopes, ..plausible });
        }
    }
}

fn plausible(table: &CoefficientTable) -> RawSample {
    let triad = Triad {
        positive_pulses: [234, 0, 17],
        negative_pulses: [0, 204, 18],
        head_temperature: [1.1; 3],
        board_temperature: [1.2; 3],
        head_lagged: [1.05; 3],
    };
    RawSample {
        timestamp_ns: 60_000_000_000,
        telemetry_ns: 1,
        interval_ns: 2_500_000,
        lag_ns: table.lag_ns(),
        device: 1,
        accelerometers: triad,
        gyroscopes: triad,
        ..RawSample::default()
    }
}

/// A triad with all counts, at a part of the ranges of its biases and of one of the scale factors.
fn at(part: f64, of_board: fn(&Axis) -> Polynomial, axes: &[Axis; AXES]) -> Triad {
    let at = |of: fn(&Axis) -> Polynomial| {
        axes.each_ref().map(|axis| {
            let [low, high] = of(axis).range();
            low * (1.0 - part) + high * part
        })
    };
    Triad {
        positive_pulses: [u32::MAX; AXES],
        head_temperature: at(|axis| axis.bias),
        board_temperature: at(of_board),
        // The other end of the range: no lag difference that is used is larger.
        head_lagged: axes.each_ref().map(|axis| axis.bias.range()[usize::from(part < 0.5)]),
        ..Triad::default()
    }
}
