//! The comparison for people: a plot, and a page that carries everything inside.

mod chart;
mod parts;

use askama::Template;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::curve::Shot;
use super::metrics::Yardstick;
use super::results::ComparisonResults;
use parts::{ContenderRow, EqualErrorTable};
use treewright_render_cli::error::CliError;
use treewright_render_cli::report::thousands;
use treewright_renderer::image_file;
use treewright_renderer::tuning::who::Who;

pub use chart::{svg, svg_file};
pub(crate) use parts::{seconds, target_in_words, verdict_in_words, with_range};

/// Difference pictures are white where the error is this large, relative to the reference.
const WHITE_AT: f64 = 1.0;

/// A picture on the page, with its errors.
struct PictureCard {
    name: String,
    picture: String,
    difference: String,
    caption: String,
}

/// The page. Numbers arrive as text, ready to be read.
#[derive(Template)]
#[template(path = "converge.html")]
struct Page<'a> {
    scene: &'a str,
    triangles: String,
    size: String,
    headline: String,
    explanation: String,
    budget: String,
    frames: Vec<PictureCard>,
    frames_with_setup: Vec<PictureCard>,
    still_tuning: Vec<String>,
    reference_image: String,
    reference_text: String,
    chart: String,
    contenders: Vec<ContenderRow>,
    equal_error: Vec<EqualErrorTable>,
    slope_text: String,
    machine: String,
    notes: Vec<String>,
}

/// Puts the page together.
pub fn html(results: &ComparisonResults, yardstick: &Yardstick) -> Result<String, CliError> {
    let frame = |who: &Who, shot: &Shot, from: &str| -> Result<PictureCard, CliError> {
        let [width, height] = results.size;
        let glow = yardstick.difference(&shot.picture, WHITE_AT);
        Ok(PictureCard {
            name: who.to_string(),
            picture: data_url(&image_file::png_bytes(&shot.picture, yardstick.exposure())?),
            difference: data_url(&image_file::png_bytes_of_colours(width, height, &glow)?),
            caption: parts::caption(&shot.point, from),
        })
    };
    let mut frames = Vec::new();
    let mut frames_with_setup = Vec::new();
    let mut still_tuning = Vec::new();
    for found in &results.contenders {
        let curve = &found.curve;
        if let Some(shot) = &curve.pictures.at_budget {
            frames.push(frame(&curve.who, shot, "build included")?);
        }
        match (&curve.pictures.at_budget_with_setup, curve.setup_ms > 0.0) {
            (Some(shot), true) => {
                frames_with_setup.push(frame(&curve.who, shot, "build and tuning included")?);
            }
            (None, true) if !curve.runs.is_empty() => still_tuning.push(curve.who.to_string()),
            _ => {}
        }
    }
    let reference = image_file::png_bytes(yardstick.reference(), yardstick.exposure())?;
    let page = Page {
        scene: &results.scene.name,
        triangles: thousands(results.scene.triangles),
        size: format!("{} × {}", results.size[0], results.size[1]),
        headline: parts::headline(results),
        explanation: parts::explanation(results),
        budget: parts::seconds(results.budget_ms),
        frames,
        frames_with_setup,
        still_tuning,
        reference_image: data_url(&reference),
        reference_text: parts::reference(results),
        chart: svg(results)?,
        contenders: parts::contenders(results),
        equal_error: parts::equal_error(results),
        slope_text: parts::slopes(results),
        machine: parts::machine(results),
        notes: results.notes.iter().chain(&results.scene.notes).cloned().collect(),
    };
    page.render().map_err(|error| CliError::Failed(format!("the report cannot be put together: {error}")))
}

fn data_url(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

#[cfg(test)]
mod tests;
