//! The plot: error over seconds of wall time, both logarithmic, with the intervals of the runs.

use plotters::coord::Shift;
use plotters::prelude::*;
use treewright_render_cli::error::CliError;

use crate::converge::results::{ComparisonResults, ContenderResult};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 600;

// Placeholders, replaced by the page's own colours so that the plot follows its light or dark theme.
const INK: RGBColor = RGBColor(1, 1, 1);
const FAINT: RGBColor = RGBColor(2, 2, 2);

/// Colours of contenders in order, taken again from the first when there are more. Legible on white and on
/// black, and distinct for most people who see fewer colours (after Okabe and Ito, 2008).
pub(super) const COLOURS: [RGBColor; 6] = [
    RGBColor(120, 124, 130),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 100, 160),
    RGBColor(190, 140, 0),
];

/// The background of the plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// Inside the page, whose style gives the colours of axes and text.
    Page,
    /// White, in a file of its own, with a legend.
    White,
}

/// The plot as an SVG element or file.
pub fn svg(results: &ComparisonResults, ground: Ground) -> Result<String, CliError> {
    let mut svg = String::new();
    draw(results, ground, &mut svg)
        .map_err(|error| CliError::Failed(format!("the plot cannot be drawn: {error}")))?;
    let (ink, faint) = match ground {
        Ground::Page => ("var(--ink)", "var(--faint)"),
        Ground::White => ("#1d1f24", "#dcdad4"),
    };
    let svg = svg.replace("#010101", ink).replace("#020202", faint);
    Ok(match ground {
        Ground::White => svg,
        // The page scales it.
        Ground::Page => svg.replacen(
            &format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" "),
            "role=\"img\" aria-label=\"Error over time\" ",
            1,
        ),
    })
}

/// A contender's curve with a time added before it.
struct Line<'a> {
    found: &'a ContenderResult,
    colour: RGBColor,
    offset_s: f64,
    dashed: bool,
}

/// Solid lines count everything; where finding the configuration took time, a dashed one leaves that out.
fn lines(results: &ComparisonResults) -> Vec<Line<'_>> {
    let mut lines = Vec::new();
    for (found, &colour) in results.contenders.iter().zip(COLOURS.iter().cycle()) {
        let setup_s = found.curve.setup_ms / 1e3;
        if setup_s > 0.0 {
            lines.push(Line { found, colour, offset_s: 0.0, dashed: true });
        }
        lines.push(Line { found, colour, offset_s: setup_s, dashed: false });
    }
    lines
}

