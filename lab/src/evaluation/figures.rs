//! The figures of the paper's section 7 as SVG: boxes by scene, break-even points, and one search.

use std::collections::BTreeMap;

use treewright_figures::{Axis, Colour, Figure, Stroke};
use treewright_renderer::statistics::quantile;

use super::folds::Split;
use super::judge::{BreakEven, Ground, Row, Verdict};

/// The width of every figure, in units of its own.
pub(super) const WIDTH: f64 = 720.0;

/// A box for each scene and entrant: quartiles, the median, whiskers to the 5th and 95th percentile.
pub(crate) fn boxes(
    verdict: &Verdict,
    split: Split,
    entrants: &[String],
    value: fn(&Row) -> f64,
    label: &str,
) -> String {
    let mut groups: BTreeMap<(&str, usize), Vec<f64>> = BTreeMap::new();
    for row in verdict.rows.iter().filter(|row| row.split == split) {
        if let Some(entrant) = entrants.iter().position(|name| *name == row.entrant) {
            groups.entry((&row.place.scene, entrant)).or_default().push(value(row));
        }
    }
    groups.values_mut().for_each(|values| values.sort_by(f64::total_cmp));
    let mut scenes: Vec<&str> = groups.keys().map(|(scene, _)| *scene).collect();
    scenes.dedup();
    let ends = groups.values().flat_map(|values| [quantile(values, 0.02), quantile(values, 0.98)]);
    let (x, y) = (Axis::linear(label, ends.chain([0.95, 1.05])), Axis::rows(&scenes));
    // The boxes of a scene share its row, with some room below.
    let thick = 1.0 / (entrants.len() + 1) as f64;
    let height = 11.0 * (entrants.len() + 1) as f64 * scenes.len() as f64 + 50.0;
    let mut figure = Figure::new(label, [WIDTH, height], x, y);
    figure.interval([1.0, 0.0], [1.0, scenes.len() as f64], Colour::Ink);
    for ((scene, entrant), values) in &groups {
        let (colour, name) = (Colour::of(*entrant), &entrants[*entrant]);
        let [p5, p25, p50, p75, p95] = [0.05, 0.25, 0.5, 0.75, 0.95].map(|share| quantile(values, share));
        let begin = scenes.partition_point(|one| one < scene) as f64 + *entrant as f64 * thick;
        let [top, middle, bottom] = [0.1, 0.5, 0.9].map(|share| begin + share * thick);
        let title = format!("{scene}, {name}: median {p50:.3} of {}", values.len());
        figure.interval([p5, middle], [p95, middle], colour);
        figure.cell([p25, p75], [top, bottom], 0.55, colour, &title);
        figure.interval([p50, top], [p50, bottom], Colour::Ink);
        figure.area_key(colour, name);
    }
    figure.finish()
}

/// Break-even points of each entrant on a logarithmic axis: how many of the drawn ones lie below.
pub(crate) fn break_even(verdict: &Verdict, split: Split, entrants: &[String]) -> String {
    let label = "iterations until the search has caught up (share of those drawn)";
    let shares = [0.0, 0.5, 1.0].map(|share| (share, format!("{:.0} %", share * 100.0)));
    let (x, y) = (Axis::logarithmic(label, [1.0, 1e4]), Axis::labelled("", [0.0, 1.0], shares.into()));
    let mut figure = Figure::new(label, [WIDTH, 250.0], x, y);
    for (index, entrant) in entrants.iter().enumerate() {
        let own = verdict.rows.iter().filter(|row| row.split == split && row.entrant == *entrant);
        let all = own.clone().count();
        let mut points: Vec<f64> = own
            .filter_map(|row| match row.break_even {
                BreakEven::At(iterations) => Some(iterations.max(1.0)),
                _ => None,
            })
            .collect();
        points.sort_by(f64::total_cmp);
        let count = points.len();
        let share = |(place, x): (usize, &f64)| [*x, (place + 1) as f64 / count as f64];
        let line: Vec<[f64; 2]> = points.iter().enumerate().map(share).collect();
        // Colours begin again before the entrants end.
        let stroke = if index < Colour::COUNT { Stroke::Solid } else { Stroke::Dashed };
        figure.line(&line, stroke, Colour::of(index), &format!("{entrant}: {count} of {all}"));
    }
    figure.finish()
}

/// One search, iteration by iteration, with its best and a prediction (Figure 11).
pub(crate) fn curve(ground: &Ground, predicted_ms: f64) -> String {
    let mut sorted: Vec<f64> = ground.curve_ms.iter().flatten().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let top = (quantile(&sorted, 0.97).max(predicted_ms)) * 1.1;
    let x = Axis::counts("iteration of the search", 1.0, ground.curve_ms.len().max(2) as f64);
    let y = Axis::between("milliseconds", 0.0, top);
    let mut figure = Figure::new("iteration of the search; milliseconds", [WIDTH, 268.0], x, y);
    let numbered = ground.curve_ms.iter().enumerate();
    let points: Vec<[f64; 2]> =
        numbered.filter_map(|(number, cost)| Some([(number + 1) as f64, (*cost)?])).collect();
    figure.line(&points, Stroke::Solid, Colour::Ink, "each iteration");
    figure.level(ground.roofline_ms, Stroke::Dashed, Colour::Purple, "the best, measured again");
    figure.level(predicted_ms, Stroke::Solid, Colour::Green, "predicted");
    figure.finish()
}
