//! A Pareto front as a table, and as a figure.

use std::fmt::Write as _;

use treewright_client::{Configuration, FrontPoint, ParetoFront};

use super::{figure, table};

/// Units across one pair of metrics, and down.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 400.0;
/// Room for the labels.
const LEFT: f64 = 80.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 36.0;
const BOTTOM: f64 = 48.0;
/// From this factor between its ends on an axis is logarithmic.
const LOGARITHMIC: f64 = 10.0;
/// About how many lines an even axis has.
const LINES: f64 = 5.0;
/// Blue and orange are distinct also for people who see fewer colours.
const STYLE: &str = "svg{--paper:#fff;--ink:#1d1f24;--line:#dcdad4;--other:#8a8f98;--front:#0b62b8;--default:#c2570c}\
@media(prefers-color-scheme:dark){svg{--paper:#16181c;--ink:#e9e7e2;--line:#3a3e46;--other:#868b94;--front:#6db3f2;--default:#f0935f}}\
text{font:12px system-ui,sans-serif;fill:var(--ink)}";

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

/// An axis for some values above 0.
struct Axis {
    low: f64,
    high: f64,
    is_logarithmic: bool,
}

impl Axis {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let ends = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        let (low, high) = values.fold((f64::INFINITY, 0.0), ends);
        let is_logarithmic = high / low > LOGARITHMIC;
        let room =
            if is_logarithmic { (high / low).powf(0.04) } else { 0.04 * (high - low).max(0.01 * high) };
        match is_logarithmic {
            true => Self { low: low / room, high: high * room, is_logarithmic },
            false => Self { low: low - room, high: high + room, is_logarithmic },
        }
    }

    /// Where a value lies, from 0 to 1.
    fn share(&self, value: f64) -> f64 {
        match self.is_logarithmic {
            true => (value / self.low).ln() / (self.high / self.low).ln(),
            false => (value - self.low) / (self.high - self.low),
        }
    }

    /// Even steps, or 1, 2 and 5 of each decade, or, across many decades, some of these.
    fn ticks(&self) -> Vec<f64> {
        let decade = |value: f64| 10_f64.powf(value.log10().floor());
        if !self.is_logarithmic {
            let rough = (self.high - self.low) / LINES;
            let wide = |unit: &f64| unit * decade(rough) >= rough;
            let step = decade(rough) * [1.0, 2.0, 5.0].into_iter().find(wide).unwrap_or(10.0);
            let (first, last) = ((self.low / step).ceil() as i64, (self.high / step).floor() as i64);
            return (first..=last).map(|number| number as f64 * step).collect();
        }
        let decades = (self.high / self.low).log10();
        let every = (decades / 8.0).ceil().max(1.0) as usize;
        let units: &[f64] = if decades > 4.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let first = self.low.log10().floor() as i32;
        let exponents = (first..=first + decades.ceil() as i32 + 1).step_by(every);
        let all = exponents.flat_map(|exponent| units.iter().map(move |unit| unit * 10_f64.powi(exponent)));
        all.filter(|tick| (self.low..=self.high).contains(tick)).collect()
    }
}

/// Every pair of metrics, one below the other, for a browser or a page.
pub(crate) fn front_svg(found: &ParetoFront) -> String {
    let metrics = &found.metrics;
    let pairs: Vec<(usize, usize)> =
        (0..metrics.len()).flat_map(|x| (x + 1..metrics.len()).map(move |y| (x, y))).collect();
    let height = HEIGHT * pairs.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"Pareto front\">\
         <style>{STYLE}</style><rect width=\"{WIDTH}\" height=\"{height}\" fill=\"var(--paper)\"/>"
    );
    for (place, (x, y)) in pairs.iter().enumerate() {
        let _ = write!(svg, "<g transform=\"translate(0 {})\">", HEIGHT * place as f64);
        pair(&mut svg, found, (&metrics[*x], &metrics[*y]));
        svg += "</g>";
    }
    svg + "</svg>\n"
}

