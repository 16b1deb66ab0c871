//! The run-off: the best few configurations of a search against each other.
//!
//! The best of many noisy single measurements is mostly luck. So the leaders are measured again in interleaved
//! rounds, and in each heat the slower half drops out (successive halving: Jamieson and Talwalkar, Non-stochastic
//! Best Arm Identification and Hyperparameter Optimization, 2016). What is measured here is reported to the
//! service like any other trial, so that its answers rest on it, too.

use treewright_client::Configuration;

use super::search::Iteration;
use crate::frame::{FrameTimes, Renderer};
use crate::measure::{Conditions, Contender, interleaved};
use crate::space::{ConfigurationError, TuningSpace};
use crate::statistics::Summary;

/// How many of a search's best configurations take part.
pub const FINALISTS: usize = 5;

/// Rounds of the heats: all, half of them, half of these. The last survivors have run in each.
const HEATS: [u32; 3] = [4, 6, 8];

/// What became of one configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Finalist {
    /// What ran.
    pub configuration: Configuration,
    /// Each frame, with its build.
    pub times: Vec<FrameTimes>,
    /// Why there is nothing more, if it cannot be built.
    pub failure: Option<String>,
}

/// The configurations with the lowest measured costs, best first, each once.
pub fn leaders(trials: &[Iteration], count: usize) -> Vec<Configuration> {
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

/// Lets configurations run against each other. The answer is ordered: first those that survived longest, among
/// them the one with the lowest median. Fewer rounds are run when `go_on` says no.
pub fn run_off(
    renderer: &Renderer,
    space: &TuningSpace,
    configurations: Vec<Configuration>,
    conditions: &Conditions,
    mut go_on: impl FnMut() -> bool,
) -> Result<Vec<Finalist>, ConfigurationError> {
    let mut standing: Vec<Finalist> = configurations
        .into_iter()
        .map(|configuration| Finalist { configuration, times: Vec::new(), failure: None })
        .collect();
    let mut out = Vec::new();
    for rounds in HEATS {
        let contenders = standing
            .iter()
            .map(|one| {
                Ok(Contender {
                    name: one.configuration.to_string(),
                    choice: space.choice(&one.configuration)?,
                })
            })
            .collect::<Result<Vec<_>, ConfigurationError>>()?;
        let heat = Conditions { rounds, ..*conditions };
        for (one, measured) in standing.iter_mut().zip(interleaved(renderer, &contenders, &heat, &mut go_on))
        {
            one.times.extend(measured.times());
            one.failure = measured.failure;
        }
        rank(&mut standing, conditions.frames_per_build);
        let losers = standing.split_off(standing.len().div_ceil(2));
        out.splice(0..0, losers);
        if standing.len() < 2 {
            break;
        }
    }
    standing.extend(out);
    Ok(standing)
}

/// Best median first; what cannot be built, or never ran, last.
fn rank(standing: &mut [Finalist], frames_per_build: u32) {
    let cost = |one: &Finalist| {
        let build_share = 1.0 / f64::from(frames_per_build);
        let costs: Vec<f64> =
            one.times.iter().map(|times| times.build_ms * build_share + times.render_ms).collect();
        if one.failure.is_some() || costs.is_empty() { f64::INFINITY } else { Summary::of(&costs).median }
    };
    standing.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
}

#[cfg(test)]
pub(super) mod testing {
    use treewright_client::{Mode, Outcome, Source};

    use super::*;

    /// A trial with this cost and leaf size.
    pub(crate) fn trial(cost: Option<f64>, leaf: u32) -> Iteration {
        Iteration {
            number: 1,
            trial: None,
            mode: Mode::Explore.into(),
            source: Source::Daemon,
            reason: String::new(),
            step: String::new(),
            configuration: Configuration::new().with("max_leaf_size", leaf),
            predicted_cost: None,
            outcome: Outcome::Ok,
            times: cost.map(|cost| FrameTimes::of(5.0, cost)),
            cost,
            waiting_ms: 1.0,
            total_ms: cost.unwrap_or(0.0) + 6.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::testing::trial;
    use super::*;
    use crate::integrator::View;
    use treewright_scene::builtin;

    #[test]
    fn leaders_are_the_best_and_distinct() {
        let trials = [
            trial(Some(9.0), 1),
            trial(None, 2),
            trial(Some(3.0), 3),
            trial(Some(4.0), 3),
            trial(Some(5.0), 5),
        ];
        let leaves: Vec<i64> =
            leaders(&trials, 2).iter().filter_map(|one| one.integer("max_leaf_size").ok()).collect();
        assert_eq!(leaves, [3, 5]);
        assert!(leaders(&[trial(None, 1)], 4).is_empty());
    }

    #[test]
    fn the_slower_half_drops_out() {
        let ran = |leaf: u32, render_ms: &[f64]| Finalist {
            configuration: Configuration::new().with("max_leaf_size", leaf),
            times: render_ms.iter().map(|&render_ms| FrameTimes::of(8.0, render_ms)).collect(),
            failure: None,
        };
        let mut failed = ran(4, &[1.0, 1.0]);
        failed.failure = Some("too deep".into());
        let mut standing = vec![ran(1, &[]), failed, ran(2, &[7.0, 9.0]), ran(3, &[5.0, 6.0])];
        rank(&mut standing, 1);
        let leaves: Vec<_> = standing.iter().map(|one| one.configuration.to_string()).collect();
        assert_eq!(leaves[..2], ["max_leaf_size=3", "max_leaf_size=2"]);
    }

    #[test]
    fn everybody_runs_and_the_last_ones_run_most() {
        let options = builtin::Options { detail: 0.02, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build("quick", &options).expect("it is built in"));
        let renderer = Renderer::new(scene.clone(), 0).expect("Embree starts");
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 1 };
        let conditions = Conditions { view, width: 8, height: 8, rounds: 1, frames_per_build: 1000 };
        let space = TuningSpace::paper();
        let configurations: Vec<Configuration> =
            (1..=5).map(|leaf| Configuration::new().with("max_leaf_size", leaf)).collect();
        let order = run_off(&renderer, &space, configurations.clone(), &conditions, || true);
        let order = order.expect("all configurations are sound");
        let counts: Vec<usize> = order.iter().map(|one| one.times.len()).collect();
        assert_eq!(counts, [18, 18, 10, 4, 4]);
        assert!(configurations.iter().all(|one| order.iter().any(|ran| ran.configuration == *one)));
        let stopped = run_off(&renderer, &space, configurations, &conditions, || false);
        assert!(stopped.is_ok_and(|order| order.len() == 5 && order.iter().all(|one| one.times.is_empty())));
    }
}
