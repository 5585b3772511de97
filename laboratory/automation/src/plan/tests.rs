//! Plans that are read, and plans that are refused.

use super::*;
use isotherm_campaign::Scheme;

const EXAMPLE: &str = include_str!("../../../../examples/plan.toml");

fn faults(text: &str) -> String {
    Plan::from_toml(text, Path::new("")).err().map(|faults| faults.to_string()).unwrap_or_default()
}

#[test]
fn the_example_says_what_is_the_default_anyway() {
    let plan = Plan::from_toml(EXAMPLE, Path::new("/plans")).unwrap();
    // Not `campaign`, the folder of the campaign that is shipped with the plan.
    assert_eq!(plan.output, Path::new("/plans/imu-a-campaign"));
    assert_eq!((plan.set_points_c.len(), plan.set_points_c[0], plan.set_points_c[14]), (15, -25.0, 45.0));
    assert_eq!(plan.positions, Scheme::SixFacesTwoHeadings.positions());
    assert_eq!(plan.campaign.positions, plan.positions);
    assert_eq!((plan.soak.time_s, plan.verify.as_ref().unwrap().runs, plan.ambient_c), (3600.0, 2, None));
    assert_eq!(plan.warnings(), Vec::<String>::new());
    let without: String = EXAMPLE
        .lines()
        .filter(|line| !["positions", "time_s", "row_s", "settle_s"].iter().any(|key| line.starts_with(key)))
        .map(|line| format!("{line}\n"))
        .collect();
    let shorter = Plan::from_toml(&without, Path::new("/plans")).unwrap();
    assert_eq!(shorter, plan);
}

#[test]
fn alarms_and_faults_that_nobody_reads_are_named() {
    let found = |chamber: &str, table: &str| {
        let text = EXAMPLE.replace("driver = \"espec\"", chamber).replace("driver = \"acutrol\"", table);
        let plan = Plan::from_toml(&text, Path::new("")).unwrap();
        plan.findings().into_iter().map(|finding| (finding.name, finding.message)).collect::<Vec<_>>()
    };
    let [espec, acutrol] = ["driver = \"espec\"", "driver = \"acutrol\""];
    assert_eq!(found(espec, acutrol), []);
    let read = ["driver = \"watlow-f4t\"", "driver = \"ascii2\"\nalarm_bit = 2"];
    for chamber in read {
        assert_eq!(found(chamber, "driver = \"aerosmith\"\nfault_mask = 4"), []);
    }
    for (chamber, key) in [("driver = \"watlow-f4t\"\nalarms = 0", "alarms"), ("driver = \"ascii2\"", "alarm_bit")] {
        let [(alarms, of_alarms), (faults, of_faults)] = &found(chamber, "driver = \"aerosmith\"")[..] else {
            panic!("{chamber}");
        };
        assert_eq!((*alarms, *faults), ("alarms-not-read", "faults-not-read"));
        assert!(of_alarms.contains(&format!("give {key}, ")) && of_faults.contains("give fault_mask, "), "{of_alarms}");
    }
}

#[test]
fn everything_wrong_is_reported_at_once() {
    let text = EXAMPLE
        .replace("imu = \"imu-a\"", "imu = \"IMU A\"\nmax_rate = -1")
        .replace("gravity_local = 9.8015", "gravity_local = 98.1")
        .replace("stop_c = 45", "stop_c = -45")
        .replace("tolerance_deg = 0.005", "tolerance_deg = 0")
        .replace("chamber_c = [-30, 50]", "chamber_c = [-90, 50]")
        .replace("hold_s = 1800", "hold = 1800")
        .replace("driver = \"acutrol\"", "driver = \"acutrol3000\"")
        .replace("driver = \"espec\"", "driver = \"especially\"")
        .replace("ramp_c_per_min = 1\n", "ramp_c_per_min = 5\n")
        .replace("to_c = 45", "to_c = 195")
        .replace("rate_deg_s = 10", "rate_deg_s = 70")
        .replace("acceleration_deg_s2 = 10", "acceleration_deg_s2 = 101");
    let faults = faults(&text);
    assert_eq!(faults.matches("unknown key").count(), 1, "{faults}");
    for part in [
        "max_rate: is -1.0",
        "gravity_local: is 98.1",
        "chamber.ramp_c_per_min: 5.000 degC/min is over limits.ramp_c_per_min",
        "turntable.rate_deg_s: 70.0 deg/s is over",
        "turntable.acceleration_deg_s2: 101.0 deg/s2 is over",
        "turntable.driver: is \"acutrol3000\"",
        "chamber.driver: is \"especially\"",
        "imu: is \"IMU A\"",
        "set_points.step_c",
        "turntable.tolerance_deg",
        "limits.chamber_c: give lowest and highest",
        "verify.to_c: 195.0 degC is outside limits.chamber_c, -65.0 to 100.0 degC",
        "verify.hold:",
    ] {
        assert!(faults.contains(part), "{part}:\n{faults}");
    }
}

