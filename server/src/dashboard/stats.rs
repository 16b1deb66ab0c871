//! Places of values between the ends of their parameters, and the share of the cost that each parameter
//! explains.

use std::collections::BTreeMap;

use treewright_core::space::{Domain, Parameter};
use treewright_core::value::Value;

use super::charts::Axis;

/// Groups of a numeric parameter's values.
const GROUPS: usize = 5;
/// Least number of different configurations for importances.
const CONFIGURATIONS_MIN: usize = 20;

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

/// The place of a value between its parameter's ends, 0 to 1, on the parameter's own scale. `None` for a
/// stored value that the parameter cannot have.
pub(super) fn place(parameter: &Parameter, value: &Value) -> Option<f64> {
    parameter.domain.contains(value).then(|| parameter.domain.encode(value))
}

/// A configuration's place for each parameter, `None` where that is inactive, and its cost.
pub(super) type Run = (Vec<Option<f64>>, f64);

/// For each parameter the share of the variance of the logarithm of the cost that groups of its values
/// predict in configurations left out, largest first. Empty where there are too few configurations. Inactive
/// values of a parameter form a separate group. Runs of one configuration count as one, so that few
/// configurations do not seem to explain each other. Estimated as `treewright analyze` does it (Plischke,
/// Borgonovo and Smith, 2013; Allen, 1974).
pub(super) fn importances(parameters: &[Parameter], runs: &[Run]) -> Vec<(String, f64)> {
    debug_assert!(runs.iter().all(|(places, _)| places.len() == parameters.len()));
    let runs = distinct(runs);
    let count = runs.len() as f64;
    let mean = runs.iter().map(|(_, log)| log).sum::<f64>() / count.max(1.0);
    // The squared error of the mean of the others.
    let without = |log: f64, mean: f64, count: f64| ((log - mean) * count / (count - 1.0)).powi(2);
    if runs.len() < CONFIGURATIONS_MIN {
        return Vec::new();
    }
    let total: f64 = runs.iter().map(|(_, log)| without(*log, mean, count)).sum();
    if total <= 0.0 {
        return Vec::new();
    }
    let predicted = |index: usize| {
        let mut groups: BTreeMap<Option<usize>, Vec<f64>> = BTreeMap::new();
        for (places, log) in &runs {
            let group = places[index].map(|place| group(&parameters[index].domain, place));
            groups.entry(group).or_default().push(*log);
        }
        let within = groups.values().map(|group| {
            let size = group.len() as f64;
            let own = group.iter().sum::<f64>() / size;
            let off =
                |log: &f64| if size > 1.0 { without(*log, own, size) } else { without(*log, mean, count) };
            group.iter().map(off).sum::<f64>()
        });
        (1.0 - within.sum::<f64>() / total).clamp(0.0, 1.0)
    };
    let mut found: Vec<_> =
        parameters.iter().enumerate().map(|(index, one)| (one.name.clone(), predicted(index))).collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    debug_assert!(found.iter().all(|(_, share)| (0.0..=1.0).contains(share)), "{found:?} are no shares");
    found
}

/// Different configurations, in the order in which they first appear, with the mean logarithm of their costs.
fn distinct(runs: &[Run]) -> Vec<(&[Option<f64>], f64)> {
    let mut known: BTreeMap<Vec<Option<u64>>, usize> = BTreeMap::new();
    let mut sums: Vec<(&[Option<f64>], f64, f64)> = Vec::new();
    for (places, cost) in runs {
        let key = places.iter().map(|place| place.map(f64::to_bits)).collect();
        let index = *known.entry(key).or_insert(sums.len());
        if index == sums.len() {
            sums.push((places, 0.0, 0.0));
        }
        sums[index].1 += cost.max(f64::MIN_POSITIVE).ln();
        sums[index].2 += 1.0;
    }
    sums.into_iter().map(|(places, sum, count)| (places, sum / count)).collect()
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
        assert!(importances(space.parameters(), &runs[..19]).is_empty(), "too few");
        let again: Vec<_> = (0..5).flat_map(|_| runs[..19].to_vec()).collect();
        assert!(importances(space.parameters(), &again).is_empty(), "repeats are no more configurations");
    }

    /// Each run is predicted by the mean of the others of its group, or of all others where it is alone.
    #[test]
    fn an_importance_is_the_share_that_others_of_a_group_predict() {
        let space = Space::builder().boolean("fast").default(false).integer("size", 1..=100).default(1);
        let space = space.build().expect("a space");
        let runs: Vec<Run> = (0..31)
            .map(|index| {
                let (fast, size) = (f64::from(u8::from(index % 3 == 0)), f64::from(index) / 31.0);
                let cost = (1.0 - 0.4 * fast + 0.3 * size + 0.1 * f64::from(index * 7 % 5)).exp();
                (vec![Some(0.25 + 0.5 * fast).filter(|_| index != 6), Some(size)], cost)
            })
            .collect();
        let mean_but = |of: &[usize], but: usize| {
            let others: Vec<f64> =
                of.iter().filter(|one| **one != but).map(|one| runs[*one].1.ln()).collect();
            (!others.is_empty()).then(|| others.iter().sum::<f64>() / others.len() as f64)
        };
        let all: Vec<usize> = (0..runs.len()).collect();
        for (name, share) in importances(space.parameters(), &runs) {
            let axis = space.parameters().iter().position(|one| one.name == name).expect("a parameter");
            let group_of =
                |run: usize| runs[run].0[axis].map(|place| group(&space.parameters()[axis].domain, place));
            let (mut off, mut total) = (0.0, 0.0);
            for run in &all {
                let group: Vec<usize> =
                    all.iter().copied().filter(|one| group_of(*one) == group_of(*run)).collect();
                let plain = mean_but(&all, *run).expect("there are others");
                total += (runs[*run].1.ln() - plain).powi(2);
                off += (runs[*run].1.ln() - mean_but(&group, *run).unwrap_or(plain)).powi(2);
            }
            let expected = (1.0 - off / total).clamp(0.0, 1.0);
            assert!((share - expected).abs() < 1e-9, "{name}: {share} for {expected}");
            assert!(name != "fast" || share > 0.05, "{name}: {share}");
        }
    }

    #[test]
    fn places_lie_between_the_ends() {
        let space =
            Space::builder().categorical("kind", ["a", "b", "c"]).default("a").build().expect("a space");
        let kind = &space.parameters()[0];
        let places: Vec<Option<f64>> = ["a", "b", "c"].map(|word| place(kind, &Value::from(word))).to_vec();
        assert!(places.iter().all(Option::is_some), "{places:?}");
        assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "{places:?}");
        for foreign in [Value::from("d"), Value::Integer(1), Value::Boolean(true)] {
            assert_eq!(place(kind, &foreign), None, "{foreign}");
        }
        assert_eq!(axis(kind).high, "c");
    }
}
