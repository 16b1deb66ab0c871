//! Pictures of the dashboard as SVG, drawn on the server, so that pages need no script. Colours are classes
//! of the style sheet, so that they follow the reader's light or dark scheme.

mod map;

use std::fmt::Write as _;

pub(super) use map::{Place, Runner, map, race};
use treewright_core::cost_view::CostView;

/// Width of wide pictures, in units of their own.
const WIDTH: f64 = 900.0;
/// Colours of a scale, from the best to the worst: the classes `c0` to `c4` of the style sheet.
pub(super) const COLOURS: usize = 5;

/// A trial in a tuning curve.
pub(super) struct CurvePoint {
    pub(super) number: f64,
    /// `None` for a trial without a usable cost.
    pub(super) cost: Option<f64>,
    /// The class of its style.
    pub(super) class: &'static str,
}

/// A cost to compare with, as a line across the curve.
pub(super) struct Level {
    pub(super) cost: f64,
    pub(super) name: &'static str,
    /// The class of its style.
    pub(super) class: &'static str,
}

/// A place in a rectangle for numbers of two ranges.
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: (f64, f64),
    y: (f64, f64),
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.left + self.width * share(value, self.x)
    }

    fn y(&self, value: f64) -> f64 {
        self.top + self.height * (1.0 - share(value, self.y))
    }

    /// Border, round numbers up the side, and the ends of the horizontal axis.
    fn axes(&self, svg: &mut String, x_label: &str, y_label: &str) {
        let Frame { left, top, width, height, x, y } = self;
        put(
            svg,
            format_args!(r#"<rect class="axis" x="{left}" y="{top}" width="{width}" height="{height}"/>"#),
        );
        let (right, bottom) = (left + width, top + height);
        let mut text = |at_x: f64, at_y: f64, anchor: &str, words: &str| {
            let words = escape(words);
            put(
                svg,
                format_args!(r#"<text x="{at_x:.0}" y="{at_y:.0}" text-anchor="{anchor}">{words}</text>"#),
            );
        };
        let marks = ticks(*y);
        for mark in &marks {
            text(left - 6.0, self.y(*mark) + 4.0, "end", &figure(*mark));
        }
        text(*left, bottom + 16.0, "start", &figure(x.0));
        text(right, bottom + 16.0, "end", &figure(x.1));
        text(left + width / 2.0, bottom + 16.0, "middle", x_label);
        text(*left, top - 6.0, "start", y_label);
        for mark in marks {
            put(svg, format_args!(r#"<path class="grid" d="M{left} {:.1}H{right}"/>"#, self.y(mark)));
        }
    }
}

fn share(value: f64, (low, high): (f64, f64)) -> f64 {
    if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 }
}

/// Three to six round numbers in a range: multiples of 1, 2 or 5 times a power of ten.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let step = (high - low) / 5.0;
    if !(step.is_finite() && step > 0.0) {
        return vec![low];
    }
    let power = 10_f64.powf(step.log10().floor());
    let step = power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|of| of * power >= step).unwrap_or(10.0);
    let first = (low / step).ceil();
    let marks = (0..12).map(|index| (first + f64::from(index)) * step);
    marks.take_while(|mark| *mark <= high).collect()
}

/// The lower end of an axis, with some room below but not below zero where values are positive.
fn above_zero(low: f64, room: f64) -> f64 {
    if low >= 0.0 { (low - room).max(0.0) } else { low - room }
}

/// The value below which 19 of 20 lie: few bad ones must not flatten the rest.
fn most(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().saturating_sub(1) * 19 / 20).copied()
}

/// Smallest and largest; `None` without any.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((low.min(value), high.max(value))),
    })
}

fn put(svg: &mut String, words: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = svg.write_fmt(words);
}

fn open(height: f64, title: &str) -> String {
    open_sized(WIDTH, height, title)
}

