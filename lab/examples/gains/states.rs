//! A study whose states are problems of one space, and one client's trials in it.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::Policy;
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};

use crate::problem::{Problem, normal};
use crate::{kernels, trees};

/// State `number` of a study of a kind.
pub(crate) fn problem(kind: &str, seed: u64, number: u64) -> Problem {
    match kind {
        "trees" => trees::problem(1000 + 50 * seed + number),
        "fresh" => trees::problem(700_000 + 50 * seed + number),
        kind => kernels::problem(kind, 100 * seed + number),
    }
}

pub(crate) fn spec(space: Space, seed: u64, policy: Policy) -> StudySpec {
    let indicator = Indicator { name: "scene".into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let terms = vec![ObjectiveTerm { metric: "render_ms".into(), weight: 1.0 }];
    StudySpec {
        display_name: "gains".into(),
        space,
        indicators: IndicatorSchema::new(vec![indicator]).expect("valid"),
        objective: Objective::new(terms).expect("valid"),
        state_tolerance: 0.01,
        policy,
        seed,
    }
}

/// A study under way.
pub(crate) struct Study {
    pub(crate) tuner: Tuner,
    pub(crate) random: ChaCha8Rng,
}

impl Study {
    pub(crate) fn new(space: Space, seed: u64, policy: Policy) -> Self {
        let tuner = Tuner::new(Arc::new(spec(space, seed, policy))).expect("valid");
        Study { tuner, random: ChaCha8Rng::seed_from_u64(seed) }
    }

    pub(crate) fn indicators(number: u64) -> BTreeMap<String, f64> {
        BTreeMap::from([("scene".to_owned(), number as f64 / 50.0)])
    }

    pub(crate) fn suggest(&mut self, client: &str, number: u64) -> Trial {
        let indicators = Self::indicators(number);
        let ask = Ask { client_id: client.into(), indicators, ..Ask::default() };
        self.tuner.suggest(&ask, 0).expect("a valid question").0
    }

    /// Reports what a trial truly costs, with noise.
    pub(crate) fn report(&mut self, trial: &Trial, truth: Option<f64>, noise: f64) {
        let (measurements, outcome) = match truth {
            Some(truth) => {
                let cost = truth * (noise * normal(&mut self.random)).exp();
                (BTreeMap::from([("render_ms".to_owned(), cost)]), Outcome::Ok)
            }
            None => (BTreeMap::new(), Outcome::Infeasible { reason: "cannot be built".into() }),
        };
        let _change = self.tuner.report(trial, measurements, outcome, 1).expect("a valid report");
    }

    /// One trial of one client.
    pub(crate) fn frame(
        &mut self,
        client: &str,
        number: u64,
        truth: impl Fn(&Configuration) -> Option<f64>,
        noise: f64,
    ) -> Trial {
        let trial = self.suggest(client, number);
        self.report(&trial, truth(&trial.configuration), noise);
        trial
    }

    /// What would be told to be best in a state.
    pub(crate) fn best(&self, number: u64) -> Option<Configuration> {
        let best = self.tuner.best(Some(&Self::indicators(number)), None).expect("valid");
        best.map(|best| best.configuration)
    }
}
