//! The state machine, transition by transition.

use super::*;
use crate::stability::Trends;
use crate::streams::tests::Bench;
use crate::timeline::{left_s, units};
use std::path::Path;

fn plan(change: impl Fn(&str) -> String) -> Plan {
    Plan::from_toml(&change(include_str!("../../../../examples/plan.toml")), Path::new("")).unwrap()
}

/// Three set points, no limit of the temperature's rate, one verification run.
fn small() -> Plan {
    plan(|text| {
        text.replace("start_c = -25", "start_c = 10")
            .replace("stop_c = 45", "stop_c = 20")
            .replace("temperature_per_h = 0.03", "")
            .replace("runs = 2\nattitudes_deg = [[50, 130], [230, 130]]", "runs = 1")
    })
}

/// The same with turns.
fn whole(change: impl Fn(&str) -> String) -> Plan {
    let text = include_str!("../../../../examples/plan-whole.toml");
    let text = change(text).replace("start_c = -25", "start_c = 10").replace("stop_c = 45", "stop_c = 20");
    let text = text.replace("temperature_per_h = 0.03", "");
    Plan::from_toml(&text, Path::new("")).unwrap()
}

/// An ideal chamber and turntable, and samples without a gap.
struct SimulatedLaboratory {
    now: f64,
    chamber: ChamberReading,
    turntable: TurntableReading,
    /// The angles with all whole turns.
    angles_deg: [f64; 2],
    target_deg: [f64; 2],
    /// Whether the controller counts modulo 360 degrees, and takes the shorter way.
    wraps: bool,
    /// Added to the angle that the next turns end at \[deg\].
    turn_error_deg: f64,
    spoiled: Option<&'static str>,
    clocks_known: bool,
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
        let chamber = ChamberReading { air_c: 22.3, set_point_c: 22.0, ..ChamberReading::default() };
        Self {
            now: 0.0,
            chamber,
            turntable: TurntableReading::default(),
            angles_deg: [0.0; 2],
            target_deg: [0.0; 2],
            wraps: false,
            turn_error_deg: 0.0,
            spoiled: None,
            clocks_known: true,
            trends: Trends::new(plan),
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
            let left = self.target_deg[axis] + self.off.1 - self.angles_deg[axis];
            let way = left.clamp(-10.0 * STEP_S, 10.0 * STEP_S);
            self.angles_deg[axis] += way;
            let angle = self.angles_deg[axis];
            self.turntable.angles_deg[axis] = if self.wraps { angle.rem_euclid(360.0) } else { angle };
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
                clocks_known: self.clocks_known,
                collected_s,
                complete: collected_s >= 300.0,
                spoiled: self.spoiled,
            };
            let action = machine.step(&observation)?;
            match &action {
                Action::Wait => return Ok(false),
                Action::Done => return Ok(true),
                Action::SetPoint(celsius) => self.chamber.set_point_c = *celsius,
                Action::StartChamber => self.chamber.running = true,
                Action::Move(angles) => {
                    assert_eq!(self.collecting, None, "no motion while samples are taken");
                    self.go_to(*angles);
                }
                Action::Turn(angles) => {
                    assert!(self.collecting.is_some(), "samples are taken while it turns");
                    self.go_to(*angles);
                    let axis = if self.target_deg[0] == self.angles_deg[0] { 1 } else { 0 };
                    self.target_deg[axis] += self.turn_error_deg;
                }
                Action::Collect(_) => self.collecting = Some(0.0),
                Action::Discard(_) | Action::Keep { .. } => self.collecting = None,
                Action::Reached(_) => {}
            }
            self.actions.push((self.now, action));
        }
    }

    fn go_to(&mut self, angles_deg: [f64; 2]) {
        let way = |axis: usize| self.angles_deg[axis] + turn_deg(self.angles_deg[axis], angles_deg[axis]);
        self.target_deg = if self.wraps { [way(0), way(1)] } else { angles_deg };
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

    fn kept(&self) -> Vec<CampaignStep> {
        self.actions
            .iter()
            .filter_map(|(_, action)| if let Action::Keep { unit, .. } = action { Some(*unit) } else { None })
            .collect()
    }
}

