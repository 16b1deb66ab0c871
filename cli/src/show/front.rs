//! A Pareto front as a table, and as a figure.

use treewright_client::{Configuration, FrontPoint, ParetoFront};
use treewright_figures::{Axis, Colour, Dot, Figure};

use super::{figure, table};

/// The size of one pair of metrics, in units of its own.
const SIZE: [f64; 2] = [720.0, 400.0];

/// The front, the default where it is not on it, and the hypervolume.
pub(crate) fn front(found: &ParetoFront, default: &Configuration) -> String {
    if found.points.is_empty() {
        return format!("no run measured all of {}", found.metrics.join(", "));
    }
    let mut header = vec!["configuration", "runs"];
    for metric in &found.metrics {
        header.extend([metric.as_str(), "of default"]);
    }
    let mut table = table(&header, &(1..header.len()).collect::<Vec<_>>());
    let is_on_it = found.points.iter().any(|point| point.configuration == *default);
    let beside = found.default.iter().filter(|_| !is_on_it);
    for point in found.points.iter().chain(beside) {
        let whose = if point.configuration == *default { " (default)" } else { "" };
        let mut row = vec![format!("{}{whose}", point.configuration), point.runs.to_string()];
        for metric in &found.metrics {
            let ratio = point.ratios.as_ref().and_then(|ratios| ratios.get(metric));
            row.push(value(point, metric).map_or_else(String::new, figure));
            row.push(ratio.map_or_else(String::new, |ratio| format!("{ratio:.3}")));
        }
        table.add_row(row);
    }
    let ParetoFront { runs, configurations, .. } = found;
    let mut text = format!(
        "{} of {configurations} configurations are on the front, by the medians of {runs} runs\n{}",
        found.points.len(),
        table.trim_fmt()
    );
    if let Some(volume) = found.hypervolume {
        text += &format!("\nhypervolume {volume:.4}");
    }
    text
}

fn value(point: &FrontPoint, metric: &str) -> Option<f64> {
    point.metrics.get(metric)
}

/// Every pair of metrics, one below the other, for a browser or a page.
pub(crate) fn front_svg(found: &ParetoFront) -> String {
    let metrics = &found.metrics;
    let pairs = (0..metrics.len()).flat_map(|x| (x + 1..metrics.len()).map(move |y| (x, y)));
    Figure::file("Pareto front", pairs.map(|(x, y)| pair(found, &metrics[x], &metrics[y])))
}

fn pair(found: &ParetoFront, x_metric: &str, y_metric: &str) -> Figure {
    let axis = |metric: &str| {
        let large = if found.maximised.iter().any(|one| one == metric) { ", more is better" } else { "" };
        let all = found.points.iter().chain(&found.dominated);
        Axis::fitting(&format!("{metric}{large}"), all.filter_map(|point| value(point, metric)))
    };
    let title = format!("{y_metric} over {x_metric}");
    let mut figure = Figure::new(&title, SIZE, axis(x_metric), axis(y_metric));
    for (points, dot, colour, name) in [
        (found.dominated.as_slice(), Dot::Small, Colour::Grey, "others"),
        (found.points.as_slice(), Dot::Large, Colour::Blue, "front"),
        (found.default.as_slice(), Dot::Ring, Colour::Vermilion, "default"),
    ] {
        figure.dot_key(dot, colour, name);
        for point in points {
            if let (Some(x), Some(y)) = (value(point, x_metric), value(point, y_metric)) {
                let (of, x_words, y_words) = (&point.configuration, super::figure(x), super::figure(y));
                let words = format!("{of}: {x_metric} {x_words}, {y_metric} {y_words}");
                figure.dot([x, y], dot, colour, &words);
            }
        }
    }
    figure
}
