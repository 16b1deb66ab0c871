//! The arguments that choose a scene, its upward axis and its light.

use std::{path::PathBuf, sync::Arc};

use clap::{Args, builder::TypedValueParser};
use treewright_scene::motion::{Motion, Mover};
use treewright_scene::{Environment, Scene, Sky, Up, builtin, load_upright};

use crate::error::{CliError, Result};
use crate::names::{number_within, one_of};

const BUILTIN: &str = "builtin:";

/// Which scene.
#[derive(Args, Clone, Debug)]
pub struct SceneArguments {
    /// A glTF, GLB, OBJ or PLY file, or `builtin:NAME` (see `treewright-render scenes`).
    #[arg(long, value_name = "PATH|builtin:NAME")]
    pub scene: String,

    /// Factor for the number of triangles of built-in scenes, 0.001 to 8.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub detail: f32,

    /// Seed of a built-in scene; each seed gives another scene of that kind.
    #[arg(long, value_name = "N")]
    pub scene_seed: Option<u64>,

    /// Make a scene move that stands still. Built-in scenes that are animated move by themselves, and so do
    /// files with an animation where motion is asked for; `file` shows its moments elsewhere.
    #[arg(long, value_name = "NAME", value_parser = motion())]
    pub motion: Option<Motion>,

    /// The animation of a glTF file to move by: its name, or its number from 0. The first one otherwise.
    #[arg(long, value_name = "NAME|N")]
    pub animation: Option<String>,

    /// Time in a scene that moves; 0 to 1 is one cycle.
    #[arg(long, value_name = "T", default_value_t = 0.0, allow_negative_numbers = true)]
    pub time: f32,

    /// Axis of the file that points up.
    #[arg(long, value_parser = up_axis(), default_value = "y")]
    pub up_axis: Up,

    /// Equirectangular environment map, .hdr or .exr; replaces the scene's own sky and sun.
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,

    /// Turn the environment map to the right, by degrees about the upright axis.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = finite, allow_negative_numbers = true, requires = "environment")]
    pub environment_rotation: f32,

    /// Factor on the radiance of the environment map, 0 to 1e6.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = brightness, requires = "environment")]
    pub environment_scale: f32,

    /// Copy instanced geometry instead of tracing rays through instances.
    #[arg(long)]
    pub flatten: bool,
}

impl SceneArguments {
    /// A scene by its name alone, as it is.
    pub fn plain(scene: String, detail: f32, scene_seed: Option<u64>, time: f32) -> Self {
        Self {
            scene,
            detail,
            scene_seed,
            time,
            motion: None,
            animation: None,
            up_axis: Up::Y,
            environment: None,
            environment_rotation: 0.0,
            environment_scale: 1.0,
            flatten: false,
        }
    }

    /// The scene at any time.
    ///
    /// # Errors
    /// Nothing moves in it, or it cannot be loaded.
    pub fn moving(&self) -> Result<Moving> {
        match self.motion {
            Some(Motion::File) => return self.of_file(self.still()?),
            Some(motion) if self.animation.is_none() => {
                return Ok(Moving::Made(Box::new(Mover::new(self.still()?, motion)?)));
            }
            Some(motion) => {
                return Err(CliError::Usage(format!(
                    "--animation chooses among those of a file, and --motion {} is none of them; leave one out",
                    motion.name()
                )));
            }
            None => {}
        }
        let is_animated = self.scene.strip_prefix(BUILTIN).is_some_and(builtin::is_animated);
        if is_animated && self.animation.is_none() {
            return Ok(Moving::Itself(Box::new(self.clone())));
        }
        let still = self.still()?;
        if still.animated.is_some() || self.animation.is_some() {
            return self.of_file(still);
        }
        let animated = builtin::names().filter(|name| builtin::is_animated(name));
        let known: Vec<String> = animated.map(|name| format!("{BUILTIN}{name}")).collect();
        let made = Motion::ALL.into_iter().filter(|motion| *motion != Motion::File).map(Motion::name);
        Err(CliError::Usage(format!(
            "nothing moves in {}; add --motion with one of {}, or take {}",
            self.scene,
            made.collect::<Vec<_>>().join(", "),
            known.join(" or ")
        )))
    }