/// A machine and a laboratory where the first turn is next.
fn at_first_turn(plan: &Plan) -> (CampaignMachine<'_>, SimulatedLaboratory) {
    let mut laboratory = SimulatedLaboratory::new(plan);
    let mut machine = CampaignMachine::new(plan, plan.positions.len(), 5.0);
    laboratory.until(&mut machine, |action| matches!(action, Action::Collect(CampaignStep::Turn { turn: 0, .. })));
    (machine, laboratory)
}

fn is_turn(action: &Action) -> bool {
    matches!(action, Action::Turn(_))
}

fn is_kept(action: &Action) -> bool {
    matches!(action, Action::Keep { .. })
}

fn is_discarded(action: &Action) -> bool {
    matches!(action, Action::Discard(_))
}

fn all(plan: &Plan) -> Vec<CampaignStep> {
    (0..units(plan)).map_while(|unit| CampaignStep::of(plan, unit)).collect()
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
    let plan = plan(|text| text.replace("stay_s = 4200", "stay_s = 40000").replace("temperature_per_h = 0.03", ""));
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
fn no_unit_begins_before_the_clocks_are_known() {
    let plan = small();
    let (mut laboratory, mut machine) = (SimulatedLaboratory::new(&plan), CampaignMachine::new(&plan, 0, 0.0));
    laboratory.clocks_known = false;
    for _ in 0..10_000 {
        assert!(!laboratory.step(&mut machine).unwrap());
    }
    assert!(machine.phase().name() == "settle" && laboratory.collecting.is_none());
    laboratory.clocks_known = true;
    laboratory.step(&mut machine).unwrap();
    assert!(machine.phase().name() == "dwell" && laboratory.collecting.is_some());
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
        assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not follow its orders")), "{halt:?}");
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
    assert_eq!(machine.reached(), None, "the soak begins again");
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
}

#[test]
fn an_interruption_late_in_a_long_stay_leaves_time_to_watch_the_rates() {
    let plan = plan(|text| {
        text.replace("temperature_per_h = 0.03", "")
            .replace("time_s = 300", "time_s = 1500")
            .replace("[limits]", "[patience]\nstable_s = 600\n\n[limits]")
    });
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    for _ in 0..10 {
        laboratory.until(&mut machine, |action| matches!(action, Action::Keep { .. }));
    }
    let reached = machine.reached();
    laboratory.trends.clear();
    machine.resume(laboratory.now, 10.0, reached, &laboratory.chamber).unwrap();
    laboratory.until(&mut machine, |action| matches!(action, Action::Keep { .. }));
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

/// The small plan with two ramps: heating first, and cooling first.
fn with_ramps() -> Plan {
    let ramps = "\n[[ramp]]\nfrom_c = 10\nto_c = 40\nramp_c_per_h = 30\nhold_s = 1200\n\
                 [[ramp]]\nfrom_c = 40\nto_c = 10\nramp_c_per_h = 60\nhold_s = 0\nouter_deg = 90\n";
    plan(|text| {
        let text = text.replace("start_c = -25", "start_c = 20").replace("stop_c = 45", "stop_c = 20");
        text.replace("temperature_per_h = 0.03", "").replace("from_c = -25", "from_c = 10") + ramps
    })
}

#[test]
fn a_ramp_goes_there_and_back_with_its_holds_at_its_rate() {
    let plan = with_ramps();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
    assert_eq!(
        laboratory.kept()[12..],
        [CampaignStep::Ramp(0), CampaignStep::Ramp(1), CampaignStep::Run(0), CampaignStep::Run(1)]
    );
    let estimate = left_s(&plan, 0);
    assert!((laboratory.now - estimate).abs() < 0.05 * estimate, "{} {estimate}", laboratory.now);
    for unit in &laboratory.kept()[12..] {
        let way = unit.way(&plan).unwrap();
        let of_unit = laboratory.actions.iter().skip_while(|(_, action)| *action != Action::Collect(*unit));
        let until_kept = of_unit.take_while(|(_, action)| !matches!(action, Action::Keep { .. }));
        let (mut last, mut turned) = (None, None);
        let mut commanded = vec![way.from_c];
        let mut collected = 0.0;
        for (at, action) in until_kept {
            match action {
                Action::Collect(_) => collected = *at,
                Action::SetPoint(celsius) => {
                    if let Some((last_at, last_c)) = last {
                        let rate_c_per_s = f64::abs(celsius - last_c) / (at - last_at);
                        let turns = turned.is_none() && (celsius - last_c) * (way.to_c - way.from_c) < 0.0;
                        if turns {
                            turned = Some(*at);
                            assert!(at - last_at >= way.hold_s, "{unit:?} holds at the other end");
                        } else {
                            assert!(rate_c_per_s <= 1.1 * way.ramp_c_per_s, "{unit:?}: {rate_c_per_s}");
                        }
                    } else {
                        assert!(at - collected >= way.hold_s, "{unit:?} holds at the beginning");
                    }
                    last = Some((*at, *celsius));
                    commanded.push(*celsius);
                }
                other => panic!("{unit:?}: {other:?}"),
            }
        }
        let turn = commanded.iter().position(|celsius| *celsius == way.to_c).unwrap();
        let heats = way.to_c > way.from_c;
        assert!(commanded[..=turn].is_sorted_by(|a, b| (a < b) == heats) && commanded.last() == Some(&way.from_c));
        assert!(commanded[turn..].is_sorted_by(|a, b| (a > b) == heats), "{commanded:?}");
    }
}

#[test]
fn an_interrupted_ramp_is_taken_again_from_its_soak_wherever_it_was() {
    let plan = with_ramps();
    // In the last hold the chamber is where it was soaked; but it has been away.
    let places = [(Leg::Begin, true), (Leg::There, false), (Leg::There, true), (Leg::Back, false), (Leg::Back, true)];
    for place in places {
        let soaks = place.0 != Leg::Begin;
        let mut machine = CampaignMachine::new(&plan, 12, 5.0);
        let mut laboratory = SimulatedLaboratory::new(&plan);
        laboratory.until(&mut machine, |action| *action == Action::Collect(CampaignStep::Ramp(0)));
        while !matches!(machine.phase(), Phase::Sweep { leg, held } if (leg, held.is_some()) == place) {
            laboratory.step(&mut machine).unwrap();
        }
        let reached = machine.reached();
        assert_eq!(reached.is_none(), soaks, "{place:?}");
        let mut machine = CampaignMachine::new(&plan, 12, 5.0);
        laboratory.collecting = None;
        laboratory.trends.clear();
        laboratory.now += 100.0;
        machine.resume(laboratory.now, 100.0, reached, &laboratory.chamber).unwrap();
        let back = laboratory.now;
        laboratory.until(&mut machine, |action| *action == Action::Collect(CampaignStep::Ramp(0)));
        assert_eq!(laboratory.now - back >= plan.soak.time_s, soaks, "{place:?}");
        assert!((laboratory.chamber.air_c - 10.0).abs() < plan.soak.tolerance_c);
        assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
        assert_eq!(laboratory.kept(), all(&plan)[12..]);
    }
}

#[test]
fn a_chamber_that_does_not_come_back_ends_the_campaign() {
    let plan = with_ramps();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 12, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| *action == Action::SetPoint(40.0));
    laboratory.until(&mut machine, |action| matches!(action, Action::SetPoint(_)));
    laboratory.off.0 = 2.0;
    let halt = laboratory.run(&mut machine, 60.0).unwrap_err();
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("does not get to 10.0")), "{halt:?}");
    assert_eq!(laboratory.kept(), vec![]);
}

