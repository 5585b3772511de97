use super::*;
use crate::step::CampaignStep;
use isotherm_campaign::specific_force;

const EXAMPLE: &str = include_str!("../../../../../examples/plan.toml");
const TURNED: [[f64; 3]; 3] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
const IMUS: &str = r#"imus = [
    { id = "imu-a", serial = "SN 1", install = "imu-a.toml" },
    { id = "imu-b", serial = "SN # 2", mounting = [[0, 1, 0], [0, 0, 1], [1, 0, 0]], install = "imu-b.toml" },
]"#;

/// The plan `text` of one IMU, for these IMUs in its place.
fn with_imus(text: &str, imus: &str) -> String {
    let of_one = |line: &str| ["imu = ", "serial = ", "install = "].iter().any(|key| line.starts_with(key));
    let text: String = text.lines().filter(|line| !of_one(line)).map(|line| format!("{line}\n")).collect();
    text.replacen("output", &format!("{imus}\noutput"), 1)
}

fn text(imus: &str) -> String {
    with_imus(EXAMPLE, imus)
}

fn plan(text: &str) -> Plan {
    Plan::from_toml(text, Path::new("/plans")).unwrap()
}

fn faults(text: &str) -> String {
    Plan::from_toml(text, Path::new("")).err().map(|faults| faults.to_string()).unwrap_or_default()
}

#[test]
fn each_imu_has_the_plan_that_it_would_have_alone() {
    let batch = plan(&text(IMUS));
    assert_eq!((batch.names().as_str(), batch.is_batch(), batch.each().len()), ("imu-a, imu-b", true, 2));
    assert_eq!(batch.positions[4].specific_force, [1.0, 0.0, 0.0], "along the axes of an IMU without mounting");
    let mounting = "[turntable]\nmounting = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]";
    let alone =
        EXAMPLE.replace("\"imu-a\"", "\"imu-b\"\nserial = \"SN # 2\"").replace("\"imu-a.toml\"", "\"imu-b.toml\"");
    let alone = plan(&alone.replace("[turntable]", mounting));
    let turned = &batch.each()[1];
    assert_eq!((&turned.imu, &turned.install), (&alone.imu, &alone.install));
    let forces = |positions: &[Position]| positions.iter().map(|position| position.specific_force).collect::<Vec<_>>();
    assert_eq!(forces(&turned.positions), forces(&alone.positions));
    let attitudes = |plan: &Plan| forces(&plan.verify.as_ref().unwrap().attitudes);
    assert_eq!(attitudes(turned), attitudes(&alone));
    assert_eq!((&turned.campaign.serial, turned.campaign.mount), (&alone.campaign.serial, alone.campaign.mount));
    assert_eq!(forces(&turned.campaign.positions), forces(&alone.campaign.positions));
    let [x, y, z] = specific_force(50.0, 130.0);
    assert_eq!(attitudes(turned)[0], [y, z, x]);
    // The campaign file says the same of each.
    let campaigns = Campaign::batch_from_toml(&batch.campaign_toml).unwrap();
    assert_eq!(
        campaigns.iter().collect::<Vec<_>>(),
        batch.each().iter().map(|plan| &plan.campaign).collect::<Vec<_>>()
    );
    assert_eq!(campaigns[1].samples, ["imu-b.csv"]);
}

#[test]
fn the_files_of_an_imu_have_its_name() {
    let ramp = "\n[[ramp]]\nfrom_c = -20\nto_c = 40\n";
    let batch = plan(&(text(IMUS) + ramp));
    let names = |plan: &Plan| {
        let dwell = CampaignStep::Dwell { visit: 0, position: 0 };
        let files = [dwell, CampaignStep::Ramp(0), CampaignStep::Run(1)].map(|unit| unit.file(plan));
        [&files[..], &[plan.file("table", "toml")]].concat()
    };
    assert_eq!(names(&batch.each()[1]), ["imu-b.csv", "ramp-1-imu-b.csv", "verify-2-imu-b.csv", "table-imu-b.toml"]);
    assert_eq!(batch.each()[1].campaign.ramps[0].samples, "ramp-1-imu-b.csv");
    assert_eq!(
        names(&plan(&(EXAMPLE.to_owned() + ramp))),
        ["campaign.csv", "ramp-1.csv", "verify-2.csv", "table.toml"]
    );
}

