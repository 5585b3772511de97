//! The decision rule: when a time constant and a transient may be written, and the words for it.

use super::result::{BiasTransient, Condition, TimeConstantEstimate, TransientVerdict};
use crate::effects::{BIAS_EFFECT, GYROSCOPE_BIAS_EFFECT as GYROSCOPE_EFFECT};
use isotherm_shared::units::SensorKind;

/// Least part of the range that heating and cooling of one recording share.
const SHARED: f64 = 0.5;
/// Largest factor between the time constant and an end of its interval.
const INTERVAL: f64 = 3.0;
/// The prediction with what a table can have, as a part of that of the static curve.
const PREDICTS: f64 = 0.90;
/// The prediction with lag and hysteresis, as a part of that with only hysteresis.
const NOT_HYSTERESIS: f64 = 0.95;
/// Least ratio of a transient to its standard error at the time constant.
const SIGNIFICANT: f64 = 4.0;
/// The verdict is hysteresis if hysteresis predicts with less than this part of the error of what a table can have.
const HYSTERESIS: f64 = 0.8;

/// What is said where a step parts the sweeps.
pub(super) const STEPPED: &str = "undetermined: no transient is written; a step parts the sweeps";

/// The conditions of the time constant that was searched for: its value and its interval, and the ends of the search
/// \[s\].
pub(super) fn of_search(tau_s: f64, interval_s: [f64; 2], ends_s: [f64; 2]) -> [Condition; 2] {
    // The end that is nearer to the interval.
    let upper = tau_s * tau_s > ends_s[0] * ends_s[1];
    let (figure, limit) = if upper { (interval_s[1], ends_s[1]) } else { (interval_s[0], ends_s[0]) };
    let met = interval_s[0] > ends_s[0] && interval_s[1] < ends_s[1];
    let factor = (interval_s[1] / interval_s[0]).sqrt();
    let interval = Condition {
        name: "interval",
        figure: factor,
        limit: INTERVAL,
        above: false,
        met: factor < INTERVAL,
        decides: true,
    };
    [Condition { name: "inside-search", figure, limit, above: !upper, met, decides: true }, interval]
}

/// The condition that heating and cooling of one recording share enough of the range.
pub(super) fn both_directions(shared: f64) -> Condition {
    Condition {
        name: "both-directions",
        figure: shared,
        limit: SHARED,
        above: true,
        met: shared >= SHARED,
        decides: true,
    }
}

/// The conditions of one bias. `difference` is the standard deviation of d.
pub(super) fn of_bias(bias: &BiasTransient, difference: f64) -> Vec<Condition> {
    let below =
        |name, figure: f64, limit| Condition { name, figure, limit, above: false, met: figure < limit, decides: true };
    let above =
        |name, figure: f64, limit| Condition { name, figure, limit, above: true, met: figure > limit, decides: true };
    let threshold = match bias.kind {
        SensorKind::Accelerometer => BIAS_EFFECT,
        SensorKind::Gyroscope => GYROSCOPE_EFFECT,
    };
    let ratio = |of: fn(&super::result::Prediction) -> f64| bias.prediction.as_ref().map_or(f64::NAN, of);
    vec![
        below("predicts", ratio(|p| p.written / p.static_curve), PREDICTS),
        below("lag-not-hysteresis", ratio(|p| p.lag_and_hysteresis / p.hysteresis), NOT_HYSTERESIS),
        above("significant", bias.estimate.abs() / bias.error_at_time_constant, SIGNIFICANT),
        above("matters", bias.estimate.abs() * difference, threshold),
    ]
}

/// Whether all conditions that decide are met.
pub(super) fn met(conditions: &[Condition]) -> bool {
    conditions.iter().all(|condition| condition.met || !condition.decides)
}

/// What the ramps show.
pub(super) fn verdict(given: bool, biases: &[BiasTransient]) -> TransientVerdict {
    let any = |of: &dyn Fn(&BiasTransient) -> bool| biases.iter().any(of);
    let predicted = |of: fn(&super::result::Prediction) -> bool| {
        move |bias: &BiasTransient| bias.prediction.as_ref().is_some_and(of)
    };
    if any(&|bias| bias.transient != 0.0) {
        if given { TransientVerdict::Given } else { TransientVerdict::Lag }
    } else if any(&predicted(|p| p.hysteresis < HYSTERESIS * p.written && p.hysteresis < PREDICTS * p.static_curve)) {
        TransientVerdict::Hysteresis
    } else if any(&predicted(|p| p.lag_and_hysteresis.min(p.written).min(p.hysteresis) < PREDICTS * p.static_curve))
        || any(&|bias| bias.conditions.iter().any(|c| c.name == "significant" && c.met))
        || any(&|bias| bias.prediction.is_none())
    {
        TransientVerdict::Undetermined
    } else {
        TransientVerdict::None
    }
}