#[test]
fn a_turntable_that_moves_in_a_ramp_costs_the_whole_ramp() {
    let plan = with_ramps();
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 12, 5.0), SimulatedLaboratory::new(&plan));
    laboratory.until(&mut machine, |action| *action == Action::SetPoint(40.0));
    laboratory.off.1 = 0.02;
    laboratory.until(&mut machine, is_discarded);
    laboratory.off.1 = 0.0;
    laboratory.until(&mut machine, |action| *action == Action::Reached(10.0));
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan)[12..]);
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
        laboratory.until(&mut machine, |action| matches!(action, Action::Keep { .. }));
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

#[test]
fn turns_follow_the_positions_from_rest_to_rest() {
    let plan = whole(str::to_owned);
    let (mut machine, mut laboratory) = (CampaignMachine::new(&plan, 0, 5.0), SimulatedLaboratory::new(&plan));
    assert_eq!(laboratory.run(&mut machine, 40.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan));
    assert_eq!(laboratory.kept().len(), 3 * (12 + 6) + 2);
    let estimate = left_s(&plan, 0);
    assert!((laboratory.now - estimate).abs() < 0.05 * estimate, "{} {estimate}", laboratory.now);
    let (mut collected, mut turned, mut turns) = (0.0, 0.0, 0);
    for (at, action) in &laboratory.actions {
        match action {
            Action::Collect(_) => collected = *at,
            Action::Turn(angles) => {
                turned = *at;
                assert!(turned - collected >= plan.turn.rest_s);
                assert_eq!(*angles, plan.turns[turns % 6].to_deg);
            }
            Action::Keep { unit: CampaignStep::Turn { turn, .. }, turned_deg } => {
                let planned = plan.turns[*turn];
                assert_eq!(*turned_deg, Some([planned.from_deg, planned.to_deg]));
                // 72 s of motion; the model's turntable needs no time to accelerate.
                assert!(at - turned >= 72.0 + plan.motion.settle_s + plan.turn.rest_s);
                turns += 1;
            }
            Action::Keep { turned_deg, .. } => assert_eq!(*turned_deg, None),
            _ => {}
        }
    }
    assert_eq!(turns, 18);
}

