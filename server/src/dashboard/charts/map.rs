//! Maps of states and races of studies.

use treewright_core::cost_view::CostView;
use treewright_core::standing::Gain;
use treewright_figures::{self as figures, Colour, Dot, Figure, Stroke};

use super::{Axis, WIDTH, figure, lowest, nothing, rank};

/// A state on a map.
pub(in super::super) struct Place {
    pub(in super::super) state: i64,
    /// Between the ends of the axes, 0 to 1.
    pub(in super::super) x: f64,
    pub(in super::super) y: f64,
    /// The rank that its colour shows: the smaller, the bluer.
    pub(in super::super) rank: f64,
    /// The rank in words.
    pub(in super::super) words: String,
    pub(in super::super) link: String,
}

/// States by two of their indicators, in five colours by rank; `ends` says what the first and the last are.
pub(in super::super) fn map(x_axis: &Axis, y_axis: &Axis, ends: [&str; 2], places: &[Place]) -> String {
    if places.is_empty() {
        return nothing("Nothing was measured yet.");
    }
    let mut ranks: Vec<f64> = places.iter().map(|place| place.rank).collect();
    ranks.sort_by(f64::total_cmp);
    ranks.dedup();
    let title = format!("States by {} and {}", x_axis.name, y_axis.name);
    // Numbers of states at the ends have room inside.
    let roomy = |Axis { name, low, high }: &Axis| {
        let ends = vec![(0.0, low.clone()), (1.0, high.clone())];
        figures::Axis::labelled(name, [-0.03, 1.03], ends)
    };
    let mut figure = Figure::new(&title, [WIDTH, 440.0], roomy(x_axis), roomy(y_axis));
    for (index, place) in places.iter().enumerate() {
        let at = [place.x, place.y];
        let [x, y] = figure.place(at);
        // Numbers of states that lie upon each other stand around them.
        let is_near = |other: &&Place| {
            let [other_x, other_y] = figure.place([other.x, other.y]);
            (other_x - x).abs() < 24.0 && (other_y - y).abs() < 24.0
        };
        let (right, down, anchor) = match places[..index].iter().filter(is_near).count() % 4 {
            0 => (0.0, -11.0, "middle"),
            1 => (0.0, 20.0, "middle"),
            2 => (12.0, 4.0, "start"),
            _ => (-12.0, 4.0, "end"),
        };
        let words = format!("state {}: {}", place.state, place.words);
        figure.link(&place.link, &words, |figure| {
            figure.dot(at, Dot::Large, Colour::Scale(rank(&ranks, place.rank)), &words);
            figure.text([x + right, y + down], anchor, &place.state.to_string());
        });
    }
    let [first, last] = ends;
    figure.scale_key(first, last);
    figure.finish()
}

/// The best so far of one study.
pub(in super::super) struct Runner {
    pub(in super::super) name: String,
    /// Cost over its default's, in the order of the trials.
    pub(in super::super) ratios: Vec<f64>,
    /// The mean gain of its answers by all measurements.
    pub(in super::super) answer: Option<Gain>,
    pub(in super::super) view: CostView,
}

