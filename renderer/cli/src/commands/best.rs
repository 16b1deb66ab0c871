//! `treewright-render best`: the service's best configuration in one scene and view.
//!
//! A study holds all scenes, so the question needs the scene's indicators, which this program computes.

use clap::Args;
use serde::Serialize;
use treewright_client::{ClientError, Configuration};

use crate::arguments::{SpaceArguments, StartArguments, ViewArguments, objective};
use crate::{
    episode_arguments::EpisodeArguments, episode_arguments::ReuseArguments, error::Result,
    narrowing::NarrowingArguments, output, server::ServerArguments,
};
use treewright_renderer::tuning::objective::{Objective, study_id};
use treewright_scene::indicators::SceneIndicators;

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    server: ServerArguments,
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    space: SpaceArguments,
    #[command(flatten)]
    narrowing: NarrowingArguments,
    #[command(flatten)]
    start: StartArguments,

    /// Objective to minimise.
    #[arg(long, value_parser = objective(), default_value = Objective::Render.name())]
    objective: Objective,

    #[command(flatten)]
    episode: EpisodeArguments,
    #[command(flatten)]
    reuse: ReuseArguments,
}

/// The output; `image` reads it with `--config-file`, `bench` with `--contender`.
#[derive(Debug, Serialize)]
struct Answer {
    study: String,
    /// Of the objective, in milliseconds; absent where nothing was measured in this scene and view.
    cost: Option<f64>,
    /// On how many measurements that rests.
    measurements: i32,
    /// The reason of the answer, where it is a prediction.
    reason: Option<String>,
    configuration: Configuration,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let client = arguments.server.connect(arguments.view.frame.threads)?;
    let scene = arguments.view.scene.load()?;
    let camera = arguments.view.camera.find(&scene)?;
    let objective = arguments.reuse.of(arguments.objective)?;
    let recommended = arguments.space.judged_by(objective)?.of(&scene, objective)?;
    let (start, whole) = arguments.start.of(&recommended)?;
    // A part of a space has a study of its own, and its configurations lack what was fixed.
    let space = arguments.narrowing.of(&whole)?;
    let made = || study_id(objective, &whole) + &start.mark(&whole) + &arguments.narrowing.mark(&space);
    let id = arguments.server.study.clone().unwrap_or_else(made);
    let study = match client.existing_study(&id) {
        // A mere question creates no study.
        Err(problem) if problem.is_not_found() => {
            let reason = Some(format!("there is no study {id} yet; these are the recommended values"));
            let configuration = space.with_held(&space.default_configuration());
            return output::json(&Answer { study: id, cost: None, measurements: 0, reason, configuration });
        }
        study => study?,
    };
    let mut workload = arguments.view.frame.workload(&scene, arguments.view.size);
    if objective == Objective::Motion {
        let mut renderer = arguments.view.frame.renderer(&scene)?;
        let (scene, episode) = (&arguments.view.scene, arguments.episode);
        workload.motion = episode.prepare(objective, scene, &recommended, &mut renderer)?;
    }
    workload.frames_per_build = objective.frames_asked();
    let state = workload.state(&SceneIndicators::of(&scene).with_camera(&camera));
    let answer = match study.best(&state) {
        Ok(best) => Answer {
            study: id,
            cost: Some(best.cost),
            measurements: best.measurements,
            reason: None,
            configuration: space.with_held(&best.configuration),
        },
        // Nothing was measured here: what would be tried first.
        Err(ClientError::Refused { .. }) => {
            let prediction = study.predict(&state)?;
            let reason = Some(prediction.reason.summary);
            let configuration = space.with_held(&prediction.configuration);
            Answer { study: id, cost: None, measurements: 0, reason, configuration }
        }
        Err(error) => return Err(error.into()),
    };
    output::json(&answer)
}
