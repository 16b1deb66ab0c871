//! `treewright-render image`: one picture with one acceleration structure.

use std::path::PathBuf;

use clap::{Args, builder::TypedValueParser};
use indicatif::ProgressBar;
use serde::Serialize;

use crate::arguments::{CameraArguments, FrameArguments, SceneArguments, Size, StructureArguments};
use crate::error::{CliError, Result, check_folder};
use crate::{interrupt::Interrupt, names::one_of, output};
use treewright_renderer::image_file::{self, Exposure, Look, Tone};
use treewright_renderer::integrator::{Counts, Omission};
use treewright_renderer::{film::Film, limits::SAMPLES_MAX, space::Choice, statistics::Summary};

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    camera: CameraArguments,
    #[command(flatten)]
    structure: StructureArguments,
    #[command(flatten)]
    frame: FrameArguments,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "640x480")]
    size: Size,

    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 64, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(SAMPLES_MAX)))]
    spp: u32,

    /// Exposure of a PNG in stops. Default: chosen from the picture. EXR files are always linear.
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f32>,

    /// How radiance becomes the colours of a PNG.
    #[arg(long, value_parser = tone(), default_value = "film")]
    tone: Tone,

    /// Output file, .png or .exr.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,

    /// Print the times and counts as JSON.
    #[arg(long)]
    json: bool,
}

fn tone() -> impl TypedValueParser<Value = Tone> {
    one_of([
        (Tone::Film, "film", "A film-like curve (AgX), in which nothing burns out"),
        (Tone::Plain, "plain", "Plain sRGB: what is above white is cut off"),
    ])
}

#[derive(Debug, Serialize)]
struct Outcome {
    scene: String,
    triangles: usize,
    choice: Choice,
    samples: u32,
    threads: usize,
    build_ms: f64,
    /// Of one sample a pixel.
    render_ms: Summary,
    mean_luminance: f64,
    counts: Counts,
    /// The features that shading leaves out, and why the scene does not need them.
    left_out: Vec<Omission>,
    statistics: Option<treewright_accel::Statistics>,
    /// Omissions and additions of the loader.
    notes: Vec<String>,
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    check_folder(&arguments.out)?;
    image_file::check_path(&arguments.out)?;
    let choice = arguments.structure.choice()?;
    let scene = arguments.scene.load()?;
    let camera = arguments.camera.find(&scene)?;
    let mut renderer = arguments.frame.renderer(&scene)?;
    let build_ms = renderer.rebuild(&choice.build)?;
    let view = arguments.frame.view(camera);
    if choice.light.learns() {
        renderer.learn_light(&view, arguments.size.0);
    }
    renderer.set_light_sampling(choice.light);
    let mut film = Film::new(arguments.size.0);
    let (mut counts, mut render_ms) = (Counts::default(), Vec::new());
    let interrupt = Interrupt::listen();
    let bar =
        if arguments.json { ProgressBar::hidden() } else { output::bar(u64::from(arguments.spp), "samples") };
    while film.samples() < arguments.spp && !interrupt.requested() {
        if let Some((sample_ms, sample_counts)) = renderer.render(&view, &choice.render, &mut film) {
            render_ms.push(sample_ms);
            counts += sample_counts;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let picture = film.picture();
    let exposure = arguments.exposure.map_or(Exposure::Auto, Exposure::Stops);
    image_file::write(&picture, Look { exposure, tone: arguments.tone }, &arguments.out)?;
    let outcome = Outcome {
        scene: scene.name.clone(),
        triangles: scene.triangles.len(),
        choice,
        samples: film.samples(),
        threads: renderer.threads(),
        build_ms,
        render_ms: Summary::of(&render_ms),
        mean_luminance: picture.mean_luminance(),
        counts,
        left_out: renderer.needs().omissions(),
        statistics: renderer.structure().map(treewright_accel::Structure::statistics),
        notes: scene.notes.clone(),
        out: arguments.out.clone(),
    };
    if arguments.json {
        return output::json(&outcome);
    }
    println!(
        "{}: {} triangles, {} samples a pixel on {} threads",
        outcome.scene, outcome.triangles, outcome.samples, outcome.threads
    );
    println!("build {build_ms:.1} ms, render {:.1} ms a sample (median)", outcome.render_ms.median);
    if counts.bad_samples > 0 {
        println!("{} samples were not numbers and count as black", counts.bad_samples);
    }
    output::left_out(&outcome.left_out);
    output::notes(&scene);
    println!("wrote {}", arguments.out.display());
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}
