//! The tuning curve, after the paper's Figure 11: the time of each trial, the best so far, and the
//! predictor's result without a search. All relative to the baseline, so that the two cameras can share one
//! axis.

use plotters::prelude::*;

use super::parts::{predicted, relative, roofline};
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::results::TuningResults;
use treewright_renderer::tuning::search::Iteration;
use treewright_renderer::tuning::who::Who;

const WIDTH: u32 = 900;
const HEIGHT: u32 = 430;

/// Trials slower than this many times the baseline are drawn at the upper edge.
const CAP: f64 = 3.0;

/// Trials of the start that suffice for its cost during the search.
const STARTS_LEAST: usize = 3;

// Placeholders, replaced by the page's own colours so that the curve follows its light or dark theme.
pub(super) const INK: RGBColor = RGBColor(1, 1, 1);
pub(super) const FAINT: RGBColor = RGBColor(2, 2, 2);
pub(super) const BEST: RGBColor = RGBColor(3, 3, 3);
const PREDICTED: RGBColor = RGBColor(4, 4, 4);
const OVERHEAD: RGBColor = RGBColor(5, 5, 5);
const FAILED: RGBColor = RGBColor(6, 6, 6);
const USED_WELL: RGBColor = RGBColor(7, 7, 7);
pub(super) const FIXED: RGBColor = RGBColor(8, 8, 8);

pub(super) const COLOURS: [(&str, &str); 8] = [
    ("#010101", "var(--ink)"),
    ("#020202", "var(--faint)"),
    ("#030303", "var(--best)"),
    ("#040404", "var(--predicted)"),
    ("#050505", "var(--overhead)"),
    ("#060606", "var(--failed)"),
    ("#070707", "var(--used-well)"),
    ("#080808", "var(--fixed)"),
];

/// The curve as an SVG element for the inside of the page.
pub(super) fn svg(results: &TuningResults) -> Result<String, String> {
    let mut svg = String::new();
    draw(results, &mut svg).map_err(|error| error.to_string())?;
    for (placeholder, colour) in COLOURS {
        svg = svg.replace(placeholder, colour);
    }
    // The page scales it; without fixed sizes it keeps its shape on a telephone, too.
    Ok(svg.replacen(
        &format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" "),
        "role=\"img\" aria-label=\"Tuning curve\" ",
        1,
    ))
}

fn draw(results: &TuningResults, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let (best, unit_ms) = (roofline(results), unit_ms(results));
    let curve: Vec<(f64, f64)> = results
        .trials
        .iter()
        .filter_map(|trial| Some((f64::from(trial.number), (trial.cost? / unit_ms).min(CAP))))
        .collect();
    let stopped: Vec<(f64, f64)> = results
        .trials
        .iter()
        .filter_map(|trial| Some((f64::from(trial.number), (trial.stopped_at()? / unit_ms).min(CAP))))
        .collect();
    let last = results.trials.len().max(2) as f64;
    let top = curve.iter().chain(&stopped).map(|(_, y)| *y).fold(1.3_f64, f64::max) * 1.05;

    let root = SVGBackend::with_string(svg, (WIDTH, HEIGHT)).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(0.0..last + 1.0, 0.0..top)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .bold_line_style(FAINT.stroke_width(1))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.stroke_width(1))
        .label_style(("sans-serif", 15).into_font().color(&INK))
        .x_desc("trial of the search")
        .y_desc(format!("frame time, {} = 1", results.baseline))
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.1}"))
        .y_labels(8)
        .draw()?;

    // The cost of the search over having known the best from the start.
    if let (Some(first), Some(end)) = (curve.first(), curve.last()) {
        let mut outline = curve.clone();
        outline.extend([(end.0, best), (first.0, best)]);
        chart.draw_series([Polygon::new(outline, OVERHEAD.mix(0.25))])?;
    }
    let line = |y: f64| [(0.0, y), (last + 1.0, y)];
    chart.draw_series(DashedLineSeries::new(line(1.0), 2, 5, INK.stroke_width(1)))?;
    for (who, colour) in [(Who::UsedWell, USED_WELL), (Who::BestFixed, FIXED)] {
        if let Some(level) = relative(results, &who) {
            chart.draw_series(DashedLineSeries::new(line(level), 2, 4, colour.stroke_width(2)))?;
        }
    }
    chart.draw_series(LineSeries::new(curve.iter().copied(), INK.stroke_width(2)))?;
    chart.draw_series(
        curve.iter().filter(|(_, y)| *y >= CAP).map(|(x, y)| TriangleMarker::new((*x, *y), 6, INK.filled())),
    )?;
    chart.draw_series(stopped.iter().map(|at| TriangleMarker::new(*at, 6, FAILED.filled())))?;
    chart.draw_series(DashedLineSeries::new(line(best), 9, 5, BEST.stroke_width(3)))?;
    if let Some(predicted) = predicted(results) {
        chart.draw_series(LineSeries::new(line(predicted), PREDICTED.stroke_width(3)))?;
    }
    let failed: Vec<f64> = results
        .trials
        .iter()
        .filter(|trial| trial.has_failed())
        .map(|trial| f64::from(trial.number))
        .collect();
    if !failed.is_empty() {
        chart.draw_series(failed.iter().map(|x| Cross::new((*x, top * 0.02), 5, FAILED.stroke_width(2))))?;
    }
    root.present()?;
    Ok(())
}

/// The cost that is drawn as 1. Where trials ran the configuration of the start often enough, it follows from
/// them, since the machine may have been slower or faster in the frames around the search than in it.
fn unit_ms(results: &TuningResults) -> f64 {
    let of_start = |trial: &&Iteration| trial.configuration == results.start;
    let costs: Vec<f64> = results.trials.iter().filter(of_start).filter_map(|trial| trial.cost).collect();
    match relative(results, &results.began_at) {
        Some(level) if costs.len() >= STARTS_LEAST => Summary::of(&costs).median / level,
        _ => results.reference_ms,
    }
}
