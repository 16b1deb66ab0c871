//! The whole session: the time of rendering, search included, over that with the configuration where the
//! search began. Below 1 the session has paid.

use plotters::prelude::*;

use super::chart::{BEST, COLOURS, FAINT, FIXED, INK};
use super::parts::{relative, roofline};
use treewright_renderer::tuning::results::TuningResults;
use treewright_renderer::tuning::who::Who;

const WIDTH: u32 = 900;
const HEIGHT: u32 = 360;

/// End of the curve, as a factor on the frame in which the session pays, or else on its number of frames.
const BEYOND: f64 = 10.0;
/// Most frames that are drawn.
const FRAMES_MAX: f64 = 1e7;
/// Ratios above this are drawn at the upper edge.
const RATIO_MAX: f64 = 8.0;
/// Points of the curve after the search.
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
        let Some(times) = trial.times else { continue };
        frames += f64::from(times.frames.unwrap_or(results.frames_per_trial));
        curve.push((frames, spent_ms / start_ms(frames)));
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

/// The curve as an SVG element for the inside of the page; none where nothing ran.
pub(super) fn svg(results: &TuningResults) -> Result<Option<String>, String> {
    let curve = curve(results);
    if curve.is_empty() {
        return Ok(None);
    }
    let mut svg = String::new();
    draw(results, &curve, &mut svg).map_err(|error| error.to_string())?;
    for (placeholder, colour) in COLOURS {
        svg = svg.replace(placeholder, colour);
    }
    let size = format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" ");
    Ok(Some(svg.replacen(&size, "role=\"img\" aria-label=\"Time of the whole session\" ", 1)))
}

fn draw(
    results: &TuningResults,
    curve: &[(f64, f64)],
    svg: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let best = roofline(results);
    let last = curve.last().map_or(2.0, |(frame, _)| frame.max(2.0));
    let most = curve.iter().map(|(_, ratio)| *ratio).fold(2.0_f64, f64::max).min(RATIO_MAX) * 1.1;
    let root = SVGBackend::with_string(svg, (WIDTH, HEIGHT)).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d((1.0..last).log_scale(), 0.0..most)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .bold_line_style(FAINT.stroke_width(1))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.stroke_width(1))
        .label_style(("sans-serif", 15).into_font().color(&INK))
        .x_desc("frames since the search began (logarithmic)")
        .y_desc(format!("time spent, {} = 1", results.baseline))
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.1}"))
        .y_labels(6)
        .draw()?;
    let line = |y: f64| [(1.0, y), (last, y)];
    chart.draw_series(DashedLineSeries::new(line(1.0), 2, 5, INK.stroke_width(1)))?;
    let fixed = relative(results, &Who::BestFixed).filter(|_| results.baseline != Who::BestFixed);
    if let Some(level) = fixed {
        chart.draw_series(DashedLineSeries::new(line(level), 2, 4, FIXED.stroke_width(2)))?;
    }
    chart.draw_series(DashedLineSeries::new(line(best), 9, 5, BEST.stroke_width(2)))?;
    let points = curve.iter().map(|(x, y)| (*x, y.min(RATIO_MAX)));
    chart.draw_series(LineSeries::new(points, BEST.stroke_width(3)))?;
    root.present()?;
    Ok(())
}
