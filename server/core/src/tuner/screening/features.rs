//! The features of a configuration for a linear model: each parameter's part apart from all others.

use crate::configuration::Configuration;
use crate::space::{Domain, Parameter, Space};
use crate::value::Value;

/// Features whose effects are one parameter's.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ParameterFeatures {
    /// Place of the parameter.
    pub(super) axis: usize,
    /// Its first feature.
    pub(super) first: usize,
    /// The number of features.
    pub(super) count: usize,
}

/// A choice with more values than this is not screened: too many effects for too few trials.
const CHOICES_MAX: usize = 16;
/// Places of a number at which its effect is judged.
const PLACES: usize = 5;

/// The features of all parameters of a space that can be screened, behind a constant.
pub(super) fn parts(space: &Space) -> Vec<ParameterFeatures> {
    let mut first = 1;
    let mut parts = Vec::new();
    for (axis, parameter) in space.parameters().iter().enumerate() {
        let count = match &parameter.domain {
            Domain::Boolean => 1,
            Domain::Categorical { values } if values.len() > CHOICES_MAX => 0,
            Domain::Categorical { values } => values.len(),
            Domain::Integer { min, max, .. } if min == max => 0,
            Domain::Integer { min, max, .. } if max.abs_diff(*min) == 1 => 1,
            Domain::Integer { .. } | Domain::Float { .. } => 2,
        };
        if count > 0 {
            parts.push(ParameterFeatures { axis, first, count });
            first += count;
        }
    }
    parts
}

/// The values of one parameter's features for one of its values, into `features`.
fn write(parameter: &Parameter, value: &Value, features: &mut [f64]) {
    match (&parameter.domain, value) {
        (Domain::Categorical { values }, value) => {
            if let Some(place) = values.iter().position(|other| other == value) {
                features[place] = 1.0;
            }
        }
        (domain, value) => {
            let x = 2.0 * domain.encode(value) - 1.0;
            assert!((-1.0..=1.0).contains(&x), "{x} is beyond the range");
            features[0] = x;
            if features.len() > 1 {
                features[1] = x * x;
            }
        }
    }
}

/// The features of a configuration: those of inactive parameters are zero.
pub(super) fn of(space: &Space, parts: &[ParameterFeatures], configuration: &Configuration) -> Vec<f64> {
    let width = parts.last().map_or(1, |part| part.first + part.count);
    assert!(parts.windows(2).all(|pair| pair[0].first + pair[0].count == pair[1].first), "without gaps");
    let mut features = vec![0.0; width];
    features[0] = 1.0;
    for part in parts {
        let parameter = &space.parameters()[part.axis];
        if let Some(value) = configuration.get(&parameter.name) {
            write(parameter, value, &mut features[part.first..part.first + part.count]);
        }
    }
    features
}

/// One parameter's features at each of its values, or at places spread over its range.
pub(super) fn alternatives(space: &Space, part: &ParameterFeatures) -> Vec<Vec<f64>> {
    let parameter = &space.parameters()[part.axis];
    let values: Vec<Value> = match &parameter.domain {
        Domain::Boolean => vec![Value::Boolean(false), Value::Boolean(true)],
        Domain::Categorical { values } => values.clone(),
        domain => (0..PLACES).map(|place| domain.decode(place as f64 / (PLACES - 1) as f64)).collect(),
    };
    values
        .iter()
        .map(|value| {
            let mut features = vec![0.0; part.count];
            write(parameter, value, &mut features);
            features
        })
        .collect()
}
