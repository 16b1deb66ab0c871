//! The stretch of motion of an episode, and how many frames a tree serves.

use std::sync::Arc;

use clap::Args;
use treewright_renderer::limits::EPISODE_FRAMES_MAX;
use treewright_renderer::{
    follow::{MotionFacts, fits},
    frame::Renderer,
    space::TuningSpace,
    tuning::objective::Objective,
    tuning::reuse::FRAMES_PER_BUILD_MAX,
};
use treewright_scene::Scene;

use crate::{error::CliError, error::Result, scene_arguments::SceneArguments};

/// Which stretch of a motion a trial shows.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct EpisodeArguments {
    /// With `--objective motion`: frames of a trial, 2 to 64, from a fresh build on.
    #[arg(long, value_name = "N", default_value_t = 24, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=i64::from(EPISODE_FRAMES_MAX)))]
    episode: u32,

    /// With `--objective motion`: cycles of the scene in an episode. Twice as many is twice as fast.
    #[arg(long, value_name = "N", default_value_t = 0.25, allow_negative_numbers = true, value_parser = cycles)]
    cycles: f32,
}

impl EpisodeArguments {
    /// Gives the renderer the episode, where motion is tuned, and returns its effect on a structure.
    ///
    /// # Errors
    /// Nothing moves in the scene, it is too large for the episode's frames, or it cannot be built.
    pub(crate) fn prepare(
        self,
        objective: Objective,
        scene: &SceneArguments,
        space: &TuningSpace,
        renderer: &mut Renderer,
    ) -> Result<Option<MotionFacts>> {
        if objective != Objective::Motion {
            return Ok(None);
        }
        renderer.set_episode(&self.moments(scene)?);
        let facts = renderer.motion(&space.default_choice());
        facts.map_err(|error| CliError::Failed(error.to_string()))
    }

    fn moments(self, scene: &SceneArguments) -> Result<Vec<Arc<Scene>>> {
        let moving = scene.moving()?;
        let moment = |frame: u32| moving.at(scene.time + self.cycles * frame as f32 / self.episode as f32);
        let first = moment(0)?;
        fits(&first, self.episode).map_err(|error| CliError::Usage(format!("{error} with --episode")))?;
        std::iter::once(Ok(first)).chain((1..self.episode).map(moment)).collect()
    }
}

fn cycles(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(cycles) if cycles.is_finite() && cycles != 0.0 => Ok(cycles),
        _ => Err("it must be a number other than 0".to_owned()),
    }
}

/// How many frames a tree serves where nobody says it.
const FRAMES_PER_BUILD: u32 = 16;

/// How many frames a tree serves.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct ReuseArguments {
    /// With `--objective auto`: how many frames a tree serves, 1 to 1024. It is a part of the state, so what
    /// is learnt for 16 frames helps at 64. Default: 16.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_PER_BUILD_MAX)))]
    frames_per_build: Option<u32>,
}

impl ReuseArguments {
    /// An objective with its number of frames.
    ///
    /// # Errors
    /// A number of frames was given for another objective than `auto`.
    pub(crate) fn of(self, objective: Objective) -> Result<Objective> {
        match (objective, self.frames_per_build) {
            (Objective::Auto(_), frames) => Ok(Objective::Auto(frames.unwrap_or(FRAMES_PER_BUILD))),
            (other, None) => Ok(other),
            (other, Some(_)) => Err(CliError::Usage(format!(
                "--frames-per-build goes with --objective auto; {} has a number of its own",
                other.name()
            ))),
        }
    }
}
