//! Costs in the form for people.
//!
//! Searches, predictors and comparisons minimise a cost. Where one metric is maximised and nothing else
//! counts, the cost is a weight over that metric, so pages, tables, figures and charts show the metric
//! instead. Every surface converts here.

/// The form in which the costs of a study are shown: the one metric that is maximised, or the costs.
/// [`Default`] shows costs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CostView {
    /// The name and the weight of a metric that is maximised and counts alone.
    maximised: Option<(String, f64)>,
}

impl CostView {
    /// The view of an objective that maximises this metric alone: costs are the weight, above 0, over its
    /// values.
    pub(crate) fn maximising(metric: &str, weight: f64) -> Self {
        Self { maximised: Some((metric.to_owned(), weight)) }
    }

    /// The name of the shown value: the metric, or `cost`.
    pub fn name(&self) -> &str {
        self.maximised.as_ref().map_or("cost", |(metric, _)| metric)
    }

    /// Whether a larger value is better.
    pub fn is_maximised(&self) -> bool {
        self.maximised.is_some()
    }

    /// The name, with its direction where that is not the usual one: `cost`, or `fps (higher is better)`.
    pub fn title(&self) -> String {
        let direction = if self.is_maximised() { " (higher is better)" } else { "" };
        format!("{}{direction}", self.name())
    }

    /// The title as the head of a column.
    pub fn heading(&self) -> String {
        if self.is_maximised() { self.title() } else { "Cost".to_owned() }
    }

    /// The shown value of a cost: in the metric's unit, or the cost itself. The function is its own inverse.
    pub fn value(&self, cost: f64) -> f64 {
        self.maximised.as_ref().map_or(cost, |(_, weight)| weight / cost)
    }

    /// The shown value of a cost if a metric is maximised.
    pub fn maximum(&self, cost: f64) -> Option<f64> {
        self.is_maximised().then(|| self.value(cost))
    }

    /// The values of the ends of an interval of costs, the lower first.
    pub fn interval(&self, low: f64, high: f64) -> (f64, f64) {
        let (one, other) = (self.value(low), self.value(high));
        if self.is_maximised() { (other, one) } else { (one, other) }
    }

    /// A share by which a cost lies below another as the share by which its value is better than the other's:
    /// half the cost is twice the rate, a gain of 1. Infinite for a rate whose cost would be nothing.
    pub fn share(&self, below: f64) -> f64 {
        match self.is_maximised() {
            true if below < 1.0 => below / (1.0 - below),
            true => f64::INFINITY,
            false => below,
        }
    }

    /// Such a share in percent with one digit; `?` stands for one that is not finite.
    pub fn percent(&self, below: f64) -> String {
        let percent = 100.0 * self.share(below);
        if percent.is_finite() { format!("{percent:.1}") } else { "?".to_owned() }
    }

    /// The side of better values: `below` or `above`.
    pub fn better_side(&self) -> &'static str {
        if self.is_maximised() { "above" } else { "below" }
    }

    /// The kind of bound that a lower bound of a cost is for its value: `at least` or `at most`.
    pub fn bound(&self) -> &'static str {
        if self.is_maximised() { "at most" } else { "at least" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_of_what_is_maximised_alone_are_told_by_it() {
        let fps = CostView::maximising("fps", 1000.0);
        assert_eq!((fps.name(), fps.value(20.0), fps.maximum(20.0)), ("fps", 50.0, Some(50.0)));
        assert_eq!(fps.value(fps.value(20.0)), 20.0);
        assert_eq!([fps.title(), fps.heading()], ["fps (higher is better)"; 2]);
        assert_eq!(fps.interval(10.0, 40.0), (25.0, 100.0), "the lower cost is the higher end");
        assert_eq!((fps.share(0.5), fps.share(-0.25)), (1.0, -0.2));
        assert_eq!([0.5, -0.25, 1.0, 1.5].map(|below| fps.percent(below)), ["100.0", "-20.0", "?", "?"]);
        assert_eq!((fps.better_side(), fps.bound()), ("above", "at most"));
    }

    #[test]
    fn other_costs_are_told_as_they_are() {
        let plain = CostView::default();
        assert_eq!([plain.title(), plain.heading()], ["cost", "Cost"]);
        assert_eq!(plain.maximum(3.0), None);
        assert_eq!((plain.value(3.0), plain.interval(1.0, 2.0), plain.share(0.5)), (3.0, (1.0, 2.0), 0.5));
        assert_eq!([0.5, 1.0].map(|below| plain.percent(below)), ["50.0", "100.0"]);
        assert_eq!((plain.better_side(), plain.bound()), ("below", "at least"));
    }
}
