//! Where values lie between the ends of their parameters, and how much of the cost each parameter explains.

use std::collections::BTreeMap;

use treewright_core::space::{Domain, Parameter};
use treewright_core::value::Value;

use super::charts::Axis;

/// Groups of a numeric parameter's values.
const GROUPS: usize = 5;
/// Fewest measurements that say anything of importances.
const MEASUREMENTS_MIN: usize = 8;

/// A parameter's axis.
pub(super) fn axis(parameter: &Parameter) -> Axis {
    let (low, high) = match &parameter.domain {
        Domain::Integer { min, max, .. } => (min.to_string(), max.to_string()),
        Domain::Float { min, max, .. } => (super::charts::figure(*min), super::charts::figure(*max)),
        Domain::Categorical { values } => {
            let end = |value: Option<&Value>| value.map(Value::to_string).unwrap_or_default();
            (end(values.first()), end(values.last()))
        }
        Domain::Boolean => ("false".to_owned(), "true".to_owned()),
    };
    Axis { name: parameter.name.clone(), low, high }
}

/// Where a value lies between its parameter's ends, 0 to 1, on the parameter's own scale.
pub(super) fn place(parameter: &Parameter, value: &Value) -> f64 {
    parameter.domain.encode(value).clamp(0.0, 1.0)
}

/// For each parameter the share of the variance of the logarithm of the cost that groups of its values explain
/// (η²), largest first; empty where there is too little to say. Each run has a place for each parameter, `None` where that
/// is inactive, which is a group of its own.
pub(super) fn importances(parameters: &[Parameter], runs: &[(Vec<Option<f64>>, f64)]) -> Vec<(String, f64)> {
    let logs: Vec<f64> = runs.iter().map(|(_, cost)| cost.max(f64::MIN_POSITIVE).ln()).collect();
    let mean = logs.iter().sum::<f64>() / logs.len().max(1) as f64;
    let total: f64 = logs.iter().map(|log| (log - mean).powi(2)).sum();
    if runs.len() < MEASUREMENTS_MIN || total <= 0.0 {
        return Vec::new();
    }
    let explained = |index: usize| {
        let mut groups: BTreeMap<Option<usize>, Vec<f64>> = BTreeMap::new();
        for ((places, _), log) in runs.iter().zip(&logs) {
            let group = places[index].map(|place| group(&parameters[index].domain, place));
            groups.entry(group).or_default().push(*log);
        }
        let between = groups.values().map(|group| {
            let own = group.iter().sum::<f64>() / group.len() as f64;
            group.len() as f64 * (own - mean).powi(2)
        });
        between.sum::<f64>() / total
    };
    let mut found: Vec<_> =
        parameters.iter().enumerate().map(|(index, one)| (one.name.clone(), explained(index))).collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    found
}

fn group(domain: &Domain, place: f64) -> usize {
    let groups = match domain {
        Domain::Categorical { values } => values.len(),
        Domain::Boolean => 2,
        Domain::Integer { .. } | Domain::Float { .. } => GROUPS,
    };
    ((place * groups as f64) as usize).min(groups.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use treewright_core::space::Space;

    use super::*;

    #[test]
    fn what_matters_is_told_from_what_does_not() {
        let space = Space::builder().boolean("fast").default(false).integer("noise", 1..=100).default(1);
        let space = space.build().expect("a space");
        let runs: Vec<_> = (0..40)
            .map(|index| {
                let (fast, noise) = (f64::from(index % 2), f64::from(index * 37 % 100) / 100.0);
                (vec![Some(0.25 + 0.5 * fast), Some(noise)], 10.0 - 5.0 * fast + 0.1 * noise)
            })
            .collect();
        let found = importances(space.parameters(), &runs);
        assert_eq!(found[0].0, "fast");
        assert!(found[0].1 > 0.95 && found[1].1 < 0.3, "{found:?}");
        assert!(importances(space.parameters(), &runs[..5]).is_empty(), "too few");
    }

    #[test]
    fn places_lie_between_the_ends() {
        let space =
            Space::builder().categorical("kind", ["a", "b", "c"]).default("a").build().expect("a space");
        let kind = &space.parameters()[0];
        let places: Vec<f64> = ["a", "b", "c"].map(|word| place(kind, &Value::from(word))).to_vec();
        assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "{places:?}");
        assert_eq!(axis(kind).high, "c");
    }
}
