use super::*;
use crate::timeline::{left_s, units};
use std::path::Path;

fn plan(change: impl Fn(&str) -> String) -> Plan {
    Plan::from_toml(&change(include_str!("../../../../examples/plan.toml")), Path::new("")).unwrap()
}

/// Three set points, no limit of the telemetry's rate, one verification run.
fn small() -> Plan {
    plan(|text| {
        text.replace("start_c = -25", "start_c = 10")
            .replace("stop_c = 45", "stop_c = 20")
            .replace("telemetry_per_h = 0.03", "")
            .replace("runs = 3", "runs = 1")
    })
}

/// An ideal chamber and turntable, and samples without a gap.
struct SimulatedLaboratory {
    now: f64,
    chamber: ChamberReading,
    turntable: TurntableReading,
    target_deg: [f64; 2],
    trends: Trends,
    collecting: Option<f64>,
    /// Error of the chamber's air \[degC\], and of the turntable's angles \[deg\].
    off: (f64, f64),
    /// Drift of the air as the trends measure it.
    drift_c_per_h: f64,
    actions: Vec<(f64, Action)>,
}

const STEP_S: f64 = 2.0;

impl SimulatedLaboratory {
    fn new(plan: &Plan) -> Self {
        let chamber = ChamberReading { air_c: 22.3, set_point_c: 22.0, running: false, alarms: Vec::new() };
        Self {
            now: 0.0,
            chamber,
            turntable: TurntableReading::default(),
            target_deg: [0.0; 2],
            trends: Trends::new(plan.soak.window_s),
            collecting: None,
            off: (0.0, 0.0),
            drift_c_per_h: 0.0,
            actions: Vec::new(),
        }
    }

    /// Simulates one step and does the machine's actions; whether the campaign is complete.
    fn step(&mut self, machine: &mut CampaignMachine<'_>) -> Result<bool, Halt> {
        self.now += STEP_S;
        if self.chamber.running {
            let left = self.chamber.set_point_c + self.off.0 - self.chamber.air_c;
            self.chamber.air_c += left * STEP_S / 120.0;
        }
        for axis in 0..2 {
            let left = self.target_deg[axis] + self.off.1 - self.turntable.angles_deg[axis];
            let way = left.clamp(-10.0 * STEP_S, 10.0 * STEP_S);
            self.turntable.angles_deg[axis] += way;
            self.turntable.rates_deg_s[axis] = way / STEP_S;
        }
        self.trends.chamber(self.now, self.chamber.air_c + self.drift_c_per_h * self.now / 3600.0);
        if let Some(collected) = &mut self.collecting {
            *collected += STEP_S;
        }
        loop {
            let collected_s = self.collecting.unwrap_or(0.0);
            let observation = Observation {
                now: self.now,
                chamber: (&self.chamber, self.now),
                turntable: (&self.turntable, self.now),
                trends: &self.trends,
                collected_s,
                complete: collected_s >= 300.0,
                spoiled: None,
            };
            let action = machine.step(&observation)?;
            match &action {
                Action::Wait => return Ok(false),
                Action::Done => return Ok(true),
                Action::SetPoint(celsius) => self.chamber.set_point_c = *celsius,
                Action::StartChamber => self.chamber.running = true,
                Action::Move(angles) => {
                    assert_eq!(self.collecting, None, "no motion while samples are taken");
                    self.target_deg = *angles;
                }
                Action::Collect(_) => self.collecting = Some(0.0),
                Action::Discard(_) | Action::Keep(_) => self.collecting = None,
                Action::Reached(_) => {}
            }
            self.actions.push((self.now, action));
        }
    }

