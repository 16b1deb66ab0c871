//! The indicators of a frame for the service: the paper's of scene and camera, and those of its workload.
//!
//! One study holds all scenes, so that trials in one of them serve the next. Every other influence on the
//! cost of a frame is therefore an indicator, too: its number of pixels, the length of its paths, and whether
//! there are lights that shadow rays are sent to. Threads and instruction sets belong to the machine, which
//! the service distinguishes by the client's fingerprint.

use treewright_client::{Indicators, Scale};
use treewright_scene::Scene;
use treewright_scene::indicators::{IndicatorScale, Indicators as SceneAndCamera, SCHEMA};

use super::reuse::FRAMES_PER_BUILD_MAX;
use crate::follow::MotionFacts;
use crate::limits::{BOUNCES_MAX, EPISODE_FRAMES_MAX};

const PIXELS: &str = "pixels";
const BOUNCES: &str = "bounces";
const SHADOW_RAYS: &str = "shadow_rays";
const MOVING_SHARE: &str = "moving_share";
const COST_GROWTH: &str = "cost_growth";
const EPISODE_FRAMES: &str = "episode_frames";
const FRAMES_PER_BUILD: &str = "frames_per_build";

/// The workload of a frame, beside its scene and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workload {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Most bounces of a path.
    pub bounces: u32,
    /// Whether the scene has lights that shadow rays are sent to.
    pub shadow_rays: bool,
    /// The motion of the scene, where updates are tuned.
    pub motion: Option<MotionFacts>,
    /// Number of frames that share a build, where that differs within a study.
    pub frames_per_build: Option<u32>,
}

impl Workload {
    /// For a scene.
    pub fn of(scene: &Scene, size: [u32; 2], bounces: u32) -> Self {
        let shadow_rays = scene.has_sampled_lights();
        Self { size, bounces, shadow_rays, motion: None, frames_per_build: None }
    }

    /// The state, as the service sees it.
    pub fn state(&self, scene_and_camera: &SceneAndCamera) -> Indicators {
        let mut values = scene_and_camera.values();
        values.insert(PIXELS.to_owned(), self.size.map(f64::from).iter().product());
        values.insert(BOUNCES.to_owned(), f64::from(self.bounces));
        values.insert(SHADOW_RAYS.to_owned(), f64::from(u8::from(self.shadow_rays)));
        if let Some(motion) = &self.motion {
            values.insert(MOVING_SHARE.to_owned(), motion.moving_share);
            values.insert(COST_GROWTH.to_owned(), motion.cost_growth);
            values.insert(EPISODE_FRAMES.to_owned(), f64::from(motion.frames));
        }
        if let Some(frames) = self.frames_per_build {
            values.insert(FRAMES_PER_BUILD.to_owned(), f64::from(frames));
        }
        values.into_iter().collect()
    }
}

/// Names, ranges and scales of all indicators.
pub fn schema() -> impl Iterator<Item = (&'static str, f64, f64, Scale)> {
    let paper = SCHEMA.iter().map(|one| {
        let scale = match one.scale {
            IndicatorScale::Linear => Scale::Linear,
            IndicatorScale::Log => Scale::Log,
        };
        (one.name, one.min, one.max, scale)
    });
    let frame = [
        (PIXELS, 0.0, 1e8, Scale::Log),
        (BOUNCES, 0.0, f64::from(BOUNCES_MAX), Scale::Log),
        (SHADOW_RAYS, 0.0, 1.0, Scale::Linear),
    ];
    paper.chain(frame)
}

/// Names, ranges and scales of the indicators of a motion.
pub(super) fn motion_schema() -> [(&'static str, f64, f64, Scale); 3] {
    [
        (MOVING_SHARE, 0.0, 1.0, Scale::Linear),
        (COST_GROWTH, 1.0, 1e4, Scale::Log),
        (EPISODE_FRAMES, 1.0, f64::from(EPISODE_FRAMES_MAX), Scale::Log),
    ]
}

/// Name, range and scale of the number of frames that share a build.
pub(super) fn reuse_schema() -> (&'static str, f64, f64, Scale) {
    (FRAMES_PER_BUILD, 1.0, f64::from(FRAMES_PER_BUILD_MAX), Scale::Log)
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_scene::{builtin, indicators::SceneIndicators};

    #[test]
    fn a_state_has_a_value_for_every_indicator() {
        let options = builtin::Options { detail: 0.02, ..builtin::Options::default() };
        let scene = builtin::build("quick", &options).expect("it is built in");
        let camera = SceneIndicators::of(&scene).with_camera(&scene.cameras[0]);
        let state = |width| Workload::of(&scene, [width, 240], 3).state(&camera);
        let names: Vec<&str> = schema().map(|(name, ..)| name).collect();
        assert_eq!(names.len(), SCHEMA.len() + 3);
        let given = state(320);
        assert!(names.iter().all(|name| given.get(name).is_some()) && given.len() == names.len());
        assert_ne!(given, state(640), "another size is another state");
        for (name, min, max, _) in schema() {
            assert!(given.get(name).is_some_and(|value| (min..=max).contains(&value)), "{name}");
        }
    }
}
