//! A logarithm whose origin is chosen by likelihood.
//!
//! Costs may span magnitudes (a stationary model can follow their logarithm) or differ by a few percent (any
//! transformation is as good as none), and measurement noise grows with the cost. So the model sees
//! `ln(cost - least + shift)` for several shifts and keeps the likeliest, the Jacobian of the
//! transformation counted (Box and Cox, "An analysis of transformations", JRSS B 26, 1964). Costs are
//! scaled by their own spread and rounded, so that the unit of the cost does not matter.

/// Shifts, in distances of the median cost from the least.
const SHIFTS: [f64; 4] = [0.01, 0.1, 0.5, 3.0];
/// Steps per unit of the costs' spread to which costs are rounded. Rounding errors of a change of unit then
/// do not reach the points.
const STEPS: f64 = (1u64 << 40) as f64;
/// Costs count as no further from the least than this, in distances of the median.
const FAR: f64 = 1e6;

/// The transformation of some costs.
pub(crate) struct ShiftedLog {
    relative: Vec<f64>,
    least: f64,
    spread: f64,
}

impl ShiftedLog {
    /// `costs` are finite, one at least.
    pub(crate) fn new(costs: &[f64]) -> Self {
        let mut sorted = costs.to_vec();
        sorted.sort_by(f64::total_cmp);
        let least = sorted[0];
        // Halves keep the difference of very large numbers finite.
        let above = |cost: f64| cost / 2.0 - least / 2.0;
        let higher: Vec<f64> = sorted.iter().map(|&cost| above(cost)).filter(|above| *above > 0.0).collect();
        let spread = higher.get(higher.len() / 2).copied().unwrap_or(1.0);
        let relative = |&cost: &f64| ((above(cost) / spread).min(FAR) * STEPS).round() / STEPS;
        let relative: Vec<f64> = costs.iter().map(relative).collect();
        assert!(relative.iter().all(|cost| (0.0..=FAR).contains(cost)), "none is below the least");
        ShiftedLog { relative, least, spread: 2.0 * spread }
    }

    /// The costs through each transformation, with the logarithm of its Jacobian.
    pub(crate) fn views(&self) -> Vec<(Vec<f64>, f64)> {
        let view = |shift: &f64| {
            let values: Vec<f64> = self.relative.iter().map(|cost| libm::log(cost + shift)).collect();
            let jacobian = -values.iter().sum::<f64>();
            (values, jacobian)
        };
        SHIFTS.iter().map(view).collect()
    }

    /// A deviation in a view at the least cost, as a share of that cost.
    pub(crate) fn relative(&self, view: usize, deviation: f64) -> f64 {
        if self.least == 0.0 {
            return 0.0;
        }
        (deviation * SHIFTS[view] * self.spread / self.least).abs().min(1.0)
    }
}
