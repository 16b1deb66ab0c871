//! Winners are measured again before anything is claimed.
//!
//! The best of many noisy single measurements is mostly luck. So the best few configurations of the search
//! first run against each other; the winner of that is then measured once more, in fresh paired rounds,
//! against the recommended default and Embree's own structures. Only these figures are quoted.

use treewright_client::Configuration;

use super::objective::Objective;
use super::search::{Found, Iteration};
use crate::frame::Renderer;
use crate::measure::{Conditions, Contender, Standing, interleaved, standings};
use crate::render_options::RenderOptions;
use crate::space::{self, ConfigurationError};
use crate::statistics::BreakEven;

/// Name of the recommended default's standing.
pub const DEFAULT: &str = "recommended default";
/// Name of the winner's standing.
pub const TUNED: &str = "tuned";
/// Name of the standing of Embree's own structure with its own default quality.
pub const NATIVE_MEDIUM: &str = "native Embree default";
/// Name of the standing of Embree's own structure with quality high.
pub const NATIVE_HIGH: &str = "native Embree high";
/// Name of the standing of the predictor's answer.
pub const PREDICTED: &str = "first prediction";

/// How many of the best configurations run against each other.
const FINALISTS: usize = 4;

/// Rounds in which they do.
const FINAL_ROUNDS: u32 = 5;

/// The configurations with the lowest measured costs, best first, each once.
pub fn finalists(trials: &[Iteration], count: usize) -> Vec<Configuration> {
    let mut measured: Vec<(f64, &Configuration)> =
        trials.iter().filter_map(|trial| Some((trial.cost?, &trial.configuration))).collect();
    measured.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let mut best: Vec<Configuration> = Vec::new();
    for (_, configuration) in measured {
        if best.len() < count && !best.contains(configuration) {
            best.push(configuration.clone());
        }
    }
    best
}

/// Lets the best configurations run against each other. The default when nothing could be measured.
pub fn winner(
    renderer: &Renderer,
    trials: &[Iteration],
    conditions: &Conditions,
    go_on: impl FnMut() -> bool,
) -> Result<Configuration, ConfigurationError> {
    let finalists = finalists(trials, FINALISTS);
    let contenders = finalists
        .iter()
        .enumerate()
        .map(|(index, configuration)| contender(&index.to_string(), configuration))
        .collect::<Result<Vec<_>, _>>()?;
    let measured =
        interleaved(renderer, &contenders, &Conditions { rounds: FINAL_ROUNDS, ..*conditions }, go_on);
    let standings = standings(&measured, conditions.build_each_round);
    let ran = standings
        .iter()
        .zip(&finalists)
        .filter(|(standing, _)| standing.failure.is_none() && standing.frame_ms.count > 0);
    let best = ran.min_by(|(a, _), (b, _)| a.frame_ms.median.total_cmp(&b.frame_ms.median));
    Ok(best
        .map_or_else(|| finalists.first().cloned(), |(_, configuration)| Some(configuration.clone()))
        .unwrap_or_else(|| space::table_1().default_configuration()))
}

/// A configuration with a name.
pub fn contender(name: &str, configuration: &Configuration) -> Result<Contender, ConfigurationError> {
    Ok(Contender {
        name: name.to_owned(),
        choice: space::build_choice(configuration)?,
        options: RenderOptions::default(),
    })
}

/// Break-even from what was measured. The search's own costs are those of its time; frames with the default
/// are taken at the reference of that time, `frames` of them a trial, and tuned ones at that over the speed-up that was measured again.
pub fn break_even(found: &Found, objective: Objective, frames: u32, standings: &[Standing]) -> BreakEven {
    let find = |name: &str| standings.iter().find(|standing| standing.name == name);
    let setup = |name: &str| match find(name) {
        Some(standing) if !objective.builds_each_frame() => standing.build_ms.median,
        _ => 0.0,
    };
    let speedup = find(TUNED).map_or(1.0, |standing| standing.speedup.median);
    let trials = &found.trials;
    BreakEven {
        tuning_ms: trials.iter().map(|trial| trial.total_ms).sum(),
        frames_while_tuning: frames * trials.iter().filter(|trial| trial.times.is_some()).count() as u32,
        tuned_setup_ms: setup(TUNED),
        tuned_frame_ms: found.reference_ms / speedup,
        default_setup_ms: setup(DEFAULT),
        default_frame_ms: found.reference_ms,
    }
}

#[cfg(test)]
mod tests {
    use treewright_client::{Mode, Outcome, Source};

    use super::*;
    use crate::frame::FrameTimes;
    use crate::statistics::Summary;

    fn trial(cost: Option<f64>, leaf: u32) -> Iteration {
        Iteration {
            number: 1,
            trial: None,
            mode: Mode::Explore,
            source: Source::Daemon,
            reason: String::new(),
            step: String::new(),
            configuration: Configuration::new().with("max_leaf_size", leaf),
            predicted_cost: None,
            outcome: Outcome::Ok,
            times: cost.map(|cost| FrameTimes { build_ms: 5.0, render_ms: cost }),
            cost,
            waiting_ms: 1.0,
            total_ms: cost.unwrap_or(0.0) + 6.0,
        }
    }

    #[test]
    fn finalists_are_the_best_and_distinct() {
        let trials = [
            trial(Some(9.0), 1),
            trial(None, 2),
            trial(Some(3.0), 3),
            trial(Some(4.0), 3),
            trial(Some(5.0), 5),
        ];
        let leaves: Vec<i64> =
            finalists(&trials, 2).iter().filter_map(|one| one.integer("max_leaf_size").ok()).collect();
        assert_eq!(leaves, [3, 5]);
        assert!(finalists(&[trial(None, 1)], 4).is_empty());
    }

    #[test]
    fn break_even_counts_builds_where_they_fall() {
        let standing = |name: &str, build: f64, speedup: f64| Standing {
            name: name.into(),
            build_ms: Summary::of(&[build]),
            render_ms: Summary::of(&[50.0]),
            frame_ms: Summary::of(&[50.0]),
            speedup: Summary::of(&[speedup]),
            failure: None,
        };
        let standings = [standing(DEFAULT, 20.0, 1.0), standing(TUNED, 30.0, 1.25)];
        let trials = vec![trial(Some(10.0), 1), trial(None, 2), trial(Some(8.0), 3)];
        let found = Found { trials, reference_ms: 10.0 };
        let render = break_even(&found, Objective::Render, 1, &standings);
        assert_eq!((render.tuning_ms, render.frames_while_tuning), (36.0, 2));
        assert_eq!((render.default_setup_ms, render.tuned_setup_ms), (20.0, 30.0));
        // 36 + 30 + (n - 2) * 8 <= 20 + n * 10
        assert_eq!(render.frame(), Some(15));
        let total = break_even(&found, Objective::Total, 1, &standings);
        assert_eq!((total.default_setup_ms, total.tuned_setup_ms), (0.0, 0.0));
    }
}
