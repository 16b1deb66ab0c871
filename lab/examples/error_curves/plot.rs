//! The plots: a panel a problem, both axes logarithmic; the horizontal one is the same for all.

use std::error::Error;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::curve::{Axis, Curve, Kind};

const WIDTH: u32 = 1200;
const HEIGHT: u32 = 900;
/// The strip above the panels that names the methods.
const LEGEND: u32 = 64;
const COLUMNS: usize = 2;

const INK: RGBColor = RGBColor(0x1d, 0x1f, 0x24);
const FAINT: RGBColor = RGBColor(0xdc, 0xda, 0xd4);

/// Colours of methods in order; told apart by most of those who see fewer colours (after Okabe and Ito,
/// 2008).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 100, 160),
    RGBColor(190, 140, 0),
    RGBColor(86, 180, 233),
];

/// One plot as an SVG file: the error of every method on every problem against one axis.
pub(crate) fn svg(curves: &[&Curve], kind: Kind, axis: Axis) -> Result<String, Box<dyn Error>> {
    let mut svg = String::new();
    draw(curves, kind, axis, &mut svg)?;
    Ok(svg)
}

/// What is met in the order in which it is met, each once.
fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut seen: Vec<&str> = Vec::new();
    for name in names {
        if !seen.contains(&name) {
            seen.push(name);
        }
    }
    seen
}

/// From the least to the most of some numbers, with some room.
fn range(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::MAX, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    low * 0.85..high * 1.2
}

fn draw(curves: &[&Curve], kind: Kind, axis: Axis, svg: &mut String) -> Result<(), Box<dyn Error>> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let x = range(points().map(|point| axis.of(point)));
    let methods = distinct(curves.iter().map(|curve| curve.method.as_str()));
    let problems = distinct(curves.iter().map(|curve| curve.problem.as_str()));
    let runs = curves.iter().map(|curve| curve.runs).min().unwrap_or(0);

    let root = SVGBackend::with_string(svg, (WIDTH, HEIGHT)).into_drawing_area();
    root.fill(&WHITE)?;
    let (top, below) = root.split_vertically(LEGEND);
    let title = format!("{} against {}: means of {runs} runs, 95 % intervals", kind.title(), axis.title());
    legend(&top, &title, &methods)?;
    for (panel, problem) in
        below.split_evenly((problems.len().div_ceil(COLUMNS), COLUMNS)).iter().zip(&problems)
    {
        let of_panel = || curves.iter().filter(|curve| curve.problem == *problem);
        // Bands may leave the panel where few runs differ much.
        let y = range(of_panel().flat_map(|curve| &curve.points).map(|point| point.error));
        let mut chart = ChartBuilder::on(panel)
            .margin(12)
            .caption(*problem, ("sans-serif", 17).into_font().color(&INK))
            .x_label_area_size(44)
            .y_label_area_size(66)
            .build_cartesian_2d(x.clone().log_scale(), y.clone().log_scale())?;
        chart
            .configure_mesh()
            .bold_line_style(FAINT.stroke_width(1))
            .light_line_style(TRANSPARENT)
            .axis_style(INK.stroke_width(1))
            .label_style(("sans-serif", 14).into_font().color(&INK))
            .x_labels(12)
            .y_labels(14)
            .x_desc(axis.title())
            .y_desc(kind.title())
            .x_label_formatter(&|x| label(*x))
            .y_label_formatter(&|y| label(*y))
            .draw()?;
        for (method, colour) in methods.iter().zip(COLOURS.iter().cycle()) {
            let Some(curve) = of_panel().find(|curve| curve.method == *method) else { continue };
            let at = |error: fn(&crate::curve::Point) -> f64| {
                let inside = |point| (axis.of(point), error(point).clamp(y.start, y.end));
                curve.points.iter().map(inside).collect::<Vec<(f64, f64)>>()
            };
            let (low, high) = (at(|point| point.low), at(|point| point.high));
            let band: Vec<(f64, f64)> = low.into_iter().chain(high.into_iter().rev()).collect();
            chart.draw_series([Polygon::new(band, colour.mix(0.1).filled())])?;
            chart.draw_series(LineSeries::new(at(|point| point.error), colour.stroke_width(2)))?;
        }
    }
    root.present()?;
    Ok(())
}

/// Powers of ten and their parts as people write them.
fn label(x: f64) -> String {
    match x {
        0.001..100_000.0 => format!("{}", (x * 1e6).round() / 1e6),
        _ => format!("{x:.0e}"),
    }
}

fn legend(
    top: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    methods: &[&str],
) -> Result<(), Box<dyn Error>> {
    top.draw(&Text::new(title.to_owned(), (24, 12), ("sans-serif", 19).into_font().color(&INK)))?;
    let step = (WIDTH as i32 - 48) / methods.len().max(1) as i32;
    for (place, (method, colour)) in (0..).zip(methods.iter().zip(COLOURS.iter().cycle())) {
        let left = 24 + step * place;
        top.draw(&PathElement::new(vec![(left, 50), (left + 22, 50)], colour.stroke_width(3)))?;
        let style = ("sans-serif", 14).into_font().color(&INK);
        top.draw(&Text::new(method.replace('_', " "), (left + 28, 43), style))?;
    }
    Ok(())
}
