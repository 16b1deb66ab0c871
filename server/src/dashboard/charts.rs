//! Pictures of the dashboard as SVG, drawn on the server, so that pages need no script.

mod front;
mod map;

pub(super) use front::fronts;
pub(super) use map::{Place, Runner, map, race};
use treewright_core::cost_view::CostView;
use treewright_figures::{self as figures, Colour, Dot, Figure, Stroke, escaped};

/// Width of wide pictures, in units of their own.
const WIDTH: f64 = 900.0;
/// Steps of a scale of ranks.
const STEPS: usize = 5;
/// Most rows of the timeline.
const ROWS: usize = 20;

/// The colour of a kind of trials, and its name.
pub(super) type Kind = (Colour, &'static str);

pub(super) struct CurvePoint {
    pub(super) number: f64,
    /// `None` for a trial without a usable cost.
    pub(super) cost: Option<f64>,
    pub(super) kind: Kind,
}

/// A cost to compare with, as a line across the curve.
pub(super) struct Level {
    pub(super) cost: f64,
    /// The ends of the 95 % interval of an estimate, which is drawn as a band.
    pub(super) ends: Option<[f64; 2]>,
    pub(super) kind: Kind,
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

/// The axis of shown values and of levels beside them, in the study's view of costs.
fn values(view: &CostView, costs: impl Iterator<Item = f64>, levels: &[Level]) -> figures::Axis {
    let shown = costs.map(|cost| view.value(cost));
    let others = levels.iter().flat_map(|one| one.ends.into_iter().flatten().chain([one.cost]));
    let others = others.map(|cost| view.value(cost));
    match view.is_maximised() {
        // Bad values lie near 0 and do not flatten the others.
        true => figures::Axis::linear(&view.title(), shown.chain(others)),
        false => figures::Axis::robust(&view.title(), shown, others),
    }
}

/// The lowest number until each point.
fn lowest(points: impl Iterator<Item = (f64, f64)>) -> impl Iterator<Item = (f64, f64)> {
    points.scan(f64::INFINITY, |lowest, (at, value)| {
        *lowest = lowest.min(value);
        Some((at, *lowest))
    })
}

/// The place of a number's rank on a scale of colours, in steps: 0 for the lowest fifth, 1 for the highest.
pub(super) fn rank(sorted: &[f64], value: f64) -> f64 {
    let step = sorted.partition_point(|other| *other < value) * STEPS / sorted.len().max(1);
    step.min(STEPS - 1) as f64 / (STEPS - 1) as f64
}

/// Costs by trial, the best so far, and the levels, in the study's view of costs.
pub(super) fn curve(points: &[CurvePoint], levels: &[Level], view: &CostView) -> String {
    debug_assert!(points.is_sorted_by(|a, b| a.number < b.number), "trials come in their order");
    let measured = || points.iter().filter_map(|point| Some((point.number, point.cost?)));
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return nothing("Nothing has been measured yet.");
    };
    if measured().next().is_none() && levels.is_empty() {
        return nothing("Nothing has been measured yet.");
    }
    let x = figures::Axis::counts("trial", first.number, last.number);
    let y = values(view, measured().map(|point| point.1), levels);
    let mut figure = Figure::new("Tuning curve", [WIDTH, 330.0], x, y);
    for CurvePoint { number, cost, kind: (colour, name) } in points {
        match cost {
            Some(cost) => {
                figure.dot([*number, view.value(*cost)], Dot::Small, *colour, "");
                figure.dot_key(Dot::Small, *colour, name);
            }
            None => figure.cross(*number, Colour::Vermilion, "without a usable cost"),
        }
    }
    for Level { cost, ends, kind: (colour, name) } in levels {
        if let Some([one, other]) = ends.map(|ends| ends.map(|end| view.value(end))) {
            figure.band(&[first, last].map(|point| [point.number, one, other]), *colour);
        }
        figure.level(view.value(*cost), Stroke::Dashed, *colour, name);
    }
    let mut best: Vec<[f64; 2]> = lowest(measured()).map(|(at, cost)| [at, view.value(cost)]).collect();
    let end = best.last().map(|[_, value]| [last.number, *value]);
    best.extend(end);
    figure.steps(&best, Colour::Amber, "best so far");
    figure.finish()
}

/// The cost of all trials so far over that of as many runs of the default, which costs `default`; the best
/// fixed configuration costs `fixed`. Costs that do not add up have no `default`.
pub(super) fn session(points: &[CurvePoint], default: Option<f64>, fixed: Option<f64>) -> String {
    let Some(default) = default else {
        return nothing("There is no cost of the default to compare with.");
    };
    let measured = points.iter().filter_map(|point| Some((point.number, point.cost?)));
    let so_far = measured.scan((0.0, 0.0), |(spent, beside), (number, cost)| {
        (*spent, *beside) = (*spent + cost, *beside + default);
        Some([number, *spent / *beside])
    });
    let so_far: Vec<[f64; 2]> = so_far.collect();
    let (Some([first, _]), Some([last, _])) = (so_far.first(), so_far.last()) else {
        return nothing("Nothing has been measured yet.");
    };
    let fixed = fixed.map(|fixed| fixed / default);
    let levels = std::iter::once(1.0).chain(fixed);
    let x = figures::Axis::counts("trial", *first, *last);
    let y =
        figures::Axis::linear("cost so far, default = 1", so_far.iter().map(|point| point[1]).chain(levels));
    let mut figure = Figure::new("Whole session", [WIDTH, 260.0], x, y);
    figure.level(1.0, Stroke::Dashed, Colour::Purple, "default");
    if let Some(fixed) = fixed {
        figure.level(fixed, Stroke::Dashed, Colour::Green, "best fixed");
    }
    figure.line(&so_far, Stroke::Solid, Colour::Amber, "all trials so far");
    figure.finish()
}

fn nothing(words: &str) -> String {
    format!(r#"<p class="note">{}</p>"#, escaped(words))
}

/// A bar for each name, of 0 to 1.
pub(super) fn bars(rows: &[(String, f64)]) -> String {
    if rows.is_empty() {
        return nothing("Too few trials to tell: 20 different configurations are needed.");
    }
    let names: Vec<&str> = rows.iter().map(|(name, _)| name.as_str()).collect();
    let x = figures::Axis::between("share of the variance", 0.0, 1.1);
    let mut figure = Figure::of_rows("Importances", WIDTH, x, &names);
    for (row, (_, value)) in rows.iter().enumerate() {
        let value = value.clamp(0.0, 1.0);
        figure.bar(row, [0.0, value], 1.0, Colour::Blue, "");
        let [x, y] = figure.place([value, row as f64 + 0.5]);
        figure.text([x + 8.0, y + 4.0], "start", &format!("{value:.2}"));
    }
    figure.finish()
}

pub(super) struct Axis {
    pub(super) name: String,
    pub(super) low: String,
    pub(super) high: String,
}

impl Axis {
    /// From 0 to 1.
    fn drawn(&self) -> figures::Axis {
        figures::Axis::ends(&self.name, &self.low, &self.high)
    }
}

/// A line for each trial across all axes. Places are 0 to 1, `None` where a parameter is inactive; ranks 0
/// (best) to 1.
pub(super) fn parallel(axes: &[Axis], runs: &[(Vec<Option<f64>>, f64)]) -> String {
    assert!(runs.iter().all(|(places, _)| places.len() == axes.len()), "a place for each axis");
    let width = (110.0 * axes.len() as f64).max(WIDTH);
    let bare = |low, high| figures::Axis::labelled("", [low, high], Vec::new());
    let (x, y) = (bare(-0.5, axes.len() as f64 - 0.5), bare(-0.1, 1.2));
    let mut figure = Figure::new("Parallel coordinates", [width, 320.0], x, y);
    let mut order: Vec<_> = runs.iter().collect();
    // The best are drawn last, above the others.
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (places, rank) in order {
        let active = places.iter().enumerate().filter_map(|(index, place)| Some([index as f64, (*place)?]));
        let stroke = if *rank == 0.0 { Stroke::Solid } else { Stroke::Thin };
        figure.line(&active.collect::<Vec<_>>(), stroke, Colour::Scale(*rank), "");
    }
    for (index, axis) in axes.iter().enumerate() {
        let at = index as f64;
        figure.interval([at, 0.0], [at, 1.0], Colour::Grey);
        let ([x, low], [_, high]) = (figure.place([at, 0.0]), figure.place([at, 1.0]));
        let name = high - if index % 2 == 0 { 36.0 } else { 21.0 };
        for (y, words) in [(name, &axis.name), (high - 6.0, &axis.high), (low + 16.0, &axis.low)] {
            figure.text([x, y], "middle", words);
        }
    }
    figure.scale_key("the best fifth", "the worst");
    figure.finish()
}

/// Costs over one parameter's places, in the study's view of costs.
pub(super) fn slice(axis: &Axis, points: &[(f64, f64)], view: &CostView) -> String {
    if points.is_empty() {
        return nothing("Never active.");
    }
    debug_assert!(points.iter().all(|(place, _)| (0.0..=1.0).contains(place)), "a point is off the axis");
    let y = values(view, points.iter().map(|point| point.1), &[]);
    let title = format!("{} over {}", view.heading(), axis.name);
    let mut figure = Figure::new(&title, [300.0, 190.0], axis.drawn(), y);
    for (place, cost) in points {
        figure.dot([*place, view.value(*cost)], Dot::Small, Colour::Blue, "");
    }
    figure.finish()
}

/// Means of a study's reports in a square of cells; places of both axes are 0 to 1. Values are averaged as
/// they were reported: the value of a mean cost would be the harmonic mean of a metric that is maximised.
pub(super) fn contour(x_axis: &Axis, y_axis: &Axis, points: &[(f64, f64, f64)], view: &CostView) -> String {
    const CELLS: usize = 12;
    let mut cells = vec![(0.0, 0_u32); CELLS * CELLS];
    let place = |share: f64| ((share * CELLS as f64) as usize).min(CELLS - 1);
    for (x, y, cost) in points {
        let cell = &mut cells[place(*y) * CELLS + place(*x)];
        *cell = (cell.0 + view.value(*cost), cell.1 + 1);
    }
    // The smaller, the better.
    let badness = |mean: f64| if view.is_maximised() { -mean } else { mean };
    let means: Vec<(usize, f64)> = (0..cells.len())
        .filter(|index| cells[*index].1 > 0)
        .map(|index| (index, cells[index].0 / f64::from(cells[index].1)))
        .collect();
    let mut sorted: Vec<f64> = means.iter().map(|(_, mean)| badness(*mean)).collect();
    sorted.sort_by(f64::total_cmp);
    let title = format!("Mean {} over {} and {}", view.title(), x_axis.name, y_axis.name);
    let mut figure = Figure::new(&title, [640.0, 440.0], x_axis.drawn(), y_axis.drawn());
    for (index, mean) in means {
        let ends = |cell: usize| [cell, cell + 1].map(|edge| edge as f64 / CELLS as f64);
        let words = format!("{} over {} runs", self::figure(mean), cells[index].1);
        let colour = Colour::Scale(rank(&sorted, badness(mean)));
        figure.cell(ends(index % CELLS), ends(index / CELLS), 1.0, colour, &words);
    }
    figure.scale_key("the best fifth", "the worst");
    figure.finish()
}

/// A trial in time: its row's name, begin and end in seconds, and its kind.
pub(super) struct Span {
    pub(super) row: String,
    pub(super) begin_s: f64,
    pub(super) end_s: f64,
    pub(super) kind: Kind,
}

/// A row for each client, a bar for each trial.
pub(super) fn timeline(spans: &[Span]) -> String {
    if spans.is_empty() {
        return nothing("No trials yet.");
    }
    let begin = spans.iter().map(|span| span.begin_s).fold(f64::INFINITY, f64::min);
    let end = spans.iter().map(|span| span.end_s).fold(begin, f64::max);
    let mut rows: Vec<&str> = spans.iter().map(|span| span.row.as_str()).collect();
    rows.sort_unstable();
    rows.dedup();
    rows.truncate(ROWS);
    let x = figures::Axis::between("seconds since the first of them began", 0.0, end - begin);
    let mut figure = Figure::of_rows("Timeline", WIDTH, x, &rows);
    for Span { row, begin_s, end_s, kind: (colour, name) } in spans {
        if let Ok(row) = rows.binary_search(&row.as_str()) {
            figure.bar(row, [begin_s - begin, end_s - begin], 0.8, *colour, "");
            figure.area_key(*colour, name);
        }
    }
    figure.finish()
}

#[cfg(test)]
mod tests {
    use treewright_core::objective::{Objective, ObjectiveTerm};

    use super::*;

    const KIND: Kind = (Colour::Blue, "explored");

    /// Of a study that maximises frames a second, with costs in milliseconds.
    pub(super) fn rate() -> CostView {
        let term = ObjectiveTerm { metric: "fps".into(), weight: 1000.0 };
        let objective = Objective::new(vec![term]).expect("valid").with_maximised(vec!["fps".into()]);
        objective.expect("a term").view()
    }

    #[test]
    fn what_is_maximised_is_drawn_by_its_value_and_the_best_is_on_top() {
        let point = |number: f64, cost| CurvePoint { number, cost: Some(cost), kind: KIND };
        let points = [point(1.0, 20.0), point(2.0, 40.0), point(3.0, 10.0)];
        let level = Level { cost: 20.0, ends: None, kind: (Colour::Purple, "default") };
        let svg = curve(&points, &[level], &rate());
        assert!(svg.contains("fps (higher is better)") && svg.contains(">100</text>"), "{svg}");
        let heights: Vec<f64> =
            svg.split(" cy=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect();
        assert!(heights[2] < heights[0] && heights[0] < heights[1], "10 ms are 100 fps: {heights:?}");
        let best =
            svg.split("<path d=\"").find(|path| path.contains("best so far")).expect("the best so far");
        let best: Vec<&str> = best.split('"').next().expect("a path").split(['V', 'H', ' ']).collect();
        assert!(best[1] == best[3] && best[3] != best[5], "40 ms is no better: {best:?}");
        let axis = || Axis { name: "x".into(), low: "0".into(), high: "1".into() };
        let svg = slice(&axis(), &[(0.0, 20.0), (1.0, 10.0)], &rate());
        assert!(svg.contains("fps (higher is better)") && svg.contains(">100<"), "{svg}");
        let svg = contour(&axis(), &axis(), &[(0.0, 0.0, 20.0), (1.0, 1.0, 10.0)], &rate());
        assert!(svg.contains("Mean fps (higher is better)"), "{svg}");
        let best = svg.split("<rect").find(|rect| rect.contains("100 over 1 runs")).expect("the best cell");
        assert!(best.contains(&Colour::Scale(0.0).to_string()), "{best}");
    }

    #[test]
    fn what_is_maximised_is_averaged_as_it_is_told() {
        let axis = || Axis { name: "x".into(), low: "0".into(), high: "1".into() };
        // 10 and 90 frames a second in one cell, 40 twice in another: by their costs 18 and 40.
        let points = [(0.0, 0.0, 100.0), (0.0, 0.0, 1000.0 / 90.0), (1.0, 1.0, 25.0), (1.0, 1.0, 25.0)];
        let svg = contour(&axis(), &axis(), &points, &rate());
        for (words, place) in [(">50 over 2 runs<", 0.0), (">40 over 2 runs<", 0.5)] {
            let cell = svg.split("<rect").find(|cell| cell.contains(words)).expect("the cell");
            assert!(cell.contains(&Colour::Scale(place).to_string()), "{svg}");
        }
        let svg = contour(&axis(), &axis(), &points, &CostView::default());
        assert!(svg.contains(">55.56 over 2 runs<") && svg.contains(">25 over 2 runs<"), "{svg}");
    }

    #[test]
    fn ranks_are_in_fifths() {
        let sorted: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!([0.0, 1.0, 2.0, 9.0, 11.0].map(|value| rank(&sorted, value)), [0.0, 0.0, 0.25, 1.0, 1.0]);
        assert_eq!(rank(&[], 1.0), 0.0);
    }

    #[test]
    fn what_people_write_is_escaped() {
        let axis = Axis { name: "<b>&\"'".into(), low: "<".into(), high: ">".into() };
        for svg in [
            parallel(&[axis], &[(vec![Some(0.5)], 0.0)]),
            bars(&[("<script>".into(), 0.5)]),
            timeline(&[Span { row: "</svg><script>".into(), begin_s: 0.0, end_s: 1.0, kind: KIND }]),
        ] {
            assert!(!svg.contains("<b>") && !svg.contains("<script>"), "{svg}");
        }
    }

    #[test]
    fn a_curve_shows_the_best_so_far() {
        let point = |number: f64, cost| CurvePoint { number, cost, kind: KIND };
        let points = [point(1.0, Some(10.0)), point(2.0, None), point(3.0, Some(4.0)), point(4.0, Some(6.0))];
        let level = |cost, name| Level { cost, ends: None, kind: (Colour::Green, name) };
        let answer = Level { ends: Some([4.0, 20.0]), ..level(8.0, "answer") };
        let levels = [level(10.0, "default"), level(3.0, "roofline"), answer];
        let svg = curve(&points, &levels, &CostView::default());
        assert!(svg.contains(">roofline<") && svg.contains(">answer<"));
        assert_eq!(svg.matches("<polygon").count(), 1, "the interval of the one that is an estimate");
        assert!(svg.contains(">20</text>"), "the axis holds the band: {svg}");
        assert_eq!(svg.matches("<circle").count(), 4, "three trials, and the legend");
        assert_eq!(svg.matches("<title>without a usable cost</title>").count(), 1);
        assert_eq!(svg.matches("<title>best so far</title>").count(), 1);
        assert!(curve(&[], &[], &CostView::default()).contains("Nothing"));
        assert!(!curve(&[point(1.0, Some(5.0))], &[], &CostView::default()).contains("NaN"));
    }

    #[test]
    fn a_session_is_compared_with_as_many_runs_of_the_default() {
        let point = |number: f64, cost| CurvePoint { number, cost, kind: KIND };
        let costs = [Some(20.0), Some(40.0), None, Some(5.0), Some(5.0)];
        let points: Vec<CurvePoint> =
            (1..).map(f64::from).zip(costs).map(|(at, cost)| point(at, cost)).collect();
        let svg = session(&points, Some(20.0), Some(15.0));
        let heights = |name: &str| -> Vec<f64> {
            let path = svg.split("<path d=\"").find(|path| path.contains(name)).expect("a line");
            let path = path.split('"').next().expect("its points");
            path.split(['M', 'L']).filter_map(|point| point.split(' ').nth(1)?.parse().ok()).collect()
        };
        let (line, default) = (heights(">all trials so far<"), heights(">default<")[0]);
        assert!(line.len() == 4 && line[0] == default, "{line:?} beside {default}");
        assert!(line[1] < default && line[2] < default && line[3] > default, "90 for 80, then 70: {line:?}");
        assert!(heights(">best fixed<")[0] > line[3], "15 of 20 are less than 70 of 80");
        assert!(session(&points, None, None).contains("no cost of the default"));
        assert!(session(&points[2..3], Some(20.0), None).contains("Nothing"));
    }

    #[test]
    fn figures_are_short() {
        let shown: Vec<_> = [0.0, 12.0, 3.34567, 123.456, 98765.4, 1e-5].into_iter().map(figure).collect();
        assert_eq!(shown, ["0", "12", "3.346", "123.5", "98765", "1.00e-5"]);
    }
}
