//! The dependence between two columns.
//!
//! Pearson's correlation sees straight lines, Spearman's every rise, mutual information every pattern.
//! Intervals of correlations are Fisher's ("On the probable error of a coefficient of correlation", Metron 1,
//! 1921). Mutual information is that of bins, less what bins alone would show by chance (Miller, "Note on the
//! bias of information estimates", 1955).

use serde::Serialize;

use super::table::{Column, bins};

/// A coefficient from -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Correlation {
    pub(crate) r: f64,
    /// 95 %.
    pub(crate) interval: [f64; 2],
}

impl Correlation {
    /// Whether the interval leaves nought out.
    pub(super) fn is_there(&self) -> bool {
        self.interval[0] > 0.0 || self.interval[1] < 0.0
    }
}

fn pairs(column: &Column, target: &[Option<f64>]) -> (Vec<f64>, Vec<f64>) {
    let scaled = |value: f64| if column.log && value > 0.0 { value.ln() } else { value };
    column.values.iter().zip(target).filter_map(|(x, y)| Some((scaled((*x)?), (*y)?))).unzip()
}

/// Pearson's coefficient; a parameter on a log scale counts by its logarithm.
pub(super) fn correlation(column: &Column, target: &[Option<f64>]) -> Option<Correlation> {
    let (x, y) = pairs(column, target);
    if column.ordered { pearson(&x, &y) } else { None }
}

/// Spearman's coefficient, equal values sharing their mean rank.
pub(super) fn rank_correlation(column: &Column, target: &[Option<f64>]) -> Option<Correlation> {
    let (x, y) = pairs(column, target);
    if column.ordered { pearson(&ranks(&x), &ranks(&y)) } else { None }
}

fn pearson(x: &[f64], y: &[f64]) -> Option<Correlation> {
    let count = x.len() as f64;
    if x.len() < 4 {
        return None;
    }
    let (mean_x, mean_y) = (x.iter().sum::<f64>() / count, y.iter().sum::<f64>() / count);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (dx, dy) = (x - mean_x, y - mean_y);
        (xx, yy, xy) = (xx + dx * dx, yy + dy * dy, xy + dx * dy);
    }
    if xx <= 0.0 || yy <= 0.0 {
        return None;
    }
    let r = (xy / (xx * yy).sqrt()).clamp(-1.0, 1.0);
    let (z, half) = (r.clamp(-0.999_999, 0.999_999).atanh(), 1.959_964 / (count - 3.0).sqrt());
    Some(Correlation { r, interval: [(z - half).tanh(), (z + half).tanh()] })
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut begin = 0;
    while begin < order.len() {
        let same = order[begin..].iter().take_while(|at| values[**at] == values[order[begin]]).count();
        for at in &order[begin..begin + same] {
            ranks[*at] = begin as f64 + (same - 1) as f64 / 2.0;
        }
        begin += same;
    }
    ranks
}

/// In bits, at least 0.
pub(super) fn mutual_information(column: &Column, target: &[Option<f64>]) -> f64 {
    let ((x, x_bins), (y, y_bins)) = (column.bins(), bins(target));
    let mut joint = vec![vec![0.0_f64; y_bins]; x_bins];
    let mut count = 0.0;
    for (x, y) in x.iter().zip(&y) {
        if let (Some(x), Some(y)) = (x, y) {
            joint[*x][*y] += 1.0;
            count += 1.0;
        }
    }
    if count == 0.0 {
        return 0.0;
    }
    let of_x: Vec<f64> = joint.iter().map(|row| row.iter().sum()).collect();
    let of_y: Vec<f64> = (0..y_bins).map(|y| joint.iter().map(|row| row[y]).sum()).collect();
    let mut nats = 0.0;
    for (row, of_x) in joint.iter().zip(&of_x) {
        for (both, of_y) in row.iter().zip(&of_y).filter(|(both, _)| **both > 0.0) {
            nats += both / count * (both * count / (of_x * of_y)).ln();
        }
    }
    let by_chance = (x_bins - 1) as f64 * (y_bins - 1) as f64 / (2.0 * count);
    ((nats - by_chance) / std::f64::consts::LN_2).max(0.0)
}
