//! The drawing without a terminal, at many sizes and in all conditions.

use super::model::Model;
use super::style::Theme;
use super::{handle_key, screen};
use isotherm_client::Flags;
use isotherm_service::StatusWait;
use isotherm_shared::status::{
    DomainStatus, GyroscopeStatus, ImuStatus, LatencyDistribution, LatencySummary, Ranges, ServiceStatus, WorkerStatus,
};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::style::{Color, Modifier};
use std::time::Duration;

const PLAIN: Theme = Theme { colour: false, unicode: false };
const SECOND: u64 = 1_000_000_000;

fn imu(id: &str, seconds: u64) -> ImuStatus {
    let latency = Some(LatencySummary { count: 400 * seconds, p50: 410, p99: 750, p999: 118_780, max: 308_320 });
    let mut counts = vec![0; 22];
    (counts[1], counts[9]) = (399 * seconds, seconds);
    ImuStatus {
        id: id.to_owned(),
        table: Some("sha256:962fc5bc1b0ce82a0123456789abcdef".to_owned()),
        table_file: format!("/etc/isotherm/tables/{id}.toml"),
        table_taken_unix_s: Some(0.0),
        table_modified_unix_s: Some(0.0),
        serial: None,
        device: None,
        other_device: None,
        lag_s: None,
        sample_lag_s: None,
        temperature_age_s: None,
        temperature_stale: false,
        nominal_interval_s: None,
        pulse_velocity: None,
        ranges: Some(Ranges { unit: "V".to_owned(), head: [[1.0, 2.0]; 3], board: [[1.0, 3.0]; 3] }),
        head_temperature: [Some(1.25), Some(1.5), Some(1.75)],
        board_temperature: [Some(1.5), Some(2.0), Some(2.5)],
        gyroscopes: None,
        received: 400 * seconds,
        rate_hz: 400,
        last_sample_unix_s: None,
        compensated: 400 * seconds,
        gaps: 0,
        missing: 0,
        repeats: 0,
        sessions: 1,
        session_missing: 0,
        session_unknown: 0,
        transport_errors: 0,
        flagged: Flags::NAMES.into_iter().map(|(_, name)| (name.to_owned(), 0)).collect(),
        reloads: 3,
        refusals: 0,
        last_reload_error: None,
        waits_for_table: false,
        refused_table: None,
        table_changes: Vec::new(),
        table_kept: true,
        keep_error: None,
        anchor: None,
        anchor_changes: Vec::new(),
        refused_unix_s: None,
        latency_ns: latency,
        latency_second_ns: latency,
        latency_minute_ns: latency,
        latency_distribution: LatencyDistribution { counts, sum_s: 0.0 },
        acquisition_connected: true,
        readers: 2,
        closed: None,
    }
}

/// The status after `seconds` at 400 Hz.
fn status(ids: &[&str], seconds: u64) -> ServiceStatus {
    ServiceStatus {
        domain: DomainStatus { name: "lab".to_owned(), prefix: String::new(), root_path: String::new() },
        configuration_file: None,
        configuration_error: None,
        pid: 4711,
        pid_namespace: 0,
        clock_offset_ns: 0,
        unix_offset_ns: 0,
        unix_offset_uncertainty_ns: 0,
        unix_steps: 0,
        version: "0.1.0".to_owned(),
        uptime_s: seconds as f64,
        started_unix_s: 0.0,
        taken_ns: seconds * SECOND,
        wait: "anticipate".to_owned(),
        budget_us: 50.0,
        cpu_s: 0.0,
        memory_resident_kb: 0,
        open_descriptors: None,
        max_descriptors: None,
        workers: vec![WorkerStatus {
            thread: 1,
            imus: ids.iter().map(|id| (*id).to_owned()).collect(),
            cores: "0-1".to_owned(),
            priority: None,
            timer_slack_ns: None,
            cpu_percent: 6.0,
            cpu_s: 0.0,
            held_back_s: 0.0,
            held_back_ms: 0.0,
            heartbeat_ns: 0,
            stands_still: false,
        }],
        memory_locked_kb: 0,
        imus: ids.iter().map(|id| imu(id, seconds)).collect(),
    }
}

