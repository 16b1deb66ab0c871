//! Parts of simulated studies: noise, parameters from 0 to 1, a specification, a client's frame.

use std::collections::{BTreeMap, BTreeSet};

use rand::{Rng, RngExt as _};
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

/// The one metric of a simulated study.
pub const METRIC: &str = "cost";

/// A standard normal number (Box and Muller 1958).
pub fn normal(random: &mut impl Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

/// A parameter that is always active.
pub fn parameter(name: impl Into<String>, domain: Domain, default: Value) -> Parameter {
    Parameter { name: name.into(), domain, default, active_if: None }
}

/// A parameter from 0 to 1 whose default is in the middle.
pub fn share(name: impl Into<String>) -> Parameter {
    parameter(name, Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear }, Value::Float(0.5))
}

/// A study that minimises [`METRIC`] over a space, with indicators from 0 to 1.
///
/// # Panics
/// If an indicator is named twice.
pub fn study(space: Space, indicators: impl Iterator<Item = String>, policy: Policy, seed: u64) -> StudySpec {
    let indicator = |name| Indicator { name, min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: METRIC.to_owned(), weight: 1.0 };
    StudySpec {
        display_name: String::new(),
        note: String::new(),
        tags: BTreeSet::new(),
        space,
        indicators: IndicatorSchema::new(indicators.map(indicator).collect()).expect("each name once"),
        objective: Objective::new(vec![term]).expect("one term"),
        state_tolerance: 0.01,
        policy,
        seed,
    }
}

/// A question of the one client in a state.
pub fn ask<'a>(indicators: impl IntoIterator<Item = (&'a str, f64)>) -> Ask {
    let indicators = indicators.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    Ask { client_id: "a".to_owned(), indicators, ..Ask::default() }
}

/// Reports what a trial cost; `None` where it cannot be run.
///
/// # Panics
/// If the trial is not open.
pub fn report(tuner: &mut Tuner, trial: &Trial, cost: Option<f64>) -> Trial {
    let outcome = cost.map_or_else(|| Outcome::infeasible("it cannot be run"), |_| Outcome::Ok);
    let measurements: BTreeMap<_, _> = cost.map(|cost| (METRIC.to_owned(), cost)).into_iter().collect();
    tuner.report(trial, measurements, outcome, 1).expect("an open trial").0
}