    /// Runs until the campaign is complete or laboratory time is `hours`; whether it is complete.
    fn run(&mut self, machine: &mut CampaignMachine<'_>, hours: f64) -> Result<bool, Halt> {
        while self.now < hours * 3600.0 {
            if self.step(machine)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn until(&mut self, machine: &mut CampaignMachine<'_>, condition: impl Fn(&Action) -> bool) {
        let begun = self.actions.len();
        while !self.actions[begun..].iter().any(|(_, action)| condition(action)) {
            self.step(machine).unwrap();
            assert!(self.now < 1e6);
        }
    }

    fn kept(&self) -> Vec<Unit> {
        self.actions
            .iter()
            .filter_map(|(_, action)| if let Action::Keep(unit) = action { Some(*unit) } else { None })
            .collect()
    }
}

fn all(plan: &Plan) -> Vec<Unit> {
    (0..units(plan)).map_while(|unit| Unit::of(plan, unit)).collect()
}

#[test]
fn every_unit_is_taken_once_in_order_and_in_time() {
    let plan = small();
    let mut machine = CampaignMachine::new(&plan, 0, 5.0);
    let mut laboratory = SimulatedLaboratory::new(&plan);
    assert_eq!(laboratory.run(&mut machine, 40.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
    // The approach takes longer than its ramp, because the air lags.
    let estimate = left_s(&plan, 0);
    assert!((laboratory.now - estimate).abs() < 0.05 * estimate, "{} {estimate}", laboratory.now);
    let mut before: Option<(f64, f64)> = None;
    let mut reached = None;
    for (at, action) in &laboratory.actions {
        match action {
            Action::SetPoint(celsius) => {
                if let Some((last_at, last)) = before {
                    let ramp = (celsius - last).abs() / (at - last_at) * 60.0;
                    assert!((celsius - last).abs() <= 1.0 + 1e-9, "{last} -> {celsius}");
                    assert!(ramp <= 1.1 * plan.ramp_c_per_s * 60.0, "{ramp} degC/min");
                }
                before = Some((*at, *celsius));
            }
            Action::Reached(_) => reached = Some(*at),
            Action::Move(_) => assert!(at - reached.unwrap() >= plan.soak.time_s),
            _ => {}
        }
    }
}

#[test]
fn a_stay_is_as_long_as_asked() {
    let plan = plan(|text| text.replace("stay_s = 4200", "stay_s = 40000").replace("telemetry_per_h = 0.03", ""));
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.run(&mut machine, 30.0).unwrap();
    let reached: Vec<_> =
        laboratory.actions.iter().filter(|(_, action)| matches!(action, Action::Reached(_))).collect();
    assert!(reached.len() >= 2 && reached[1].0 - reached[0].0 >= 40_000.0);
}

#[test]
fn a_table_that_leaves_its_place_costs_the_dwell_in_progress() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
    laboratory.off.1 = 0.02;
    laboratory.until(&mut machine, |action| matches!(action, Action::Discard(_)));
    laboratory.off.1 = 0.0;
    assert_eq!(laboratory.run(&mut machine, 40.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
}

#[test]
fn a_table_that_never_settles_ends_the_campaign() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.off.1 = 0.02;
    let halt = laboratory.run(&mut machine, 40.0).unwrap_err();
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not settle")), "{halt:?}");
    let moves = laboratory.actions.iter().filter(|(_, action)| matches!(action, Action::Move(_))).count();
    assert_eq!((moves, laboratory.kept()), (5, vec![]));
}

#[test]
fn a_chamber_that_never_gets_there_ends_the_campaign() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.off.0 = 2.0;
    let halt = laboratory.run(&mut machine, 40.0).unwrap_err();
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not get to 10.0")), "{halt:?}");
}

#[test]
fn a_chamber_that_overshoots_is_soaked_from_when_it_is_back() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| matches!(action, Action::Reached(_)));
    laboratory.off.0 = -2.0;
    while laboratory.chamber.air_c > 8.5 {
        laboratory.step(&mut machine).unwrap();
    }
    laboratory.off.0 = 0.0;
    laboratory.until(&mut machine, |action| matches!(action, Action::Reached(_)));
    let back = laboratory.now;
    laboratory.until(&mut machine, |action| matches!(action, Action::Move(_)));
    assert!(laboratory.now - back >= plan.soak.time_s);
    assert_eq!(laboratory.run(&mut machine, 40.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
}

#[test]
fn a_chamber_that_drifts_is_waited_for_and_then_given_up() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.drift_c_per_h = 3.0;
    let halt = laboratory.run(&mut machine, 40.0).unwrap_err();
    assert!(
        matches!(&halt, Halt::GivenUp(why) if why.contains("not settled") && why.contains("+3.00 degC/h")),
        "{halt:?}"
    );
    assert!(laboratory.actions.iter().all(|(_, action)| !matches!(action, Action::Move(_))));
}

#[test]
fn a_chamber_that_somebody_else_commands_ends_the_campaign() {
    let plan = small();
    let changes: [fn(&mut ChamberReading); 2] =
        [|chamber| chamber.running = false, |chamber| chamber.set_point_c = 15.0];
    for change in changes {
        let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
        laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
        change(&mut laboratory.chamber);
        let halt = laboratory.step(&mut machine).unwrap_err();
        assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not do what it was told")), "{halt:?}");
    }
}

#[test]
fn a_chamber_that_has_stopped_while_it_was_away_is_led_there_again() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
    laboratory.chamber.running = false;
    laboratory.collecting = None;
    let reached = machine.reached();
    machine.resume(laboratory.now, 10.0, reached, &laboratory.chamber).unwrap();
    assert_eq!(machine.reached(), None, "the soak begins anew");
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
}

#[test]
fn an_interruption_late_in_a_long_stay_leaves_time_to_watch_the_rates() {
    let plan = plan(|text| {
        text.replace("telemetry_per_h = 0.03", "")
            .replace("time_s = 300", "time_s = 1500")
            .replace("[limits]", "[patience]\nstable_s = 600\n\n[limits]")
    });
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    for _ in 0..10 {
        laboratory.until(&mut machine, |action| matches!(action, Action::Keep(_)));
    }
    let reached = machine.reached();
    laboratory.trends.clear();
    machine.resume(laboratory.now, 10.0, reached, &laboratory.chamber).unwrap();
    laboratory.until(&mut machine, |action| matches!(action, Action::Keep(_)));
    assert_eq!(machine.completed(), 11);
}

#[test]
fn a_verification_run_is_kept_only_if_the_chamber_has_gone_all_the_way() {
    let plan = small();
    let (mut machine, mut laboratory) =
        (CampaignMachine::new(&plan, units(&plan) - 1, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
    // The first hold is over when the next set point is commanded.
    laboratory.until(&mut machine, |action| matches!(action, Action::SetPoint(_)));
    laboratory.off.0 = -3.0;
    let halt = laboratory.run(&mut machine, 60.0).unwrap_err();
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not get to 45.0")), "{halt:?}");
    assert_eq!(laboratory.kept(), vec![]);
}

#[test]
fn noise_at_the_edge_of_the_tolerance_costs_no_attempts() {
    let plan = small();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    while machine.commanded_c() != Some(10.0) {
        laboratory.step(&mut machine).unwrap();
    }
    for step in 0..600 {
        laboratory.chamber.air_c = if step % 2 == 0 { 10.45 } else { 10.55 };
        laboratory.step(&mut machine).unwrap();
        assert_eq!(machine.reached(), None);
    }
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
}

#[test]
fn a_short_interruption_keeps_the_soak_and_a_long_one_does_not() {
    let plan = small();
    for (interruption_s, keeps) in [(500.0, true), (700.0, false)] {
        let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
        laboratory.until(&mut machine, |action| matches!(action, Action::Keep(_)));
        laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
        let reached = machine.reached();
        // As after SIGKILL: a new machine that knows only what is in the journal.
        let mut machine = CampaignMachine::new(&plan, 1, 5.0);
        laboratory.collecting = None;
        laboratory.trends.clear();
        laboratory.now += interruption_s;
        machine.resume(laboratory.now, interruption_s, reached, &laboratory.chamber).unwrap();
        let back = laboratory.now;
        laboratory.until(&mut machine, |action| matches!(action, Action::Move(_)));
        let waited = laboratory.now - back;
        assert!(waited >= 0.9 * plan.soak.window_s, "{waited}");
        assert_eq!(waited < plan.soak.time_s, keeps, "{waited}");
        assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
        assert_eq!(laboratory.kept(), all(&plan));
    }
}

#[test]
fn interruptions_without_a_dwell_between_them_are_bounded() {
    let plan = small();
    let mut machine = CampaignMachine::new(&plan, 0, 5.0);
    let chamber = ChamberReading::default();
    for _ in 0..5 {
        machine.resume(0.0, 0.0, None, &chamber).unwrap();
    }
    assert!(matches!(machine.resume(0.0, 0.0, None, &chamber), Err(Halt::GivenUp(_))));
}