fn draw(
    results: &ComparisonResults,
    ground: Ground,
    svg: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let lines = lines(results);
    let points = || {
        lines.iter().flat_map(|line| {
            line.found.mean_curve().into_iter().map(|(wall_s, error)| (wall_s + line.offset_s, error))
        })
    };
    let (mut left, mut right, mut bottom, mut top) = (f64::MAX, 0.0_f64, f64::MAX, 0.0_f64);
    for (wall_s, error) in points() {
        let [low, high] = error.range.unwrap_or([error.estimate; 2]);
        (left, right) = (left.min(wall_s), right.max(wall_s));
        (bottom, top) = (bottom.min(low.max(error.estimate * 0.1)), top.max(high));
    }
    if right == 0.0 || top <= 0.0 {
        return Err("no contender has rendered anything".into());
    }
    let floor = results.reference.relative_mse;
    if floor > 0.0 {
        bottom = bottom.min(floor);
    }
    let bottom = bottom.max(top * 1e-12);
    let (x, y) = (left * 0.8..right * 1.25, bottom * 0.5..top * 1.4);

    let root = SVGBackend::with_string(svg, (WIDTH, HEIGHT)).into_drawing_area();
    if ground == Ground::White {
        root.fill(&WHITE)?;
    }
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .x_label_area_size(48)
        .y_label_area_size(78)
        .build_cartesian_2d(x.clone().log_scale(), y.clone().log_scale())?;
    chart
        .configure_mesh()
        .bold_line_style(FAINT.stroke_width(1))
        .light_line_style(TRANSPARENT)
        .axis_style(INK.stroke_width(1))
        .label_style(("sans-serif", 15).into_font().color(&INK))
        .x_desc("seconds since the begin, build and tuning included")
        .y_desc("relative mean squared error")
        .x_label_formatter(&|seconds| seconds_label(*seconds))
        .y_label_formatter(&|error| format!("{error:.0e}"))
        .draw()?;

    // The line of the theory: one over the time, through the first point of the first contender.
    if let Some((wall_s, error)) = results.contenders.iter().find_map(|found| found.mean_curve().pop()) {
        let line = [x.start, x.end].map(|seconds| (seconds, error.estimate * wall_s / seconds));
        chart.draw_series(DashedLineSeries::new(clipped(line, &y), 2, 6, INK.stroke_width(1)))?;
    }
    if floor > 0.0 {
        let level = [(x.start, floor), (x.end, floor)];
        chart.draw_series(DashedLineSeries::new(level, 10, 6, INK.stroke_width(1)))?;
        let style = ("sans-serif", 14).into_font().color(&INK);
        let label = Text::new("the reference's own error", (0, -18), style);
        chart.draw_series([EmptyElement::at((x.start * 1.1, floor)) + label])?;
    }
    for line in &lines {
        let curve: Vec<(f64, f64)> = line
            .found
            .mean_curve()
            .iter()
            .map(|(wall_s, error)| (wall_s + line.offset_s, error.estimate))
            .collect();
        let style = line.colour.stroke_width(2);
        if line.dashed {
            chart.draw_series(DashedLineSeries::new(curve, 7, 5, style))?;
            continue;
        }
        let marks: Vec<_> = curve
            .iter()
            .map(|&point| {
                // Hollow where the reference's own error decides.
                let trusted = point.1 >= results.reference.trusted_from;
                let style = if trusted { line.colour.filled() } else { line.colour.stroke_width(1) };
                Circle::new(point, 3, style)
            })
            .collect();
        chart.draw_series(LineSeries::new(curve, style))?;
        chart.draw_series(marks)?;
        let bars = line.found.mean_curve().into_iter().filter_map(|(wall_s, error)| {
            let [low, high] = error.range?;
            let ends = [low.max(y.start), high.min(y.end)];
            let seconds = wall_s + line.offset_s;
            Some(PathElement::new(ends.map(|error| (seconds, error)).to_vec(), line.colour.stroke_width(1)))
        });
        chart.draw_series(bars)?;
    }
    if ground == Ground::White {
        legend(&root, results)?;
    }
    root.present()?;
    Ok(())
}

/// A falling line's part between two levels.
fn clipped(line: [(f64, f64); 2], y: &std::ops::Range<f64>) -> [(f64, f64); 2] {
    // On the line, seconds times error is constant.
    line.map(|(seconds, error)| {
        let inside = error.clamp(y.start, y.end);
        (seconds * error / inside, inside)
    })
}

fn seconds_label(seconds: f64) -> String {
    match seconds {
        ..0.01 => format!("{seconds:.3}"),
        ..0.1 => format!("{seconds:.2}"),
        ..1.0 => format!("{seconds:.1}"),
        _ => format!("{seconds:.0}"),
    }
}

fn legend(
    root: &DrawingArea<SVGBackend, Shift>,
    results: &ComparisonResults,
) -> Result<(), Box<dyn std::error::Error>> {
    let (right, top) = (WIDTH as i32 - 280, 34);
    let text = ("sans-serif", 15).into_font().color(&INK);
    let title = format!("{}, {}×{}", results.scene.name, results.size[0], results.size[1]);
    root.draw(&Text::new(title, (right, top), text.clone()))?;
    for (row, (found, colour)) in results.contenders.iter().zip(COLOURS.iter().cycle()).enumerate() {
        let y = top + 22 * (row as i32 + 1);
        root.draw(&PathElement::new(vec![(right, y + 8), (right + 26, y + 8)], colour.stroke_width(3)))?;
        root.draw(&Text::new(found.curve.who.to_string(), (right + 34, y), text.clone()))?;
    }
    Ok(())
}
