//! A logarithm that draws outliers in.
//!
//! Noise grows with the cost and costs span magnitudes, so the process sees logarithms. One thousandfold
//! outlier must not hide the differences between the others, so values further from the median than a few
//! quartile distances are drawn in, by a logarithm of their own. Values are relative to the median, so the
//! unit of the cost does not matter.

/// The distance from the median beyond which values are drawn in, in distances of the quartiles.
const REACH: f64 = 2.0;
/// Costs count as no less than this share of the median.
const LEAST: f64 = 1e-6;

/// The transformation.
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
