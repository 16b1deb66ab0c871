//! The plot: error over seconds of wall time, both logarithmic, with the intervals of the runs.

use treewright_figures::{Axis, Colour, Dot, Figure, Stroke};
use treewright_render_cli::error::CliError;

use crate::converge::results::{ComparisonResults, ContenderResult};

/// Of the largest error: what is smaller does not stretch the plot.
const ERROR_LEAST: f64 = 1e-12;

/// The plot as a file of its own.
pub fn svg_file(results: &ComparisonResults) -> Result<String, CliError> {
    let title = format!("{}, {}×{}", results.scene.name, results.size[0], results.size[1]);
    Ok(Figure::file(&title, [figure(results)?]))
}

/// A contender's curve with a time added before it.
struct Line<'a> {
    found: &'a ContenderResult,
    colour: Colour,
    offset_s: f64,
    stroke: Stroke,
}

/// Solid lines count everything; where finding the configuration took time, a dashed one leaves that out.
fn lines(results: &ComparisonResults) -> Vec<Line<'_>> {
    let mut lines = Vec::new();
    for (index, found) in results.contenders.iter().enumerate() {
        let (setup_s, colour) = (found.curve.setup_ms / 1e3, Colour::of(index));
        if setup_s > 0.0 {
            lines.push(Line { found, colour, offset_s: 0.0, stroke: Stroke::Dashed });
        }
        lines.push(Line { found, colour, offset_s: setup_s, stroke: Stroke::Solid });
    }
    lines
}

fn figure(results: &ComparisonResults) -> Result<Figure, CliError> {
    let lines = lines(results);
    let floor = results.reference.relative_mse;
    let (mut seconds, mut errors) = (Vec::new(), Vec::new());
    for line in &lines {
        for (wall_s, error) in line.found.mean_curve() {
            let [low, high] = error.range.unwrap_or([error.estimate; 2]);
            seconds.push(wall_s + line.offset_s);
            errors.extend([low.max(error.estimate * 0.1), error.estimate, high]);
        }
    }
    let top = errors.iter().copied().fold(0.0, f64::max);
    if top <= 0.0 {
        let words = "the plot cannot be drawn: no contender has rendered anything";
        return Err(CliError::Failed(words.to_owned()));
    }
    errors.push(floor);
    errors.retain(|error| *error > ERROR_LEAST * top);
    let x = Axis::logarithmic("seconds since the begin, build and tuning included", seconds);
    let y = Axis::logarithmic("relative mean squared error", errors);
    let mut figure = Figure::new("Error over time", [960.0, 560.0], x, y);
    // The line of the theory: one over the time, through the last point of the first contender.
    let first = results.contenders.iter().map(ContenderResult::mean_curve).find(|curve| !curve.is_empty());
    if let Some((curve, (last_s, last))) = first.as_ref().and_then(|curve| Some((curve, curve.last()?))) {
        let theory: Vec<[f64; 2]> =
            curve.iter().map(|(wall_s, _)| [*wall_s, last.estimate * last_s / wall_s]).collect();
        figure.line(&theory, Stroke::Dotted, Colour::Ink, "slope −1: what theory promises");
    }
    if floor > 0.0 {
        figure.level(floor, Stroke::Dashed, Colour::Ink, "the reference's own error");
    }
    for Line { found, colour, offset_s, stroke } in lines {
        let who = &found.curve.who;
        let curve = found.mean_curve();
        let points: Vec<[f64; 2]> =
            curve.iter().map(|(wall_s, error)| [wall_s + offset_s, error.estimate]).collect();
        if stroke == Stroke::Dashed {
            figure.line(&points, stroke, colour, &format!("{who}, configuration known from the start"));
            continue;
        }
        figure.line(&points, stroke, colour, &who.to_string());
        for (at, (_, error)) in points.into_iter().zip(curve) {
            // Hollow where the reference's own error decides.
            let trusted = error.estimate >= results.reference.trusted_from;
            figure.dot(at, if trusted { Dot::Small } else { Dot::Hollow }, colour, "");
            if let Some([low, high]) = error.range {
                figure.interval([at[0], low], [at[0], high], colour);
            }
        }
    }
    Ok(figure)
}
