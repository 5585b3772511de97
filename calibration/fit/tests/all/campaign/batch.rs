//! Campaign files of several IMUs.

use isotherm_campaign::{Campaign, MOST_IMUS, Member, select_imu};
use isotherm_shared::names::ImuId;
use nalgebra::{Matrix3, Rotation3, Vector3};

const EXAMPLE: &str = include_str!("../../../../../examples/campaign/campaign.toml");

/// The example's campaign file, with `imus` in place of `imu`.
fn file(imus: &str) -> String {
    EXAMPLE
        .replace("imu = \"imu-paper\"\nsamples = \"samples.csv\"", &format!("imus = {imus}\nsamples = \"{{imu}}.csv\""))
}

fn faults(text: &str) -> String {
    Campaign::batch_from_toml(text).unwrap_err().to_string()
}

#[test]
fn each_imu_gets_its_own_campaign() {
    let one = Campaign::from_toml(EXAMPLE).unwrap();
    assert_eq!(Campaign::batch_from_toml(EXAMPLE).unwrap(), core::slice::from_ref(&one));
    let text = file(
        "[{ id = \"imu-a\", serial = \"17\" }, { id = \"imu-b\", mounting = [[0, 1, 0], [-1, 0.001, 0], [0, 0, 1]] },\n\
         { id = \"imu-c\", serial = \"19\", mounting = [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]] }]",
    );
    let [a, b, c] = Campaign::batch_from_toml(&text).unwrap().try_into().unwrap();
    let expected = Campaign {
        imu: ImuId::new("imu-a").unwrap(),
        serial: Some("17".to_owned()),
        samples: vec!["imu-a.csv".to_owned()],
        ..one.clone()
    };
    assert_eq!(a, expected);
    assert_eq!((b.imu.as_str(), b.serial.as_deref(), b.samples[0].as_str()), ("imu-b", None, "imu-b.csv"));
    // Positions 5 and 9 are +x and +y. A mounting that only exchanges axes is exact, although it was stated with an
    // error.
    assert_eq!([b.positions[4].specific_force, b.positions[8].specific_force], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]);
    assert_eq!(b.mount, Some(Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)));
    assert_eq!(
        b.positions.iter().map(|p| p.angles).collect::<Vec<_>>(),
        one.positions.iter().map(|p| p.angles).collect::<Vec<_>>()
    );
    for (mounted, level) in c.positions.iter().zip(&one.positions) {
        let [x, y, z] = level.specific_force;
        let force = Vector3::new(0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, z);
        assert!((Vector3::from(mounted.specific_force) - force).amax() < 1e-15);
    }
}

#[test]
fn a_member_is_the_campaign_that_a_file_of_its_own_gives() {
    // The same IMU by its own file, with the directions along its axes, and as a member of a batch.
    let mounting = Rotation3::from_euler_angles(0.3, -0.2, 1.0).into_inner();
    let member = Member { imu: ImuId::new("imu-a").unwrap(), serial: Some("1\"7".to_owned()), mounting };
    let turn = "\n[[turn]]\nnumber = 20\naxis = [0, 0, 1]\nangle_deg = 720\nouter_deg = 0\ninner_deg = 0\n";
    let ramp = "\n[[ramp]]\nsamples = \"ramp-{imu}.csv\"\nspecific_force = [0, 0, 1]\n";
    let text = file(&format!("[{}]", member.to_toml())) + turn + ramp;
    let text = text.replace("gravity_local = 9.8015 ", "latitude_deg = 46\ngravity_local = 9.8015 ");
    let batch = Campaign::batch_from_toml(&text).unwrap();
    assert_eq!(batch, [Campaign::from_toml(&text).unwrap()]);
    assert_eq!((batch[0].serial.as_deref(), batch[0].ramps[0].samples.as_str()), (Some("1\"7"), "ramp-imu-a.csv"));
    for vector in [batch[0].turns[0].axis, batch[0].ramps[0].specific_force.unwrap()] {
        assert!((Vector3::from(vector) - mounting * Vector3::z()).amax() < 1e-15);
    }
    let own = batch[0].positions.iter().fold(
        EXAMPLE.lines().take_while(|line| !line.starts_with("[[")).fold(String::new(), |text, line| text + line + "\n"),
        |text, p| {
            let [outer, inner] = p.angles.unwrap();
            format!(
                "{text}[[position]]\nnumber = {}\nouter_deg = {outer}\ninner_deg = {inner}\nspecific_force = {:?}\n",
                p.number, p.specific_force
            )
        },
    );
    let own = Campaign::from_toml(&own).unwrap();
    assert!((own.mount.unwrap() - batch[0].mount.unwrap()).amax() < 1e-15);
}

