//! What is found in the files of a campaign, for tests here and with real processes.

use serde_json::Value;

/// Asserts that the rows of a turn are one unbroken run of one session, in which a gyroscope has turned by its whole
/// angle.
///
/// # Panics
/// If they are not.
fn assert_whole_turn(unit: &Value, header: &str, rows: &str) {
    let column =
        |name: &str| header.split(',').position(|column| column == name).unwrap_or_else(|| panic!("no {name}"));
    let rows: Vec<Vec<&str>> = rows.lines().map(|row| row.split(',').collect()).collect();
    let number =
        |row: &[&str], name: &str| row[column(name)].parse::<i64>().unwrap_or_else(|error| panic!("{name}: {error}"));
    for pair in rows.windows(2) {
        let same = ["session", "position", "set_point_c", "interval_ns"].map(column);
        assert!(same.iter().all(|&column| pair[0][column] == pair[1][column]), "{unit}\n{pair:?}");
        let step_ns = number(&pair[1], "timestamp_ns") - number(&pair[0], "timestamp_ns");
        assert_eq!(step_ns, number(&pair[1], "interval_ns"), "{unit}\n{pair:?}");
    }
    let pulses = |gyroscope: usize| {
        let [positive, negative] = ["positive", "negative"].map(|channel| format!("g{gyroscope}_{channel}"));
        rows.iter().map(|row| number(row, &positive) - number(row, &negative)).sum::<i64>()
    };
    let turned = (1..=3).map(pulses).map(i64::abs).max().unwrap_or_default() as f64;
    let angle = unit["turn"]["angle_deg"].as_f64().unwrap_or(f64::NAN).abs() * 3600.0;
    // The scale factors are 0.98 to 1.12 pulses per arc second; bias and Earth add or take less than a tenth.
    assert!((0.88..1.23).contains(&(turned / angle)), "{unit}: {turned} pulses for {angle} arcsec");
}

/// The names of the events on a live page, oldest first.
#[must_use]
pub fn events_on_page(page: &str) -> Vec<String> {
    let cells = page.split("<td class=\"").filter(|cell| !cell.starts_with("number") && !cell.starts_with("long"));
    let names = cells.filter_map(|cell| Some(cell.split_once("</span> ")?.1.split_once("</td>")?.0.to_owned()));
    let mut names: Vec<_> = names.collect();
    names.reverse();
    names
}

/// Asserts that the kept units are those from 0 on, each once and in order, that the file has exactly the bytes of the
/// dwells, of so many rows each, and of the turns, and that every turn is whole.
///
/// # Panics
/// If it is not so.
pub fn assert_units(kept: &[Value], samples: &str, units: usize, rows_of_dwell: usize) {
    let number = |unit: &Value, key: &str| unit[key].as_u64().unwrap_or_else(|| panic!("{key}: {unit}")) as usize;
    let numbers: Vec<_> = kept.iter().map(|kept| number(kept, "unit")).collect();
    assert_eq!(numbers, (0..units).collect::<Vec<_>>());
    let (mut end, mut rows) = (0, 0);
    for unit in kept.iter().filter(|kept| kept["file"] == "campaign.csv") {
        let [from, to, of_unit] = ["from", "to", "rows"].map(|key| number(unit, key));
        assert_eq!(from, end, "{unit}");
        if unit["turn"].is_null() {
            assert_eq!(of_unit, rows_of_dwell, "{unit}");
        } else {
            assert_eq!(samples[from..to].lines().count(), of_unit);
            assert_whole_turn(unit, samples.lines().next().unwrap_or_default(), &samples[from..to]);
        }
        (end, rows) = (to, rows + of_unit);
    }
    assert_eq!(samples.len(), end);
    assert_eq!(samples.lines().count(), 1 + rows);
}
