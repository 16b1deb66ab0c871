//! A Pareto front as a table, and as a figure.

use treewright_client::{FrontPoint, ParetoFront};
use treewright_figures::{Figure, Marked};

use super::{figure, table};

/// The size of one pair of metrics, in units of its own.
const SIZE: [f64; 2] = [720.0, 400.0];

/// The front, the default where it is not on it, and the hypervolume.
pub(crate) fn front(found: &ParetoFront) -> String {
    if found.points.is_empty() {
        return format!("no run measured all of {}", found.metrics.join(", "));
    }
    let mut header = vec!["configuration", "runs"];
    for metric in &found.metrics {
        header.extend([metric.as_str(), "of default"]);
    }
    let mut table = table(&header, &(1..header.len()).collect::<Vec<_>>());
    let beside = found.default.iter().filter(|default| !found.points.contains(default));
    for point in found.points.iter().chain(beside) {
        let whose = if found.default.as_ref() == Some(point) { " (default)" } else { "" };
        let mut row = vec![format!("{}{whose}", point.configuration), point.runs.to_string()];
        for metric in &found.metrics {
            let ratio = point.ratios.as_ref().and_then(|ratios| ratios.get(metric));
            let value = point.metrics.get(metric).copied();
            row.push(value.map_or_else(String::new, figure));
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
        text += &format!("\nhypervolume {}", figure(volume));
    }
    text
}

/// Every pair of metrics, one below the other, for a browser or a page.
pub(crate) fn front_svg(found: &ParetoFront) -> String {
    let metrics = &found.metrics;
    let pairs = (0..metrics.len()).flat_map(|x| (x + 1..metrics.len()).map(move |y| (x, y)));
    Figure::file("Pareto front", pairs.map(|(x, y)| pair(found, [&metrics[x], &metrics[y]])))
}

fn pair(found: &ParetoFront, metrics: [&str; 2]) -> Figure {
    let marked = |points: &[FrontPoint]| -> Vec<Marked> {
        let mark = |point: &FrontPoint| {
            let [x, y] = metrics.map(|metric| point.metrics.get(metric).copied());
            let at = [x?, y?];
            let [x, y] = [0, 1].map(|axis| format!("{} {}", metrics[axis], super::figure(at[axis])));
            Some((at, format!("{}: {x}, {y}", point.configuration)))
        };
        points.iter().filter_map(mark).collect()
    };
    let [dominated, front, default] =
        [found.dominated.as_slice(), &found.points, found.default.as_slice()].map(marked);
    let titles = metrics.map(|metric| found.title(metric));
    let corners = found.corners(metrics);
    Figure::front(SIZE, [&titles[0], &titles[1]], [&dominated, &front, &default], &corners)
}