/// Gives an IMU gyroscopes and a lag.
fn give_gyroscopes(imu: &mut ImuStatus) {
    (imu.lag_s, imu.sample_lag_s) = (Some(240.0), Some(240.0));
    imu.gyroscopes = Some(GyroscopeStatus {
        ranges: Ranges { unit: "V".to_owned(), head: [[0.0, 2.0]; 3], board: [[0.0, 4.0]; 3] },
        head_temperature: [Some(0.5), Some(1.0), Some(1.125)],
        board_temperature: [Some(0.5), Some(1.0), Some(3.5)],
        pulse_angle: [1e-9; 3],
    });
}

/// A model with one status a second for ten seconds; `change` modifies the last one.
fn model(ids: &[&str], theme: Theme, change: impl FnOnce(&mut ServiceStatus)) -> Model {
    let mut model = Model::new("lab", theme);
    for second in 1..10 {
        model.update(Some(status(ids, second)), None);
    }
    let mut last = status(ids, 10);
    change(&mut last);
    model.update(Some(last), None);
    model
}

fn drawn(model: &mut Model, width: u16, height: u16) -> Terminal<TestBackend> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| screen::draw(frame, model)).unwrap();
    terminal
}

fn text(model: &mut Model, width: u16, height: u16) -> String {
    drawn(model, width, height).backend().to_string()
}

#[track_caller]
fn has(screen: &str, parts: &[&str]) {
    for part in parts {
        assert!(screen.contains(part), "{part:?} is not in\n{screen}");
    }
}

#[test]
fn everything_is_on_a_screen_of_80_by_24() {
    let screen = text(&mut model(&["imu-a"], PLAIN, |_| {}), 80, 24);
    has(
        &screen,
        &["Isotherm 0.1.0  lab  pid 4711  up 10 s  anticipate  cpu 6 %", "imu-a", "400    0.41    118.8   25..75"],
    );
    has(
        &screen,
        &["962fc5bc1b0ce82a", "tables/imu-a.toml", "3 reloads", "4000, 0 missing in 0 gaps", "acquisition, 2 readers"],
    );
    has(&screen, &["head [V]", "1.2500 1.0000|---o---------|2.0000", "board [V]", "2.5000 1.0000|", "|3.0000"]);
    has(
        &screen,
        &[
            "second     0.41    0.75   118.8   308.3",
            "minute",
            "all",
            "budget 50 us, 0 were late",
            "1us   100us 10ms  1s",
        ],
    );
    has(&screen, &["flags     none", "q quit  up down IMU  p pause  ? help", " ok "]);
    assert!(screen.is_ascii(), "not ASCII where the terminal knows nothing else:\n{screen}");
}

#[test]
fn a_whole_imu_has_both_triads() {
    let mut whole = model(&["imu-a"], PLAIN, |status| give_gyroscopes(&mut status.imus[0]));
    let screen = text(&mut whole, 80, 24);
    has(&screen, &["A1    1.2500 1.0000|", "head [V], lag 240 s                   board [V]", "12..88"]);
    has(&screen, &["G1    0.5000 0|----o-------------|2.0000", "3.5000 0|", "|4.0000"]);
    has(&screen, &["second     0.41", "flags     none", "q quit  up down IMU  p pause  ? help"]);
    assert!(screen.is_ascii(), "{screen}");
    whole.update(Some(status(&["imu-a"], 11)), None);
    let without = text(&mut whole, 80, 24);
    assert!(!without.contains(", lag") && !without.contains("G1"), "{without}");
}

#[test]
fn gyroscopes_count_for_the_condition_and_the_span() {
    let state = |change: fn(&mut GyroscopeStatus)| {
        let change = |status: &mut ServiceStatus| {
            give_gyroscopes(&mut status.imus[0]);
            change(status.imus[0].gyroscopes.as_mut().unwrap());
        };
        text(&mut model(&["imu-a"], PLAIN, change), 80, 24)
    };
    has(&state(|_| {}), &["12..88", " ok "]);
    has(&state(|gyroscopes| gyroscopes.head_temperature[1] = Some(0.02)), &["1..88", "near range end"]);
    has(&state(|gyroscopes| gyroscopes.board_temperature[2] = Some(5.0)), &["12..125", "out of range"]);
    has(&state(|gyroscopes| gyroscopes.board_temperature[0] = None), &["25..88", "out of range"]);
}