/// The verdict and its reasons in sentences.
pub(super) fn words(
    verdict: TransientVerdict,
    time_constant: &TimeConstantEstimate,
    conditions: &[Condition],
    biases: &[BiasTransient],
) -> Vec<String> {
    let names = |of: &dyn Fn(&&BiasTransient) -> bool| {
        biases.iter().filter(of).map(BiasTransient::name).collect::<Vec<_>>().join(", ")
    };
    let written = names(&|bias| bias.transient != 0.0);
    let TimeConstantEstimate { value_s, interval_s: [low_s, high_s], given, .. } = time_constant;
    let tau = if *given {
        format!("time constant {value_s} s")
    } else {
        format!("time constant {value_s:.0} s ({low_s:.0} .. {high_s:.0} s, 95 %)")
    };
    let mut words = vec![match verdict {
        TransientVerdict::Lag => format!("lag: {tau}; transients are written for {written}"),
        TransientVerdict::Given => format!("given: {tau}, which you gave; transients are written for {written}"),
        TransientVerdict::Hysteresis => "hysteresis, or a drift: it predicts the sweeps left out better than a lag; no transient is written, and the band between heating and cooling \
             stays".to_owned(),
        TransientVerdict::Undetermined => {
            "undetermined: no transient is written; these ramps do not show whether heating and cooling differ by a lag. Record ramps of another rate, with holds \
             between them, and each both ways"
                .to_owned()
        }
        TransientVerdict::None => "none: no transient is written; neither a lag nor hysteresis predicts the sweeps left out better than the static curve".to_owned(),
    }];
    let of_time_constant = conditions.iter().filter(|condition| !condition.met);
    words.extend(of_time_constant.map(|condition| reason(condition, time_constant)));
    let refused = biases.iter().filter(|bias| bias.transient == 0.0);
    words.extend(refused.filter_map(|bias| {
        let reasons: Vec<_> =
            bias.conditions.iter().filter(|condition| !condition.met).map(|c| reason(c, time_constant)).collect();
        (!reasons.is_empty()).then(|| format!("{}: {}", bias.name(), reasons.join("; ")))
    }));
    words
}

/// The words for a condition that is not met.
fn reason(condition: &Condition, time_constant: &TimeConstantEstimate) -> String {
    let Condition { figure, limit, .. } = *condition;
    match condition.name {
        "both-directions" => format!(
            "heating and cooling of one recording share {:.0} % of the range of the temperature, {:.0} % are needed: heat and cool in one recording",
            100.0 * figure.max(0.0),
            100.0 * limit
        ),
        "inside-search" => {
            let ends = time_constant.search.first().zip(time_constant.search.last());
            let [low, high] = ends.map_or([limit; 2], |(first, last)| [first.0, last.0]);
            let side = if condition.above { "below" } else { "above" };
            format!(
                "the time constant is at the edge of its range: these ramps can show {low:.0} .. {high:.0} s, and its interval reaches {side} that"
            )
        }
        "interval" => {
            let factor = if figure < 100.0 { format!("{figure:.1}") } else { "over 100".to_owned() };
            format!(
                "the time constant is not determined: its interval is a factor {factor} either way, below {limit:.0} is needed"
            )
        }
        "predicts" if !figure.is_finite() => {
            "no sweep can be left out to try the prediction: record at least two sweeps in one recording".to_owned()
        }
        "predicts" => format!(
            "a transient does not predict the sweeps left out: {figure:.2} of the error of the static curve, below {limit:.2} is needed"
        ),
        "lag-not-hysteresis" if !figure.is_finite() => {
            "lag and hysteresis cannot be distinguished without a sweep left out".to_owned()
        }
        "lag-not-hysteresis" => format!(
            "hysteresis explains as much: with a lag in addition to it, the error on the sweeps left out is {figure:.2} of that with only hysteresis, below {limit:.2} \
             is needed"
        ),
        "significant" => format!(
            "the transient is {figure:.1} of its standard errors at this time constant, over {limit:.0} are needed"
        ),
        _ => "the transient changes the bias by less than what matters".to_owned(),
    }
}

/// Warnings: what a given time constant did without. `searched` is the time constant that the ramps show, with its
/// conditions.
pub(super) fn warnings(
    searched: &TimeConstantEstimate,
    conditions: &[Condition],
    biases: &[BiasTransient],
    given_s: f64,
) -> Vec<String> {
    let failed = |conditions: &[Condition]| {
        let failed = conditions.iter().filter(|condition| !condition.met && !condition.decides);
        failed.map(|condition| reason(condition, searched)).collect::<Vec<_>>()
    };
    let written = || biases.iter().filter(|bias| bias.transient != 0.0);
    let of_biases = written().filter_map(|bias| {
        let reasons = failed(&bias.conditions);
        (!reasons.is_empty()).then(|| format!("{}: {}", bias.name(), reasons.join("; ")))
    });
    let all = failed(conditions).into_iter().chain(of_biases);
    let mut warnings: Vec<_> =
        all.map(|reason| format!("left to find the lag, the ramps would not show it: {reason}")).collect();
    let [low_s, high_s] = searched.interval_s;
    if conditions.iter().all(|condition| condition.met) && !(low_s..=high_s).contains(&given_s) {
        warnings.push(format!(
            "the time constant given is {given_s} s, but the ramps show {:.0} s ({low_s:.0} .. {high_s:.0} s, 95 %): check it, or leave it to the ramps",
            searched.value_s
        ));
    }
    let better = written().filter(|bias| bias.prediction.is_some_and(|it| it.hysteresis < HYSTERESIS * it.written));
    let names: Vec<_> = better.map(BiasTransient::name).collect();
    if !names.is_empty() {
        warnings.push(format!(
            "hysteresis predicts the sweeps left out better than this lag, for {}: at other rates the transients can be worse than none. Verify the table on a \
             run of another rate",
            names.join(", ")
        ));
    }
    warnings
}
