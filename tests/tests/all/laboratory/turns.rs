//! The automatic campaign of a whole IMU with a real service, which is restarted while the turntable turns. More of
//! turns: laboratory/bench/tests.

use isotherm_client::device;
use isotherm_laboratory_bench::GYROSCOPES;
use isotherm_tests::laboratory::{SERIAL, TestLaboratory, stdout_of_success, wait_for_end, wait_long};
use isotherm_tests::{text, wait_until};
use rustix::process::Signal;

/// Positions and turns of a set point.
const POSITIONS: usize = 12;
const TURNS: usize = 6;

/// The acquisition sends what the service has not answered again, so that nothing of a turn is missing.
#[test]
fn a_service_that_is_restarted_in_a_turn_costs_nothing() {
    // A single set point with turns so slow that the first can be disturbed.
    let changes = [
        ("list_c = [20, 23]", "list_c = [20]"),
        ("[turns]\n", "[turns]\nrate_deg_s = 1\n"),
        ("stream_s = 30000", "stream_s = 60"),
        ("settle_s = 20000", "settle_s = 10000"),
    ];
    let mut laboratory = TestLaboratory::with_truth(GYROSCOPES, &["--interval", "1"], &changes);
    let checked = laboratory.domain.run(&["campaign", "check", "station/plan.toml"]);
    let checked = stdout_of_success(&checked);
    assert!(checked.contains("1 set points x (12 positions and 6 turns)"), "{checked}");
    assert!(checked.contains("positions 1 to 12, turns 13 to 18"), "{checked}");
    let runner = laboratory.spawn();
    wait_long("a turn", || {
        assert!(laboratory.events("kept").len() <= POSITIONS, "the turn was too fast");
        laboratory.place() == ("turn".to_owned(), POSITIONS as u64)
    });
    wait_long("a turntable that turns", || {
        laboratory.readbacks().last().is_some_and(|(phase, _, [outer, _])| phase == "turn" && *outer > 1.0)
    });
    let discarded = laboratory.events("discarded").len();
    laboratory.service.signal(Signal::KILL);
    wait_until("the end of the service", || laboratory.service.has_ended());
    laboratory.service = laboratory.domain.serve(&["--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"]);
    laboratory.wait_for("kept", POSITIONS + 1);
    assert_eq!(laboratory.events("discarded").len(), discarded);
    let (success, log) = wait_for_end(runner);
    assert!(success, "{log}");
    laboratory.assert_complete(POSITIONS + TURNS);
    laboratory.assert_in_standby();
    let samples = text(&laboratory.file("campaign.csv"));
    let column = samples.lines().next().unwrap().split(',').position(|column| column == "device").unwrap();
    let of_unit = format!("{:016x}", device(SERIAL));
    assert!(samples.lines().skip(1).all(|row| row.split(',').nth(column) == Some(&of_unit)));
}
