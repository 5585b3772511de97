//! What is refused, by name: in the campaign file, in the rows, in the list of positions and turns.

use super::data::text;
use super::station::{Station, TestTurn};
use isotherm_campaign::Campaign;
use isotherm_fit::{
    Calibration, CalibrationError, CalibrationOptions, TriadObservability, calibrate, read_measurements,
};
use isotherm_recording::CampaignRow;
use isotherm_shared::wire::Triad;
use isotherm_support::finding::name;
use nalgebra::{Rotation3, Unit, Vector3};

#[test]
fn turns_of_a_campaign_file_are_refused_with_line_and_key() {
    let good = text("campaign.toml");
    let campaign = Campaign::from_toml(&good).unwrap();
    assert_eq!((campaign.turns.len(), campaign.latitude_deg), (6, Some(39.9)));
    assert_eq!(campaign.turns[2].axis, [0.0, -1.0, 0.0]);
    for (from, to, expected) in [
        ("latitude_deg = 39.9", "", "line 1: latitude_deg: missing; give the latitude"),
        ("latitude_deg = 39.9", "latitude_deg = 139.9", "line 6: latitude_deg: is 139.9, give -90 to 90"),
        ("axis = [1, 0, 0]", "axis = [1, 1, 0]", "turn.1.axis: give the unit vector"),
        ("axis = [1, 0, 0]", "axis = [1, 0]", "turn.1.axis: give the unit vector"),
        (
            "axis = [0, -1, 0]",
            "axis = [1, 0, 0]",
            "turn.3.axis: is [1, 0, 0], which is not an axis of the turntable there; give the outer axis, [0, -1, \
             0], or the inner one, [0, 0, 1]",
        ),
        ("angle_deg = 360 ", "angle_deg = 0 ", "turn.1.angle_deg: is 0"),
        ("angle_deg = 360 ", "angle_deg = 1e300 ", "turn.1.angle_deg: is 1e300, give at most 36000 degrees"),
        ("number = 14", "number = 13", "turn.2.number: 13 is there twice"),
        ("number = 14", "number = 12", "turn.2.number: 12 is the number of a position"),
        ("number = 14\n", "", "turn.2.number: missing"),
        (
            "inner_deg = 90\nspecific_force = [0, 0, 1]\n\n[[turn]]\nnumber = 16",
            "specific_force = [0, 0, 1]\n\n[[turn]]\nnumber = 16",
            "turn.3: give both",
        ),
        (
            "outer_deg = 0   # where it begins\ninner_deg = 0\n",
            "",
            "turn.1: give outer_deg and inner_deg, where the turn begins",
        ),
        (
            "inner_deg = 0\nspecific_force = [0, 0, 1]\n\n[[turn]]\nnumber = 14",
            "inner_deg = 0\nspecific_force = [0, 1, 0]\n\n[[turn]]\nnumber = 14",
            "turn.1.specific_force: contradicts outer_deg and inner_deg, at which it is [0, 0, 1]",
        ),
        ("outer_deg = 0\ninner_deg = 180\n", "", "position: some have outer_deg and inner_deg, others have not"),
        ("angle_deg = -360", "angle = -360", "turn.2.angle: unknown key"),
    ] {
        assert!(good.contains(from), "{from}");
        let faults = Campaign::from_toml(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(faults.contains(expected), "{from} -> {to}: {faults}");
    }
    // Another fault of the file does not make the turns unknown.
    let faults = Campaign::from_toml(&good.replacen("imu = \"imu-g\"\n", "", 1)).unwrap_err();
    assert_eq!(faults.0.len(), 1, "{faults}");
    // Without angles anywhere, the turns must have none either.
    let without: String = good
        .lines()
        .filter(|line| !line.starts_with("inner_deg") && !line.starts_with("outer_deg"))
        .map(|line| format!("{line}\n"))
        .collect();
    assert_eq!(Campaign::from_toml(&without).unwrap().mount, None);
    let one = without.replacen("angle_deg = 360", "outer_deg = 0\ninner_deg = 0\nangle_deg = 360", 1);
    let faults = Campaign::from_toml(&one).unwrap_err().to_string();
    assert!(faults.contains("turn.1.outer_deg: the positions have no angles"), "{faults}");
    let last = without.rfind("specific_force").unwrap();
    let faults = Campaign::from_toml(&without[..last]).unwrap_err().to_string();
    assert!(faults.contains("turn.6.specific_force: missing"), "{faults}");
    let turn = &good[good.rfind("[[turn]]").unwrap()..];
    let many: String = (100..200).map(|number| turn.replace("number = 18", &format!("number = {number}"))).collect();
    let faults = Campaign::from_toml(&format!("{good}{many}")).unwrap_err().to_string();
    assert!(faults.contains("turn: a campaign with turns has at most 100 of them"), "{faults}");
    // A latitude without height needs turns.
    let no_turns = &good[..good.find("[[turn]]").unwrap()];
    let faults = Campaign::from_toml(no_turns).unwrap_err().to_string();
    assert!(faults.contains("give both latitude_deg and height_m"), "{faults}");
}

/// Calibrates rows that `change` has spoiled.
fn spoiled(change: impl Fn(&mut Vec<CampaignRow>)) -> Result<Calibration, String> {
    let station = Station { set_points: vec![-20.0, 0.0, 20.0, 40.0], ..Station::new(40) };
    let mut rows = station.rows();
    change(&mut rows);
    let options = CalibrationOptions { order: Some(2), ..CalibrationOptions::default() };
    station.calibrate_rows(rows, options).map_err(|error| error.to_string())
}

fn turn(set_point: f64, number: u32) -> impl Fn(&CampaignRow) -> bool {
    move |row| row.set_point_c == set_point && row.position == Some(number)
}

/// The rows of a turn, by their indices.
fn of(rows: &[CampaignRow], number: u32) -> Vec<usize> {
    (0..rows.len()).filter(|row| turn(0.0, number)(&rows[*row])).collect()
}

/// What concerns the whole campaign is the first line.
#[test]
fn one_cause_of_all_rows_is_the_first_line() {
    fn exchange(rows: &mut [CampaignRow], order: [usize; 3]) {
        for row in rows {
            let all = row.sample.gyroscopes;
            let own = &mut row.sample.gyroscopes;
            own.positive_pulses = order.map(|axis| all.positive_pulses[axis]);
            own.negative_pulses = order.map(|axis| all.negative_pulses[axis]);
        }
    }
    type Change = fn(&mut Vec<CampaignRow>);
    let cases: [(&str, Change, &str); 3] = [
        ("G1 and G2", |rows| exchange(rows, [1, 0, 2]), "G1 and G2 look exchanged: exchange their cables or columns"),
        ("all", |rows| exchange(rows, [1, 2, 0]), "the gyroscopes look exchanged: G1 is in the columns g3, G2"),
        (
            "16 bits",
            |rows| {
                for row in rows {
                    let all = &mut row.sample.accelerometers;
                    let counts = all.positive_pulses.iter_mut().chain(&mut all.negative_pulses);
                    counts.for_each(|count| *count &= 0xffff);
                }
            },
            "the counters of A1+, A1-, A2+, A2-, A3+, A3- wrap within a row: A1+ counts ",
        ),
    ];
    for (name, change, expected) in cases {
        let refused = spoiled(change).map(|_| ()).unwrap_err();
        println!("{name}: {refused}\n");
        let first = refused.lines().next().unwrap_or_default();
        assert!(first.contains(expected), "{name}: {refused}");
        assert!(refused.lines().count() <= 2, "{name}: {refused}");
        assert!(!refused.contains("say the opposite") && !refused.contains("correct its angles"), "{name}: {refused}");
    }
}

#[test]
fn turns_that_were_disturbed_are_refused_by_name() {
    assert!(spoiled(|_| {}).is_ok());
    type Change = fn(&mut Vec<CampaignRow>);
    let cases: [(&str, Change, &[&str]); 12] = [
        (
            "missing",
            |rows| rows.retain(|row| !turn(0.0, 103)(row)),
            &["set point 0 degC: turn 103 of the campaign file is missing"],
        ),
        (
            "begins late",
            |rows| {
                let of = of(rows, 102);
                rows.drain(of[0]..of[8]);
            },
            &["turn 102: it does not begin at rest: G1 is 10.0"],
        ),
        (
            "ends early",
            |rows| {
                let of = of(rows, 102);
                rows.drain(of[of.len() - 9]..=of[of.len() - 1]);
            },
            &["turn 102: it does not end at rest: G1 is 10.0"],
        ),
        (
            "a row is lost",
            |rows| {
                let of = of(rows, 105);
                rows.remove(of[20]);
            },
            &["turn 105: rows are missing by their sequences"],
        ),
        (
            "10 ms are lost",
            |rows| {
                let of = of(rows, 105);
                rows[of[20]].sample.interval_ns -= 10_000_000;
            },
            &["turn 105: its intervals add up to", "10.0 ms are lost"],
        ),
        (
            "another session",
            |rows| {
                let of = of(rows, 105);
                rows[of[20]..].iter_mut().for_each(|row| row.sample.session = 9);
            },
            &["turn 105: rows are missing by their sequences"],
        ),
        (
            "exchanged",
            |rows| {
                for row in rows.iter_mut().filter(|row| turn(0.0, 103)(row) || turn(0.0, 104)(row)) {
                    row.position = row.position.map(|number| 207 - number);
                }
            },
            &[
                "turn 104: the pulses of G2 say the opposite direction",
                "turn 103: the pulses of G2 say the opposite direction",
            ],
        ),
        (
            "twice the angle",
            |rows| {
                for row in rows.iter_mut().filter(|row| turn(0.0, 105)(row)) {
                    row.sample.gyroscopes.positive_pulses[2] *= 2;
                }
            },
            &["turn 105: the pulses of G3 show 719.7 deg", "and the campaign file 360 deg"],
        ),
        (
            "no pulses",
            |rows| rows.iter_mut().for_each(|row| row.sample.gyroscopes.negative_pulses[1] = 0),
            &["turn 103, at every set point: G2 gives no pulses"],
        ),
        (
            "no columns",
            |rows| rows.iter_mut().for_each(|row| row.sample.gyroscopes = Triad::default()),
            &["the campaign file has turns, but the samples have no gyroscopes"],
        ),
        (
            "moved in a dwell",
            |rows| {
                let row = rows.iter_mut().filter(|row| turn(0.0, 7)(row)).nth(11).unwrap();
                row.sample.gyroscopes.positive_pulses[2] += 3600;
            },
            &["set point 0 degC, position 7: G3 turns by 0.1", "within the dwell"],
        ),
        (
            "a dead thermistor",
            |rows| rows.iter_mut().for_each(|row| row.sample.gyroscopes.head_temperature[1] = 2.0),
            &["g2_head is the same at every set point"],
        ),
    ];
    for (name, change, expected) in cases {
        let refused = spoiled(change).map(|_| ()).unwrap_err();
        println!("{name}: {refused}\n");
        for words in expected {
            assert!(refused.contains(words), "{name}: {refused}");
        }
    }
}

#[test]
fn rows_that_are_too_long_are_refused() {
    // Rows of 10 s would give D 0.007, s 0.01, M 1e-5.
    let station = Station { turn_row: 10.0, rest: 12.0, set_points: vec![-20.0, 20.0], ..Station::new(41) };
    let refused =
        station.calibrate(CalibrationOptions { order: Some(1), ..CalibrationOptions::default() }).unwrap_err();
    assert!(
        refused
            .to_string()
            .contains("turn 101, at every set point: it turns by 100 deg in a row of 10.00 s; at most 30 deg"),
        "{refused}"
    );
}

#[test]
fn rows_that_cannot_be_used_end_the_reading() {
    let station = Station { set_points: vec![0.0], ..Station::new(42) };
    let campaign = station.campaign();
    for (change, expected) in [
        (
            (|triad| triad.board_temperature[2] = f64::NAN) as fn(&mut Triad),
            "line 12: set point 0 degC, position 1: g3_board is NaN",
        ),
        (|triad| triad.positive_pulses[0] = u32::MAX, "the counter of G1 is full: saturated"),
    ] {
        let mut rows = station.rows();
        change(&mut rows[10].sample.gyroscopes);
        let refused = read_measurements(&campaign, rows.into_iter().map(Ok)).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn disturbed_turns_can_be_left_out_or_accepted() {
    let station = Station { set_points: vec![-20.0, 0.0, 20.0, 40.0], ..Station::new(43) };
    let mut rows = station.rows();
    rows.retain(|row| !turn(0.0, 103)(row));
    let options = |exclude: &[(f64, u32)]| CalibrationOptions {
        order: Some(2),
        exclude: exclude.to_vec(),
        ..CalibrationOptions::default()
    };
    // A turn that is missing is left out as one that is there: then nothing drives its channel at this set point.
    let refused = station.calibrate_rows(rows.clone(), options(&[(0.0, 103)])).unwrap_err();
    assert!(matches!(refused, CalibrationError::SetPoint { .. }), "{refused}");
    // Without the whole set point there is a table.
    let all: Vec<(f64, u32)> = (1..=12).chain(101..=106).map(|number| (0.0, number)).collect();
    assert_eq!(station.calibrate_rows(rows.clone(), options(&all)).unwrap().set_points.len(), 3);
    let refused = station.calibrate_rows(rows, options(&[(7.0, 103)])).unwrap_err();
    assert!(matches!(refused, CalibrationError::NothingToExclude(7.0, 103)), "{refused}");
    // A dwell that is left out is left out of both triads.
    let without = station.calibrate(options(&[(0.0, 3)])).unwrap();
    assert_eq!((without.dwells.len(), without.gyroscopes.unwrap().runs.len()), (47, 47 + 24));
    // A turn that is there can be left out, but then nothing drives K- of G2 at this set point.
    let refused = station.calibrate(options(&[(0.0, 103)])).unwrap_err().to_string();
    assert!(
        refused
            .starts_with("set point 0 degC: K- of G2: no turn drives it negative; add angle_deg < 0 about [0, 1, 0]"),
        "{refused}"
    );
    // With another turn of this direction the disturbed one is left out, and the table is as good.
    let mut station = station.fine();
    station.turns.push(TestTurn { number: 107, ..station.turns[2] });
    let mut rows = station.rows();
    let lost = of(&rows, 103)[20];
    rows.remove(lost);
    assert!(station.calibrate_rows(rows.clone(), options(&[])).is_err());
    let calibration = station.calibrate_rows(rows.clone(), options(&[(0.0, 103)])).unwrap();
    let runs = &calibration.gyroscopes.as_ref().unwrap().runs;
    assert_eq!(runs.len(), 4 * 12 + 4 * 7 - 1);
    let excluded = station.errors(&calibration)[1];
    // Accepted, the lost row is in the fit: 10 deg of 360 are missing.
    let accept = CalibrationOptions { accept: vec![name::TURN_GAP, name::TURN_ANGLE], ..options(&[]) };
    let accepted = station.calibrate_rows(rows, accept).unwrap();
    assert_eq!(accepted.accepted, [name::TURN_GAP, name::TURN_ANGLE]);
    assert!(station.errors(&accepted)[1] > 100.0 * excluded, "{excluded}");
}

#[test]
fn gyroscopes_without_turns_are_said_in_a_line() {
    let station = Station { turns: Vec::new(), set_points: vec![-20.0, 0.0, 20.0, 40.0], ..Station::new(44) };
    let file = station.file().replace("latitude_deg", "height_m = 4.0\nlatitude_deg").replace("9.80123", "9.8015");
    let file = Campaign::from_toml(&file)
        .or_else(|_| {
            Campaign::from_toml(
                &station
                    .file()
                    .lines()
                    .filter(|line| !line.starts_with("latitude"))
                    .map(|line| format!("{line}\n"))
                    .collect::<String>(),
            )
        })
        .unwrap();
    let options = || CalibrationOptions { order: Some(2), ..CalibrationOptions::default() };
    let measurements = read_measurements(&file, station.rows().into_iter().map(Ok)).unwrap();
    let calibration = calibrate(&file, measurements, options()).unwrap();
    assert_eq!(calibration.findings.iter().map(|finding| finding.name).collect::<Vec<_>>(), [name::NO_TURNS]);
    assert!(calibration.gyroscopes.is_none() && calibration.table.content().gyroscopes.is_none());
    assert_eq!(calibration.table.content().format, 1);
    // An IMU without gyroscopes sees nothing of it.
    let rows = station.rows().into_iter().map(|mut row| {
        row.sample.gyroscopes = Triad::default();
        Ok(row)
    });
    let measurements = read_measurements(&file, rows).unwrap();
    assert_eq!(calibrate(&file, measurements, options()).unwrap().findings, []);
}

#[test]
fn what_positions_and_turns_leave_open_is_named_with_what_would_help() {
    let station = Station::new(45);
    let of = |positions: &[[f64; 2]]| {
        TriadObservability::of(&Station { positions: positions.to_vec(), ..station.clone() }.campaign())
    };
    let all = of(&station.positions);
    println!("{all:?}");
    assert_eq!((all.rank, all.unknowns, all.deficiencies.len()), (26, 26, 0));
    // Three faces in one heading, with the six turns, are enough for the gyroscopes.
    let three = of(&[[0.0, 0.0], [90.0, 0.0], [90.0, 90.0]]);
    assert!(three.rank == 26 && three.condition > 10.0 * all.condition, "{three:?}");
    // A mounting whose inner axis has the same angle to all gyroscopes: two turns drive every channel, but do not
    // distinguish misalignments.
    let diagonal = Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
    let mount = *Rotation3::rotation_between(&Vector3::z(), &diagonal).unwrap().matrix();
    let axis: [f64; 3] = diagonal.into_inner().into();
    let turned = |number, angle| TestTurn { number, axis, angle, outer: 0.0, inner: 0.0 };
    let skew = Station { mount, turns: vec![turned(101, 360.0), turned(102, -360.0)], ..station.clone() };
    let found = TriadObservability::of(&skew.campaign());
    println!("{found:?}");
    let text = found.deficiencies.join("\n");
    assert!(found.rank < 26 && text.contains("misalignment of G1 onto G2") && text.contains("K+ of G1"), "{text}");
    assert!(text.contains("missing: turns of 360 and -360 degrees about"), "{text}");
    let refused = skew.calibrate(CalibrationOptions::default()).unwrap_err();
    assert!(matches!(refused, CalibrationError::Positions(_)), "{refused}");
    // By hand, only up and down: the g-sensitivity along the other axes is open.
    let by_hand = Station { angles: false, positions: station.positions[..4].to_vec(), ..station };
    let found = TriadObservability::of(&by_hand.campaign());
    println!("{found:?}");
    let text = found.deficiencies.join("\n");
    assert!(found.unknowns == 24, "{found:?}");
    assert!(text.is_empty() || text.contains("g-sensitivity"), "{text}");
}

#[test]
fn a_disturbed_dwell_or_turn_is_named_and_kept() {
    let station = Station::new(46).noisy();
    // 60 arcsec in a dwell and in a turn; 0.01 deg of the table.
    let disturbed = |number: u32, axis: usize, pulses: u32| {
        let mut rows = station.rows();
        let row = of(&rows, number)[20];
        rows[row].sample.gyroscopes.positive_pulses[axis] += pulses;
        let calibration = station.calibrate_rows(rows, CalibrationOptions::default()).unwrap();
        calibration.findings.iter().map(|finding| format!("{finding}\n")).collect::<String>()
    };
    assert_eq!(disturbed(3, 2, 0), "");
    let text = disturbed(3, 2, 60);
    println!("{text}");
    assert!(text.contains("set point 0 degC, position 3: G3 is 5") && text.contains("--exclude 0/3"), "{text}");
    let text = disturbed(101, 1, 70);
    println!("{text}");
    assert!(text.contains("set point 0 degC, turn 101: G2 is ") && text.contains("--exclude 0/101"), "{text}");
}
