//! Input: any text as a coefficient table. Every refusal must name a line and a reason. An accepted table that is written and
//! read again must be the same table with the same digest. `checked` must accept its answers to a plausible sample and to samples
//! within, at the ends of and outside its ranges.
#![no_main]

use isotherm_fuzz::{check_faults, checked};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::wire::{MAX_INTERVAL_NS, RawSample};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
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

    let plausible = RawSample {
        timestamp_ns: 60_000_000_000,
        telemetry_ns: 1,
        interval_ns: 2_500_000,
        positive_pulses: [234, 0, 17],
        negative_pulses: [0, 204, 18],
        head_temperature: [1.1; 3],
        board_temperature: [1.2; 3],
        ..RawSample::default()
    };
    checked(Some(&table), &plausible);
    let full = RawSample { interval_ns: MAX_INTERVAL_NS, positive_pulses: [u32::MAX; 3], ..plausible };
    let axes = &table.content().axes;
    for part in [0.0, 0.5, 1.0, -1.0, 2.0] {
        let at = |p: &Polynomial| p.range()[0] * (1.0 - part) + p.range()[1] * part;
        let telemetry = |of: fn(&Axis) -> &Polynomial| axes.each_ref().map(|axis| at(of(axis)));
        for board_temperature in
            [telemetry(|axis| &axis.positive_scale_factor), telemetry(|axis| &axis.negative_scale_factor)]
        {
            checked(
                Some(&table),
                &RawSample { head_temperature: telemetry(|axis| &axis.bias), board_temperature, ..full },
            );
        }
    }
});