    fn of_file(&self, still: Arc<Scene>) -> Result<Moving> {
        Ok(Moving::Made(Box::new(Mover::of_file(still, self.animation.as_deref())?)))
    }

    /// Loads or generates the scene, at its time.
    pub fn load(&self) -> Result<Arc<Scene>> {
        let mut scene = match self.motion.is_some() || self.animation.is_some() {
            true => self.moving()?.at(self.time)?,
            false => self.still()?,
        };
        // What it would move by may be larger than itself. A command that asks for motion reads it again.
        Arc::make_mut(&mut scene).animated = None;
        Ok(scene)
    }

    fn still(&self) -> Result<Arc<Scene>> {
        let scene = match self.scene.strip_prefix(BUILTIN) {
            Some(_) if self.up_axis != Up::Y => {
                return Err(CliError::Usage("--up-axis is for files; built-in scenes stand on y".to_owned()));
            }
            Some(name) => {
                let default = builtin::Options::default();
                let seed = self.scene_seed.unwrap_or(default.seed);
                let options = builtin::Options { detail: self.detail, time: self.time, seed };
                builtin::build(name, &options)?
            }
            None => load_upright(&self.scene, self.up_axis)?,
        };
        let mut scene = if self.flatten { scene.flattened()? } else { scene };
        if let Some(path) = &self.environment {
            let map = Environment::load(path)?;
            let map = map.changed(self.environment_scale, self.environment_rotation);
            scene.environment = Some(Arc::new(map));
            scene.sky = Sky::BLACK;
        }
        Ok(Arc::new(scene))
    }
}

/// A scene at any time.
#[derive(Clone, Debug)]
pub enum Moving {
    /// A built-in one that is animated.
    Itself(Box<SceneArguments>),
    /// One that is made to move.
    Made(Box<Mover>),
}

impl Moving {
    /// The scene at a time; 0 to 1 is one cycle.
    ///
    /// # Errors
    /// The motion leads out of the space that there is.
    pub fn at(&self, time: f32) -> Result<Arc<Scene>> {
        match self {
            Self::Itself(arguments) => SceneArguments { time, ..(**arguments).clone() }.still(),
            Self::Made(mover) => Ok(mover.at(time)?),
        }
    }
}

fn motion() -> impl TypedValueParser<Value = Motion> {
    one_of(Motion::ALL.map(|motion| (motion, motion.name(), motion.about())))
}

fn up_axis() -> impl TypedValueParser<Value = Up> {
    one_of([
        (Up::Y, "y", "As in glTF"),
        (Up::Z, "z", "As in most files from construction and for printing"),
        (Up::X, "x", "Some of these"),
    ])
}

fn finite(text: &str) -> Result<f32, String> {
    number_within(text, f32::MIN..=f32::MAX, "a finite number")
}

fn brightness(text: &str) -> Result<f32, String> {
    number_within(text, 0.0..=1e6, "a number from 0 to 1e6")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle that an animation puts one further along x.
    const ANIMATED: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
            {"bufferView":0,"componentType":5126,"count":1,"type":"SCALAR"},
            {"bufferView":0,"byteOffset":12,"componentType":5126,"count":1,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "buffers":[{"byteLength":36,
            "uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],
        "animations":[{"channels":[{"sampler":0,"target":{"node":0,"path":"translation"}}],
            "samplers":[{"input":1,"output":2}]}]}"#;

    #[test]
    fn a_scene_that_stands_still_does_not_keep_what_would_move_it() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, ANIMATED).expect("it can be written");
        let still = SceneArguments::plain(path.to_string_lossy().into_owned(), 1.0, None, 0.0);
        let moved = SceneArguments { animation: Some("0".to_owned()), ..still.clone() };
        let first = |scene: &Scene| scene.triangles.positions()[0].x;
        for (arguments, expected) in [(&still, 0.0), (&moved, 1.0)] {
            let scene = arguments.load().expect("it is a scene");
            assert_eq!(first(&scene), expected);
            assert!(scene.animated.is_none());
            let moving = arguments.moving().expect("it moves");
            assert_eq!(first(&moving.at(0.0).expect("it stays in range")), 1.0);
        }
    }
}
