//! Covering arrays: few configurations with every combination of the values of a few parameters.
//!
//! Most failures need but two or three values to meet (Kuhn, Wallace and Gallo, "Software Fault Interactions
//! and Implications for Software Testing", 2004). The arrays are grown greedily, as in Cohen, Dalal, Fredman
//! and Patton, "The AETG System" (1997).

use std::collections::HashSet;

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use treewright_client::{Configuration, Domain, Parameter, Value};
use treewright_renderer::space::TuningSpace;

/// A combination of values, by the numbers of their levels, in ascending order.
type Combination = Vec<u16>;

/// A value of a parameter.
struct Level<'a> {
    parameter: &'a Parameter,
    value: Value,
}

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
        .flat_map(|parameter| values(parameter).into_iter().map(move |value| Level { parameter, value }))
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(strength as u64);
    let mut covered: HashSet<Combination> = HashSet::new();
    let mut all = Vec::new();
    combinations(&mut Vec::new(), strength, levels.len() as u16, &mut |combination| {
        let names: HashSet<&str> = combination.iter().map(|&level| name(&levels, level)).collect();
        if names.len() < strength || covered.contains(combination) {
            return;
        }
        let given = combination.iter().map(|&level| {
            let Level { parameter, value } = &levels[usize::from(level)];
            (parameter.name.clone(), value.clone())
        });
        let Ok(configuration) = fill(space, given.collect(), &levels, &mut random) else {
            // These values never meet.
            return;
        };
        let held: Vec<u16> = (0..levels.len() as u16)
            .filter(|&level| {
                configuration.get(name(&levels, level)) == Some(&levels[usize::from(level)].value)
            })
            .collect();
        let count = held.len() as u16;
        combinations(&mut Vec::new(), strength, count, &mut |places| {
            covered.insert(places.iter().map(|&place| held[usize::from(place)]).collect());
        });
        all.push(configuration);
    });
    all
}

fn name<'a>(levels: &[Level<'a>], level: u16) -> &'a str {
    &levels[usize::from(level)].parameter.name
}

/// Every ascending choice of `left` further numbers below `end`.
fn combinations(chosen: &mut Combination, left: usize, end: u16, visit: &mut impl FnMut(&Combination)) {
    if left == 0 {
        return visit(chosen);
    }
    let first = chosen.last().map_or(0, |last| last + 1);
    for number in first..end {
        chosen.push(number);
        combinations(chosen, left - 1, end, visit);
        chosen.pop();
    }
}

/// The given values with any others that go with them.
fn fill(
    space: &TuningSpace,
    mut given: Configuration,
    levels: &[Level<'_>],
    random: &mut ChaCha8Rng,
) -> Result<Configuration, treewright_renderer::space::ConfigurationError> {
    let mut complete = space.complete(&given)?;
    let mut parameters: Vec<&Parameter> = space.space().parameters().iter().collect();
    parameters.shuffle(random);
    for parameter in parameters {
        if complete.get(&parameter.name).is_none() || given.get(&parameter.name).is_some() {
            continue;
        }
        let values: Vec<&Value> = (levels.iter())
            .filter(|level| level.parameter.name == parameter.name)
            .map(|level| &level.value)
            .collect();
        let value = values[random.random_range(0..values.len())];
        let mut wider = given.clone();
        wider.set(parameter.name.clone(), value.clone());
        // An active parameter may have become inactive meanwhile, and limits may cross.
        if let Ok(next) = space.complete(&wider) {
            (given, complete) = (wider, next);
        }
    }
    Ok(complete)
}