fn pair(svg: &mut String, found: &ParetoFront, (x_metric, y_metric): (&str, &str)) {
    let all = || found.points.iter().chain(&found.dominated);
    let axis = |metric| Axis::of(all().filter_map(move |point| value(point, metric)));
    let (x, y) = (axis(x_metric), axis(y_metric));
    let bottom = HEIGHT - BOTTOM;
    let at_x = |value: f64| LEFT + x.share(value) * (WIDTH - LEFT - RIGHT);
    let at_y = |value: f64| bottom - y.share(value) * (bottom - TOP);
    for tick in x.ticks() {
        let (at, below) = (at_x(tick), bottom + 16.0);
        let _ = write!(
            svg,
            "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"var(--line)\"/>\
             <text x=\"{at:.1}\" y=\"{below}\" text-anchor=\"middle\">{}</text>",
            short(tick)
        );
    }
    for tick in y.ticks() {
        let (at, end, before) = (at_y(tick), WIDTH - RIGHT, LEFT - 6.0);
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{end}\" stroke=\"var(--line)\"/>\
             <text x=\"{before}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            at + 4.0,
            short(tick)
        );
    }
    let named = |metric: &str, axis: &Axis| {
        let scale = if axis.is_logarithmic { ", logarithmic" } else { "" };
        let large = if found.maximised.iter().any(|one| one == metric) { ", more is better" } else { "" };
        format!("{metric}{scale}{large}")
    };
    let (right, middle, low) = ((LEFT + WIDTH - RIGHT) / 2.0, (TOP + bottom) / 2.0, HEIGHT - 12.0);
    let _ = write!(
        svg,
        "<text x=\"{right}\" y=\"{low}\" text-anchor=\"middle\">{}</text>\
         <text x=\"16\" y=\"{middle}\" text-anchor=\"middle\" transform=\"rotate(-90 16 {middle})\">{}</text>",
        named(x_metric, &x),
        named(y_metric, &y)
    );
    let mut dot = |point: &FrontPoint, colour: &str, look: &str| {
        if let (Some(x), Some(y)) = (value(point, x_metric), value(point, y_metric)) {
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" {look} fill=\"var(--{colour})\"><title>{}: {x_metric} {}, {y_metric} {}</title></circle>",
                at_x(x),
                at_y(y),
                escaped(&point.configuration.to_string()),
                figure(x),
                figure(y)
            );
        }
    };
    found.dominated.iter().for_each(|point| dot(point, "other", "r=\"3\" opacity=\".6\""));
    found.points.iter().for_each(|point| dot(point, "front", "r=\"5\""));
    found.default.iter().for_each(|point| {
        dot(point, "default", "r=\"8\" fill-opacity=\".25\" stroke=\"var(--default)\" stroke-width=\"2\"")
    });
    legend(svg);
}

fn legend(svg: &mut String) {
    for (place, (colour, name)) in
        [("front", "front"), ("other", "others"), ("default", "default")].iter().enumerate()
    {
        let at = LEFT + 100.0 * place as f64;
        let _ = write!(
            svg,
            "<circle cx=\"{}\" cy=\"18\" r=\"5\" fill=\"var(--{colour})\"/><text x=\"{}\" y=\"22\">{name}</text>",
            at + 5.0,
            at + 16.0
        );
    }
}

/// A tick without digits that say nothing.
fn short(value: f64) -> String {
    let size = value.abs();
    if size >= 1e6 || size < 1e-3 && size > 0.0 {
        return format!("{value:e}");
    }
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_ticks_within_their_ends() {
        let axis = |values: &[f64]| Axis::of(values.iter().copied());
        assert_eq!(axis(&[1.0, 9.0]).ticks(), [2.0, 4.0, 6.0, 8.0]);
        assert_eq!(axis(&[1.0, 30.0]).ticks(), [1.0, 2.0, 5.0, 10.0, 20.0]);
        assert_eq!(axis(&[1e-3, 1e4]).ticks().len(), 8);
        for values in [&[7.0][..], &[3.0, 3.001], &[1e-9, 1e9]] {
            let axis = axis(values);
            let ticks = axis.ticks();
            assert!((1..=20).contains(&ticks.len()), "{values:?}: {ticks:?}");
            assert!(ticks.iter().chain(values).all(|tick| (0.0..=1.0).contains(&axis.share(*tick))));
        }
        let labels: Vec<_> = [0.25, 1200.0, 2e7, 5e-5].into_iter().map(short).collect();
        assert_eq!(labels, ["0.25", "1200", "2e7", "5e-5"]);
    }
}