fn open_sized(width: f64, height: f64, title: &str) -> String {
    let title = escape(title);
    format!(r#"<svg viewBox="0 0 {width} {height}" role="img" aria-label="{title}"><title>{title}</title>"#)
}

/// Text as it stands in SVG and HTML.
pub(super) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for each in text.chars() {
        match each {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            other => safe.push(other),
        }
    }
    safe
}

/// About four significant digits.
pub(super) fn figure(value: f64) -> String {
    let size = value.abs();
    if value == value.trunc() && size < 1e9 {
        return format!("{value:.0}");
    }
    match size {
        1000.0..1e9 => format!("{value:.0}"),
        0.01..1000.0 => {
            let whole_digits = size.log10().floor().max(0.0) as usize;
            format!("{value:.*}", 3 - whole_digits.min(3))
        }
        _ => format!("{value:.2e}"),
    }
}

/// Costs by trial, the best so far, and the levels, in the study's view of costs.
pub(super) fn curve(points: &[CurvePoint], levels: &[Level], view: &CostView) -> String {
    debug_assert!(
        points.is_sorted_by(|a, b| a.number < b.number),
        "the best so far is of the trials before, which come first"
    );
    let values = || points.iter().filter_map(|point| point.cost).map(|cost| view.value(cost));
    let of_levels = || levels.iter().map(|level| view.value(level.cost));
    let (Some(x), Some(all)) =
        (range(points.iter().map(|point| point.number)), range(values().chain(of_levels())))
    else {
        return nothing("Nothing has been measured yet.");
    };
    let high = match view.is_maximised() {
        // Bad values lie near 0 and do not flatten the others.
        true => all.1,
        false => of_levels().fold(most(values()).unwrap_or(all.0), f64::max),
    };
    let room = 0.06 * (high - all.0).max(1e-3 * high.abs());
    let frame = Frame {
        left: 70.0,
        top: 24.0,
        width: 815.0,
        height: 270.0,
        x,
        y: (above_zero(all.0, room), high + room),
    };
    let mut svg = open(330.0, "Tuning curve");
    frame.axes(&mut svg, "trial", &view.title());
    let y = |cost: f64| frame.y(view.value(cost));
    for point in points {
        let at_x = frame.x(point.number);
        match point.cost {
            Some(cost) => {
                let (at_y, class) = (y(cost), point.class);
                put(
                    &mut svg,
                    format_args!(r#"<circle class="point {class}" cx="{at_x:.1}" cy="{at_y:.1}" r="3"/>"#),
                );
            }
            None => {
                let (low, high) = (at_x - 3.0, at_x + 3.0);
                put(
                    &mut svg,
                    format_args!(
                        r#"<path class="bad" d="M{low:.1} 28L{high:.1} 34M{low:.1} 34L{high:.1} 28"/>"#
                    ),
                );
            }
        }
    }
    for (index, level) in levels.iter().enumerate() {
        let (y, right, class, name) = (y(level.cost), frame.left + frame.width, level.class, level.name);
        put(&mut svg, format_args!(r#"<path class="{class}" d="M70 {y:.1}H{right}"/>"#));
        // Side by side, since two may lie upon each other.
        let (x, y) = (right - 4.0 - 90.0 * index as f64, y - 4.0);
        put(&mut svg, format_args!(r#"<text x="{x}" y="{y:.1}" text-anchor="end">{name}</text>"#));
    }
    let mut best = f64::INFINITY;
    let mut path = String::new();
    for (number, cost) in points.iter().filter_map(|point| Some((point.number, point.cost?))) {
        if cost < best {
            best = cost;
            let (x, y) = (frame.x(number), y(cost));
            let (to, then) = if path.is_empty() { ("M", " ") } else { ("H", "V") };
            put(&mut path, format_args!("{to}{x:.1}{then}{y:.1}"));
        }
    }
    if !path.is_empty() {
        put(&mut svg, format_args!(r#"<path class="best" d="{path}H{}"/>"#, frame.left + frame.width));
    }
    svg + "</svg>"
}

fn nothing(words: &str) -> String {
    format!(r#"<p class="note">{}</p>"#, escape(words))
}

/// A bar for each name, of 0 to 1.
pub(super) fn bars(rows: &[(String, f64)]) -> String {
    if rows.is_empty() {
        return nothing("Too few trials to tell: 20 different configurations are needed.");
    }
    let mut svg = open(24.0 * rows.len() as f64 + 8.0, "Importances");
    for (index, (name, value)) in rows.iter().enumerate() {
        let y = 24.0 * index as f64 + 4.0;
        let (width, text_y) = (560.0 * value.clamp(0.0, 1.0), y + 14.0);
        put(
            &mut svg,
            format_args!(r#"<text x="220" y="{text_y}" text-anchor="end">{}</text>"#, escape(name)),
        );
        put(&mut svg, format_args!(r#"<rect class="bar" x="230" y="{y}" width="{width:.1}" height="18"/>"#));
        put(&mut svg, format_args!(r#"<text x="{:.1}" y="{text_y}">{:.2}</text>"#, 238.0 + width, value));
    }
    svg + "</svg>"
}

/// An axis of a parameter: its name and the labels of its ends.
pub(super) struct Axis {
    pub(super) name: String,
    pub(super) low: String,
    pub(super) high: String,
}

/// A line for each trial across all axes. Places are 0 to 1, `None` where a parameter is inactive; classes 0
/// (best) to 4.
pub(super) fn parallel(axes: &[Axis], runs: &[(Vec<Option<f64>>, usize)]) -> String {
    assert!(runs.iter().all(|(places, _)| places.len() == axes.len()), "a place for each axis");
    debug_assert!(runs.iter().all(|(_, class)| *class < COLOURS), "a run has no colour");
    let width = (110.0 * axes.len() as f64).max(WIDTH);
    let step = (width - 140.0) / (axes.len().max(2) - 1) as f64;
    let x = |index: usize| 70.0 + step * index as f64;
    let mut svg = open_sized(width, 320.0, "Parallel coordinates");
    let mut order: Vec<_> = runs.iter().collect();
    // The best are drawn last, above the others.
    order.sort_by_key(|(_, class)| std::cmp::Reverse(*class));
    for (places, class) in order {
        let mut path = String::new();
        for (index, place) in places.iter().enumerate() {
            if let Some(place) = place {
                let start = if path.is_empty() { "M" } else { "L" };
                put(&mut path, format_args!("{start}{:.1} {:.1}", x(index), 280.0 - 230.0 * place));
            }
        }
        put(&mut svg, format_args!(r#"<path class="run c{class}" d="{path}"/>"#));
    }
    for (index, axis) in axes.iter().enumerate() {
        let x = x(index);
        let y = if index % 2 == 0 { 14.0 } else { 28.0 };
        put(&mut svg, format_args!(r#"<path class="axis" d="M{x:.1} 50V280"/>"#));
        for (y, words) in [(y, &axis.name), (44.0, &axis.high), (296.0, &axis.low)] {
            let words = escape(words);
            put(&mut svg, format_args!(r#"<text x="{x:.1}" y="{y}" text-anchor="middle">{words}</text>"#));
        }
    }
    svg + "</svg>"
}

/// Costs over one parameter's places, in the study's view of costs.
pub(super) fn slice(axis: &Axis, points: &[(f64, f64)], view: &CostView) -> String {
    let values = || points.iter().map(|point| view.value(point.1));
    let Some((low, high)) = range(values()) else { return nothing("Never active.") };
    debug_assert!(points.iter().all(|(place, _)| (0.0..=1.0).contains(place)), "a point is off the axis");
    let shown = most(values()).filter(|most| *most > low && !view.is_maximised());
    let y = (low, shown.unwrap_or(high));
    let frame = Frame { left: 56.0, top: 18.0, width: 234.0, height: 130.0, x: (0.0, 1.0), y };
    let mut svg = open_sized(300.0, 180.0, &format!("{} over {}", view.heading(), axis.name));
    put(&mut svg, format_args!(r#"<rect class="axis" x="56" y="18" width="234" height="130"/>"#));
    for (x, y, anchor, words) in [
        (50.0, 28.0, "end", figure(y.1)),
        (50.0, 148.0, "end", figure(y.0)),
        (56.0, 164.0, "start", axis.low.clone()),
        (290.0, 164.0, "end", axis.high.clone()),
        (56.0, 12.0, "start", view.title()),
    ] {
        let words = escape(&words);
        put(&mut svg, format_args!(r#"<text x="{x}" y="{y}" text-anchor="{anchor}">{words}</text>"#));
    }
    for (place, cost) in points {
        let (x, y) = (frame.x(*place), frame.y(view.value(*cost)));
        put(&mut svg, format_args!(r#"<circle class="point explore" cx="{x:.1}" cy="{y:.1}" r="2.5"/>"#));
    }
    svg + "</svg>"
}

/// Means in a square of cells of what a study tells; places of both axes are 0 to 1. Values are averaged as
/// they are told: the value of a mean cost would be the harmonic mean of a metric that is maximised.
pub(super) fn contour(x_axis: &Axis, y_axis: &Axis, points: &[(f64, f64, f64)], view: &CostView) -> String {
    const CELLS: usize = 12;
    let mut cells = vec![(0.0, 0_u32); CELLS * CELLS];
    let place = |share: f64| ((share * CELLS as f64) as usize).min(CELLS - 1);
    for (x, y, cost) in points {
        let cell = &mut cells[place(*y) * CELLS + place(*x)];
        *cell = (cell.0 + view.value(*cost), cell.1 + 1);
    }
    let counted: usize = cells.iter().map(|(_, count)| *count as usize).sum();
    assert_eq!(counted, points.len());
    let means: Vec<Option<f64>> =
        cells.iter().map(|(sum, count)| (*count > 0).then(|| sum / f64::from(*count))).collect();
    // The smaller, the better.
    let rank = |mean: f64| if view.is_maximised() { -mean } else { mean };
    let mut sorted: Vec<f64> = means.iter().flatten().map(|mean| rank(*mean)).collect();
    sorted.sort_by(f64::total_cmp);
    let mut svg =
        open_sized(640.0, 440.0, &format!("Mean {} over {} and {}", view.title(), x_axis.name, y_axis.name));
    for (index, mean) in means.iter().enumerate().filter_map(|(index, mean)| mean.map(|mean| (index, mean))) {
        let class = sorted.partition_point(|other| *other < rank(mean)) * COLOURS / sorted.len();
        debug_assert!(class < COLOURS, "a mean of {mean} has no colour");
        let (x, y) =
            (130.0 + 40.0 * (index % CELLS) as f64, 20.0 + 30.0 * (CELLS - 1 - index / CELLS) as f64);
        let words = format!("{} over {} runs", figure(mean), cells[index].1);
        put(
            &mut svg,
            format_args!(
                r#"<rect class="c{class}" x="{x}" y="{y}" width="38" height="28"><title>{words}</title></rect>"#
            ),
        );
    }
    put(&mut svg, format_args!(r#"<rect class="axis" x="128" y="18" width="484" height="364"/>"#));
    for (x, y, anchor, words) in [
        (130.0, 400.0, "start", &x_axis.low),
        (610.0, 400.0, "end", &x_axis.high),
        (370.0, 418.0, "middle", &x_axis.name),
        (122.0, 380.0, "end", &y_axis.low),
        (122.0, 30.0, "end", &y_axis.high),
        // Above the frame, where a long name has room.
        (128.0, 12.0, "start", &y_axis.name),
    ] {
        let words = escape(words);
        put(&mut svg, format_args!(r#"<text x="{x}" y="{y}" text-anchor="{anchor}">{words}</text>"#));
    }
    svg + "</svg>"
}

/// A trial in time: its row's name, begin and end in seconds, and the class of its style.
pub(super) struct Span {
    pub(super) row: String,
    pub(super) begin_s: f64,
    pub(super) end_s: f64,
    pub(super) class: &'static str,
}

/// A row for each client, a bar for each trial.
pub(super) fn timeline(spans: &[Span]) -> String {
    let ends = spans.iter().flat_map(|span| [span.begin_s, span.end_s]);
    let Some((begin, end)) = range(ends) else { return nothing("No trials yet.") };
    let mut rows: Vec<&str> = spans.iter().map(|span| span.row.as_str()).collect();
    rows.sort_unstable();
    rows.dedup();
    let shown = rows.len().min(20);
    let mut svg = open(26.0 * shown as f64 + 30.0, "Timeline");
    for (index, row) in rows.iter().take(shown).enumerate() {
        let y = 26.0 * index as f64 + 6.0;
        let short: String = row.chars().take(28).collect();
        put(&mut svg, format_args!(r#"<text x="4" y="{}">{}</text>"#, y + 13.0, escape(&short)));
        for span in spans.iter().filter(|span| span.row == *row) {
            let x = |time: f64| 200.0 + 690.0 * share(time, (begin, end));
            let (left, width) = (x(span.begin_s), (x(span.end_s) - x(span.begin_s)).max(1.0));
            assert!((200.0..=890.0).contains(&left) && width <= 690.0, "a bar of {width} at {left}");
            let class = span.class;
            put(
                &mut svg,
                format_args!(
                    r#"<rect class="{class}" x="{left:.1}" y="{y}" width="{width:.1}" height="16"/>"#
                ),
            );
        }
    }
    let y = 26.0 * shown as f64 + 20.0;
    put(&mut svg, format_args!(r#"<text x="200" y="{y}">0 s</text>"#));
    put(
        &mut svg,
        format_args!(r#"<text x="890" y="{y}" text-anchor="end">{} s</text>"#, figure(end - begin)),
    );
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use treewright_core::objective::{Objective, ObjectiveTerm};

    use super::*;

    /// Of a study that maximises frames a second, with costs in milliseconds.
    pub(super) fn rate() -> CostView {
        let term = ObjectiveTerm { metric: "fps".into(), weight: 1000.0 };
        let objective = Objective::new(vec![term]).expect("valid").with_maximised(vec!["fps".into()]);
        objective.expect("a term").view()
    }

    #[test]
    fn what_is_maximised_is_drawn_by_its_value_and_the_best_is_on_top() {
        let point = |number: f64, cost| CurvePoint { number, cost: Some(cost), class: "explore" };
        let points = [point(1.0, 20.0), point(2.0, 40.0), point(3.0, 10.0)];
        let level = Level { cost: 20.0, name: "default", class: "base" };
        let svg = curve(&points, &[level], &rate());
        assert!(svg.contains("fps (higher is better)") && svg.contains(">100</text>"), "{svg}");
        let heights: Vec<f64> =
            svg.split(" cy=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect();
        assert!(heights[2] < heights[0] && heights[0] < heights[1], "10 ms are 100 fps: {heights:?}");
        let best = svg.split("class=\"best\" d=\"").nth(1).expect("the best so far");
        assert_eq!(best.split('"').next().expect("a path").matches('V').count(), 1, "40 ms is no better");
        let axis = || Axis { name: "x".into(), low: "0".into(), high: "1".into() };
        let svg = slice(&axis(), &[(0.0, 20.0), (1.0, 10.0)], &rate());
        assert!(svg.contains("fps (higher is better)") && svg.contains(">100<") && svg.contains(">50<"));
        let svg = contour(&axis(), &axis(), &[(0.0, 0.0, 20.0), (1.0, 1.0, 10.0)], &rate());
        assert!(svg.contains("Mean fps (higher is better)"), "{svg}");
        let best = svg.split("<rect").find(|rect| rect.contains("100 over 1 runs")).expect("the best cell");
        assert!(best.contains("class=\"c0\""), "{best}");
    }

    #[test]
    fn what_is_maximised_is_averaged_as_it_is_told() {
        let axis = || Axis { name: "x".into(), low: "0".into(), high: "1".into() };
        // 10 and 90 frames a second in one cell, 40 twice in another: by their costs 18 and 40.
        let points = [(0.0, 0.0, 100.0), (0.0, 0.0, 1000.0 / 90.0), (1.0, 1.0, 25.0), (1.0, 1.0, 25.0)];
        let svg = contour(&axis(), &axis(), &points, &rate());
        let class = |words: &str| {
            let cell = svg.split("<rect").find(|cell| cell.contains(words)).expect("the cell");
            cell.split("class=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a class")
        };
        assert_eq!((class(">50 over 2 runs<"), class(">40 over 2 runs<")), ("c0", "c2"), "{svg}");
        let svg = contour(&axis(), &axis(), &points, &CostView::default());
        assert!(svg.contains(">55.56 over 2 runs<") && svg.contains(">25 over 2 runs<"), "{svg}");
    }

    #[test]
    fn ticks_are_round_and_within_their_range() {
        assert_eq!(ticks((0.0, 10.0)), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks((0.3, 1.7)), [0.5, 1.0, 1.5]);
        assert_eq!(ticks((-30.0, 170.0)), [0.0, 50.0, 100.0, 150.0]);
        assert_eq!(ticks((7.0, 7.0)), [7.0]);
        for (low, high) in [(1e-9, 3e-9), (5.0, 5.001), (-1e12, 2e12), (99.0, 101.0)] {
            let marks = ticks((low, high));
            assert!((3..=6).contains(&marks.len()), "{marks:?}");
            assert!(marks.iter().all(|mark| (low..=high).contains(mark)), "{marks:?}");
        }
    }

    #[test]
    fn what_lies_in_a_range_has_its_share() {
        assert_eq!(
            [0.0, 2.0, 5.0, 6.0, 9.0].map(|value| share(value, (2.0, 6.0))),
            [0.0, 0.0, 0.75, 1.0, 1.0]
        );
        assert_eq!(share(3.0, (3.0, 3.0)), 0.5);
        assert_eq!([above_zero(3.0, 1.0), above_zero(0.5, 1.0), above_zero(-2.0, 1.0)], [2.0, 0.0, -3.0]);
        assert_eq!(most((0..40).map(f64::from)), Some(37.0));
        assert_eq!(range([3.0, -1.0, 2.0].into_iter()), Some((-1.0, 3.0)));
    }

    #[test]
    fn what_people_write_is_escaped() {
        let axis = Axis { name: "<b>&\"'".into(), low: "<".into(), high: ">".into() };
        for svg in [
            parallel(&[axis], &[(vec![Some(0.5)], 0)]),
            bars(&[("<script>".into(), 0.5)]),
            timeline(&[Span { row: "</svg><script>".into(), begin_s: 0.0, end_s: 1.0, class: "point" }]),
        ] {
            assert!(!svg.contains("<b>") && !svg.contains("<script>"), "{svg}");
        }
    }

    #[test]
    fn a_curve_shows_the_best_so_far() {
        let point = |number: f64, cost| CurvePoint { number, cost, class: "explore" };
        let points = [point(1.0, Some(10.0)), point(2.0, None), point(3.0, Some(4.0)), point(4.0, Some(6.0))];
        let level = |cost, name| Level { cost, name, class: "base" };
        let svg = curve(&points, &[level(10.0, "default"), level(3.0, "roofline")], &CostView::default());
        assert!(svg.contains(">roofline<"));
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(svg.matches("class=\"bad\"").count(), 1);
        assert_eq!(svg.matches("class=\"best\"").count(), 1);
        assert!(curve(&[], &[], &CostView::default()).contains("Nothing"));
        assert!(!curve(&[point(1.0, Some(5.0))], &[], &CostView::default()).contains("NaN"));
    }

    #[test]
    fn figures_are_short() {
        let shown: Vec<_> = [0.0, 12.0, 3.34567, 123.456, 98765.4, 1e-5].into_iter().map(figure).collect();
        assert_eq!(shown, ["0", "12", "3.346", "123.5", "98765", "1.00e-5"]);
    }
}
