//! Axes and curves as SVG that takes its colours from the page.

use std::fmt::Write as _;

pub(super) const WIDTH: f64 = 720.0;
const LEFT: f64 = 76.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 10.0;

/// An axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axis {
    low: f64,
    high: f64,
    is_logarithmic: bool,
}

impl Axis {
    /// Even steps, with a little room at both ends.
    pub(crate) fn linear(values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = ends(values);
        let room = ((high - low) * 0.04).max(high.abs().max(1.0) * 1e-6);
        Self { low: low - room, high: high + room, is_logarithmic: false }
    }

    /// Even factors; values that are not above 0 have no place.
    pub(crate) fn logarithmic(values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = ends(values.into_iter().filter(|value| *value > 0.0));
        let (low, high) = if low > 0.0 { (low, high) } else { (1.0, 10.0) };
        let room = (high / low).powf(0.04).max(1.02);
        Self { low: low / room, high: high * room, is_logarithmic: true }
    }

    fn share(&self, value: f64) -> f64 {
        let share = if self.is_logarithmic {
            (value.max(f64::MIN_POSITIVE) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        share.clamp(0.0, 1.0)
    }

    /// Where lines are drawn: even steps, or 1, 2 and 5 of each decade.
    fn ticks(&self) -> Vec<f64> {
        if !self.is_logarithmic {
            let step = nice_step(self.high - self.low);
            let first = (self.low / step).ceil() as i64;
            let last = (self.high / step).floor() as i64;
            return (first..=last).map(|number| number as f64 * step).collect();
        }
        // Where few of them would lie on the axis, every whole one.
        let units: &[i32] =
            if self.high < self.low * 4.0 { &[1, 2, 3, 4, 5, 6, 7, 8, 9] } else { &[1, 2, 5] };
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        decades
            .flat_map(|decade| units.iter().map(move |unit| f64::from(*unit) * 10_f64.powi(decade)))
            .filter(|value| (self.low..=self.high).contains(value))
            .collect()
    }
}

fn ends(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), one| (low.min(one), high.max(one)));
    if low > high { (0.0, 1.0) } else { (low, high) }
}

/// A number without digits that say nothing.
pub(crate) fn number(value: f64) -> String {
    let digits = (2 - value.abs().max(1e-9).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A figure that is being drawn.
#[derive(Debug)]
pub(crate) struct Plot {
    x: Axis,
    y: Axis,
    height: f64,
    svg: String,
    x_label: String,
}

impl Plot {
    /// Axes with their labels, `height` units of the 720 across high.
    pub(crate) fn new(x: Axis, y: Axis, x_label: &str, y_label: &str, height: f64) -> Self {
        let svg = begin(height, &format!("{y_label} over {x_label}"));
        let mut plot = Self { x, y, height, svg, x_label: x_label.to_owned() };
        let bottom = plot.bottom();
        for tick in x.ticks() {
            let at = plot.at_x(tick);
            let _ = write!(
                plot.svg,
                "<path d=\"M{at:.1} {TOP}V{bottom:.1}\" stroke=\"var(--line)\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                number(tick)
            );
        }
        for tick in y.ticks() {
            let at = plot.at_y(tick);
            let _ = write!(
                plot.svg,
                "<path d=\"M{LEFT} {at:.1}H{}\" stroke=\"var(--line)\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                at + 4.0,
                number(tick)
            );
        }
        let middle = (TOP + bottom) / 2.0;
        let _ = write!(
            plot.svg,
            "<text x=\"14\" y=\"{middle:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 14 {middle:.1})\">{}</text>",
            escaped(y_label)
        );
        plot
    }

    fn bottom(&self) -> f64 {
        self.height - 44.0
    }

    fn at_x(&self, value: f64) -> f64 {
        LEFT + self.x.share(value) * (WIDTH - LEFT - RIGHT)
    }

    fn at_y(&self, value: f64) -> f64 {
        TOP + (1.0 - self.y.share(value)) * (self.bottom() - TOP)
    }

    fn path(&self, points: impl IntoIterator<Item = [f64; 2]>) -> String {
        let mut path = String::new();
        for [x, y] in points {
            let step = if path.is_empty() { "M" } else { "L" };
            let _ = write!(path, "{step}{:.1} {:.1}", self.at_x(x), self.at_y(y));
        }
        path
    }

    /// A curve, with the text that a pointer shows.
    pub(crate) fn line(&mut self, points: &[[f64; 2]], colour: &str, is_dashed: bool, title: &str) {
        let path = self.path(points.iter().copied());
        let dashes = if is_dashed { " stroke-dasharray=\"7 4\"" } else { "" };
        let _ = write!(
            self.svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"var(--{colour})\" stroke-width=\"1.8\"{dashes}><title>{}</title></path>",
            escaped(title)
        );
    }

    /// A line across at one value.
    pub(crate) fn level(&mut self, y: f64, colour: &str, title: &str) {
        self.line(&[[self.x.low, y], [self.x.high, y]], colour, true, title);
    }

    /// The area between two curves: x, lower and upper end.
    pub(crate) fn band(&mut self, points: &[[f64; 3]], colour: &str) {
        let upper = points.iter().map(|[x, _, high]| [*x, *high]);
        let path = self.path(points.iter().map(|[x, low, _]| [*x, *low]).chain(upper.rev()));
        let _ = write!(self.svg, "<path d=\"{path}Z\" fill=\"var(--{colour})\" opacity=\".2\"/>");
    }

    /// A dot.
    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], colour: &str, opacity: f64) {
        let _ = write!(
            self.svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"var(--{colour})\" opacity=\"{opacity:.2}\"/>",
            self.at_x(x),
            self.at_y(y)
        );
    }

    /// The finished figure.
    pub(crate) fn finish(self) -> String {
        end(self.svg, [LEFT, WIDTH - RIGHT], self.height - 8.0, &self.x_label)
    }
}

