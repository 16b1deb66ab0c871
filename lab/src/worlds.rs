//! The worlds of a measurement, each written in one word: a scene, its motion, the size of its pictures, and
//! the number of threads.

use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

use treewright_render_cli::arguments::SceneArguments;
use treewright_render_cli::error::CliError;
use treewright_renderer::{follow::fits, limits::SIZE_MAX, limits::THREADS_MAX};
use treewright_scene::Scene;
use treewright_scene::limits::DETAIL_RANGE;
use treewright_scene::motion::Motion;

/// Cycles of the motion in an episode, unless the world has others.
const CYCLES: f32 = 0.25;

/// Least width of pictures: three quarters of it are their height.
pub const WIDTH_MIN: u32 = 4;

/// A world as it is written: a scene, a file or `builtin:NAME`. Behind it, each after an `@`, may stand a
/// motion (`itself` for scenes that move by themselves), the cycles in an episode, the width of pictures, the
/// number of threads, and the factor for the number of triangles of a built-in scene:
/// `builtin:city@sway@0.25@160px@1t@x0.5`.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenWorld {
    name: String,
    scene: String,
    moves: Option<Moves>,
    cycles: f32,
    width: Option<u32>,
    threads: usize,
    detail: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Moves {
    Itself,
    By(Motion),
}

/// A scene, and how it moves.
pub struct World {
    /// Its name, which distinguishes it from all others: `city-sway-0.25-160px-1t-x0.5`.
    pub name: String,
    /// The name of its scene alone.
    pub scene: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Threads for building and rendering; 0 for one a core.
    pub threads: usize,
    /// The scene in each frame of an episode; one where it stands still.
    pub moments: Vec<Arc<Scene>>,
}

/// The name of a scene, without folder and ending.
fn stem(scene: &str) -> String {
    let path = Path::new(scene.trim_start_matches("builtin:"));
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

impl FromStr for WrittenWorld {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split('@');
        let scene = parts.next().unwrap_or_default().to_owned();
        let words = std::iter::once(stem(&scene)).chain(parts.clone().map(str::to_owned));
        let name = words.collect::<Vec<_>>().join("-");
        let mut world =
            Self { name, scene, moves: None, cycles: CYCLES, width: None, threads: 0, detail: 1.0 };
        let mut has_cycles = false;
        for part in parts {
            let number = part.parse().ok().filter(|number: &f32| number.is_finite());
            if let Some(cycles) = number {
                (world.cycles, has_cycles) = (cycles, true);
            } else if let Some(width) = part.strip_suffix("px") {
                let width = width.parse().ok().filter(|width| (WIDTH_MIN..=SIZE_MAX).contains(width));
                world.width = Some(width.ok_or_else(|| format!("{part} is no width, such as 160px"))?);
            } else if let Some(detail) = part.strip_prefix('x') {
                let detail = detail.parse().ok().filter(|detail| DETAIL_RANGE.contains(detail));
                let is_builtin = world.scene.starts_with("builtin:");
                let wrong = || format!("{part} is no factor of a built-in scene, such as x0.5");
                world.detail = detail.filter(|_| is_builtin).ok_or_else(wrong)?;
            } else if let Some(threads) = part.strip_suffix('t').and_then(|count| count.parse().ok()) {
                if !(1..=THREADS_MAX).contains(&threads) {
                    return Err(format!("{part} is no number of threads, such as 1t"));
                }
                world.threads = threads;
            } else if part == "itself" {
                world.moves = Some(Moves::Itself);
            } else {
                let known = Motion::ALL.into_iter().find(|known| known.name() == part);
                world.moves = Some(Moves::By(known.ok_or_else(|| format!("there is no motion {part}"))?));
            }
        }
        if has_cycles && world.moves.is_none() {
            return Err("cycles want a motion, as in builtin:city@sway@0.25".to_owned());
        }
        Ok(world)
    }
}

impl WrittenWorld {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it moves.
    pub fn is_moving(&self) -> bool {
        self.moves.is_some()
    }

