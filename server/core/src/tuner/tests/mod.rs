//! The promises of the state machine to its clients, one a test; here the study they share.

mod answers;
mod branches;
mod budget;
mod changed;
mod decisions;
mod estimates;
mod excluded;
mod exploiting;
mod exploring;
mod fidelities;
mod fleet;
mod known_states;
mod leases;
mod limits;
mod moving;
mod parts;
mod paying;
mod proven;
mod robust;
mod small;
mod starts;
mod verdicts;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::*;
use crate::configuration::Configuration;
use crate::decision::{ExploitRule, ExploitSource};
use crate::fidelity::Fidelity;
use crate::indicator::IndicatorSchema;
use crate::policy::{Policy, PredictorMethod, SearchMethod};
use crate::space::{Scale, Space};
use crate::study::StudySpec;
use crate::trial::{Mode, Outcome, Rule, Trial, TrialState};
use crate::tuner::proposal::Exploitation;
use crate::value::Value;

/// A study with four parameters (1280 configurations and a float) and two indicators.
pub(super) fn spec(policy: Policy) -> StudySpec {
    let space = Space::builder().categorical("width", [2, 4, 8]).default(2);
    let space = space.integer("min_leaf_size", 1..=16).default(1);
    let space = space.integer("max_leaf_size", 1..=16).default(16);
    let space = space.float("travel_cost", 0.0..=10.0).default(1.0);
    let space = space.less_or_equal("min_leaf_size", "max_leaf_size").build();
    spec_of(space.expect("a valid space"), policy)
}

pub(super) fn spec_of(space: Space, policy: Policy) -> StudySpec {
    let spec = StudySpec::builder(space).display_name("test").minimise("render_ms", 1.0).seed(42);
    let spec = spec.indicator("x", 0.0..=1.0, Scale::Linear).indicator("y", 0.0..=1.0, Scale::Linear);
    spec.state_tolerance(0.05).build().expect("valid").with_policy(policy)
}

/// The study with two cheaper levels.
pub(super) fn with_levels(spec: StudySpec) -> StudySpec {
    let level = |(name, cost): (&str, f64)| Fidelity { name: name.into(), cost };
    let levels = [("16", 0.1), ("64", 0.4)].map(level).to_vec();
    let objective = spec.objective.clone().with_fidelities(levels).expect("valid");
    StudySpec { objective, ..spec }
}

fn tuner(policy: Policy) -> Tuner {
    Tuner::new(Arc::new(spec(policy))).expect("a valid specification")
}

fn seeded(seed: u64, policy: Policy) -> Tuner {
    Tuner::new(Arc::new(StudySpec { seed, ..spec(policy) })).expect("a valid specification")
}

pub(super) fn ask(client: &str, x: f64, y: f64) -> Ask {
    let indicators = BTreeMap::from([("x".to_owned(), x), ("y".to_owned(), y)]);
    Ask { client_id: client.into(), indicators, ..Ask::default() }
}

pub(super) fn measured(render_ms: f64) -> BTreeMap<String, f64> {
    BTreeMap::from([("render_ms".to_owned(), render_ms)])
}

/// A cost that wants wide nodes, small leaves and a travel cost that follows `x`.
pub(super) fn cost(trial: &Trial) -> f64 {
    cost_at(&trial.configuration, trial.indicators["x"])
}

/// That cost of a configuration at an `x`.
fn cost_at(configuration: &Configuration, x: f64) -> f64 {
    let number = |name: &str| configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
    20.0 - number("width")
        + number("max_leaf_size") * 0.5
        + number("min_leaf_size") * 0.25
        + (number("travel_cost") - 10.0 * x).abs()
}

fn suggest(tuner: &mut Tuner, client: &str, x: f64, y: f64) -> Trial {
    tuner.suggest(&ask(client, x, y), 0).expect("a valid question").0
}

/// The trial of a question with its plan.
fn with_plan(tuner: &mut Tuner, ask: &Ask, plan: SuggestionPlan) -> Trial {
    match tuner.suggest_step(ask, Some(plan), |_| true, 0).expect("a valid question") {
        DecisionStep::Done((trial, _)) => trial,
        DecisionStep::Need(_) => panic!("a question that has its plan needs more"),
    }
}

fn finish(tuner: &mut Tuner, trial: &Trial, outcome: Outcome) -> Trial {
    tuner.report(trial, measured(cost(trial)), outcome, 1).expect("a valid report").0
}

fn infeasible() -> Outcome {
    Outcome::Infeasible { reason: "depth limit reached".into() }
}

fn run(tuner: &mut Tuner, client: &str, x: f64, y: f64, trials: usize) -> Vec<Trial> {
    let one = |_| {
        let trial = suggest(tuner, client, x, y);
        finish(tuner, &trial, Outcome::Ok)
    };
    (0..trials).map(one).collect()
}

/// Lets a client keep a configuration, as if that had been decided when it came.
fn exploits(
    tuner: &mut Tuner,
    client: &str,
    configuration: Configuration,
    source: ExploitSource,
    rule: ExploitRule,
) {
    let own = Exploitation { configuration, predicted_cost: None, source, rolled_back: false };
    let decision = own.kept(rule, Default::default());
    let visit = tuner.clients.visits.of(client).expect("it came").clone();
    tuner.clients.visits.begin(Visit { decision, ..visit });
}

/// The search alone: nothing is measured again to confirm its results or to find the speed of the machine.
fn explore_always() -> Policy {
    Policy { epsilon: 1.0, trials_per_state: 30, confirm_rounds: 0, track_speed: false, ..Policy::default() }
}

fn exploit_always() -> Policy {
    Policy { epsilon: 0.0, ..explore_always() }
}
