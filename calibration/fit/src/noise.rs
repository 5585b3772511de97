//! The white noise of a triad's sensors, from the rows of a campaign.

use isotherm_campaign::{Block, Dwell};
use isotherm_shared::table::Axis;
use isotherm_shared::wire::AXES;
use isotherm_statistics::robust_sd;

/// The noise of each sensor in a mean over 1 s \[base unit of the triad\]; in a mean over T seconds it is that over the
/// root of T. It comes from the differences of successive blocks of the dwells, which a wrong position or a wrong curve
/// does not change. 0 if dwells have a single block.
pub fn noise_of_dwells<'a>(dwells: impl Iterator<Item = &'a Dwell> + Clone, axes: &[Axis; AXES]) -> [f64; AXES] {
    [0, 1, 2].map(|axis| {
        let differences = |dwell: &Dwell| -> Vec<f64> {
            let (content, board) = (&axes[axis], dwell.board(axis));
            let scale_factors = [content.positive_scale_factor_at(board).0, content.negative_scale_factor_at(board).0];
            let indicated = |block: &Block| {
                let [positive, negative] = block.sums.rates(axis);
                positive / scale_factors[0] + negative / scale_factors[1]
            };
            let difference = |pair: &[Block]| {
                let variance = pair.iter().map(|block| 1.0 / block.sums.seconds).sum::<f64>();
                (indicated(&pair[1]) - indicated(&pair[0])) / variance.sqrt()
            };
            dwell.blocks.windows(2).map(difference).collect()
        };
        let found = robust_sd(&dwells.clone().flat_map(differences).collect::<Vec<_>>());
        if found.is_nan() { 0.0 } else { found }
    })
}