#[test]
fn any_size_can_be_drawn() {
    let mut one = model(&["imu-a"], PLAIN, |status| {
        status.imus[0].missing = 7;
        status.imus[0].flagged.insert("gap".to_owned(), 3);
    });
    let screen = text(&mut one, 40, 10);
    has(&screen, &["Isotherm 0.1.0", "400", "118.8", "losing samples", "962fc5bc1b0ce82a", "q quit"]);
    let names: Vec<_> = (0..32).map(|number| format!("imu-{number}")).collect();
    let names: Vec<_> = names.iter().map(String::as_str).collect();
    let mut many = model(&names, Theme { colour: true, unicode: true }, |_| {});
    let mut whole = model(&["imu-a"], PLAIN, |status| give_gyroscopes(&mut status.imus[0]));
    let mut none = Model::new("lab", PLAIN);
    for (width, height) in
        [(0, 0), (1, 1), (2, 30), (300, 1), (10, 3), (20, 5), (40, 10), (78, 23), (79, 22), (300, 100)]
    {
        for model in [&mut one, &mut many, &mut whole, &mut none] {
            for help in [false, true] {
                model.help = help;
                drawn(model, width, height);
            }
            model.help = false;
        }
    }
}

/// A status is the text of another process.
#[test]
fn a_status_cannot_steer_the_terminal() {
    const HOSTILE: &str = "\u{1b}]0;x\u{7}\u{9b}2J\r\u{202e}abc\u{2066}\n\u{7f}";
    let mut hostile = model(&["imu-a"], Theme { colour: true, unicode: true }, |status| {
        status.version = HOSTILE.to_owned();
        status.domain.name = HOSTILE.to_owned();
        status.wait = HOSTILE.to_owned();
        status.workers[0].cores = HOSTILE.to_owned();
        status.imus[0].table = Some(HOSTILE.to_owned());
        status.imus[0].table_file = HOSTILE.to_owned();
        status.imus[0].last_reload_error = Some(HOSTILE.to_owned());
        status.imus[0].refused_unix_s = Some(1.0);
        status.imus[0].flagged.insert(HOSTILE.to_owned(), 3);
        status.imus[0].serial = Some(HOSTILE.to_owned());
        status.imus[0].other_device = Some(HOSTILE.to_owned());
        status.imus[0].ranges =
            Some(Ranges { unit: HOSTILE.to_owned(), head: [[1.0, 2.0]; 3], board: [[1.0, 3.0]; 3] });
    });
    for (width, height) in [(300, 100), (80, 24), (40, 10)] {
        let terminal = drawn(&mut hostile, width, height);
        let cells: String = terminal.backend().buffer().content().iter().map(|cell| cell.symbol()).collect();
        assert!(cells.contains("abc"), "nothing of it is shown");
        assert!(isotherm_support::failure::printable(&cells) == cells && !cells.contains('\n'), "{cells:?}");
    }
}