/// The fall of the best cost so far in several studies, each relative to its own default, which is 1. That
/// line follows luck, so a dot with its interval shows where the answers are.
pub(in super::super) fn race(runners: &[Runner]) -> String {
    let best: Vec<Vec<[f64; 2]>> = runners
        .iter()
        .map(|runner| {
            let numbered = runner.ratios.iter().enumerate();
            let ratios = numbered.map(|(index, ratio)| ((index + 1) as f64, *ratio));
            lowest(ratios).map(|(at, ratio)| [at, ratio]).collect()
        })
        .collect();
    let ratios = || best.iter().flatten().map(|[_, ratio]| *ratio).filter(|ratio| ratio.is_finite());
    if ratios().next().is_none() {
        return nothing("Nothing can be compared yet.");
    }
    let longest = best.iter().map(Vec::len).max().unwrap_or(1);
    let x = figures::Axis::counts("measured trials", 1.0, longest as f64);
    // A line that begins above the default is cut there, and marked.
    let low = ratios().fold(1.0, f64::min);
    let answers = runners.iter().filter_map(|runner| runner.answer);
    let answers = answers.flat_map(|gain| [Some(gain.share), gain.low, gain.high].into_iter().flatten());
    let y = figures::Axis::linear("cost, default = 1", answers.map(|share| 1.0 - share).chain([low, 1.0]));
    let mut figure = Figure::new("Best so far over the default, by study", [WIDTH, 326.0], x, y);
    figure.level(1.0, Stroke::Dashed, Colour::Grey, "default");
    for (index, (runner, line)) in runners.iter().zip(&best).enumerate() {
        let reached = line.last().map(|[_, ratio]| reached(*ratio, &runner.view)).unwrap_or_default();
        figure.steps(line, Colour::of(index), &format!("{}: {reached}", runner.name));
        // Those of studies of one length stand side by side.
        let at = (line.len() as f64 - 0.012 * (index * longest) as f64).max(1.0);
        if let Some(gain) = runner.answer {
            if let (Some(low), Some(high)) = (gain.low, gain.high) {
                figure.interval([at, 1.0 - high], [at, 1.0 - low], Colour::of(index));
            }
            let words = format!("{}, answers by all measurements: {}", runner.name, gain.by(&runner.view));
            figure.dot([at, 1.0 - gain.share], Dot::Large, Colour::of(index), &words);
            figure.dot_key(
                Dot::Large,
                Colour::Ink,
                "answers by all measurements, mean with its 95 % interval",
            );
        }
    }
    figure.finish()
}

/// The last ratio of a study; for a maximised metric also the best value over the default's.
fn reached(ratio: f64, view: &CostView) -> String {
    match view.is_maximised() {
        true => format!("{} ({} {} times the default’s)", figure(ratio), view.name(), figure(1.0 / ratio)),
        false => figure(ratio),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_shows_each_state_as_a_link() {
        let axis = |name: &str| Axis { name: name.into(), low: "0".into(), high: "1".into() };
        let place = |state, rank| Place {
            state,
            x: 0.5,
            y: 0.5,
            rank,
            words: "<b>".into(),
            link: format!("/studies/a?state={state}"),
        };
        let svg = map(&axis("triangles"), &axis("<i>"), ["least", "most"], &[place(1, 0.1), place(2, 0.9)]);
        assert_eq!(svg.matches("<a href").count(), 2);
        assert!(!svg.contains("<b>") && !svg.contains("<i>"), "{svg}");
        let high = Place { y: 1.0, ..place(3, 0.5) };
        let svg = map(&axis("x"), &axis("y"), ["", ""], &[high]);
        // The title of the axis ends at 14 from above, and the number is 11 above the point.
        let down = svg.split(" cy=\"").nth(1).and_then(|rest| rest.split('"').next()?.parse::<f64>().ok());
        assert!(down.is_some_and(|down| down > 14.0 + 11.0 + 10.0), "{svg}");
        assert!(map(&axis("x"), &axis("y"), ["", ""], &[]).contains("Nothing"));
    }

    #[test]
    fn a_race_shows_the_best_so_far() {
        let runner = |name: &str, ratios: &[f64], view: &CostView| Runner {
            name: name.into(),
            ratios: ratios.to_vec(),
            answer: None,
            view: view.clone(),
        };
        let times = CostView::default();
        let svg = race(&[runner("a", &[1.0, 0.5, 0.7], &times), runner("<b>", &[], &times)]);
        assert!(svg.contains("a: 0.500") && !svg.contains("<b>") && !svg.contains("NaN"), "{svg}");
        assert!(!svg.contains("<circle"), "no answer is known: {svg}");
        let rate = super::super::tests::rate();
        let gain = Gain { share: 0.2, low: Some(-1.0), high: Some(0.5), probability_better: None };
        let answered = Runner { answer: Some(gain), ..runner("a", &[1.0, 0.5, 0.7], &rate) };
        let svg = race(&[answered]);
        assert!(svg.contains("a: 0.500 (fps 2 times the default’s)"), "{svg}");
        assert!(svg.contains("a, answers by all measurements: 25.0 % [-50.0, 100.0]"), "{svg}");
        assert!(svg.contains(">2.0</text>") && !svg.contains("beyond the axis"), "{svg}");
        assert!(race(&[]).contains("Nothing"));
    }
}