/// The begin of a figure, 720 units across.
pub(super) fn begin(height: f64, label: &str) -> String {
    format!(
        "<svg viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" aria-label=\"{}\" font-size=\"12\" fill=\"var(--ink)\">",
        escaped(label)
    )
}

/// The end of a figure with the label of an axis from left to right.
pub(super) fn end(mut svg: String, [left, right]: [f64; 2], y: f64, label: &str) -> String {
    let x = (left + right) / 2.0;
    let _ =
        write!(svg, "<text x=\"{x}\" y=\"{y:.0}\" text-anchor=\"middle\">{}</text></svg>", escaped(label));
    svg
}

/// Names beside their colours.
pub(crate) fn legend(entries: &[(&str, &str)]) -> String {
    let items: String = entries
        .iter()
        .map(|(name, colour)| {
            format!("<li><i style=\"background:var(--{colour})\"></i>{}</li>", escaped(name))
        })
        .collect();
    format!("<ul class=\"legend\">{items}</ul>")
}

/// A step of 1, 2 or 5 times a power of ten that parts a length into about five.
pub(crate) fn nice_step(length: f64) -> f64 {
    let power = 10_f64.powf((length / 5.0).log10().floor());
    let unit = match length / 5.0 / power {
        of if of < 1.5 => 1.0,
        of if of < 3.5 => 2.0,
        of if of < 7.5 => 5.0,
        _ => 10.0,
    };
    power * unit
}

pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_labelled_within_the_decade() {
        assert_eq!(Axis::logarithmic([1.5, 30.0]).ticks(), [2.0, 5.0, 10.0, 20.0]);
        assert_eq!(Axis::logarithmic([24.0, 48.0]).ticks(), [30.0, 40.0]);
        assert_eq!(Axis::linear([0.0, 10.0]).ticks(), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert!(Axis::linear([]).ticks().len() > 2, "an empty figure has axes too");
        assert!(Axis::logarithmic([0.0, -1.0]).ticks().len() > 1);
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [(0.05, "0.05"), (1200.0, "1200"), (0.5, "0.5"), (2.0, "2"), (-0.0, "0")] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn what_lies_beyond_an_axis_ends_at_its_edge() {
        let axis = Axis::linear([0.0, 1.0]);
        assert_eq!((axis.share(-5.0), axis.share(5.0)), (0.0, 1.0));
        let mut plot = Plot::new(axis, axis, "x", "y < z", 200.0);
        plot.line(&[[0.0, 0.0], [1.0, 1.0]], "c0", false, "a & b");
        let svg = plot.finish();
        assert!(svg.contains("y &lt; z") && svg.contains("a &amp; b") && svg.ends_with("</svg>"));
    }

    #[test]
    fn axes_have_steps_that_people_like() {
        for (length, step) in [(1.0, 0.2), (0.2, 0.05), (47.0, 10.0), (100.0, 20.0)] {
            assert!((nice_step(length) - step).abs() < 1e-9, "{length}: {}", nice_step(length));
        }
    }
}
