//! `treewright-render info`, `scenes` and `spaces`: a scene, the built-in scenes, and the tuning spaces.

use clap::Args;
use serde::Serialize;
use treewright_client::{Configuration, Constraint, Indicators};

use crate::arguments::{CameraArguments, SceneArguments, SpaceArguments, objective};
use crate::{error::Result, output};
use treewright_renderer::integrator::{Omission, Prepared};
use treewright_renderer::space::{Explained, Preset};
use treewright_renderer::tuning::objective::Objective;
use treewright_scene::{builtin, indicators::SceneIndicators};

#[derive(Args, Clone, Debug)]
pub(crate) struct InfoArguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    camera: CameraArguments,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct ListArguments {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct SpacesArguments {
    #[command(flatten)]
    space: SpaceArguments,
    /// Objective to minimise; this decides where a search starts.
    #[arg(long, value_parser = objective(), default_value = Objective::Render.name())]
    objective: Objective,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct SpaceInfo<'a> {
    name: &'static str,
    parameters: Vec<Explained>,
    constraints: &'a [Constraint],
    default: Configuration,
}

#[derive(Debug, Serialize)]
struct SceneInfo {
    name: String,
    triangles: usize,
    /// Objects placed; 0 in a scene without instances.
    instances: usize,
    /// Triangles of all instances, as rays meet them.
    placed_triangles: u64,
    meshes: usize,
    materials: usize,
    cameras: usize,
    emissive_triangles: usize,
    sun: bool,
    /// Lights without size.
    punctual_lights: usize,
    bounds_min: [f32; 3],
    bounds_max: [f32; 3],
    /// The features that shading leaves out, and why the scene does not need them.
    left_out: Vec<Omission>,
    indicators: Indicators,
    notes: Vec<String>,
}

pub(crate) fn info(arguments: &InfoArguments) -> Result<()> {
    let scene = arguments.scene.load()?;
    let camera = arguments.camera.find(&scene)?;
    let bounds = scene.bounds();
    let prepared = Prepared::new(scene.clone());
    let info = SceneInfo {
        name: scene.name.clone(),
        triangles: scene.triangles.len(),
        instances: scene.instances.as_ref().map_or(0, |instances| instances.placed().len()),
        placed_triangles: scene.placed().count(),
        meshes: scene.meshes.len(),
        materials: scene.materials.len(),
        cameras: scene.cameras.len(),
        emissive_triangles: prepared.lights.triangle_count(),
        left_out: prepared.needs.omissions(),
        sun: scene.sky.sun.is_some(),
        punctual_lights: scene.lights.len(),
        bounds_min: bounds.min.into(),
        bounds_max: bounds.max.into(),
        indicators: SceneIndicators::of(&scene).with_camera(&camera).values().into_iter().collect(),
        notes: scene.notes.clone(),
    };
    if arguments.json {
        return output::json(&info);
    }
    println!("{}", info.name);
    let mut table = output::table(&["", "value"]);
    let mut row = |name: &str, value: String| {
        table.add_row([name.to_owned(), value]);
    };
    row("triangles", info.triangles.to_string());
    if info.instances > 0 {
        row("instances", info.instances.to_string());
        row("placed triangles", info.placed_triangles.to_string());
    }
    row("meshes", info.meshes.to_string());
    row("materials", info.materials.to_string());
    row("cameras", info.cameras.to_string());
    row("emissive triangles", info.emissive_triangles.to_string());
    if info.punctual_lights > 0 {
        row("lights without size", info.punctual_lights.to_string());
    }
    row("sun", if info.sun { "yes" } else { "no" }.to_owned());
    row("lowest corner", corner(info.bounds_min));
    row("highest corner", corner(info.bounds_max));
    for (name, value) in info.indicators.iter() {
        row(&format!("indicator {name}"), format!("{value:.6}"));
    }
    println!("{table}");
    output::left_out(&info.left_out);
    for note in &info.notes {
        println!("note: {note}");
    }
    Ok(())
}

fn corner(corner: [f32; 3]) -> String {
    corner.map(|coordinate| format!("{coordinate:.3}")).join("  ")
}

pub(crate) fn scenes(arguments: &ListArguments) -> Result<()> {
    let scenes: Vec<_> = builtin::names()
        .map(|name| (format!("builtin:{name}"), builtin::about(name).unwrap_or_default()))
        .collect();
    if arguments.json {
        let objects: Vec<_> =
            scenes.iter().map(|(name, about)| serde_json::json!({ "name": name, "about": about })).collect();
        return output::json(&objects);
    }
    for (name, about) in scenes {
        println!("{name:<16} {about}");
    }
    Ok(())
}

pub(crate) fn spaces(arguments: &SpacesArguments) -> Result<()> {
    let space = arguments.space.whole(arguments.objective)?;
    let parameters: Vec<Explained> = space.explained().collect();
    if arguments.json {
        return output::json(&SpaceInfo {
            name: space.preset().name(),
            parameters,
            constraints: space.space().constraints(),
            default: space.default_configuration(),
        });
    }
    println!("{}\n", about(space.preset()));
    let mut table = output::table(&["parameter", "default", "may be", "only while", "what it does"]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(comfy_table::CellAlignment::Left);
    }
    for Explained { parameter, about } in parameters {
        let condition = parameter.active_if.as_ref().map(ToString::to_string).unwrap_or_default();
        table.add_row([
            parameter.name,
            parameter.default.to_string(),
            parameter.domain.to_string(),
            condition,
            about.to_owned(),
        ]);
    }
    println!("{table}");
    for constraint in space.space().constraints() {
        println!("always {constraint}");
    }
    if space.preset() == Preset::Full {
        println!("{NOT_TUNED}");
    }
    Ok(())
}

/// The choice that the full space leaves to the user.
const NOT_TUNED: &str = "Watertight intersection is not among them: it decides which hits are found at edges, which no stopwatch \
    can judge. Ask for it with --robust.";

fn about(preset: Preset) -> &'static str {
    match preset {
        Preset::Full => {
            "The full space: native Embree, the tunable tree, and how rays are grouped. Without a value each parameter \
             keeps its default; a value takes along what it needs (quality=2 means backend=tunable)."
        }
        Preset::Paper => {
            "The eleven parameters of the paper's Table 1. Without a value each keeps its default."
        }
        Preset::Light => {
            "How light is looked for, with the recommended tree (tune --objective error). A scene has the parameters of the \
             lights that it has. Every choice gives pictures of equal expectation; time and noise differ."
        }
        Preset::Follow => {
            "How structures follow scenes that move (tune --objective motion): which tree is built, after how many frames it \
             is rebuilt, and when parts of it are. Pictures stay equal."
        }
    }
}
