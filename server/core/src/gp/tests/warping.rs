//! The transformations through which processes see costs.

use super::super::warping::{RobustLog, ShiftedLog};

const COSTS: [f64; 7] = [3.0, 1.0, 10.0, 2.5, 400.0, 2.0, 5.0];

#[test]
fn the_jacobian_of_a_view_agrees_with_finite_differences() {
    // The least cost is 1, the median of those above it 5; with both held, a view is a function of each cost
    // alone.
    let views = |costs: &[f64]| ShiftedLog::new(costs).views();
    // The unit in which the Jacobian counts is their distance.
    let unit = 5.0 - 1.0;
    for (view, (_, jacobian)) in views(&COSTS).into_iter().enumerate() {
        let mut sum = 0.0;
        for index in (0..COSTS.len()).filter(|index| COSTS[*index] != 1.0 && COSTS[*index] != 5.0) {
            let moved = |by: f64| {
                let mut costs = COSTS;
                costs[index] += by;
                views(&costs)[view].0[index]
            };
            sum += (unit * (moved(1e-4) - moved(-1e-4)) / 2e-4).ln();
        }
        // These two themselves have the slope of the logarithm.
        let values = &views(&COSTS)[view].0;
        sum -= values[1] + values[6];
        assert!((sum - jacobian).abs() < 1e-4, "{view}: {sum} {jacobian}");
    }
}

#[test]
fn views_keep_the_order_and_do_not_depend_on_the_unit() {
    let views = ShiftedLog::new(&COSTS).views();
    assert_eq!(views.len(), 4);
    for (values, _) in &views {
        for (a, cost_a) in values.iter().zip(COSTS) {
            for (b, cost_b) in values.iter().zip(COSTS) {
                assert_eq!(a.total_cmp(b), cost_a.total_cmp(&cost_b));
            }
        }
    }
    for unit in [1e-9, 0.37, 1e12] {
        let scaled = ShiftedLog::new(&COSTS.map(|cost| unit * cost));
        assert_eq!(scaled.views(), views, "{unit}");
    }
    let mut equal = ShiftedLog::new(&[5.0; 4]).views().into_iter();
    assert!(equal.all(|(values, jacobian)| values.iter().chain([&jacobian]).all(|value| value.is_finite())));
}

#[test]
fn a_deviation_in_a_view_is_a_share_of_the_least_cost() {
    let costs = [10.0, 12.0, 14.0, 30.0];
    let warping = ShiftedLog::new(&costs);
    for (view, (values, _)) in warping.views().iter().enumerate() {
        // A small step up from the least cost, there and back.
        let step = 1e-6;
        let mut moved = costs.to_vec();
        moved.push(10.0 + step);
        let above = ShiftedLog::new(&moved).views()[view].0[4] - values[0];
        let share = warping.relative(view, above);
        assert!((share / (step / 10.0) - 1.0).abs() < 0.05, "{view}: {share}");
    }
    assert_eq!(ShiftedLog::new(&[0.0, 1.0]).relative(0, 1.0), 0.0);
}

#[test]
fn the_robust_logarithm_has_an_inverse_and_draws_outliers_in() {
    let warping = RobustLog::of(&COSTS).expect("positive");
    let mut sorted = COSTS;
    sorted.sort_by(f64::total_cmp);
    assert!(sorted.windows(2).all(|pair| warping.see(pair[0]) < warping.see(pair[1])));
    for cost in sorted.into_iter().chain([1e-3, 1e4]) {
        assert!((warping.cost(warping.see(cost)) / cost - 1.0).abs() < 1e-9, "{cost}");
    }
    assert_eq!(warping.see(3.0), 0.0, "zero at the median");
    assert!(warping.see(400.0) < (400.0f64 / 3.0).ln(), "an outlier is drawn in");
    assert!((warping.see(2.5) - (2.5f64 / 3.0).ln()).abs() < 1e-15, "what is near is not");
}

#[test]
fn the_robust_logarithm_needs_a_median_above_zero_and_no_unit() {
    assert_eq!(RobustLog::of(&[]), None);
    assert_eq!(RobustLog::of(&[0.0, 0.0, 1.0]), None);
    let (plain, scaled) = (RobustLog::of(&COSTS), RobustLog::of(&COSTS.map(|cost| 8.0 * cost)));
    let (plain, scaled) = (plain.expect("positive"), scaled.expect("positive"));
    assert!(COSTS.iter().all(|&cost| plain.see(cost) == scaled.see(8.0 * cost)));
    assert!(plain.cost(1e6).is_finite() && plain.see(f64::MAX).is_finite());
}

#[test]
fn beyond_two_distances_of_the_quartiles_values_grow_by_another_logarithm() {
    let drawn_in = |log: f64, scale: f64| 2.0 * scale + scale * ((log - 2.0 * scale) / scale).ln_1p();
    let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
    // Quartiles of 2.5 and 10 are the logarithm of 4 apart.
    let warping = RobustLog::of(&COSTS).expect("positive");
    assert!(close(warping.see(400.0), drawn_in((400.0f64 / 3.0).ln(), 4.0f64.ln())));
    // Where the quartiles are equal, the extremes are taken to lie where values begin to be drawn in.
    let alike = RobustLog::of(&[0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 8.0]).expect("positive");
    assert!(close(alike.see(64.0), drawn_in(64.0f64.ln(), 16.0f64.ln() / 2.0)), "{}", alike.see(64.0));
    assert!(alike.see(1e6) < 1e6f64.ln());
    // Where all are equal, nothing is drawn in.
    let equal = RobustLog::of(&[3.0; 5]).expect("positive");
    assert!(close(equal.see(6e5), 2e5f64.ln()));
    assert!(RobustLog::of(&[f64::MIN_POSITIVE; 3]).is_some());
}
