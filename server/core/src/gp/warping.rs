//! Output warping: the transformations through which processes see costs.
//!
//! Costs span magnitudes and their noise grows with them, so that processes look at logarithms.
//! [`ShiftedLog`] chooses the origin of the logarithm by likelihood, and suits the measurements of one state,
//! of which the least count most. [`RobustLog`] is fixed by median and quartiles, and suits measurements of
//! many states, among which there are wild ones. The unit of the cost matters to neither.

/// Shifts, in distances of the median cost from the least.
const SHIFTS: [f64; 4] = [0.01, 0.1, 0.5, 3.0];
/// Steps per unit of the costs' spread to which costs are rounded. Rounding errors of a change of unit then
/// do not reach the points.
const STEPS: f64 = (1u64 << 40) as f64;
/// Costs count as no further from the least than this, in distances of the median.
const FAR: f64 = 1e6;

/// A logarithm whose origin is chosen by likelihood. Costs may span magnitudes (a stationary model can follow
/// their logarithm) or differ by a few percent (any transformation is as good as none). So the model sees
/// `ln(cost - least + shift)` for several shifts and keeps the likeliest, the Jacobian of the transformation
/// counted (Box and Cox, "An analysis of transformations", JRSS B 26, 1964). Costs are scaled by their own
/// spread and rounded.
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

/// The distance from the median beyond which values are drawn in, in distances of the quartiles.
const REACH: f64 = 2.0;
/// Costs count as no less than this share of the median.
const LEAST: f64 = 1e-6;

/// A logarithm that draws outliers in. One thousandfold outlier must not hide the differences between the
/// others, so values further from the median than a few quartile distances are drawn in, by a logarithm of
/// their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RobustLog {
    median: f64,
    scale: f64,
}

impl RobustLog {
    /// Chosen for these costs: finite, not negative. `None` where no more than half of them are positive.
    pub(crate) fn of(costs: &[f64]) -> Option<Self> {
        let mut sorted = costs.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted.get((share * (sorted.len() as f64 - 1.0)).round() as usize).copied();
        let median = at(0.5).filter(|median| *median >= f64::MIN_POSITIVE)?;
        let values = RobustLog { median, scale: f64::INFINITY };
        let quartile = |share| at(share).map_or(0.0, |cost| values.see(cost));
        let spread = quartile(0.75) - quartile(0.25);
        // Where most values are equal, the others give the reach.
        let widest = if spread > 0.0 { spread } else { (quartile(1.0) - quartile(0.0)) / REACH };
        let scale = if widest > 0.0 { widest } else { f64::INFINITY };
        Some(RobustLog { median, scale })
    }

    /// A cost as the process sees it: 0 at the median.
    pub(crate) fn see(&self, cost: f64) -> f64 {
        let value = libm::log((cost / self.median).clamp(LEAST, f64::MAX));
        let limit = REACH * self.scale;
        if value.abs() <= limit {
            return value;
        }
        (limit + self.scale * libm::log1p((value.abs() - limit) / self.scale)).copysign(value)
    }

    /// The cost that is seen as `value`, finite.
    pub(crate) fn cost(&self, value: f64) -> f64 {
        let limit = REACH * self.scale;
        let value = if value.abs() <= limit {
            value
        } else {
            (limit + self.scale * libm::expm1((value.abs() - limit) / self.scale)).copysign(value)
        };
        (libm::exp(value.clamp(-700.0, 700.0)) * self.median).min(f64::MAX)
    }
}
