//! The worth of measuring a point, against averages of random draws and finite differences.

use super::super::Posterior;
use super::super::acquisition::{confidence_bound, log_expected_improvement, mean_above, probability_below};
use super::*;
use crate::statistics::distribution::{normal_cdf, normal_density};

const DRAWS: usize = 400_000;

fn expected_improvement(best: f64, mean: f64, deviation: f64) -> f64 {
    log_expected_improvement(best, Posterior { mean, deviation }).exp()
}

#[test]
fn its_derivatives_are_the_probability_and_the_density_of_an_improvement() {
    for (best, mean, deviation) in [(0.0, 0.0, 1.0), (3.0, 4.0, 1.0), (3.0, 1.5, 0.5), (-2.0, 1.0, 2.0)] {
        let z = (best - mean) / deviation;
        let step = 1e-5;
        let by_mean = (expected_improvement(best, mean + step, deviation)
            - expected_improvement(best, mean - step, deviation))
            / (2.0 * step);
        assert!((by_mean + normal_cdf(z)).abs() < 1e-8, "{by_mean}");
        let by_deviation = (expected_improvement(best, mean, deviation + step)
            - expected_improvement(best, mean, deviation - step))
            / (2.0 * step);
        assert!((by_deviation - normal_density(z)).abs() < 1e-8, "{by_deviation}");
    }
}

#[test]
fn far_points_are_told_apart_where_the_improvement_itself_vanishes() {
    let log = |z: f64| log_expected_improvement(0.0, Posterior { mean: -z, deviation: 1.0 });
    // To 40 digits by mpmath; from -5 down by another formula.
    for (z, exact) in [
        (-5.0 + 1e-12, -16.744_301_162_690_99),
        (-5.0, -16.744_301_162_690_99),
        (-6.0, -22.578_879_392_169_797),
        (-10.0, -55.553_122_036_122_36),
        (-40.0, -808.298_568_356_62),
        (-1e3, -500_014.734_452_091_16),
    ] {
        assert!((log(z) / exact - 1.0).abs() < 1e-11, "{z}: {} {exact}", log(z));
    }
    let far: Vec<f64> = [-4.0, -8.0, -20.0, -39.0, -60.0, -1e3].into_iter().map(log).collect();
    assert!(far.windows(2).all(|pair| pair[0] > pair[1]) && far.iter().all(|log| log.is_finite()), "{far:?}");
    // A sure gain is worth its size.
    assert!((expected_improvement(50.0, 20.0, 1.0) - 30.0).abs() < 1e-9);
}

#[test]
fn the_normal_distribution_is_the_standard_one() {
    let random = &mut random(2);
    let draws: Vec<f64> = (0..DRAWS).map(|_| standard_normal(random)).collect();
    let mean = draws.iter().sum::<f64>() / DRAWS as f64;
    let square = draws.iter().map(|z| z * z).sum::<f64>() / DRAWS as f64;
    assert!(mean.abs() < 0.01 && (square - 1.0).abs() < 0.01, "{mean} {square}");
    for z in [-2.0, -0.5, 0.0, 1.0, 1.96] {
        let below = draws.iter().filter(|draw| **draw < z).count() as f64 / DRAWS as f64;
        assert!((normal_cdf(z) - below).abs() < 0.005, "{z}");
        let slope = (normal_cdf(z + 1e-5) - normal_cdf(z - 1e-5)) / 2e-5;
        assert!((normal_density(z) - slope).abs() < 1e-9, "{z}");
    }
    assert!((normal_cdf(1.959_963_985) - 0.975).abs() < 1e-9);
}

#[test]
fn noise_and_doubt_blur_the_probability_of_a_low_measurement() {
    let belief = Posterior { mean: 2.0, deviation: 3.0 };
    assert_eq!(probability_below(2.0, belief, 16.0), 0.5);
    // One deviation of the whole, 5, above.
    assert!((probability_below(7.0, belief, 16.0) - normal_cdf(1.0)).abs() < 1e-15);
    assert_eq!(confidence_bound(belief, 0.5), 0.5);
    assert_eq!(confidence_bound(belief, -0.5), 3.5);
}

#[test]
fn the_mean_above_a_bound_is_that_of_a_truncated_normal() {
    let belief = Posterior { mean: 1.0, deviation: 3.0 };
    // Half a normal: the root of two over pi times its deviation above the bound, here 5.
    let half = mean_above(1.0, belief, 16.0);
    assert!((half - 1.0 - 5.0 * (2.0 / std::f64::consts::PI).sqrt()).abs() < 1e-12, "{half}");
    assert!((mean_above(-1e6, belief, 16.0) - 1.0).abs() < 1e-9, "a bound far below says nothing");
    let far = mean_above(1e6, belief, 16.0);
    assert!((1e6..1e6 + 1.0).contains(&far), "a bound far above is all there is: {far}");
    // The hazard by mpmath, at 5 deviations and, by another formula, just above and far above.
    for (z, hazard) in
        [(5.0, 5.186_503_967_125_842), (5.0 + 1e-12, 5.186_503_967_125_842), (40.0, 40.024_968_847_207_26)]
    {
        let mean = mean_above(1.0 + 5.0 * z, belief, 16.0);
        assert!((mean / (1.0 + 5.0 * hazard) - 1.0).abs() < 1e-11, "{z}: {mean}");
    }
    let random = &mut random(3);
    let above: Vec<f64> =
        (0..DRAWS).map(|_| 1.0 + 5.0 * standard_normal(random)).filter(|value| *value > 4.0).collect();
    let average = above.iter().sum::<f64>() / above.len() as f64;
    assert!((mean_above(4.0, belief, 16.0) / average - 1.0).abs() < 0.01, "{average}");
}
