//! What both predictors promise, and how well the radial basis model learns.

use proptest::prelude::*;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::rbf::feature_count;
use super::*;
use crate::space::{Domain, Parameter, Scale, Space};
use crate::value::Value;

fn space(dimension: usize) -> Space {
    let parameter = |index: usize| Parameter {
        name: format!("p{index}"),
        domain: Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear },
        default: Value::Float(0.5),
        active_if: None,
    };
    Space::new((0..dimension).map(parameter).collect(), vec![]).expect("a valid space")
}

/// A cost whose best action follows the state.
fn cost(state: &[f64], point: &[f64]) -> f64 {
    1.0 + state.iter().zip(point).map(|(s, p)| 3.0 * (s - p).powi(2)).sum::<f64>()
}

fn lesson<'a>(
    state: &'a [f64],
    configuration: &'a Configuration,
    point: &'a [f64],
    verdict: Verdict,
) -> Lesson<'a> {
    Lesson { state, configuration, point, verdict, default_cost: Some(cost(state, &[0.5; 3])) }
}

/// Trains on random pairs of state and configuration, `scale` times the cost.
fn trained(trials: usize, scale: f64) -> Rbf {
    let space = space(3);
    let mut model = Rbf::new(3, 3, 11);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..trials {
        let state: [f64; 3] = std::array::from_fn(|_| random.random());
        let x: [f64; 3] = std::array::from_fn(|_| random.random());
        let configuration = space.decode(&x);
        let point = space.encode(&configuration);
        model.learn(&lesson(&state, &configuration, &point, Verdict::Cost(scale * cost(&state, &point))));
    }
    model
}

fn ask(model: &Rbf, state: &[f64]) -> Option<Answer> {
    model.predict(&Query { state, here: None, known: &[] })
}

#[test]
fn the_feature_count_is_the_papers() {
    assert_eq!(feature_count(11, 17), 98);
    assert_eq!(feature_count(1, 0), 4);
}

#[test]
fn the_radial_basis_model_learns_a_smooth_function() {
    let (space, model) = (space(3), trained(6000, 1.0));
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let (mut error, mut chosen, mut default, mut rewards) = (0.0, 0.0, 0.0, Vec::new());
    for _ in 0..200 {
        let state: [f64; 3] = std::array::from_fn(|_| random.random());
        let point: [f64; 3] = std::array::from_fn(|_| random.random());
        let reward = 1.0 / cost(&state, &point);
        error += (model.value_at(&state, &point) - reward).abs() / 200.0;
        rewards.push(reward);
        let answer = ask(&model, &state).expect("trained");
        chosen += cost(&state, &space.encode(&answer.configuration)) / 200.0;
        default += cost(&state, &[0.5; 3]) / 200.0;
        assert!(answer.predicted_cost.is_some_and(f64::is_finite));
    }
    // The best that a model could do which ignores state and action.
    let mean = rewards.iter().sum::<f64>() / 200.0;
    let constant = rewards.iter().map(|reward| (reward - mean).abs()).sum::<f64>() / 200.0;
    assert!(error < 0.85 * constant, "mean error {error}, of a constant {constant}");
    assert!(chosen < 1.0 + 0.6 * (default - 1.0), "chosen {chosen}, default {default}");
}

#[test]
fn the_choice_does_not_depend_on_the_unit_of_the_cost() {
    // Powers of two leave every rounding as it is, so even the bytes agree.
    for scale in [2f64.powi(-20), 2f64.powi(30)] {
        let (plain, scaled) = (trained(500, 1.0), trained(500, scale));
        for step in 0..20 {
            let state = [f64::from(step) / 20.0, 0.3, 0.7];
            let (a, b) = (ask(&plain, &state).expect("trained"), ask(&scaled, &state).expect("trained"));
            assert_eq!(a.configuration, b.configuration);
            assert_eq!(a.predicted_cost.map(|cost| cost * scale), b.predicted_cost);
        }
    }
}

#[test]
fn infeasible_configurations_lose_their_value() {
    let (space, mut model) = (space(3), trained(2000, 1.0));
    let state = [0.2, 0.8, 0.4];
    let before = ask(&model, &state).expect("trained");
    let point = space.encode(&before.configuration);
    let value = model.value_at(&state, &point);
    for _ in 0..20 {
        model.learn(&lesson(&state, &before.configuration, &point, Verdict::Infeasible));
    }
    assert!(model.value_at(&state, &point) < 0.3 * value);
    // A bound that the model respects already changes nothing.
    let untouched = model.clone();
    model.learn(&lesson(&state, &before.configuration, &point, Verdict::AtLeast(1e-9)));
    assert_eq!(model, untouched);
}

proptest! {
    #![proptest_config(crate::testing::cases(32))]

    #[test]
    fn the_model_stays_finite_whatever_it_is_told(
        costs in prop::collection::vec((0usize..6, 0.0f64..1.0), 1..200), far in 0usize..4,
    ) {
        let space = space(3);
        let mut model = Rbf::new(3, 3, 1);
        for (index, (kind, at)) in costs.iter().enumerate() {
            let verdict = match kind {
                0 => Verdict::Cost(0.0),
                1 => Verdict::Cost(f64::MAX),
                2 => Verdict::Cost(5e-324),
                3 => Verdict::Infeasible,
                4 => Verdict::AtLeast(1e300),
                _ => Verdict::Cost(1e-3 + at),
            };
            let outlier = if index % 4 == far { 1e9 } else { *at };
            let configuration = space.decode(&[*at, 1.0 - at, 0.5]);
            let point = space.encode(&configuration);
            model.learn(&lesson(&[outlier, *at, 0.1], &configuration, &point, verdict));
            prop_assert!(model.is_finite());
            if let Some(answer) = ask(&model, &[0.5; 3]) {
                prop_assert!(answer.predicted_cost.is_none_or(|cost| cost.is_finite() && cost >= 0.0));
            }
        }
    }
}
