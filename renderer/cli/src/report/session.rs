//! The whole session: rendering with the search, over rendering with its start. Below 1 it has paid.

use treewright_figures::{Axis, Colour, Figure, Stroke};

use super::parts::roofline;
use treewright_renderer::{tuning::results::TuningResults, tuning::who::Who};

/// End of the curve, as a factor on the frame in which the session pays, or else on its number of frames.
const BEYOND: f64 = 10.0;
/// Most frames that are drawn.
const FRAMES_MAX: f64 = 1e7;
/// Ratios above this are drawn at the upper edge.
const RATIO_MAX: f64 = 8.0;
const POINTS: u32 = 60;

/// Frame and time spent by then, over that of the start; the first point is the first frame of the search.
pub(super) fn curve(results: &TuningResults) -> Vec<(f64, f64)> {
    let pay = &results.break_even;
    let start_ms = |frames: f64| pay.default_setup_ms + frames * pay.default_frame_ms;
    let (mut spent_ms, mut frames) = (0.0, 0.0);
    let mut curve = Vec::new();
    for trial in &results.trials {
        spent_ms += trial.total_ms;
        // A trial that could not be built or was stopped showed nothing.
        let shown = trial.frames(results.frames_per_trial);
        if shown > 0 {
            frames += f64::from(shown);
            curve.push((frames, spent_ms / start_ms(frames)));
        }
    }
    if curve.is_empty() || pay.default_frame_ms <= 0.0 {
        return Vec::new();
    }
    spent_ms += pay.tuned_setup_ms;
    let last = results.break_even_frame.map_or(frames, |frame| frame as f64).max(frames);
    let last = (BEYOND * last).min(FRAMES_MAX);
    for point in 1..=POINTS {
        let at = frames * (last / frames).powf(f64::from(point) / f64::from(POINTS));
        curve.push((at, (spent_ms + (at - frames) * pay.tuned_frame_ms) / start_ms(at)));
    }
    curve
}

/// The time spent by the frame `at` over that of the start by then; `None` where the curve ends before.
pub(crate) fn ratio_at(results: &TuningResults, at: f64) -> Option<f64> {
    let curve = curve(results);
    let after = curve.iter().position(|(frame, _)| *frame >= at)?;
    let (frame, ratio) = curve[after];
    let Some((before, earlier)) = after.checked_sub(1).map(|before| curve[before]) else {
        return Some(ratio);
    };
    Some(earlier + (ratio - earlier) * (at - before) / (frame - before))
}

/// The curve as an SVG element for the inside of the page; none where nothing ran.
pub(super) fn svg(results: &TuningResults) -> Option<String> {
    let curve = curve(results);
    let last = curve.last()?.0.max(2.0);
    let most = curve.iter().map(|(_, ratio)| *ratio).fold(2.0, f64::max).min(RATIO_MAX) * 1.1;
    let x = Axis::logarithmic("frames since the search began", [1.0, last]);
    let y = Axis::between(&format!("time spent, {} = 1", results.baseline), 0.0, most);
    let mut figure = Figure::new("Time of the whole session", [900.0, 360.0], x, y);
    figure.level(1.0, Stroke::Dotted, Colour::Ink, &results.baseline.to_string());
    let fixed = results.relative(&Who::BestFixed).filter(|_| results.baseline != Who::BestFixed);
    if let Some(level) = fixed {
        figure.level(level, Stroke::Dotted, Colour::Blue, "best fixed configuration");
    }
    let name = "its best configuration from the first frame on";
    figure.level(roofline(results), Stroke::Dashed, Colour::Purple, name);
    let points: Vec<[f64; 2]> = curve.iter().map(|(frame, ratio)| [*frame, *ratio]).collect();
    figure.line(&points, Stroke::Solid, Colour::Purple, "this session");
    Some(figure.finish())
}