#[test]
fn a_set_point_with_turns_takes_the_time_that_is_estimated() {
    let time = |plan: &Plan| left_s(plan, 0) - left_s(plan, 18);
    let without = |plan: &Plan| Plan { turns: Vec::new(), ..plan.clone() };
    for (limit, minutes) in [("365", 7.5), ("720", 11.1)] {
        let plan = whole(|text| text.replace("[-5, 720]", &format!("[-5, {limit}]")));
        let plain = without(&plan);
        let added = time(&plan) - (left_s(&plain, 0) - left_s(&plain, 12));
        assert!((added / 60.0 - minutes).abs() < 0.1, "{limit}: {:.2} min", added / 60.0);
    }
    // The rest of a long stay is after the last turn.
    let long = whole(|text| text.replace("stay_s = 4200", "stay_s = 40000"));
    let ramp = left_s(&long, 0) - left_s(&long, 18) - 40_000.0;
    assert!((ramp - 10.0 / long.ramp_c_per_s).abs() < 100.0, "{ramp}");
}

#[test]
fn a_disturbed_turn_is_taken_again_from_its_start() {
    let plan = whole(str::to_owned);
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.until(&mut machine, is_turn);
    for _ in 0..5 {
        laboratory.step(&mut machine).unwrap();
    }
    assert_eq!(laboratory.angles_deg[0], 100.0);
    laboratory.spoiled = Some("samples are missing");
    laboratory.step(&mut machine).unwrap();
    laboratory.spoiled = None;
    let count = laboratory.actions.len();
    let last: Vec<_> = laboratory.actions[count - 2..].iter().map(|(_, action)| action.clone()).collect();
    let start = plan.turns[0].from_deg;
    assert_eq!(last, [Action::Discard("samples are missing".to_owned()), Action::Move(start)]);
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan)[12..]);
}