/// A missing part is replaced by a valid one, so that the parts that depend on it are checked too.
#[test]
fn one_missing_part_hides_no_other_fault() {
    let wrong = EXAMPLE
        .replace("start_c = -25", "start_c = -35")
        .replace("to_c = 45", "to_c = 95")
        .replace("rate_deg_s = 10", "rate_deg_s = 70")
        .replace("gravity_local = 9.8015", "gravity_local = 98.1");
    for line in ["imu = ", "gravity_reference = ", "temperature_unit = ", "output = ", "driver = ", "from_c = "] {
        let lines = wrong.lines().filter(|other| !other.starts_with(line));
        let faults = faults(&lines.map(|line| format!("{line}\n")).collect::<String>());
        let key = line.split(' ').next().unwrap();
        for part in
            [key, "set_points: -35.0 degC", "verify.to_c: 95.0", "turntable.rate_deg_s: 70.0", "gravity_local: is 98.1"]
        {
            assert!(faults.contains(part), "without {line:?} {part}:\n{faults}");
        }
    }
}

#[test]
fn the_folder_of_the_installed_table_must_be_there_to_run() {
    let folder = tempfile::Builder::new().prefix("iso-").tempdir().unwrap();
    let path = folder.path().join("plan.toml");
    let text = EXAMPLE.replace("install = \"imu-a.toml\"", "install = \"nowhere/imu-a.toml\"");
    std::fs::write(&path, text.replace("hold_s = 1800", "hold = 1800")).unwrap();
    let faults = Plan::load_to_run(&path).unwrap_err().to_string();
    for part in ["install: there is no folder", "nowhere; make it", "verify.hold: unknown key"] {
        assert!(faults.contains(part), "{part}:\n{faults}");
    }
    std::fs::write(&path, text).unwrap();
    assert!(Plan::load(&path).is_ok());
    std::fs::create_dir(folder.path().join("nowhere")).unwrap();
    assert!(Plan::load_to_run(&path).is_ok());
    // The installation writes where a link leads.
    std::os::unix::fs::symlink("gone/imu-a.toml", folder.path().join("nowhere/imu-a.toml")).unwrap();
    let faults = Plan::load_to_run(&path).unwrap_err().to_string();
    assert!(faults.contains("install: there is no folder") && faults.contains("nowhere/gone; make it"), "{faults}");
    std::fs::create_dir(folder.path().join("nowhere/gone")).unwrap();
    assert!(Plan::load_to_run(&path).is_ok());
}

#[test]
fn nothing_beyond_the_limits_is_planned() {
    for (from, to, part) in [
        ("start_c = -25", "start_c = -35", "set_points: -35.0 degC is outside limits.chamber_c"),
        ("start_c = -25", "start_c = -80", "-30.0 to 50.0 degC; so are 10 more set points"),
        ("from_c = -25", "from_c = -31", "verify.from_c: -31.0 degC"),
        (
            "outer_deg = [-5, 365]",
            "outer_deg = [-5, 185]",
            "position 6: outer angle 270.0 deg is outside limits.outer_deg",
        ),
        (
            "chamber_c = [-30, 50]",
            "chamber_c = [-30, 45]",
            "set_points: 45.0 degC, within chamber.tolerance_c: 45.5 degC is outside",
        ),
        ("attitudes_deg = [[50, 130], [230, 130]]", "outer_deg = 500", "verify: outer angle 500.0 deg"),
        ("[230, 130]]", "[230, 430]]", "verify: inner angle 430.0 deg"),
        ("step_c = 5", "step_c = 7.3", "set_points.step_c: 7.3 does not lead"),
        ("step_c = 5", "step_c = 5\nlist_c = [0, 10]", "set_points.start_c: there is list_c too"),
        ("rate_deg_s = 10", "rate_deg_s = 61", "61.0 deg/s is over"),
        ("ramp_c_per_min = 1", "ramp_c_per_min = 4", "4.000 degC/min is over"),
        ("ramp_c_per_h = 20", "ramp_c_per_h = 200", "3.333 degC/min is over"),
        ("chamber = \"standby\"", "chamber = \"ambient\"\nambient_c = 60", "safe.ambient_c: 60.0 degC"),
    ] {
        let faults = faults(&EXAMPLE.replacen(from, to, 1));
        assert!(faults.contains(part), "{part}:\n{faults}");
    }
}

