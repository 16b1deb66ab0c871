//! The tuning curve, after the paper's Figure 11: each trial, the best so far, and the predictor's result.
//! All relative to the baseline, so that the two cameras can share one axis.

use treewright_figures::{Axis, Colour, Dot, Figure, Stroke};

use super::parts::{predicted, roofline};
use treewright_renderer::{tuning::results::TuningResults, tuning::search::Iteration, tuning::who::Who};

/// Trials slower than this many times the baseline are drawn at the upper edge.
const CAP: f64 = 3.0;

/// The curve as an SVG element for the inside of the page.
pub(super) fn svg(results: &TuningResults) -> String {
    let (best, unit_ms) = (roofline(results), unit_ms(results));
    let points = |cost: fn(&Iteration) -> Option<f64>| -> Vec<[f64; 2]> {
        let trials = results.trials.iter();
        trials.filter_map(|trial| Some([f64::from(trial.number), cost(trial)? / unit_ms])).collect()
    };
    let (curve, stopped) = (points(|trial| trial.cost), points(Iteration::stopped_at));
    let last = results.trials.len().max(2) as f64;
    let top = curve.iter().chain(&stopped).map(|[_, y]| y.min(CAP)).fold(1.3, f64::max) * 1.05;
    let x = Axis::counts("trial of the search", 0.0, last + 1.0);
    let y = Axis::between(&format!("frame time, {} = 1", results.baseline), 0.0, top);
    let mut figure = Figure::new("Tuning curve", [900.0, 430.0], x, y);
    if !curve.is_empty() {
        // A trial below the best had luck: it cost nothing extra.
        let over_best: Vec<[f64; 3]> = curve.iter().map(|[x, y]| [*x, best, y.max(best)]).collect();
        figure.band(&over_best, Colour::Amber);
        figure.area_key(Colour::Amber, "extra cost of the search");
    }
    figure.level(1.0, Stroke::Dotted, Colour::Ink, &results.baseline.to_string());
    for (who, colour, name) in [
        (Who::UsedWell, Colour::Sky, "native Embree used well"),
        (Who::BestFixed, Colour::Blue, "best fixed configuration"),
    ] {
        // The baseline is drawn already, and equal names have one place in the legend.
        if let Some(level) = results.relative(&who).filter(|_| results.baseline != who) {
            figure.level(level, Stroke::Dotted, colour, name);
        }
    }
    figure.line(&curve, Stroke::Solid, Colour::Ink, "each trial of the search");
    for at in stopped {
        figure.dot(at, Dot::Hollow, Colour::Vermilion, "");
        figure.dot_key(Dot::Hollow, Colour::Vermilion, "stopped: it would have cost more than this");
    }
    figure.level(best, Stroke::Dashed, Colour::Purple, "best answer (roofline)");
    if let Some(predicted) = predicted(results) {
        let name = "first prediction, for the other camera";
        figure.level(predicted, Stroke::Solid, Colour::Green, name);
    }
    for trial in results.trials.iter().filter(|trial| trial.has_failed()) {
        figure.cross(f64::from(trial.number), Colour::Vermilion, "could not be built");
    }
    figure.finish()
}

/// The cost that is drawn as 1: the baseline's while the search ran.
fn unit_ms(results: &TuningResults) -> f64 {
    let start = results.start_ms().zip(results.relative(&results.began_at));
    start.map_or(results.reference_ms, |(start_ms, level)| start_ms / level)
}
