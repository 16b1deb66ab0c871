//! `treewright-render info`, `scenes` and `spaces`: what there is.

use clap::Args;
use serde::Serialize;
use treewright_client::{Indicators, Space, Value};

use super::arguments::{CameraArguments, SceneArguments, indicators};
use super::error::CliError;
use super::output;
use crate::integrator::{Omission, Prepared};
use crate::scene::builtin;
use crate::space::{domain_in_words, table_1};

/// Arguments of `info`.
#[derive(Args, Clone, Debug)]
pub(super) struct InfoArguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    camera: CameraArguments,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of `scenes` and `spaces`.
#[derive(Args, Clone, Debug)]
pub(super) struct ListArguments {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `info --json` prints.
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
    bounds_min: [f32; 3],
    bounds_max: [f32; 3],
    /// What shading leaves out, and why the scene can do without.
    left_out: Vec<Omission>,
    indicators: Indicators,
    notes: Vec<String>,
}

/// Tells what a scene consists of.
pub(super) fn info(arguments: &InfoArguments) -> Result<(), CliError> {
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
        bounds_min: bounds.min.into(),
        bounds_max: bounds.max.into(),
        indicators: indicators(&scene, &camera),
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

/// Lists the built-in scenes.
pub(super) fn scenes(arguments: &ListArguments) -> Result<(), CliError> {
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

/// Shows the parameter space.
pub(super) fn spaces(arguments: &ListArguments) -> Result<(), CliError> {
    let space: Space = table_1();
    if arguments.json {
        return output::json(&space);
    }
    println!("The eleven parameters of the paper's Table 1; without a value each keeps its default.\n");
    let mut table = output::table(&["parameter", "default", "may be", "only while"]);
    for parameter in space.parameters() {
        let condition = parameter.active_if.as_ref().map_or_else(String::new, |condition| {
            let values: Vec<String> = condition.any_of.iter().map(Value::to_string).collect();
            format!("{} = {}", condition.parameter, values.join(" or "))
        });
        table.add_row([
            parameter.name.clone(),
            parameter.default.to_string(),
            domain_in_words(&parameter.domain),
            condition,
        ]);
    }
    println!("{table}");
    for constraint in space.constraints() {
        println!("{} must not be above {}", constraint.lesser, constraint.greater);
    }
    Ok(())
}