#[test]
fn positions_may_be_listed_and_their_claims_are_checked() {
    let listed = |claim: &str, mounting: &str| {
        let positions: String = (1..)
            .zip(Scheme::SixFacesTwoHeadings.angles())
            .map(|(number, [outer, inner])| {
                let claim = if number == 5 { claim } else { "" };
                format!("[[position]]\nnumber = {number}\nouter_deg = {outer}\ninner_deg = {inner}\n{claim}\n")
            })
            .collect();
        let text = EXAMPLE.replace("positions = \"six-faces-two-headings\"\n", "");
        text.replace("[turntable]", &format!("[turntable]\n{mounting}")) + &positions
    };
    let plain = Plan::from_toml(&listed("specific_force = [1, 0, 0]", ""), Path::new("")).unwrap();
    assert_eq!(plain.positions, Scheme::SixFacesTwoHeadings.positions());
    let wrong = faults(&listed("specific_force = [0, 1, 0]", ""));
    assert!(
        wrong.contains("position.5.specific_force: the angles and the mounting give [1.000, 0.000, 0.000]"),
        "{wrong}"
    );
    // A1 along the turntable's Y, A2 along its Z, A3 along its X.
    let mounting = "mounting = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]";
    let turned = Plan::from_toml(&listed("specific_force = [0, 0, 1]", mounting), Path::new("")).unwrap();
    assert_eq!((turned.positions[4].label.as_str(), turned.positions[4].specific_force), ("+z", [0.0, 0.0, 1.0]));
    assert_eq!(turned.campaign.positions, turned.positions);
    let mirrored = faults(&listed("", "mounting = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"));
    assert!(mirrored.contains("turntable.mounting: give three rows"), "{mirrored}");
    let both = faults(&(EXAMPLE.to_owned() + "[[position]]\nnumber = 1\nouter_deg = 0\ninner_deg = 0\n"));
    assert!(both.contains("give one of the two"), "{both}");
}

/// The example's plan with these lines of `[verify]` in place of its runs and attitudes.
fn verifying(lines: &str) -> String {
    EXAMPLE
        .lines()
        .filter(|line| !["runs = ", "attitudes_deg = "].iter().any(|key| line.starts_with(key)))
        .map(|line| format!("{line}\n{}", if line.starts_with("[verify]") { lines } else { "" }))
        .map(|line| line.trim_end().to_owned() + "\n")
        .collect()
}

fn plan(text: &str) -> Plan {
    Plan::from_toml(text, Path::new("")).unwrap()
}

