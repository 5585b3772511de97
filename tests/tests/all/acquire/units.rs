//! A device whose unit is not the described one.

use super::{counts, dry_run};
use isotherm_tests::{TestDomain, text};

#[test]
fn a_driver_in_g_is_found_out_by_gravity_and_one_in_degrees_by_its_rates() {
    let domain = TestDomain::new();
    // 6 s at an angle, and then a turn.
    let rate = |number: u32| if number < 550 { 0.01 } else { 57.5 };
    let lines: String = (0..600).map(|number| format!("{number},0.6,0,-0.8,0,0,{}\n", rate(number))).collect();
    domain.write("device.txt", &lines);
    let describe = |root: &str, accelerometer: &str, gyroscope: &str| {
        let description = format!(
            "format = 1\nimu = \"imu-a\"\n{root}\n[source]\nkind = \"lines\"\nfile = \"device.txt\"\n[timing]\n\
             interval_s = 0.01\ncounter = {{ column = \"number\", bits = 32 }}\n[lines]\n\
             names = [\"number\", \"ax\", \"ay\", \"az\", \"gx\", \"gy\", \"gz\"]\n[accelerometer]\n\
             columns = [\"ax\", \"ay\", \"az\"]\nkind = \"reading\"\nresolution = 1e-6\n{accelerometer}\n[gyroscope]\n\
             columns = [\"gx\", \"gy\", \"gz\"]\nkind = \"reading\"\nresolution = 1e-6\n{gyroscope}\n[temperature]\n\
             constant = 25\n"
        );
        domain.write("source.toml", &description);
        domain.run_ok(&["check", "source.toml"]);
        let (samples, tally) = dry_run(&domain, &[]);
        assert_eq!(samples.len(), 600);
        assert_eq!(counts(&tally, ["samples", "missing"]), [600, 0]);
        let output = domain.run(&["acquire", "source.toml", "--dry-run"]);
        let log = text(&output.stderr);
        [log.matches("unit = \"g\" in [accelerometer]").count(), log.matches("unit = \"deg/s\" in [gyroscope]").count()]
    };
    assert_eq!(describe("", "", ""), [1, 1]);
    assert_eq!(describe("", "unit = \"g\"", "unit = \"deg/s\""), [0, 0]);
    assert_eq!(describe("gravity = false", "", ""), [0, 1]);
}
