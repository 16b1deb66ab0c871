//! Pareto fronts.

use treewright_core::front::{FrontPoint, ParetoFront};
use treewright_figures::{Figure, Marked};

use super::{WIDTH, figure};

/// A figure of every pair of metrics; `words` are those of a configuration.
pub(in super::super) fn fronts(found: &ParetoFront, words: impl Fn(&FrontPoint) -> String) -> Vec<String> {
    let metrics = &found.metrics;
    let pairs = (0..metrics.len()).flat_map(|x| (x + 1..metrics.len()).map(move |y| (x, y)));
    pairs.map(|(x, y)| pair(found, [&metrics[x], &metrics[y]], &words)).collect()
}

fn pair(found: &ParetoFront, metrics: [&str; 2], words: impl Fn(&FrontPoint) -> String) -> String {
    let mark = |point: &FrontPoint| -> Option<Marked> {
        let [x, y] = metrics.map(|metric| point.metrics.get(metric).copied());
        let at = [x?, y?];
        let [x, y] = [0, 1].map(|axis| format!("{} {}", metrics[axis], figure(at[axis])));
        Some((at, format!("{}: {x}, {y}", words(point))))
    };
    let marked = |points: &[FrontPoint]| -> Vec<Marked> { points.iter().filter_map(mark).collect() };
    let groups = [found.dominated.as_slice(), found.points.as_slice(), found.default.as_slice()];
    let [dominated, front, default] = groups.map(marked);
    let [x, y] = metrics.map(|metric| found.title(metric));
    let corners = found.corners(metrics);
    Figure::front([WIDTH, 400.0], [&x, &y], [&dominated, &front, &default], &corners).finish()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use treewright_core::assignment::Assignment;
    use treewright_core::front::Front;

    use super::*;

    #[test]
    fn every_pair_of_metrics_has_a_figure_whose_words_are_escaped() {
        let front = Front::new(&["a", "b", "1/c"]).expect("good metrics");
        let runs: Vec<(Assignment, BTreeMap<String, f64>)> =
            [[1.0, 2.0, 3.0], [2.0, 1.0, 3.0], [3.0, 3.0, 1.0]]
                .into_iter()
                .zip(1..)
                .map(|(metrics, level)| {
                    let names = ["a", "b", "c"].map(str::to_owned);
                    (Assignment::new().with("level", level), names.into_iter().zip(metrics).collect())
                })
                .collect();
        let default = runs[0].0.clone();
        let found =
            front.of(runs.iter().map(|(configuration, measured)| (configuration, measured)), &default, None);
        let svgs = fronts(&found, |point| format!("<{}>", point.configuration));
        assert_eq!(svgs.len(), 3);
        // Two on the front, one dominated, the default marked, and a legend of three.
        assert!(svgs.iter().all(|svg| svg.matches("<circle").count() == 7), "{svgs:?}");
        assert!(svgs[0].contains("<title>&lt;level=3&gt;: a 3, b 3</title>"), "{}", svgs[0]);
        assert!(svgs[1].contains("c (higher is better)"), "{}", svgs[1]);
    }
}