#[test]
fn runs_alternate_over_their_attitudes() {
    let angles = |lines: &str| {
        let verify = plan(&verifying(lines)).verify.unwrap();
        (0..verify.runs as usize).map(|run| verify.attitude(run).angles.unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(angles(""), [[50.0, 130.0]; 3]);
    assert_eq!(angles("runs = 2\nouter_deg = 30"), [[30.0, 130.0]; 2]);
    assert_eq!(
        angles("runs = 3\nattitudes_deg = [[50, 130], [230, 130]]"),
        [[50.0, 130.0], [230.0, 130.0], [50.0, 130.0]]
    );
    let [first, second] = [0, 1].map(|run| plan(EXAMPLE).verify.unwrap().attitude(run).specific_force);
    assert!(first.iter().zip(second).all(|(a, b)| (a + b).abs() < 1e-12 && a.abs() > 0.4), "{first:?} {second:?}");
    for (lines, part) in [
        ("runs = 1\nattitudes_deg = [[50, 130], [230, 130]]", "verify.runs: is 1, give at least one for each of the 2"),
        ("attitudes_deg = [[50, 130], [230, 130]]\nouter_deg = 50", "verify.outer_deg: there is attitudes_deg too"),
        ("attitudes_deg = []", "verify.attitudes_deg: give outer and inner angle"),
        ("attitudes_deg = [[50, 130, 0]]", "verify.attitudes_deg: give outer and inner angle"),
        ("attitudes_deg = [50, 130]", "verify.attitudes_deg"),
    ] {
        let faults = faults(&verifying(lines));
        assert!(faults.contains(part), "{part}:\n{faults}");
    }
}

#[test]
fn what_the_runs_leave_unseen_is_told_with_its_remedy() {
    let warnings = |text: &str| plan(text).warnings();
    let one = warnings(&verifying(""));
    assert_eq!(
        one,
        [
            "verify: no run drives K- of A1, K+ of A2, K- of A3: mistakes there stay unseen; attitudes_deg = [[50, 130], [230, 130]] \
          drives all six"
        ]
    );
    // An outer axis that goes from 0 to 180 deg: the opposite attitude takes both axes.
    let positions: String = (1..)
        .zip(Scheme::SixFacesTwoHeadings.angles())
        .map(
            |(number, [outer, inner])| {
                if outer > 180.0 { (number, 360.0 - outer, inner + 180.0) } else { (number, outer, inner) }
            },
        )
        .map(|(number, outer, inner)| {
            format!("[[position]]\nnumber = {number}\nouter_deg = {outer}\ninner_deg = {}\n", inner % 360.0)
        })
        .collect();
    let half = verifying("").replace("outer_deg = [-5, 365]", "outer_deg = [-5, 185]");
    let half = warnings(&(half.replace("positions = \"six-faces-two-headings\"", "") + &positions));
    assert!(half[0].contains("attitudes_deg = [[50, 130], [130, 310]] drives all six"), "{half:?}");
    let other = warnings(&verifying("outer_deg = 220"));
    assert!(other[0].contains("attitudes_deg = [[220, 130], [40, 130]] drives"), "{other:?}");
    // The opposite of a face drives one more channel only.
    let face = warnings(&verifying("outer_deg = 0\ninner_deg = 0"));
    assert!(face.len() == 1 && face[0].contains("K+ of A1, K- of A1, K+ of A2, K- of A2, K- of A3"), "{face:?}");
    assert!(face[0].ends_with("0.3 g0 or more along each accelerometer in both directions"), "{face:?}");
    // Runs that are taken stay as they are.
    let more = plan(&verifying("runs = 2")).more_runs().unwrap();
    assert_eq!(more, "runs = 3 and attitudes_deg = [[50, 130], [50, 130], [230, 130]]");

    for (from, to, part) in [("20", "20", "0 %"), ("45", "0", "64 %"), ("-24", "20", "63 %"), ("-29", "-10", "21 %")] {
        let text =
            EXAMPLE.replace("from_c = -25", &format!("from_c = {from}")).replace("to_c = 45", &format!("to_c = {to}"));
        let found = warnings(&text);
        assert!(
            found.len() == 1 && found[0].contains(&format!(" covers {part} of the set points' range")),
            "{found:?}"
        );
        assert!(found[0].ends_with("from_c = -25 and to_c = 45 covers it"), "{found:?}");
    }
    assert_eq!(warnings(&EXAMPLE.replace("to_c = 45", "to_c = 32")), Vec::<String>::new());
}

#[test]
fn positions_that_do_not_observe_everything_are_refused() {
    let positions: String =
        (0..12).map(|k| format!("[[position]]\nnumber = {k}\nouter_deg = 90\ninner_deg = {}\n", 30 * k)).collect();
    let faults = faults(&(EXAMPLE.replace("positions = \"six-faces-two-headings\"\n", "") + &positions));
    assert!(faults.contains("A3"), "{faults}");
}

const WHOLE: &str = include_str!("../../../../examples/plan-whole.toml");

/// The way of each turn: axis, from and to \[deg\].
fn ways(plan: &Plan) -> Vec<(usize, f64, f64)> {
    plan.turns.iter().map(|turn| (turn.axis, turn.from_deg[turn.axis], turn.to_deg[turn.axis])).collect()
}

#[test]
fn a_plan_with_turns_takes_six_whole_turns_within_its_limits() {
    let whole = plan(WHOLE);
    let two = [(0, 0.0, 720.0), (0, 720.0, 0.0), (0, 0.0, 720.0), (0, 720.0, 0.0), (1, 0.0, 720.0), (1, 720.0, 0.0)];
    assert_eq!(ways(&whole), two);
    assert_eq!(whole.turns.iter().map(|turn| turn.number).collect::<Vec<_>>(), [13, 14, 15, 16, 17, 18]);
    assert_eq!([whole.turns[2].from_deg[1], whole.turns[4].from_deg[0]], [90.0, 0.0]);
    assert_eq!(whole.turn, TurnPlan { rest_s: 5.0, rate_deg_s: 10.0, acceleration_deg_s2: 10.0, row_s: 1.0 });
    assert_eq!(whole.size(), "15 set points x (12 positions and 6 turns)");
    // The campaign file has them with the latitude, at the same start.
    assert_eq!((whole.campaign.latitude_deg, whole.campaign.serial.as_deref()), (Some(39.9), Some("SN 42")));
    let in_file: Vec<_> =
        whole.campaign.turns.iter().map(|turn| (turn.axis, turn.angle_deg, turn.start.angles)).collect();
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
    let at = |outer: f64, inner: f64| Some([outer, inner]);
    assert_eq!(
        in_file,
        [
            (x, 720.0, at(0.0, 0.0)),
            (x, -720.0, at(0.0, 0.0)),
            (y, 720.0, at(0.0, 90.0)),
            (y, -720.0, at(0.0, 90.0)),
            (z, 720.0, at(0.0, 0.0)),
            (z, -720.0, at(0.0, 0.0)),
        ]
    );
    // The keys of [turns] are the defaults.
    let section = WHOLE.find("[turns]").unwrap()..WHOLE.find("[chamber]").unwrap();
    let instead = |text: &str| {
        let mut whole = WHOLE.to_owned();
        whole.replace_range(section.clone(), text);
        whole
    };
    assert_eq!(plan(&instead("[turns]\n")), whole);
    // A latitude by itself only checks the local gravity.
    let place = instead("").replace("latitude_deg", "height_m = 0.0\nlatitude_deg");
    assert_eq!(plan(&place).size(), "15 set points x 12 positions");
    // Where two turns do not fit, one does; the other axis may still take two.
    let one = plan(&WHOLE.replace("outer_deg = [-5, 720]", "outer_deg = [-5, 365]"));
    assert_eq!(ways(&one)[1..5], [(0, 360.0, 0.0), (0, 0.0, 360.0), (0, 360.0, 0.0), (1, 0.0, 720.0)]);
    // Two turns from one end to the other.
    let both = plan(&WHOLE.replace("outer_deg = [-5, 720]", "outer_deg = [-365, 365]"));
    assert_eq!(ways(&both)[..2], [(0, -360.0, 360.0), (0, 360.0, -360.0)]);
    // A plan without [turns] has none, and none in its campaign file.
    let without = plan(EXAMPLE);
    assert_eq!(
        (without.turns.len(), without.campaign.turns.len(), without.size()),
        (0, 0, "15 set points x 12 positions".to_owned())
    );
    assert!(without.identity().iter().all(|(key, _)| !key.starts_with("turn.") && !key.starts_with("turns.")));
    assert!(whole.identity().contains(&("turn.14".to_owned(), "[720.0, 0.0] to [0.0, 0.0] deg".to_owned())));
    assert!(whole.identity().contains(&("latitude_deg".to_owned(), "39.9".to_owned())));
}

/// A turn as in a campaign file: number, axis, angle, outer and inner angle.
type ListedTurn = (u32, &'static str, f64, f64, f64);

fn listed(turns: &[ListedTurn]) -> String {
    let turns = turns.iter().map(|(number, axis, angle, outer, inner)| {
        format!("[[turn]]\nnumber = {number}\naxis = {axis}\nangle_deg = {angle}\nouter_deg = {outer}\ninner_deg = {inner}\n")
    });
    WHOLE.replace("[-5, 720]", "[-5, 365]") + &turns.collect::<String>()
}

const LISTED: [ListedTurn; 6] = [
    (21, "[1, 0, 0]", 360.0, 0.0, 0.0),
    (22, "[1, 0, 0]", -360.0, 0.0, 0.0),
    (23, "[0, 1, 0]", 360.0, 0.0, 90.0),
    (24, "[0, -1, 0]", 360.0, 0.0, 90.0),
    (25, "[0, 0, 1]", 180.0, 0.0, 0.0),
    (26, "[0, 0, 1]", -180.0, 0.0, 180.0),
];

#[test]
fn turns_may_be_listed_as_in_a_campaign_file_and_begin_within_the_limits() {
    let found = plan(&listed(&LISTED));
    // The second begins where the first has ended; the third goes the other way, about the opposite of the axis.
    let expected =
        [(0, 0.0, 360.0), (0, 360.0, 0.0), (0, 360.0, 0.0), (0, 0.0, 360.0), (1, 0.0, 180.0), (1, 180.0, 0.0)];
    assert_eq!(ways(&found), expected);
    assert_eq!(found.campaign.turns[1].start.angles, Some([0.0, 0.0]), "the campaign file has what is stated");
    // The IMU is mounted in another way: A1 along the turntable's Y, A2 along its Z, A3 along its X.
    let mounted = listed(&LISTED.map(|(number, axis, angle, outer, inner)| {
        let axis = match axis {
            "[1, 0, 0]" => "[0, 0, 1]",
            "[0, 1, 0]" => "[1, 0, 0]",
            "[0, -1, 0]" => "[-1, 0, 0]",
            _ => "[0, 1, 0]",
        };
        (number, axis, angle, outer, inner)
    }));
    let mounted = mounted.replace("[turntable]", "[turntable]\nmounting = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]");
    assert_eq!(ways(&plan(&mounted)), expected);
}

#[test]
fn every_fault_of_the_turns_is_named() {
    let with = |change: fn(&mut [ListedTurn; 6])| {
        let mut turns = LISTED;
        change(&mut turns);
        listed(&turns)
    };
    for (text, part) in [
        (with(|turns| turns[1].0 = 21), "turn.2.number: 21 is there twice"),
        (with(|turns| turns[1].0 = 7), "turn.2.number: 7 is the number of a position"),
        (with(|turns| turns[2].2 = 0.0), "turn.3.angle_deg: is 0"),
        (with(|turns| turns[2].1 = "[1, 1, 0]"), "turn.3.axis: give the unit vector"),
        (
            with(|turns| turns[2].1 = "[1, 0, 0]"),
            "turn.3.axis: is [1, 0, 0], which is not an axis of the turntable \
            there",
        ),
        (
            with(|turns| turns[0].2 = 400.0),
            "turn.1.angle_deg: turn 21 from 0.0 to 400.0 deg: outer angle 400.0 deg is outside limits.outer_deg, -5.0 to 365.0 deg",
        ),
        (
            with(|turns| turns[4].3 = 400.0),
            "turn.5.angle_deg: turn 25 from 0.0 to 180.0 deg: outer angle 400.0 deg is outside",
        ),
        (with(|turns| turns[1].2 = 360.0), "K- of G1: no turn drives it negative"),
        (listed(&LISTED).replace("latitude_deg = 39.9", "# none"), "latitude_deg: missing"),
        (listed(&LISTED).replace("latitude_deg = 39.9", "latitude_deg = 99"), "latitude_deg: is 99.0, give -90 to 90"),
        (WHOLE.replace("latitude_deg = 39.9", "# none"), "latitude_deg: missing; turns need it"),
        (
            WHOLE.replace("row_s = 1 ", "row_s = 4 "),
            "turns.row_s: at 10.0 deg/s a row is 40.0 deg long, give at most 2.900 s",
        ),
        (WHOLE.replace("rest_s = 5", "rest_s = 0.5"), "turns.row_s: is 1.0, give a number over 0 and up to 0.5"),
        (WHOLE.replace("rest_s = 5", "rest_s = -1"), "turns.rest_s: is -1.0"),
        (WHOLE.replace("rest_s = 5", "rest = 5"), "turns.rest: unknown key"),
        (
            WHOLE
                .replace("[limits]", "[limits]\nrate_deg_s = 5")
                .replace("rate_deg_s = 10", "rate_deg_s = 4")
                .replacen("rate_deg_s = 4", "rate_deg_s = 6", 1),
            "turns.rate_deg_s: 6.0 deg/s is over limits.rate_deg_s",
        ),
        (
            WHOLE.replace("inner_deg = [-5, 720]", "inner_deg = [-5, 355]"),
            "turns: the turntable takes whole turns: turn 17 from 0.0 to 360.0 deg: inner angle 360.0 deg is outside limits.inner_deg",
        ),
    ] {
        let faults = faults(&text);
        assert!(faults.contains(part), "{part}:\n{faults}");
        assert!(faults.contains("line "), "{faults}");
    }
}

/// The example's plan with this ramp.
fn ramping(lines: &str) -> String {
    format!("{EXAMPLE}\n[[ramp]]\n{lines}")
}

#[test]
fn a_ramp_is_one_recording_of_the_campaign_file() {
    let text = ramping("from_c = 45\nto_c = -25\nramp_c_per_h = 60\nhold_s = 5400\n");
    let two = plan(&(text + "[[ramp]]\nfrom_c = 10\nto_c = 20\nouter_deg = 90\ninner_deg = 90\n"));
    let [first, second] = [&two.ramps[0], &two.ramps[1]];
    let way = ThereAndBack { from_c: 45.0, to_c: -25.0, ramp_c_per_s: 60.0 / 3600.0, hold_s: 5400.0 };
    assert_eq!((first.way, first.attitude.angles), (way, Some([0.0; 2])));
    assert_eq!(way.time_s(), 2.0 * 70.0 * 60.0 + 3.0 * 5400.0);
    assert_eq!((second.way.ramp_c_per_s * 3600.0, second.way.hold_s), (20.0, 1800.0));
    assert_eq!(two.size(), "15 set points x 12 positions, 2 ramps");
    let files: Vec<_> = two.campaign.ramps.iter().map(|ramp| (ramp.samples.as_str(), ramp.specific_force)).collect();
    let force = |ramp: &RampPlan| Some(ramp.attitude.specific_force);
    assert_eq!(files, [("ramp-1.csv", force(first)), ("ramp-2.csv", force(second))]);
    assert_eq!(first.attitude.specific_force, [0.0, 0.0, 1.0]);
    let identity = two.identity();
    let settings = |key: &str| identity.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str());
    assert_eq!(
        settings("ramp.1"),
        Some("45.0 to -25.0 degC and back at 60.0 degC/h, hold 5400.0 s, at [0.0, 0.0] deg")
    );
    assert!(settings("ramp.2").is_some() && settings("ramp.3").is_none());
}

#[test]
fn a_ramp_beyond_the_limits_is_refused_with_line_and_key() {
    let right = "from_c = -25\nto_c = 45\nramp_c_per_h = 60\nhold_s = 1800\nouter_deg = 0\ninner_deg = 0\n";
    let line = EXAMPLE.lines().count() + 2;
    for (from, to, after, part) in [
        (
            "from_c = -25",
            "from_c = -31",
            1,
            "ramp.1.from_c: -31.0 degC is outside limits.chamber_c, -30.0 to 50.0 degC",
        ),
        ("to_c = 45", "to_c = 49.8", 2, "ramp.1.to_c: 49.8 degC, within chamber.tolerance_c: 50.3 degC is outside"),
        ("to_c = 45", "to_c = -24", 2, "ramp.1.to_c: is -24.0, as from_c within chamber.tolerance_c"),
        ("to_c = 45\n", "", 0, "ramp.1.to_c: missing; give the chamber's temperature at the other end"),
        ("= 60", "= 181", 3, "ramp.1.ramp_c_per_h: 3.017 degC/min is over limits.ramp_c_per_min, 3.0"),
        ("= 60", "= 0", 3, "ramp.1.ramp_c_per_h: is 0.0"),
        ("hold_s = 1800", "hold_s = -1", 4, "ramp.1.hold_s: is -1.0"),
        ("hold_s = 1800", "hold = 1800", 4, "ramp.1.hold: unknown key"),
        ("outer_deg = 0", "outer_deg = 400", 0, "ramp.1: outer angle 400.0 deg is outside limits.outer_deg"),
    ] {
        let faults = faults(&ramping(&right.replacen(from, to, 1)));
        let place = format!("line {}", line + after);
        assert!(
            faults.contains(part) && faults.contains(&place) && faults.lines().count() == 1,
            "{place}: {part}\n{faults}"
        );
    }
    assert_eq!(faults(&ramping(right)), "");
}
