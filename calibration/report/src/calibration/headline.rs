//! The first screen of a calibration's page: what the instrument was, what it is now, and whether every check that can
//! fail was made and passed.

use super::parts::CalibrationPage;
use super::triad::Bars;
use crate::page::{Cell, Column, NoteKind, Page};
use isotherm_campaign::SampleLayout;
use isotherm_fit::{Accuracy, CalibratedTriad};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_statistics::rms;

/// An accelerometer: its number, its errors before and after, and what is known of the whole curves.
type Row<'a> = (usize, [f64; 2], &'a Accuracy);

impl CalibrationPage<'_> {
    /// The result in a sentence for each triad, then by accelerometer, then what is to be looked at.
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
            page.paragraph(&format!("{}{accuracy}.", self.whose(triad)));
        }
        let columns: [Column<'_, Row<'_>>; 6] = [
            ("Axis", &|(axis, ..)| Cell::text(AXIS_NAMES[*axis])),
            ("Before", &|(_, [before, _], _)| Cell::number(*before, 3)),
            ("After", &|(_, [_, after], _)| Cell::number(*after, 3)),
            ("Factor", &|(_, [before, after], _)| Cell::number(before / after, 1)),
            ("Bias, ± / 1e-6 g0", &|(axis, _, known)| Cell::known(known.bias_band[*axis].map(|half| half * 1e6), 2)),
            ("Scale factor, ± / ppm", &|(axis, _, known)| {
                Cell::known(known.scale_factor_band[*axis].map(|half| half * 1e6), 2)
            }),
        ];
        let rows = errors.into_iter().enumerate().map(|(axis, both)| (axis, both, &accuracies[0]));
        page.columns("Error of the dwells, rms [1e-6 g0], and 95 % of the curves", rows, &columns);
        page.paragraph(
            "These dwells made the table, so the factor is a check of the fit: how good the table is on other data, verify shows.",
        );
        self.remarks(page, &accuracies);
    }

    /// What is to be looked at; a green box if every check that can fail was made, and passed.
    fn remarks(&self, page: &mut Page, accuracies: &[Accuracy]) {
        let calibration = self.calibration;
        for finding in &calibration.findings {
            let line = match (finding.line, self.campaign.layout) {
                (None, _) => String::new(),
                (Some(line), SampleLayout::ByPosition { .. }) => format!("{}: ", (self.locate)(line)),
                (Some(line), _) => format!("{}, line {line}: ", self.campaign.samples.join(", ")),
            };
            page.note(NoteKind::Warning, "Look at this", &format!("{line}{finding}"));
        }
        let misfits: Vec<_> = self.triads.iter().filter_map(misfit).collect();
        misfits.iter().for_each(|misfit| page.note(NoteKind::Warning, "The curve misses the set points", misfit));
        let cautions: Vec<_> = accuracies.iter().filter_map(Accuracy::caution).collect();
        cautions.iter().for_each(|caution| page.note(NoteKind::Warning, "Caution", caution));
        let unmade = self.unmade_checks();
        if !unmade.is_empty() {
            page.note(NoteKind::Warning, "Not everything could be checked", &format!("{}.", unmade.join("; ")));
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
