//! Parts of simulated studies: noise, parameters from 0 to 1, a specification, a client's frame.

use std::collections::BTreeMap;

use rand::{Rng, RngExt as _};
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::{policy::Policy, study::StudySpec};

/// The one metric of a simulated study.
pub const METRIC: &str = "cost";

/// A standard normal number (Box and Muller 1958).
pub fn normal(random: &mut impl Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

/// The mean of some values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// A parameter from 0 to 1 whose default is in the middle.
pub fn share(name: impl Into<String>) -> Parameter {
    Parameter::new(name, Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear }, 0.5)
}

/// A study that minimises [`METRIC`] over a space, with indicators from 0 to 1.
///
/// # Panics
/// If an indicator is named twice.
pub fn study(space: Space, indicators: impl Iterator<Item = String>, policy: Policy, seed: u64) -> StudySpec {
    let begin = StudySpec::builder(space).minimise(METRIC, 1.0).seed(seed);
    let spec = indicators.fold(begin, |spec, name| spec.indicator(&name, 0.0..=1.0, Scale::Linear));
    spec.build().expect("each name once").with_policy(policy)
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