#[test]
fn turns_are_along_the_axes_of_each_imu() {
    let batch = plan(&with_imus(include_str!("../../../../../examples/plan-whole.toml"), IMUS));
    let axis = |imu: usize| batch.each()[imu].campaign.turns[0].axis;
    assert_eq!((batch.turns.len(), axis(0), axis(1)), (6, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]));
    assert_eq!(batch.each()[1].turns, batch.turns, "the angles of the turntable are the same");
}

#[test]
fn another_imu_serial_or_mounting_is_another_campaign() {
    let identity = |imus: &str| plan(&text(imus)).identity();
    let same = identity(IMUS);
    assert!(same.iter().any(|(key, value)| key == "imus.imu-b" && value.contains("SN # 2")), "{same:?}");
    assert!(!same.iter().any(|(key, _)| key.contains('{') || key == "imus"), "{same:?}");
    assert_eq!(identity(&IMUS.replace("imu-b.toml", "other.toml")), same, "where it is installed");
    for (from, to) in [("SN # 2", "SN # 3"), ("imu-b", "imu-c"), ("[0, 0, 1], [1, 0, 0]", "[0, 0, -1], [-1, 0, 0]")] {
        assert_ne!(identity(&IMUS.replace(from, to)), same, "{to}");
    }
}

#[test]
fn what_is_wrong_with_imus_is_named_with_its_key() {
    assert_eq!(faults(&text(IMUS)), "");
    for (from, to, part) in [
        ("id = \"imu-b\"", "id = \"imu-a\"", "imus.2.id: imu-a is there twice"),
        ("[[0, 1, 0]", "[[0, 2, 0]", "imus.2.mounting: give three rows of three numbers, a rotation"),
        ("[[0, 1, 0]", "[[0, -1, 0]", "imus.2.mounting: give three rows of three numbers, a rotation"),
        ("\"imu-b.toml\"", "\"imu-a.toml\"", "imus.2.install: is the install of another IMU too"),
        ("serial = \"SN 1\"", "serie = \"SN 1\"", "imus.1.serie: unknown key"),
        (
            "id = \"imu-b\"",
            "id = \"verify-1-imu-a\"",
            "imus.2.id: is \"verify-1-imu-a\", its samples would be verify-1-imu-a.csv",
        ),
        ("imus = [", "imu = \"imu-a\"\nimus = [", "imu: there is imus too"),
        ("imus = [", "serial = \"SN 1\"\nimus = [", "serial: there is imus too"),
        ("imus = [", "install = \"imu-a.toml\"\nimus = [", "install: there is imus too"),
    ] {
        let faults = faults(&text(&IMUS.replacen(from, to, 1)));
        assert!(faults.contains(part) && faults.lines().count() == 1, "{part}:\n{faults}");
    }
    assert!(faults(&text("imus = []")).contains("imus: names no IMU"));
    assert!(faults(&text("imus = [3]")).contains("imus: "));
    let mounted = text(IMUS).replace("[turntable]", &format!("[turntable]\nmounting = {TURNED:?}"));
    assert!(faults(&mounted).contains("turntable.mounting: there is imus, where each IMU has its own mounting"));
    // Faults of the rest are still reported.
    let both =
        faults(&text(&IMUS.replace("imu-b\"", "imu-a\"")).replace("gravity_local = 9.8015", "gravity_local = 98.1"));
    assert!(both.contains("imu-a is there twice") && both.contains("gravity_local: is 98.1"), "{both}");
}

#[test]
fn the_folder_of_every_installed_table_must_be_there_to_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.toml");
    std::fs::write(&path, text(&IMUS.replace("\"imu-b.toml\"", "\"nowhere/imu-b.toml\""))).unwrap();
    let faults = Plan::load_to_run(&path).unwrap_err().to_string();
    assert!(faults.contains("imus.2.install: there is no folder"), "{faults}");
    assert!(Plan::load(&path).is_ok());
}

#[test]
fn what_the_runs_leave_unseen_is_told_for_each_imu() {
    let lines = "runs = 2\nattitudes_deg = [[50, 130], [230, 130]]";
    let one = text(IMUS).replace(lines, "runs = 1\nattitudes_deg = [[50, 130]]");
    let warnings = plan(&one).warnings();
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(
        warnings[0].starts_with("imu-a: verify: no run drives ") && warnings[1].starts_with("imu-b: "),
        "{warnings:?}"
    );
}