#[test]
fn imus_that_spoil_a_dwell_in_turn_are_dropped_and_the_last_one_ends_the_campaign() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path());
    let mut machine = CampaignMachine::new(bench.plan, 0, 5.0);
    let mut laboratory = SimulatedLaboratory::new(bench.plan);
    let (mut dropped, mut attempts, mut is_begun) = (Vec::new(), 0, false);
    // imu-a and imu-b by turns; then imu-b, which is left, as soon as imu-a is dropped; then imu-c.
    let spoilers = [0, 1, 0, 1, 0, 1, 1, 1, 2, 2, 2, 2, 2];
    let mut halt = None;
    for (number, spoiler) in spoilers.into_iter().enumerate() {
        if !is_begun {
            laboratory.until(&mut machine, |action| matches!(action, Action::Collect(_)));
            bench.streams.begin(CampaignStep::Dwell { visit: 0, position: 0 }).unwrap();
            is_begun = true;
        }
        let at = 1 + 20 * number as u64;
        bench.feed(spoiler, 2 * at, at..at + 10);
        bench.feed(spoiler, 2 * at + 1, at + 10..at + 20);
        // As the runner does.
        while let Some(failed) = bench.streams.spoiler(machine.is_last_attempt()).filter(|_| bench.streams.has_others())
        {
            bench.streams.drop_imu(failed.imu);
            machine.renew_attempts();
            dropped.push((number, failed.imu, failed.reason));
        }
        if bench.streams.spoiled().is_some() {
            laboratory.spoiled = Some("the acquisition was restarted");
            halt = laboratory.step(&mut machine).err();
            laboratory.spoiled = None;
            bench.streams.discard();
            (is_begun, attempts) = (false, attempts + 1);
        }
        if halt.is_some() {
            break;
        }
    }
    let reason = |attempts| format!("the acquisition was restarted; attempts spoiled: {attempts}");
    assert_eq!(dropped, [(4, 0, reason(3)), (7, 1, reason(5))]);
    assert_eq!(attempts, spoilers.len() - 2, "who is dropped costs the others no attempt");
    assert_eq!(halt, Some(Halt::GivenUp("the acquisition was restarted; 5 attempts".to_owned())));
}

#[test]
fn a_turn_of_a_wrong_angle_is_taken_again_and_then_given_up() {
    let plan = whole(str::to_owned);
    // Up to the tolerance of a position the turntable has arrived; the read-backs show the difference.
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.turn_error_deg = -0.0006;
    laboratory.until(&mut machine, is_discarded);
    laboratory.turn_error_deg = 0.0;
    laboratory.until(&mut machine, is_kept);
    let Some((_, Action::Discard(reason))) = laboratory.actions.iter().find(|(_, action)| is_discarded(action)) else {
        panic!()
    };
    assert_eq!(
        reason,
        "the read-backs 0.0 and 719.9994 deg differ by -0.00060 deg from 720.0 deg, 0.0005 deg is allowed"
    );
    // What is allowed, by the tolerance or by the read-back's last digit.
    for (error, resolution) in [(0.0005, 1e-5), (0.002, 1e-3)] {
        let (mut machine, mut laboratory) = at_first_turn(&plan);
        (laboratory.turn_error_deg, laboratory.turntable.resolution_deg) = (error, resolution);
        laboratory.until(&mut machine, is_kept);
        assert!(!laboratory.actions.iter().any(|(_, action)| is_discarded(action)));
    }
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.turn_error_deg = 0.004;
    let halt = laboratory.run(&mut machine, 60.0).unwrap_err();
    assert!(
        matches!(&halt, Halt::GivenUp(why) if why.contains("0.00400 deg from 720.0 deg") && why.ends_with("; 5 attempts")),
        "{halt:?}"
    );
    assert_eq!(laboratory.actions.iter().filter(|(_, action)| is_turn(action)).count(), 5);
}

#[test]
fn a_turn_that_stops_early_or_goes_the_other_way_is_taken_again() {
    let plan = whole(str::to_owned);
    for (error, part) in
        [(-300.0, "the turn does not end: the turntable is -300.0000"), (-900.0, "not on the way from")]
    {
        let (mut machine, mut laboratory) = at_first_turn(&plan);
        laboratory.turn_error_deg = error;
        laboratory.until(&mut machine, is_discarded);
        let found = laboratory.actions.iter().find(|(_, action)| is_discarded(action));
        assert!(matches!(found, Some((_, Action::Discard(reason))) if reason.contains(part)), "{found:?}");
        laboratory.turn_error_deg = 0.0;
        assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
        assert_eq!(laboratory.kept(), all(&plan)[12..]);
    }
    // The other axis moves.
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.until(&mut machine, is_turn);
    laboratory.target_deg[1] = 2.0;
    laboratory.until(&mut machine, is_discarded);
}

