//! The figures of the paper's section 7 as SVG: boxes by scene, break-even points, and one search beside its
//! prediction.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use treewright_renderer::statistics::quantile;

use super::folds::Split;
use super::judge::{BreakEven, Ground, Row, Verdict};
use super::plot::{self, WIDTH, begin, end, escaped, nice_step};

const LEFT: f64 = 150.0;
const RIGHT: f64 = 28.0;
const ENDS: [f64; 2] = [LEFT, WIDTH - RIGHT];

/// The number of colours that the page names.
const COLOURS: usize = 9;

/// Colours of entrants, in their order, as the page names them.
fn colour(index: usize) -> String {
    format!("var(--c{})", index % COLOURS)
}

/// A box for each scene and entrant: quartiles, whiskers to the 5th and 95th percentile, a line at the
/// median. Beyond the axis whiskers end at its edge.
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
    let ends = groups.values().flat_map(|values| [quantile(values, 0.02), quantile(values, 0.98)]);
    let (low, high) = ends.fold((0.95_f64, 1.05_f64), |(low, high), end| (low.min(end), high.max(end)));
    let (low, high) = ((low * 20.0).floor() / 20.0, (high * 20.0).ceil() / 20.0);
    let at = |x: f64| LEFT + (x.clamp(low, high) - low) / (high - low) * (WIDTH - LEFT - RIGHT);
    let scenes: Vec<&str> = {
        let mut all: Vec<&str> = groups.keys().map(|(scene, _)| *scene).collect();
        all.dedup();
        all
    };
    let row_height = 11.0;
    let scene_height = row_height * entrants.len() as f64 + 12.0;
    let bottom = scene_height * scenes.len() as f64 + 8.0;
    let mut svg = begin(bottom + 40.0, label);
    let step = nice_step(high - low);
    let mut tick = (low / step).ceil() * step;
    while tick <= high + 1e-9 {
        let x = at(tick);
        let strong = if (tick - 1.0).abs() < 1e-9 { "ink" } else { "line" };
        let _ = write!(
            svg,
            "<path d=\"M{x:.1} 4V{bottom:.1}\" stroke=\"var(--{strong})\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{tick:.2}</text>",
            bottom + 15.0
        );
        tick += step;
    }
    for (number, scene) in scenes.iter().enumerate() {
        let top = 8.0 + number as f64 * scene_height;
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 8.0,
            top + scene_height / 2.0 - 3.0,
            escaped(scene)
        );
        for (entrant, name) in entrants.iter().enumerate() {
            let Some(values) = groups.get(&(*scene, entrant)) else { continue };
            let y = top + entrant as f64 * row_height;
            let [p5, p25, p50, p75, p95] =
                [0.05, 0.25, 0.5, 0.75, 0.95].map(|share| at(quantile(values, share)));
            let _ = write!(
                svg,
                "<g><title>{}, {}: median {:.3} of {}</title><path d=\"M{p5:.1} {mid:.1}H{p95:.1}\" stroke=\"{colour}\"/>\
                 <rect x=\"{p25:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"8\" fill=\"{colour}\" opacity=\".55\"/>\
                 <path d=\"M{p50:.1} {:.1}v8\" stroke=\"var(--ink)\" stroke-width=\"2\"/></g>",
                escaped(scene),
                escaped(name),
                quantile(values, 0.5),
                values.len(),
                y,
                (p75 - p25).max(1.0),
                y,
                mid = y + 4.0,
                colour = colour(entrant),
            );
        }
    }
    end(svg, ENDS, bottom + 34.0, label)
}

