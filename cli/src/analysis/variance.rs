//! Variance-based sensitivity from given data: how much of a measurement's variance a parameter explains,
//! alone and together with another.
//!
//! Sobol's indices ("Sensitivity estimates for nonlinear mathematical models", 1993), estimated from the
//! trials there are by the means of bins (Plischke, Borgonovo and Smith, "Global sensitivity measures from
//! given data", 2013). So that few trials do not seem to explain each other, each is predicted by the others
//! of its bin (Allen, "The relationship between variable selection and data augmentation and a method for
//! prediction", 1974). Repeated runs of one configuration in one state count as one. Costs count by their
//! logarithm, so that factors add up and a few very dear configurations are not all there is.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Influence;
use super::table::{Column, Measured, Table};

/// Number of most influential parameters that form pairs.
const PAIRED: usize = 6;
/// A pair that explains less beyond its halves is not shown.
const PAIR_MIN: f64 = 0.01;

/// Two parameters that matter together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Pair {
    pub(crate) parameters: [String; 2],
    /// Share of the variance that both explain beyond what each does alone.
    pub(crate) interaction: f64,
}

/// Fewer different configurations say nothing of a share.
const CONFIGURATIONS_MIN: usize = 20;

/// Share of the variance that a parameter explains alone, 0 to 1, among the trials in which it is active;
/// `None` with too few configurations to say.
pub(super) fn first_order(table: &Table, column: &Column, target: &[Option<f64>]) -> Option<f64> {
    explained(table, &column.bins().0, target)
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
            // The single shares from the trials that have both values.
            let only = |bins: &[Option<usize>]| -> Vec<Option<usize>> {
                bins.iter().zip(&both).map(|(bin, both)| both.and(*bin)).collect()
            };
            let share = |bins: &[Option<usize>]| explained(table, bins, &metric.relative).unwrap_or(0.0);
            let interaction = share(&both) - share(&only(&in_a)) - share(&only(&in_b));
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

/// Share of the variance of a target's logarithm that bins predict in configurations left out.
fn explained(table: &Table, bins: &[Option<usize>], target: &[Option<f64>]) -> Option<f64> {
    // Of each configuration its bin, and the sum and the number of its logarithms.
    let mut configurations: BTreeMap<usize, (usize, f64, f64)> = BTreeMap::new();
    for ((bin, y), configuration) in bins.iter().zip(target).zip(&table.configurations) {
        let (Some(bin), Some(y)) = (bin, y.filter(|y| *y > 0.0)) else { continue };
        let sum = configurations.entry(*configuration).or_insert((*bin, 0.0, 0.0));
        (sum.1, sum.2) = (sum.1 + y.ln(), sum.2 + 1.0);
    }
    let means: Vec<(usize, f64)> =
        configurations.into_values().map(|(bin, sum, count)| (bin, sum / count)).collect();
    if means.len() < CONFIGURATIONS_MIN {
        return None;
    }
    let most = means.iter().map(|(bin, _)| *bin).max().unwrap_or(0);
    let mut sums = vec![(0.0_f64, 0.0_f64); most + 1];
    for (bin, y) in &means {
        (sums[*bin].0, sums[*bin].1) = (sums[*bin].0 + 1.0, sums[*bin].1 + y);
    }
    let count = means.len() as f64;
    let mean = means.iter().map(|(_, y)| y).sum::<f64>() / count;
    // The squared distance from the mean of the others.
    let without = |y: f64, mean: f64, count: f64| ((y - mean) * count / (count - 1.0)).powi(2);
    let all: f64 = means.iter().map(|(_, y)| without(*y, mean, count)).sum();
    let within: f64 = means
        .iter()
        .map(|(bin, y)| match sums[*bin] {
            (own, sum) if own > 1.0 => without(*y, sum / own, own),
            _ => without(*y, mean, count),
        })
        .sum();
    Some(if all > 0.0 { (1.0 - within / all).clamp(0.0, 1.0) } else { 0.0 })
}
