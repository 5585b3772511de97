//! What the machine sees, what it decides, and the phases that it goes through.

use crate::plan::ThereAndBack;
use crate::stability::Trends;
use crate::step::CampaignStep;
use isotherm_instruments::{ChamberReading, TurntableReading};

/// The input of the machine. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation<'a> {
    /// The present time.
    pub now: f64,
    /// The last reading of the chamber, and its time.
    pub chamber: (&'a ChamberReading, f64),
    /// The last reading of the turntable, and its time.
    pub turntable: (&'a TurntableReading, f64),
    /// Rates of change of the temperatures.
    pub trends: &'a Trends,
    /// Whether the samples' clocks are known, so that a unit may begin.
    pub clocks_known: bool,
    /// Counted time of the unit in progress \[s\].
    pub collected_s: f64,
    /// Whether `collected_s` is enough for a dwell.
    pub complete: bool,
    /// Why the unit in progress cannot be used.
    pub spoiled: Option<&'a str>,
}

/// One action for the runner, which pauses or ends the campaign if the action fails.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Action {
    /// Do nothing now.
    Wait,
    /// Set the chamber's set point \[degC\].
    SetPoint(f64),
    /// Start the chamber.
    StartChamber,
    /// Move the turntable to these angles \[deg\].
    Move([f64; 2]),
    /// Move it to these angles with the rate and the acceleration of a turn \[deg\].
    Turn([f64; 2]),
    /// Record that this set point has been reached \[degC\].
    Reached(f64),
    /// The turntable has settled: take samples of this unit from now on.
    Collect(CampaignStep),
    /// Discard the samples of the unit in progress for this reason. The machine attempts the unit again.
    Discard(String),
    /// Keep this unit: it is complete.
    Keep {
        /// The unit.
        unit: CampaignStep,
        /// Read-backs of both angles at rest before and after a turn \[deg\]; `None` for other units.
        turned_deg: Option<[[f64; 2]; 2]>,
    },
    /// The campaign is complete.
    Done,
}

/// Why the machine cannot go on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Halt {
    /// Pause, and go on when all is well again.
    Interrupted(String),
    /// End the campaign in the safe state.
    GivenUp(String),
}

/// The state of the machine. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Phase {
    /// The start, or a new start after an interruption.
    Begin,
    /// The chamber ramps to the set point.
    Approach {
        /// When the final set point was commanded; `None` while the ramp goes on.
        commanded_at: Option<f64>,
    },
    /// The chamber is at the set point. The soak time and the rates of change are waited for.
    Soak {
        /// When the phase began.
        since: f64,
    },
    /// The turntable moves.
    Travel {
        /// When the motion was commanded; `None` before that.
        begun: Option<f64>,
    },
    /// The turntable is at its angles and at rest, but not yet for long enough.
    Settle {
        /// When the motion was commanded.
        begun: f64,
        /// When the turntable arrived.
        since: f64,
    },
    /// Samples are taken.
    Dwell {
        /// When the phase began.
        begun: f64,
        /// When the samples were complete. A later reading must confirm that the turntable is still in its position.
        complete: Option<f64>,
    },
    /// Samples are taken while the turntable rests, turns and rests again.
    Turn(TurnState),
    /// Samples are taken while the chamber goes there and back.
    Sweep {
        /// How far it is.
        leg: Leg,
        /// When the hold began at the end of the leg; `None` while the chamber ramps.
        held: Option<f64>,
    },
    /// All positions and turns are done; the shortest time at the set point is not over yet.
    Stay,
    /// The campaign is complete.
    Done,
}

/// How far the chamber is on its way there and back.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Leg {
    /// It has not left where it begins.
    Begin,
    /// It goes to the other end, or holds there.
    There,
    /// It goes back, or holds there.
    Back,
}

impl Leg {
    /// The set point at the end of the leg \[degC\].
    pub(crate) const fn end_c(self, way: &ThereAndBack) -> f64 {
        match self {
            Self::Begin | Self::Back => way.from_c,
            Self::There => way.to_c,
        }
    }
}

/// The state of a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TurnState {
    /// When its samples began, laboratory time \[s\].
    pub begun: f64,
    /// Read-back before the turn \[deg\]; NaN until it has been taken.
    pub before_deg: [f64; 2],
    /// How far it is.
    pub stage: TurnStage,
}

/// How far a turn is. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TurnStage {
    /// The turntable rests where the turn begins.
    Before {
        /// When the samples were complete. A later reading is the read-back before the turn.
        complete: Option<f64>,
    },
    /// It turns.
    Turning {
        /// Number of the motion, from 1: a controller that counts modulo 360 degrees gets several.
        motion: u32,
        /// When the motion was commanded.
        commanded: f64,
        /// When the turntable arrived.
        arrived: Option<f64>,
    },
    /// It rests where the turn ends.
    After {
        /// When the turntable had settled.
        settled: f64,
        /// When the samples were complete. A later reading is the read-back after the turn.
        complete: Option<f64>,
    },
}

impl Phase {
    /// The name that messages and files show.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Begin | Self::Approach { .. } => "approach",
            Self::Soak { .. } => "soak",
            Self::Travel { .. } => "travel",
            Self::Settle { .. } => "settle",
            Self::Dwell { .. } => "dwell",
            Self::Turn(_) => "turn",
            Self::Sweep { .. } => "sweep",
            Self::Stay => "stay",
            Self::Done => "done",
        }
    }

    /// Whether the turntable may move.
    pub(crate) const fn is_moving(self) -> bool {
        matches!(self, Self::Travel { .. } | Self::Settle { .. } | Self::Turn(_))
    }
}