/// Break-even points of each entrant on a logarithmic axis: how many of the drawn ones lie below.
pub(crate) fn break_even(verdict: &Verdict, split: Split, entrants: &[String]) -> String {
    let label = "iterations until the search has caught up (share of those drawn)";
    let at = |x: f64| LEFT + x.max(1.0).log10() / 4.0 * (WIDTH - LEFT - RIGHT);
    let up = |share: f64| 8.0 + 200.0 * (1.0 - share);
    let mut svg = begin(250.0, label);
    for decade in 0..=4_i32 {
        for unit in [1.0, 2.0, 5.0] {
            let value = unit * 10_f64.powi(decade);
            if value > 10_000.0 {
                continue;
            }
            let x = at(value);
            // Where there is little room, only powers of ten are named.
            let class = if unit > 1.0 { " class=\"minor\"" } else { "" };
            let _ = write!(
                svg,
                "<path d=\"M{x:.1} 8V208\" stroke=\"var(--line)\"/><text{class} x=\"{x:.1}\" y=\"222\" text-anchor=\"middle\">{value:.0}</text>"
            );
        }
    }
    for share in [0.0, 0.5, 1.0] {
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {y}H{}\" stroke=\"var(--line)\"/><text x=\"{}\" y=\"{}\" text-anchor=\"end\">{:.0} %</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            up(share) + 4.0,
            share * 100.0,
            y = up(share)
        );
    }
    for (index, entrant) in entrants.iter().enumerate() {
        let own = verdict.rows.iter().filter(|row| row.split == split && row.entrant == *entrant);
        let mut points: Vec<f64> = own
            .filter_map(|row| match row.break_even {
                BreakEven::At(iterations) => Some(iterations),
                _ => None,
            })
            .collect();
        points.sort_by(f64::total_cmp);
        let count = points.len();
        let path: String = points
            .iter()
            .enumerate()
            .map(|(place, x)| {
                format!(
                    "{}{:.1} {:.1}",
                    if place == 0 { "M" } else { "L" },
                    at(*x),
                    up((place + 1) as f64 / count as f64)
                )
            })
            .collect();
        let _ = write!(
            svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"><title>{}: {count} points</title></path>",
            colour(index),
            escaped(entrant)
        );
    }
    end(svg, ENDS, 244.0, label)
}

/// One search, iteration by iteration, with its best and a prediction (Figure 11).
pub(crate) fn curve(ground: &Ground, predicted_ms: f64) -> String {
    let label = "iteration of the search; milliseconds";
    let mut sorted: Vec<f64> = ground.curve_ms.iter().flatten().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let top = (quantile(&sorted, 0.97).max(predicted_ms)) * 1.1;
    let count = ground.curve_ms.len().max(2) as f64;
    let at = |number: usize| LEFT + number as f64 / (count - 1.0) * (WIDTH - LEFT - RIGHT);
    let up = |ms: f64| 8.0 + 220.0 * (1.0 - (ms / top).min(1.0));
    let mut svg = begin(268.0, label);
    let step = nice_step(top);
    let mut tick = 0.0;
    while tick <= top {
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {y:.1}H{}\" stroke=\"var(--line)\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            up(tick) + 4.0,
            if step < 1.0 { format!("{tick:.1}") } else { format!("{tick:.0}") },
            y = up(tick)
        );
        tick += step;
    }
    for number in (0..ground.curve_ms.len()).step_by(10) {
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"243\" text-anchor=\"middle\">{}</text>",
            at(number),
            number + 1
        );
    }
    let mut path = String::new();
    for (number, cost) in ground.curve_ms.iter().enumerate() {
        if let Some(cost) = cost {
            let _ =
                write!(path, "{}{:.1} {:.1}", if path.is_empty() { "M" } else { "L" }, at(number), up(*cost));
        }
    }
    let _ = write!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"var(--ink)\"/><path d=\"M{LEFT} {best:.1}H{right}\" stroke=\"var(--c1)\" \
         stroke-dasharray=\"7 4\" stroke-width=\"2\"/><path d=\"M{LEFT} {predicted:.1}H{right}\" stroke=\"var(--c0)\" stroke-width=\"2\"/>",
        best = up(ground.roofline_ms),
        predicted = up(predicted_ms),
        right = WIDTH - RIGHT
    );
    end(svg, ENDS, 262.0, label)
}

/// The entrants with their colours.
pub(crate) fn legend(entrants: &[String]) -> String {
    let colours: Vec<String> = (0..entrants.len()).map(|index| format!("c{}", index % COLOURS)).collect();
    let named = entrants.iter().map(String::as_str).zip(colours.iter().map(String::as_str));
    plot::legend(&named.collect::<Vec<_>>())
}