#[test]
fn every_condition_is_shown() {
    let state = |change: fn(&mut ServiceStatus)| text(&mut model(&["imu-a"], PLAIN, change), 80, 24);
    has(&state(|status| status.workers[0].stands_still = true), &["stands still"]);
    has(&state(|status| status.imus[0].acquisition_connected = false), &["no acquisition", "NO acquisition"]);
    has(&state(|status| status.imus[0].received = 9 * 400), &["no samples"]);
    has(&state(|status| status.imus[0].head_temperature[1] = Some(1.03)), &["near range end"]);
    has(
        &state(|status| status.imus[0].board_temperature[2] = Some(3.5)),
        &["out of range", "3.5000 1.0000|------------>|3.0000"],
    );
    has(
        &state(|status| status.imus[0].board_temperature[2] = Some(-3.5)),
        &["out of range", "1.0000|<------------|3.0000"],
    );
    has(
        &state(|status| status.imus[0].head_temperature[0] = None),
        &["out of range", "none 1.0000|-------------|2.0000"],
    );
    has(
        &state(|status| _ = status.imus[0].flagged.insert("late".to_owned(), 5)),
        &["late", "flags     late 5 (5.0/s)"],
    );
    has(&state(|status| _ = status.imus[0].flagged.insert("time-step".to_owned(), 5)), &["time steps", "time-step 5"]);
    has(&state(|status| _ = status.imus[0].flagged.insert("session".to_owned(), 1)), &["new session", "session 1"]);
    let other = state(|status| _ = status.imus[0].flagged.insert("interval-not-nominal".to_owned(), 5));
    has(&other, &["wrong interval", "interval-not-nominal 5"]);
    has(&state(|status| _ = status.imus[0].flagged.insert("a1-rate".to_owned(), 5)), &["flagged", "a1-rate 5"]);
    let without = state(|status| {
        status.imus[0].table = None;
        status.imus[0].ranges = None;
    });
    has(&without, &["no table", "none: increments are NaN"]);
    let waits = |status: &mut ServiceStatus| {
        status.imus[0].table = None;
        status.imus[0].ranges = None;
        status.imus[0].last_reload_error = Some("imu-a.toml: no such file".to_owned());
        status.imus[0].waits_for_table = true;
    };
    let waiting = state(waits);
    has(&waiting, &["first table", "waits for its first table: increments are NaN"]);
    assert!(!waiting.contains("REFUSED"), "{waiting}");
    let refused = state(|status| {
        status.imus[0].last_reload_error = Some("imu-a.toml:3: gravity: is 8\nand more".to_owned());
        status.imus[0].refused_unix_s = Some(0.0);
    });
    has(&refused, &["file REFUSED", "d ago: imu-a.toml:3: gravity: is 8; and more"]);
    let other = state(|status| {
        status.imus[0].serial = Some("SN 42".to_owned());
        status.imus[0].other_device = Some("46a7426ef29cc83b".to_owned());
    });
    has(
        &other,
        &["other device", "OTHER DEVICE: samples of 46a7426ef29cc83b, table of serial \"SN 42\"", "flags     none"],
    );
    let lag = |sample_lag_s: Option<f64>| {
        let change = |status: &mut ServiceStatus| {
            give_gyroscopes(&mut status.imus[0]);
            status.imus[0].sample_lag_s = sample_lag_s;
            status.imus[0].flagged.insert("lag-unknown".to_owned(), 5);
        };
        text(&mut model(&["imu-a"], PLAIN, change), 80, 24)
    };
    has(&lag(Some(100.0)), &["lag unknown", "OTHER LAG: samples 100 s, table 240 s", "lag-unknown 5 (5.0/s)"]);
    has(&lag(None), &["lag unknown", "OTHER LAG: samples none, table 240 s"]);
    // A sensor that is not fed, or was not soaked.
    let same = lag(Some(240.0));
    has(&same, &["lag unknown", "lag-unknown 5"]);
    assert!(!same.contains("OTHER LAG"), "{same}");
    let mut held = model(&["imu-a"], PLAIN, |status| status.workers[0].held_back_ms = 48.7);
    has(&text(&mut held, 80, 24), &["cpu 6 %, held 49 ms"]);
}

#[test]
fn a_service_that_is_gone_is_waited_for_and_one_that_returns_counts_anew() {
    let mut model = model(&["imu-a"], PLAIN, |_| {});
    let waiting = || Some(StatusWait { time: Duration::from_secs(12), cause: "no service".to_owned() });
    model.update(None, waiting());
    has(
        &text(&mut model, 80, 24),
        &["waiting for the service since ", "UTC, 12 s; below is its last status: no", "not served", "4000"],
    );
    let mut returned = status(&["imu-a"], 1);
    (returned.pid, returned.taken_ns) = (4712, 30 * SECOND);
    model.update(Some(returned.clone()), None);
    let screen = text(&mut model, 80, 24);
    has(&screen, &["pid 4712", "no samples", "samples   400,"]);
    (returned.imus[0].received, returned.taken_ns) = (1200, 32 * SECOND);
    model.update(Some(returned), None);
    has(&text(&mut model, 80, 24), &["imu-a               400"]);

    let mut never = Model::new("lab", PLAIN);
    never.update(None, waiting());
    let screen = text(&mut never, 80, 24);
    has(&screen, &["Isotherm, domain lab", "waiting for the service", "q quit"]);
    assert!(!screen.contains("last status"), "{screen}");
}