    /// Loads the first and the last moment of an episode of `frames` frames, and drops them.
    ///
    /// # Errors
    /// As [`WrittenWorld::load`], or its moments would not fit into memory together.
    pub fn check(&self, frames: u32) -> Result<(), CliError> {
        let moments = self.moments(&[0, frames.saturating_sub(1)], frames)?;
        for scene in moments.iter().filter(|_| self.is_moving()) {
            fits(scene, frames)
                .map_err(|error| CliError::Failed(format!("{}: {error} frames", self.name)))?;
        }
        Ok(())
    }

    /// Loads it, with an episode of `frames` frames where it moves. Pictures are `width` wide, unless it says
    /// otherwise.
    ///
    /// # Errors
    /// There is no such scene, it cannot be read, or nothing moves in it.
    pub fn load(&self, frames: u32, width: u32) -> Result<World, CliError> {
        let width = self.width.unwrap_or(width);
        let all: Vec<u32> = (0..frames).collect();
        Ok(World {
            name: self.name.clone(),
            scene: stem(&self.scene),
            size: [width, width / 4 * 3],
            threads: self.threads,
            moments: self.moments(&all, frames)?,
        })
    }

    fn moments(&self, which: &[u32], frames: u32) -> Result<Vec<Arc<Scene>>, CliError> {
        let named = |error: CliError| CliError::Failed(format!("{}: {error}", self.name));
        let mut arguments = SceneArguments::plain(self.scene.clone(), self.detail, None, 0.0);
        let Some(moves) = self.moves else {
            return Ok(vec![arguments.load().map_err(named)?]);
        };
        if let Moves::By(motion) = moves {
            arguments.motion = Some(motion);
        }
        let moving = arguments.moving().map_err(named)?;
        let at = |frame: &u32| moving.at(self.cycles * *frame as f32 / frames as f32);
        which.iter().map(at).collect::<Result<_, _>>().map_err(named)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> WrittenWorld {
        text.parse().expect("it is a world")
    }

    #[test]
    fn a_word_says_scene_motion_cycles_size_and_triangles() {
        let world = read("builtin:quick@explode@0.5@64px@1t@x0.05");
        assert_eq!(world.name(), "quick-explode-0.5-64px-1t-x0.05");
        assert!(world.is_moving() && world.check(3).is_ok());
        let loaded = world.load(3, 320).expect("it is built in");
        assert_eq!((loaded.scene.as_str(), loaded.size, loaded.moments.len()), ("quick", [64, 48], 3));
        assert_eq!((loaded.threads, read("builtin:quick@twist").threads), (1, 0));
        let still = read("builtin:quick@x0.05");
        assert!(!still.is_moving());
        let still = still.load(24, 160).expect("it is built in");
        assert_eq!((still.size, still.moments.len()), ([160, 120], 1));
        assert_eq!(read("scenes/a.glb@sway").name(), "a-sway");
        assert_eq!(read("scenes/a.glb@sway").cycles, CYCLES);
    }

    #[test]
    fn what_is_no_world_is_refused_with_its_name() {
        for (text, words) in [
            ("builtin:quick@swing", "no motion swing"),
            ("builtin:quick@0.25", "cycles want a motion"),
            ("builtin:quick@sway@nan", "no motion nan"),
            ("builtin:quick@2px", "2px is no width"),
            ("builtin:quick@0t", "0t is no number of threads"),
            ("builtin:quick@x0", "x0 is no factor"),
            ("a.glb@x0.5", "x0.5 is no factor"),
        ] {
            let error = text.parse::<WrittenWorld>().expect_err(text);
            assert!(error.contains(words), "{error}");
        }
        for (text, words) in [
            ("builtin:nowhere", "nowhere"),
            ("missing.glb", "missing"),
            ("builtin:quick@itself@x0.05", "nothing moves"),
        ] {
            let error = read(text).check(24).expect_err(text).to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
