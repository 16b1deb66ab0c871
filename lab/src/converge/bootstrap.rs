//! Intervals of any statistic of independent runs, by resampling the runs.
//!
//! Efron's percentile bootstrap is too narrow for the few runs that one waits for. Its percentiles are
//! therefore widened so that for a mean they agree with Student's interval (Hesterberg: What Teachers Should
//! Know About the Bootstrap, The American Statistician 69/4, 2015, "expanded percentile interval").

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use treewright_renderer::statistics::quantile;

const RESAMPLES: usize = 4000;
/// Intervals hold the truth with about this probability.
pub const CONFIDENCE: f64 = 0.95;

/// An estimate and where the truth lies with a probability of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// From all runs together.
    pub estimate: f64,
    /// The 95 % interval; absent for a single run.
    pub range: Option<[f64; 2]>,
}

/// An estimate and its interval with `digits` digits after the point; a dash for none.
pub fn in_words(interval: Option<Interval>, digits: usize) -> String {
    let Some(Interval { estimate, range }) = interval else { return "–".to_owned() };
    let show = |value: f64| format!("{value:.digits$}");
    show(estimate) + &in_brackets(range, show)
}

/// A range as it stands behind its estimate; nothing for none.
pub(crate) fn in_brackets(range: Option<[f64; 2]>, show: impl Fn(f64) -> String) -> String {
    range.map_or_else(String::new, |[low, high]| format!(" [{}, {}]", show(low), show(high)))
}

/// A statistic of `runs` independent runs, given by their numbers. `None` where it cannot be computed.
pub fn interval(runs: usize, statistic: impl Fn(&[usize]) -> Option<f64>) -> Option<Interval> {
    let all: Vec<usize> = (0..runs).collect();
    let estimate = statistic(&all)?;
    let Some(tail) = tail(runs) else { return Some(Interval { estimate, range: None }) };
    let values = resampled(runs, RESAMPLES, runs as u64, statistic);
    let range = [quantile(&values, tail), quantile(&values, 1.0 - tail)];
    Some(Interval { estimate, range: Some(range) })
}

/// The mean of independent values with its interval; `None` where there is none that is a number.
pub(crate) fn mean_of(values: &[f64]) -> Option<Interval> {
    interval(values.len(), |drawn| {
        let sum: f64 = drawn.iter().map(|&run| values[run]).sum();
        (!drawn.is_empty()).then(|| sum / drawn.len() as f64).filter(|mean| mean.is_finite())
    })
}

/// A statistic of resamples of `count` values, given by their numbers, sorted. The seed is fixed.
pub(crate) fn resampled(
    count: usize,
    resamples: usize,
    seed: u64,
    statistic: impl Fn(&[usize]) -> Option<f64>,
) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut drawn = vec![0; count];
    let mut values: Vec<f64> = (0..resamples)
        .filter_map(|_| {
            drawn.fill_with(|| random.random_range(0..count));
            statistic(&drawn)
        })
        .collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The geometric mean of drawn clusters, each the sum of its logarithms and their number; `None` for none.
pub(crate) fn geometric(clusters: &[(f64, usize)], drawn: &[usize]) -> Option<f64> {
    let add = |(sum, count), at: &usize| (sum + clusters[*at].0, count + clusters[*at].1);
    let (sum, count) = drawn.iter().fold((0.0, 0), add);
    (count > 0).then(|| (sum / count as f64).exp())
}

/// Half the width of Student's interval of a mean, in standard errors; `None` without a degree of freedom.
pub(crate) fn student(freedom: f64, confidence: f64) -> Option<f64> {
    Some(StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf((1.0 + confidence) / 2.0))
}

/// Share of the resamples on each side of the interval. `None` for fewer than two runs.
fn tail(runs: usize) -> Option<f64> {
    let freedom = runs.checked_sub(1).filter(|&freedom| freedom > 0)? as f64;
    let student = student(freedom, CONFIDENCE)?;
    Some(Normal::standard().cdf(-student * (runs as f64 / freedom).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(values: &[f64]) -> impl Fn(&[usize]) -> Option<f64> {
        move |drawn| Some(drawn.iter().map(|&run| values[run]).sum::<f64>() / drawn.len() as f64)
    }

    #[test]
    fn means_have_students_interval() {
        let values: Vec<f64> = (0..12).map(|run| f64::from(run * 7 % 12)).collect();
        let found = interval(values.len(), mean(&values)).expect("there is a mean");
        assert_eq!(found.estimate, 5.5);
        // Standard error sqrt(13 / 12), Student's quantile for 11 degrees of freedom 2.201.
        let half = 2.201 * (13.0_f64 / 12.0).sqrt();
        let [low, high] = found.range.expect("twelve runs are enough");
        assert!((low - (5.5 - half)).abs() < 0.25 && (high - (5.5 + half)).abs() < 0.25, "{low} to {high}");
    }

    #[test]
    fn the_truth_lies_in_about_all_but_one_of_twenty() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for runs in [4, 8] {
            let holds = (0..200).filter(|_| {
                let normal =
                    |random: &mut ChaCha8Rng| (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                let values: Vec<f64> = (0..runs).map(|_| normal(&mut random)).collect();
                let range = interval(runs, mean(&values)).and_then(|found| found.range);
                range.is_some_and(|[low, high]| low <= 0.0 && 0.0 <= high)
            });
            let holds = holds.count();
            assert!((172..=199).contains(&holds), "{runs} runs: {holds} of 200");
        }
    }

    #[test]
    fn one_run_has_no_interval_and_none_no_estimate() {
        assert_eq!(interval(1, mean(&[3.0])), Some(Interval { estimate: 3.0, range: None }));
        assert_eq!(interval(0, |_| None), None);
        let same = interval(3, mean(&[2.0; 3])).expect("there is a mean");
        assert_eq!(same, Interval { estimate: 2.0, range: Some([2.0; 2]) });
    }
}
