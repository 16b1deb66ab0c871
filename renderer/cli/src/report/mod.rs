//! The report: one HTML file that explains a tuning run to somebody who has not read the paper.
//!
//! It carries everything inside (pictures, curve, style), so that it can be mailed or opened from a file
//! system. The curve is the paper's Figure 11.

mod chart;
pub(crate) mod parts;
pub(crate) mod session;

use askama::Template;
use base64::{Engine, engine::general_purpose::STANDARD};

use parts::WayRow;

use crate::error::{CliError, Result};
use treewright_renderer::film::{Film, Picture};
use treewright_renderer::image_file::{Exposure, png_bytes};
use treewright_renderer::{
    frame::Renderer, measure::Standing, space::Choice, tuning::objective::Objective,
    tuning::results::TuningResults, tuning::search::SearchSetting, tuning::who::Who,
};

/// Samples a pixel of the report's two pictures.
const PICTURE_SAMPLES: u32 = 24;

/// The page: the results, and what it shows several times or of the pictures as text.
#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    results: &'a TuningResults,
    triangles: String,
    per: &'a str,
    unit: &'a str,
    default_image: String,
    tuned_image: String,
    default_ms: String,
    tuned_ms: String,
    best: String,
    pictures: String,
    way: Vec<WayRow>,
    notes: Vec<String>,
}

/// Puts the report together. Renders the two pictures, which takes some seconds.
pub fn html(renderer: &mut Renderer, setting: &SearchSetting, results: &TuningResults) -> Result<String> {
    let default = picture(renderer, setting, &setting.baseline)?;
    let tuned = picture(renderer, setting, &setting.space.choice(&results.tuned)?)?;
    page(results, &default, &tuned)
}

fn picture(renderer: &mut Renderer, setting: &SearchSetting, choice: &Choice) -> Result<Picture> {
    let (structure, _) = renderer.build(&choice.build).map_err(|error| {
        CliError::Failed(format!("the pictures of the report cannot be rendered: {error}"))
    })?;
    if choice.light.learns() {
        renderer.learn_light_with(&structure, &setting.view, setting.size);
    }
    renderer.set_light_sampling(choice.light);
    let mut film = Film::new(setting.size);
    for _ in 0..PICTURE_SAMPLES {
        renderer.render_with(&structure, &setting.view, &choice.render, &mut film);
    }
    Ok(film.picture())
}

fn page(results: &TuningResults, default: &Picture, tuned: &Picture) -> Result<String> {
    let frame_ms = |who: &Who| results.standing(who).map_or(0.0, |standing| standing.frame_ms.median);
    let page = Page {
        results,
        triangles: parts::thousands(results.scene.triangles),
        per: if results.objective == Objective::Error { "to an error of 10 %" } else { "a frame" },
        unit: if results.objective == Objective::Error { "ms to 10 % error" } else { "frame, ms" },
        default_image: data_url(default)?,
        tuned_image: data_url(tuned)?,
        default_ms: format!("{:.1}", frame_ms(&results.baseline)),
        best: results.standing(&results.best).map_or_else(|| results.best.to_string(), Standing::title),
        tuned_ms: format!("{:.1}", frame_ms(&results.best)),
        pictures: parts::pictures(results, default.mean_relative_difference(tuned), PICTURE_SAMPLES),
        way: parts::on_the_way(results),
        notes: results.notes.iter().chain(&results.scene.notes).cloned().collect(),
    };
    page.render().map_err(|error| CliError::Failed(format!("the report cannot be put together: {error}")))
}

fn data_url(picture: &Picture) -> Result<String> {
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png_bytes(picture, Exposure::Auto)?)))
}

#[cfg(test)]
mod tests;
