//! Variance-based sensitivity from given data: how much of a measurement's variance a parameter explains, alone and
//! together with another.
//!
//! Sobol's indices ("Sensitivity estimates for nonlinear mathematical models", 1993), estimated from the trials there are:
//! the variance between the means of bins over that of all (Plischke, Borgonovo and Smith, "Global sensitivity measures
//! from given data", 2013), less what bins show by chance, as the adjusted coefficient of determination has it. Costs count
//! by their logarithm, so that factors add up and a few very dear configurations are not all there is.

use serde::Serialize;

use super::Influence;
use super::table::{Column, Measured, Table};

/// Pairs are formed of so many of the most influential parameters.
const PAIRED: usize = 6;
/// A pair that explains less beyond its halves is not told.
const PAIR_MIN: f64 = 0.01;

/// Two parameters that matter together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Pair {
    pub(crate) parameters: [String; 2],
    /// Share of the variance that both explain beyond what each does alone.
    pub(crate) interaction: f64,
}

/// Share of the variance that a parameter explains alone, 0 to 1, among the trials in which it is active.
pub(super) fn first_order(column: &Column, target: &[Option<f64>]) -> f64 {
    explained(&column.bins().0, target)
}

/// The pairs of the most influential parameters that matter together, strongest first.
pub(super) fn pairs(table: &Table, metric: &Measured, influences: &[Influence]) -> Vec<Pair> {
    let columns: Vec<&Column> =
        influences.iter().take(PAIRED).filter_map(|one| table.parameter(&one.parameter)).collect();
    let mut pairs = Vec::new();
    for (index, a) in columns.iter().enumerate() {
        for b in &columns[index + 1..] {
            let ((in_a, _), (in_b, of_b)) = (a.bins(), b.bins());
            let both: Vec<Option<usize>> =
                in_a.iter().zip(&in_b).map(|(a, b)| Some((*a)? * of_b + (*b)?)).collect();
            // The halves by the same trials.
            let only = |bins: &[Option<usize>]| -> Vec<Option<usize>> {
                bins.iter().zip(&both).map(|(bin, both)| both.and(*bin)).collect()
            };
            let target = &metric.relative;
            let interaction =
                explained(&both, target) - explained(&only(&in_a), target) - explained(&only(&in_b), target);
            if interaction >= PAIR_MIN {
                pairs.push(Pair { parameters: [a.name.clone(), b.name.clone()], interaction });
            }
        }
    }
    pairs.sort_by(|a, b| {
        b.interaction.total_cmp(&a.interaction).then_with(|| a.parameters.cmp(&b.parameters))
    });
    pairs
}

/// Share of the variance of a target's logarithm between bins, adjusted for their number.
fn explained(bins: &[Option<usize>], target: &[Option<f64>]) -> f64 {
    let pairs =
        || bins.iter().zip(target).filter_map(|(bin, y)| Some(((*bin)?, y.filter(|y| *y > 0.0)?.ln())));
    let count = pairs().count() as f64;
    let most = pairs().map(|(bin, _)| bin).max().unwrap_or(0);
    let mut sums = vec![(0.0_f64, 0.0_f64); most + 1];
    for (bin, y) in pairs() {
        sums[bin].0 += 1.0;
        sums[bin].1 += y;
    }
    let used = sums.iter().filter(|(count, _)| *count > 0.0).count() as f64;
    if count <= used + 1.0 {
        return 0.0;
    }
    let mean = pairs().map(|(_, y)| y).sum::<f64>() / count;
    let all: f64 = pairs().map(|(_, y)| (y - mean) * (y - mean)).sum();
    let within: f64 = pairs()
        .map(|(bin, y)| {
            let own = sums[bin].1 / sums[bin].0;
            (y - own) * (y - own)
        })
        .sum();
    if all <= 0.0 {
        return 0.0;
    }
    (1.0 - within / (count - used) * ((count - 1.0) / all)).clamp(0.0, 1.0)
}