#[test]
fn a_batch_that_cannot_be_right_is_refused_with_line_and_key() {
    let good = "[{ id = \"imu-a\" }, { id = \"imu-b\" }]";
    let mounted =
        |mounting: &str| file(&format!("[{{ id = \"imu-a\" }}, {{ id = \"imu-b\", mounting = {mounting} }}]"));
    let rotation = "line 2: imus.2.mounting: give three rows of three numbers, a rotation";
    let many: Vec<_> = (0..=MOST_IMUS).map(|k| format!("{{ id = \"imu-{k}\" }}")).collect();
    for (text, expected) in [
        (file("[{ id = \"imu-a\" }, { id = \"imu-a\" }]"), "line 2: imus.2.id: imu-a is there twice"),
        (mounted("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]"), rotation),
        (mounted("[[1, 0, 0], [0, 2, 0], [0, 0, 1]]"), rotation),
        (mounted("[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]"), rotation),
        (mounted("[[1, 0, 0], [0, 1, 0]]"), rotation),
        (mounted("\"up\""), "imus.2.mounting: is the string \"up\", give three rows"),
        (
            file(good).replace("{imu}.csv", "samples.csv"),
            "line 3: samples: \"samples.csv\" is one file; each IMU of a batch has its own",
        ),
        (file(good) + "\n[[ramp]]\nsamples = \"ramp.csv\"\n", "ramp: \"ramp.csv\" is one file"),
        (file(good).replace("format = 1", "format = 1\nimu = \"imu-a\""), "line 2: imu: there is imus too"),
        (file(good).replace("format = 1", "format = 1\nserial = \"17\""), "line 2: serial: there is imus too"),
        (file("[]"), "line 2: imus: names no IMU; give one { id"),
        (file("\"imu-a\""), "line 2: imus: is the string \"imu-a\", give sections"),
        (file(&format!("[{}]", many.join(", "))), "imus: names 101 IMUs, give at most 100"),
        (file("[{ id = \"IMU A\" }]"), "imus.1.id: is \"IMU A\", give 1 to 32"),
        (file("[{ serial = \"17\" }]"), "imus.1.id: missing"),
        (
            file("[{ id = \"imu-a\", install = \"a.toml\" }]"),
            "imus.1.install: unknown key; known here: id, serial, mounting",
        ),
    ] {
        let faults = faults(&text);
        assert!(faults.contains(expected), "{expected}: {faults}");
    }
    let imus = || Campaign::batch_from_toml(&file(good)).unwrap();
    assert_eq!(select_imu(imus(), Some("imu-b")).unwrap(), imus()[1]);
    assert_eq!(select_imu(imus(), None).unwrap_err(), "it has several IMUs; choose one of imu-a, imu-b");
    assert_eq!(select_imu(imus(), Some("imu-c")).unwrap_err(), "there is no imu-c; it has imu-a, imu-b");
    // All faults together.
    let both = faults(
        &file("[{ id = \"imu-a\" }, { id = \"imu-a\" }]").replace("gravity_local = 9.8015", "gravity_local = 98"),
    );
    assert!(both.contains("is there twice") && both.contains("gravity_local: is 98.0"), "{both}");
    let several = Campaign::from_toml(&file(good)).unwrap_err().to_string();
    assert_eq!(several, "line 2: imus: are several, and one is wanted here; leave the others out");
}
