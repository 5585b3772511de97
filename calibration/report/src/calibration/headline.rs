//! The first screen of a calibration's page: what the instrument was, what it is now, and whether every check that can
//! fail was made and passed.

use super::parts::CalibrationPage;
use super::triad::Bars;
use crate::page::{Cell, Column, NoteKind, Page};
use crate::quantity::sentence;
use crate::transients;
use isotherm_campaign::SampleLayout;
use isotherm_fit::{Accuracy, CalibratedTriad};
use isotherm_shared::wire::AXES;
use isotherm_statistics::rms;

/// A sensor on the first screen.
struct Row<'a> {
    triad: &'a CalibratedTriad<'a>,
    axis: usize,
    /// Errors of the dwells before and after, rms \[1e-6 g0\]; of accelerometers.
    errors: Option<[f64; 2]>,
    accuracy: &'a Accuracy,
}

impl Row<'_> {
    /// The value of a quantity at the middle of its range, in the unit of the page.
    fn middle(&self, quantity: usize) -> f64 {
        let curve = &self.triad.curves[self.axis][quantity];
        let [low, high] = curve.range();
        curve.at(0.5 * (low + high)) * self.triad.units.factor(quantity)
    }

    fn bias(&self) -> Cell {
        let units = self.triad.units;
        let (value, places) = (self.middle(0), units.accuracy_decimals);
        let band = self.accuracy.bias_band[self.axis].map(|half| format!("{:.places$}", half * units.bias_factor));
        Cell::Number(format!("{value:.places$} ± {}", band.as_deref().unwrap_or("not known")))
    }
}

impl CalibrationPage<'_> {
    /// The result in a sentence for each triad, then by sensor, then what was found.
    pub(super) fn headline(&self, page: &mut Page) {
        let errors = [0, 1, 2].map(|axis| [rms(&self.frozen_errors(axis)), rms(&self.errors(axis))]);
        let worst = |time: usize| errors.iter().map(|both| both[time]).fold(0.0, f64::max);
        page.paragraph(&format!(
            "With coefficients frozen at mid temperature, as without a calibration over temperature, the worst accelerometer is \
             off by {:.1}e-6 g0 rms over the dwells; with this table by {:.2}e-6 g0, which is {:.0} times less.",
            worst(0),
            worst(1),
            worst(0) / worst(1)
        ));
        let accuracies: Vec<_> = self.triads.iter().map(|triad| Accuracy::of_triad(self.calibration, triad)).collect();
        for (triad, accuracy) in self.triads.iter().zip(&accuracies) {
            page.paragraph(&sentence(&format!("{}{accuracy}", self.whose(triad))));
        }
        for (triad, accuracy) in self.triads.iter().zip(&accuracies) {
            let is_first = triad.gyroscopes.is_none();
            let row = |axis: usize| Row { triad, axis, errors: is_first.then_some(errors[axis]), accuracy };
            let error = |it: &Row<'_>, time: usize| Cell::known(it.errors.map(|both| both[time]), 3);
            let factor = |it: &Row<'_>| it.errors.map(|[before, after]| before / after);
            let scale = |it: &Row<'_>| it.accuracy.scale_factor_band[it.axis].map(|half| half * 1e6);
            let titles = [0, 1].map(|quantity| {
                format!("{} / {}", ["Bias", "Scale factor K+"][quantity], triad.units.on_page(quantity))
            });
            let columns: [Column<'_, Row<'_>>; 7] = [
                ("Axis", &|it| Cell::text(it.triad.names[it.axis])),
                ("Before", &|it| error(it, 0)),
                ("After", &|it| error(it, 1)),
                ("Factor", &|it| Cell::known(factor(it), 1)),
                (&titles[0], &Row::bias),
                (&titles[1], &|it| Cell::number(it.middle(1), triad.units.scale_factor_decimals)),
                ("Scale factor, ± / ppm", &|it| Cell::known(scale(it), 2)),
            ];
            let of_dwells = if is_first { "Error of the dwells that made the table, rms [1e-6 g0]; v" } else { "V" };
            let caption = format!("{of_dwells}alues at mid range with the largest 95 % band of each whole curve");
            page.columns(&caption, (0..AXES).map(row), &columns);
        }
        self.remarks(page, &accuracies);
    }

    /// What is to be looked at; a green box if every check that can fail was made, and passed.
    fn remarks(&self, page: &mut Page, accuracies: &[Accuracy]) {
        let calibration = self.calibration;
        page.findings(&calibration.findings, |finding| match (finding.line, self.campaign.layout) {
            (None, _) => String::new(),
            (Some(line), SampleLayout::ByPosition { .. }) => format!("{}: ", (self.locate)(line)),
            (Some(line), _) => format!("{}, line {line}: ", self.campaign.samples.join(", ")),
        });
        if let Some(found) = &calibration.transients {
            transients::verdict(page, found);
        }
        let misfits: Vec<_> = self.triads.iter().filter_map(misfit).collect();
        misfits.iter().for_each(|misfit| page.note(NoteKind::Warning, "The curve misses the set points", misfit));
        let cautions: Vec<_> = accuracies.iter().filter_map(Accuracy::caution).collect();
        cautions.iter().for_each(|caution| page.note(NoteKind::Warning, "Caution", caution));
        let unmade = self.unmade_checks();
        if !unmade.is_empty() {
            page.note(NoteKind::Warning, "Not everything could be checked", &sentence(&unmade.join("; ")));
        }
        if calibration.findings.is_empty() && misfits.is_empty() && cautions.is_empty() && unmade.is_empty() {
            let turns = if calibration.gyroscopes.is_some() { "turns, Earth's rate, " } else { "" };
            let text = format!(
                "Positions, {turns}time, soak, stillness, temperature, saturation, fit, outliers, and the residuals of the set points were \
                 looked at without a remark."
            );
            page.note(NoteKind::Good, "Nothing found", &text);
        }
    }

    /// The checks that the data do not allow.
    fn unmade_checks(&self) -> Vec<String> {
        let tilt = self.calibration.solution.tilt.is_none().then(|| {
            "the positions cannot separate a tilt of the base from the biases, or have no angles: the level was not checked".to_owned()
        });
        let bars = self.triads.iter().filter(|triad| Bars::of_triad(triad).all(|bars| bars.known() == 0));
        let bars = bars.map(|triad| {
            let whose = self.whose(triad);
            format!("{whose}no set point shows its own error: whether the curves miss the set points was not checked")
        });
        tilt.into_iter().chain(bars).collect()
    }
}

/// Of the curves that miss more error bars of set points than chance allows the worst one, in words.
fn misfit(triad: &CalibratedTriad<'_>) -> Option<String> {
    let misfits = Bars::of_triad(triad).filter(Bars::is_misfit);
    let worst = misfits.max_by(|a, b| a.largest().total_cmp(&b.largest()))?;
    Some(format!(
        "{} of {} error bars of {} miss the curve, the worst by {:.1} times its half length: its order is too low (--order), or \
         something changed between the set points; the residuals below show it.",
        worst.missed(),
        worst.known(),
        worst.name,
        worst.largest()
    ))
}