#[test]
fn rates_are_taken_over_a_second_and_the_histogram_over_a_minute() {
    let mut model = Model::new("lab", PLAIN);
    // Five statuses a second for two minutes. In the second minute the samples come twice as fast.
    for tick in 0..600 {
        let mut status = status(&["imu-a"], 0);
        status.taken_ns = tick * SECOND / 5;
        let samples = 80 * tick + 80 * tick.saturating_sub(300);
        status.imus[0].received = samples;
        status.imus[0].latency_distribution.counts[3] = samples;
        model.update(Some(status), None);
        if tick == 250 {
            assert_eq!(model.rate(0, |imu| imu.received), Some(400.0));
            let (counts, seconds) = model.distribution();
            assert_eq!((counts[3], seconds), (80 * 250, 50.0), "all that is known");
        }
    }
    assert_eq!(model.rate(0, |imu| imu.received), Some(800.0));
    let (counts, seconds) = model.distribution();
    assert!((48_000..=49_000).contains(&counts[3]) && (60.0..61.1).contains(&seconds), "{counts:?} in {seconds} s");
}

#[test]
fn thirty_two_imus_scroll() {
    let names: Vec<_> = (0..32).map(|number| format!("imu-{number:02}")).collect();
    let names: Vec<_> = names.iter().map(String::as_str).collect();
    let mut model = model(&names, PLAIN, |_| {});
    let press = |model: &mut Model, code| assert!(handle_key(model, KeyEvent::new(code, KeyModifiers::NONE)));
    let shows = |model: &mut Model, id: &str| {
        let screen = text(model, 80, 24);
        assert_eq!(model.imu().map(|imu| imu.id.as_str()), Some(id));
        // Once in the table, and once above the details.
        assert_eq!(screen.matches(&format!("{id} ")).count(), 2, "{screen}");
    };
    shows(&mut model, "imu-00");
    for (code, id) in [
        (KeyCode::Up, "imu-00"),
        (KeyCode::Down, "imu-01"),
        (KeyCode::Char('j'), "imu-02"),
        (KeyCode::Char('k'), "imu-01"),
        (KeyCode::PageDown, "imu-11"),
        (KeyCode::End, "imu-31"),
        (KeyCode::Down, "imu-31"),
        (KeyCode::Tab, "imu-00"),
        (KeyCode::BackTab, "imu-31"),
        (KeyCode::PageUp, "imu-21"),
        (KeyCode::Home, "imu-00"),
    ] {
        press(&mut model, code);
        shows(&mut model, id);
    }
    press(&mut model, KeyCode::End);
    model.update(Some(status(&["only"], 11)), None);
    assert_eq!(model.imu().map(|imu| imu.id.as_str()), Some("only"), "fewer IMUs than before");
}

#[test]
fn keys_quit_pause_and_help() {
    let mut model = model(&["imu-a"], PLAIN, |_| {});
    let press = |model: &mut Model, code, modifiers| handle_key(model, KeyEvent::new(code, modifiers));
    let none = KeyModifiers::NONE;
    assert!(!press(&mut model, KeyCode::Char('q'), none));
    assert!(!press(&mut model, KeyCode::Esc, none));
    assert!(!press(&mut model, KeyCode::Char('c'), KeyModifiers::CONTROL));
    assert!(press(&mut model, KeyCode::Char('p'), none) && model.paused);
    has(&text(&mut model, 80, 24), &["p go on", "PAUSED"]);
    assert!(press(&mut model, KeyCode::Char('?'), none) && model.help);
    has(&text(&mut model, 80, 24), &["Ctrl-C", "within the calibrated range"]);
    has(&text(&mut model, 40, 10), &["Ctrl-C", "select an IMU"]);
    assert!(press(&mut model, KeyCode::Esc, none) && !model.help, "the help first");
    assert!(press(&mut model, KeyCode::F(1), none) && press(&mut model, KeyCode::Char('p'), none) && !model.paused);
}

#[test]
fn without_colours_weight_and_inversion_stand_for_them() {
    let bad = |status: &mut ServiceStatus| status.imus[0].missing = 7;
    let cells = |theme| drawn(&mut model(&["imu-a"], theme, bad), 80, 24).backend().buffer().content().to_vec();
    let plain = cells(PLAIN);
    assert!(plain.iter().all(|cell| cell.fg == Color::Reset && cell.bg == Color::Reset));
    assert!(plain.iter().any(|cell| cell.modifier.contains(Modifier::BOLD)));
    let coloured = cells(Theme { colour: true, unicode: true });
    assert!(coloured.iter().any(|cell| cell.fg == Color::Red));
}
