//! An analysis as one page without anything from outside: figures as SVG, light and dark, as narrow as a
//! telephone. `cli/templates/analysis.html` has its words.

use askama::Template;
use treewright_figures::{Axis, Colour, Figure};

use super::dependence::Correlation;
use super::map::{Cell, Map};
use super::narrow::{Narrowed, Spread};
use super::table::{quantile, rounded, sorted};
use super::{Analysis, Metric, titled};

#[derive(Template)]
#[template(path = "analysis.html")]
struct AnalysisPage<'a> {
    analysis: &'a Analysis,
}

pub(crate) fn html(analysis: &Analysis) -> String {
    // Writing to a string cannot fail.
    AnalysisPage { analysis }.render().unwrap_or_default()
}

impl Metric {
    fn title(&self) -> String {
        titled(&self.name, self.higher_is_better)
    }

    fn spread(&self) -> String {
        let [low, high] = self.relative_quartiles;
        format!(
            "median {}, middle 50 % between {low:.2} and {high:.2} times the mean of its state",
            rounded(self.median)
        )
    }

    /// The pairs that matter most.
    fn together(&self) -> String {
        let pairs = self.pairs.iter().take(4).map(|pair| {
            format!("{} with {} {:.1} %", pair.parameters[0], pair.parameters[1], pair.interaction * 100.0)
        });
        pairs.collect::<Vec<_>>().join("; ")
    }

    /// Correlations as bars from the middle, with their intervals.
    fn bars(&self) -> String {
        let ordered =
            self.parameters.iter().filter_map(|one| Some((one.parameter.as_str(), one.correlation?)));
        let ordered: Vec<(&str, Correlation)> = ordered.collect();
        if ordered.is_empty() {
            return String::new();
        }
        let names: Vec<&str> = ordered.iter().map(|(name, _)| *name).collect();
        let mut figure = Figure::of_rows("Correlations", 340.0, Axis::between("r", -1.0, 1.0), &names);
        for (row, (_, correlation)) in ordered.iter().enumerate() {
            let Correlation { r, interval: [low, high] } = *correlation;
            let (colour, name) = match (r < 0.0) == self.higher_is_better {
                true => (Colour::Vermilion, "higher is worse"),
                false => (Colour::Blue, "higher is better"),
            };
            let opacity = if correlation.is_there() { 1.0 } else { 0.35 };
            figure.bar(row, [r.min(0.0), r.max(0.0)], opacity, colour, "");
            figure.area_key(colour, name);
            let middle = row as f64 + 0.5;
            figure.interval([low, middle], [high, middle], Colour::Ink);
        }
        figure.finish()
    }
}

impl Narrowed {
    fn title(&self) -> String {
        titled(&self.metric, self.higher_is_better)
    }

    fn rows(&self) -> [(&'static str, [String; 5]); 2] {
        let cells = |Spread { trials, best, median, dear, worst }: Spread| {
            let shown = |value: f64| if trials == 0 { "–".to_owned() } else { format!("{value:.2}") };
            [trials.to_string(), shown(best), shown(median), shown(dear), shown(worst)]
        };
        [("whole space", cells(self.whole)), ("this part", cells(self.part))]
    }
}

impl Map {
    fn title(&self) -> String {
        titled(&self.metric, self.higher_is_better)
    }

    /// Coloured cells, from the best of its values to the worst. The worst tenth share a colour, so that a
    /// single bad cell does not make all others alike.
    fn drawn(&self) -> String {
        let values = sorted(self.cells.iter().map(|cell| cell.relative));
        let [best, worst] = if self.higher_is_better { [1.0, 0.1] } else { [0.0, 0.9] };
        let [best, worst] = [best, worst].map(|share| quantile(&values, share));
        let axis = |which: usize| {
            let edges = &self.edges[which];
            let cells = edges.len() - 1;
            let labels = [0, cells / 2, cells].map(|edge| (edge as f64, rounded(edges[edge])));
            Axis::labelled(&self.parameters[which], [0.0, cells as f64], labels.into())
        };
        let mut figure = Figure::new("Map", [340.0, 270.0], axis(0), axis(1));
        for Cell { at, trials, relative } in &self.cells {
            let [x, y] = at.map(|index| [index as f64, index as f64 + 1.0]);
            let share = if best == worst { 0.5 } else { (relative - best) / (worst - best) };
            figure.cell(x, y, 1.0, Colour::Scale(share), &format!("{trials} trials: {relative:.3}"));
        }
        figure.scale_key(&format!("{best:.2}"), &format!("{worst:.2} and worse"));
        figure.finish()
    }
}
