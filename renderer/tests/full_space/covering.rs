//! Covering arrays: few configurations with every combination of the values of a few parameters.
//!
//! Most failures need but two or three values to meet (Kuhn, Wallace and Gallo, "Software Fault Interactions
//! and Implications for Software Testing", 2004). The arrays are grown greedily, as in Cohen, Dalal, Fredman
//! and Patton, "The AETG System" (1997).

use rand::seq::SliceRandom;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use treewright_client::{Configuration, Domain, Parameter, Value};
use treewright_renderer::space::{ConfigurationError, TuningSpace};

type Level<'a> = (&'a str, Value);

/// Every value of a list; of a range both ends and the default.
fn values(parameter: &Parameter) -> Vec<Value> {
    let mut values = match &parameter.domain {
        Domain::Integer { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
        Domain::Float { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
        Domain::Categorical { values } => values.clone(),
        Domain::Boolean => vec![Value::from(false), Value::from(true)],
    };
    if !values.contains(&parameter.default) {
        values.push(parameter.default.clone());
    }
    values
}

/// Configurations that hold every possible combination of values of `strength` parameters.
pub(crate) fn covering(space: &TuningSpace, strength: usize) -> Vec<Configuration> {
    let parameters = space.space().parameters();
    let levels: Vec<Level<'_>> = parameters
        .iter()
        .flat_map(|parameter| {
            values(parameter).into_iter().map(move |value| (parameter.name.as_str(), value))
        })
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(strength as u64);
    let mut all: Vec<Configuration> = Vec::new();
    combinations(&levels, strength, &Configuration::new(), &mut |given| {
        let holds = |one: &Configuration| given.iter().all(|(name, value)| one.get(name) == Some(value));
        if !all.iter().any(holds) {
            // There is none where the values never meet.
            all.extend(fill(space, given, &levels, &mut random).ok());
        }
    });
    all
}

/// The given values with those of `left` further parameters, in every way.
fn combinations(
    levels: &[Level<'_>],
    left: usize,
    given: &Configuration,
    visit: &mut impl FnMut(&Configuration),
) {
    if left == 0 {
        return visit(given);
    }
    for (number, (name, value)) in levels.iter().enumerate() {
        if given.get(name).is_none() {
            let more = given.clone().with(*name, value.clone());
            combinations(&levels[number + 1..], left - 1, &more, visit);
        }
    }
}

/// The given values with any others that go with them.
fn fill(
    space: &TuningSpace,
    given: &Configuration,
    levels: &[Level<'_>],
    random: &mut ChaCha8Rng,
) -> Result<Configuration, ConfigurationError> {
    let (mut given, mut complete) = (given.clone(), space.complete(given)?);
    let mut levels: Vec<&Level<'_>> = levels.iter().collect();
    levels.shuffle(random);
    for (name, value) in levels {
        if complete.get(name).is_none() || given.get(name).is_some() {
            continue;
        }
        let wider = given.clone().with(*name, value.clone());
        // An active parameter may have become inactive meanwhile, and limits may cross.
        if let Ok(next) = space.complete(&wider) {
            (given, complete) = (wider, next);
        }
    }
    Ok(complete)
}
