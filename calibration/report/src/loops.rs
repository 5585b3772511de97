//! Pictures of the loop between heating and cooling: the residual of a bias against its temperature, coloured by
//! direction.

use super::plot::{Plot, Style};
use super::quantity::digits;
use isotherm_statistics::{LoopPoint, band};
use maud::Markup;

/// The loop of the sensor `name` without its transient and with it, as two figures on one scale, each with a caption
/// that gives the hysteresis band: for [`Page::figures`](super::page::Page::figures). One figure where both are the
/// same. `unit` is that of the pictures, for example `ug0`, and `factor` leads to it from the unit of the residuals.
#[must_use]
pub(crate) fn pictures(
    name: &str,
    unit: &str,
    factor: f64,
    before: &[LoopPoint],
    after: &[LoopPoint],
) -> Vec<(Markup, String)> {
    let all = || before.iter().chain(after).map(|point| point.residual * factor);
    let picture = |model: &str, points: &[LoopPoint]| {
        let title = format!("{name} {model}");
        let of = |heating: bool| {
            let of_direction = points.iter().filter(move |point| point.heating == heating);
            of_direction.map(|point| (point.temperature, point.residual * factor))
        };
        let plot = Plot::new(&title, "Head temperature", &format!("Residual / {unit}")).zero_line().include_y(all());
        let plot = plot.series("Cooling", Style::Points, of(false)).series("Heating", Style::Points, of(true));
        (plot.svg(), format!("{title}: {}", caption(unit, factor, points)))
    };
    let mut pictures = vec![picture("without transient", before)];
    if before != after {
        pictures.push(picture("with transient", after));
    }
    pictures
}

/// The band of the points in words.
fn caption(unit: &str, factor: f64, points: &[LoopPoint]) -> String {
    match band(points) {
        Some(band) => format!("hysteresis band {} {unit}.", digits(band * factor, 3)),
        None => "heating and cooling share no temperature, no hysteresis band.".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::tests::assert_well_formed;

    /// A loop whose directions are `apart` [g0].
    fn round_trip(apart: f64) -> Vec<LoopPoint> {
        let point = |i: i32, heating: bool| LoopPoint {
            temperature: f64::from(i),
            residual: if heating { 0.5 * apart } else { -0.5 * apart },
            heating,
        };
        (0..60).flat_map(|i| [point(i, true), point(i, false)]).collect()
    }

    /// The labels of the y axis.
    fn y_labels(svg: &str) -> Vec<&str> {
        svg.split("<text class=\"k e\"").skip(1).filter_map(|rest| rest.split(['>', '<']).nth(1)).collect()
    }

    #[test]
    fn before_and_after_have_one_scale_and_their_bands() {
        let pictures = pictures("A1", "ug0", 1e6, &round_trip(50e-6), &round_trip(0.5e-6));
        let [(before, of_before), (after, of_after)] = &pictures[..] else { panic!("{}", pictures.len()) };
        assert_eq!(of_before, "A1 without transient: hysteresis band 50.0 ug0.");
        assert_eq!(of_after, "A1 with transient: hysteresis band 0.500 ug0.");
        let (before, after) = (&before.0, &after.0);
        assert!(y_labels(before).len() >= 4 && y_labels(before) == y_labels(after), "{before} {after}");
        for svg in [before, after] {
            assert_well_formed(svg);
            for series in ["Cooling (60 points)", "Heating (60 points)"] {
                assert!(svg.contains(series), "{series}: {svg}");
            }
            assert!(["p s1", "p s2"].iter().all(|class| svg.contains(&format!("<path class=\"{class}\""))), "{svg}");
        }
    }

    #[test]
    fn a_loop_that_is_not_closed_has_no_band() {
        let up: Vec<_> = round_trip(1.0).into_iter().filter(|point| point.heating).collect();
        for points in [&up[..], &[]] {
            let pictures = pictures("G3", "deg/h", 1.0, points, points);
            let [(svg, caption)] = &pictures[..] else { panic!("both are the same: {}", pictures.len()) };
            assert_well_formed(&svg.0);
            assert!(caption.ends_with("share no temperature, no hysteresis band."), "{caption}");
        }
    }
}
