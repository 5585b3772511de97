//! Descriptions, recordings and state folders of the version before are read as they were.

use isotherm_shared::document::RENAMED;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, text};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;

fn before(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/data/before")).join(name)
}

#[test]
fn recordings_of_before_are_read_and_replayed_alike() {
    let domain = TestDomain::new();
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/data/imu-a.toml");
    let replayed = ["run.csv", "run.parquet", "run.mcap"].map(|name| {
        let path = before(name).display().to_string();
        assert!(domain.run_ok(&["check", &path]).contains("200 rows"), "{name}");
        domain.run_ok(&["replay", "--table", table, &path])
    });
    assert!(replayed.iter().all(|rows| *rows == replayed[0] && rows.lines().count() == 201));
    // The increments that were answered then.
    let columns = |text: &str| {
        let names: Vec<_> = text.lines().next().unwrap().split(',').map(str::to_owned).collect();
        let own: Vec<_> = (0..names.len()).filter(|at| names[*at].ends_with("_dv")).collect();
        assert_eq!(own.len(), 3, "{names:?}");
        let row = |row: &str| own.iter().map(|at| row.split(',').nth(*at).unwrap().to_owned()).collect::<Vec<_>>();
        text.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    assert_eq!(columns(&replayed[0]), columns(&fs::read_to_string(before("run.increments.csv")).unwrap()));
}

#[test]
fn a_state_folder_of_before_gives_the_table_that_was_in_force() {
    let domain = TestDomain::new();
    let folder = domain.path(".state").join(domain.client_domain().name());
    fs::create_dir_all(&folder).unwrap();
    for folder in [domain.path(".state"), folder.clone()] {
        fs::set_permissions(folder, fs::Permissions::from_mode(0o700)).unwrap();
    }
    for name in ["imu-a.toml", "imu-a.anchor.toml"] {
        fs::copy(before("kept.toml"), folder.join(name)).unwrap();
        fs::set_permissions(folder.join(name), fs::Permissions::from_mode(0o600)).unwrap();
    }
    domain.write("imu-a.toml", "damaged");
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    service.wait_for_log("the table that was in force last is served");
    assert!(fs::read_to_string(before("kept.toml")).unwrap().contains(domain.imu_status()["table"].as_str().unwrap()));
    service.terminate();
}

/// Every key that has another name now is refused in one go, with that name; what is wrong under the old name, too.
#[test]
fn a_plan_of_before_is_refused_with_todays_names() {
    let domain = TestDomain::new();
    let old = fs::read_to_string(before("plan-whole.toml")).unwrap();
    domain.write("plan.toml", &old.replace("tolerance_deg = 0.005", "tolerance_deg = -1"));
    for command in [&["check", "plan.toml"][..], &["campaign", "check", "plan.toml"]] {
        let refused = domain.run(command);
        let message = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(78), "{message}");
        let line = |begin: &str| 1 + old.lines().position(|line| line.starts_with(begin)).unwrap();
        for (key, new, begin) in
            [("table", "turntable", "[table]"), ("soak.telemetry_per_h", "soak.temperature_per_h", "telemetry_per_h")]
        {
            let fault = format!("plan.toml:{}: {key}: is called {new} now; rename it", line(begin));
            assert!(message.contains(&fault), "{fault}\n{message}");
        }
        let wrong = format!("plan.toml:{}: turntable.tolerance_deg: ", line("tolerance_deg"));
        assert!(message.contains(&wrong), "{message}");
        assert_eq!(message.matches("plan.toml:").count(), RENAMED.len() + 1, "{message}");
    }
}

#[test]
fn descriptions_of_before_acquire_what_they_did() {
    for emulator in [Emulator::Stim300, Emulator::Vn100, Emulator::Mtdata2, Emulator::Kvh1750, Emulator::Arduino] {
        let domain = TestDomain::new();
        let description = before(emulator.profile()).with_extension("toml").display().to_string();
        domain.run_ok(&["check", &description]);
        let bytes: Vec<_> = (0..300).flat_map(|number| emulator.frame(number)).collect();
        fs::write(domain.path("bytes"), bytes).unwrap();
        let rows = |description: &str| {
            let output = domain.run(&["acquire", description, "--device", "bytes", "--dry-run"]);
            assert!(output.status.success(), "{emulator:?}: {}", text(&output.stderr));
            let text = text(&output.stdout);
            let names = text.lines().next().unwrap().to_owned();
            // Without its session, a random number, the time of its writing, and their check.
            let of_run = ["session", "recorded_ns", "check"];
            let own: Vec<_> = names.split(',').map(|name| !of_run.contains(&name)).collect();
            let row = |row: &str| {
                let fields = row.split(',').zip(&own).filter(|(_, own)| **own);
                fields.map(|(field, _)| field.to_owned()).collect::<Vec<_>>()
            };
            text.lines().skip(1).map(row).collect::<Vec<_>>()
        };
        let now = format!("{}/../examples/acquire/{}.toml", env!("CARGO_MANIFEST_DIR"), emulator.profile());
        let (then, now) = (rows(&description), rows(&now));
        let differs = then.iter().zip(&now).find(|(then, now)| then != now);
        assert!(
            then.len() >= 299 && then.len() == now.len() && differs.is_none(),
            "{emulator:?}: {} and {}, {differs:?}",
            then.len(),
            now.len()
        );
    }
}