#[test]
fn a_controller_that_counts_modulo_360_turns_by_thirds() {
    let wrapped = whole(|text| text.replace("driver = \"acutrol\"", "driver = \"acutrol\"\nwrap = true"));
    let mut laboratory = SimulatedLaboratory::new(&wrapped);
    laboratory.wraps = true;
    let mut machine = CampaignMachine::new(&wrapped, 0, 5.0);
    assert_eq!(laboratory.run(&mut machine, 40.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&wrapped));
    let turned: Vec<_> = laboratory
        .actions
        .iter()
        .filter_map(|(_, action)| if let Action::Turn(angles) = action { Some(angles[0]) } else { None })
        .collect();
    assert_eq!(turned[..12], [120.0, 240.0, 360.0, 480.0, 600.0, 720.0, 600.0, 480.0, 360.0, 240.0, 120.0, 0.0]);
    let wrong = |error: f64| {
        let (mut machine, mut laboratory) = at_first_turn(&wrapped);
        laboratory.wraps = true;
        laboratory.turn_error_deg = error;
        laboratory.run(&mut machine, 60.0).unwrap_err()
    };
    let halt = wrong(0.0006);
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains("differ by 0.0")), "{halt:?}");
    // The plan does not say that the controller counts so.
    let plain = whole(str::to_owned);
    let (mut machine, mut laboratory) = at_first_turn(&plain);
    laboratory.wraps = true;
    let halt = laboratory.run(&mut machine, 60.0).unwrap_err();
    let hint = "the turn does not end: the turntable is -720.0000 and 0.0000 deg off";
    assert!(matches!(&halt, Halt::GivenUp(why) if why.contains(hint) && why.contains("needs wrap = true")), "{halt:?}");
}

#[test]
fn an_interrupted_turn_is_taken_again_whole() {
    let plan = whole(str::to_owned);
    for (interruption_s, keeps) in [(500.0, true), (700.0, false)] {
        let (mut machine, mut laboratory) = at_first_turn(&plan);
        let reached = machine.reached();
        laboratory.until(&mut machine, is_turn);
        laboratory.step(&mut machine).unwrap();
        // As after SIGKILL, and the safe state: the turntable has been stopped where it was.
        let mut machine = CampaignMachine::new(&plan, 12, 5.0);
        laboratory.target_deg = laboratory.angles_deg;
        laboratory.collecting = None;
        laboratory.trends.clear();
        laboratory.now += interruption_s;
        machine.resume(laboratory.now, interruption_s, reached, &laboratory.chamber).unwrap();
        let back = laboratory.now;
        laboratory.until(&mut machine, |action| matches!(action, Action::Move(_)));
        assert_eq!(laboratory.now - back < plan.soak.time_s, keeps);
        assert_eq!(laboratory.actions.last().unwrap().1, Action::Move(plan.turns[0].from_deg));
        assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
        assert_eq!(laboratory.kept(), all(&plan)[12..]);
    }
}

#[test]
fn a_chamber_that_leaves_its_set_point_costs_the_turn_in_progress() {
    let plan = whole(str::to_owned);
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.until(&mut machine, is_turn);
    laboratory.off.0 = -2.0;
    laboratory.until(&mut machine, is_discarded);
    laboratory.off.0 = 0.0;
    laboratory.until(&mut machine, |action| matches!(action, Action::Reached(_)));
    assert_eq!(laboratory.run(&mut machine, 60.0), Ok(true));
    assert_eq!(laboratory.kept(), all(&plan)[12..]);
}

#[test]
fn a_turn_without_samples_is_interrupted() {
    let plan = whole(str::to_owned);
    let (mut machine, mut laboratory) = at_first_turn(&plan);
    laboratory.collecting = None;
    let halt = laboratory.run(&mut machine, 60.0).unwrap_err();
    assert!(matches!(&halt, Halt::Interrupted(why) if why.contains("only 0.0 s of usable samples")), "{halt:?}");
    assert!(!laboratory.actions.iter().any(|(_, action)| is_turn(action)), "it does not turn before");
}
