//! Location, scale and change of repeated measurements that a few wild ones do not disturb.
//!
//! Frame times have a long tail: another process, a page fault, a clock that falls. The mean follows every
//! one of them. The estimator of Hodges and Lehmann ("Estimates of location based on rank tests", 1963) is
//! the median of all means of two. For Gaussian noise it is as good as the mean but for 5 %. It stands while
//! fewer than 29 % of the measurements are wild. With one or two measurements it is their mean.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::limits::EVIDENCE_MAX;

/// The median absolute deviation times this estimates the standard deviation of a Gaussian.
pub const MAD_TO_DEVIATION: f64 = 1.4826;
/// Deviations from the location beyond which a measurement is an outlier.
const OUTLIER: f64 = 5.0;
/// Number of measurements that must agree before one can be called an outlier.
const OUTLIER_AFTER: usize = 4;
/// Number of recent measurements that are compared with all older ones that are kept.
const RECENT: usize = 5;
/// Least number of older ones.
const OLDER_LEAST: usize = 8;
/// Standard errors between recent and older measurements that are a change. With 5, Gaussian noise raises a
/// false alarm about once in ten thousand measurements (see the tests).
const CHANGE: f64 = 5.0;
/// Smaller changes than this share are not worth an alarm, and scales below it are not believed.
const SHARE_LEAST: f64 = 0.01;

/// Factor above which two or three measurements of one configuration contradict one another. One of them
/// comes from a clock that was read wrongly, or from a program that ended early.
pub const TORN: f64 = 10.0;
/// The reach of belief: the largest distance of a single measurement from the middle of all configurations'
/// costs, in deviations of their logarithms, and its least value.
const REACH: f64 = 6.0;
const REACH_LEAST: f64 = std::f64::consts::LN_10;
/// Least number of configurations before the reach is judged.
pub const REACH_AFTER: usize = 6;
/// Deviations beyond which one of several measurements counts as if it were no further away.
const WILD: f64 = 4.0;
/// The least deviation that is assumed for logarithms of measurements.
pub(crate) const SPREAD_LEAST: f64 = 0.005;

/// The noise of one measurement, relative to its cost, that is assumed before anything was measured twice.
pub(crate) const NOISE_PRIOR: f64 = 0.05;
/// That noise where frames are compared: a tenth.
pub(crate) const FRAME_NOISE_PRIOR: f64 = 0.1;
/// The least noise that is assumed: timers and clocks are not better.
pub(crate) const NOISE_LEAST: f64 = 0.01;

/// The least that a measurement counts for, in usual ones.
const WEIGHT_LEAST: f64 = 1e-3;

/// Weight of all configurations' noise in that of one, in measurements of its own.
pub(crate) const USUAL_COUNT: f64 = 4.0;

/// The location of Hodges and Lehmann; 0 of nothing. Costs are finite and not negative.
pub fn location(values: &[f64]) -> f64 {
    let mut means: Vec<f64> = Vec::with_capacity(values.len() * (values.len() + 1) / 2);
    for (index, a) in values.iter().enumerate() {
        // Halved first, because the sum of two large costs could leave the range of a double.
        means.extend(values[index..].iter().map(|b| a / 2.0 + b / 2.0));
    }
    median(&mut means)
}

/// Whether two costs, finite and not negative, lie further apart than by the factor [`TORN`].
pub fn is_torn(a: f64, b: f64) -> bool {
    a.max(b) > TORN * a.min(b)
}

/// The places of those measurements of one configuration that count. The estimators of this module take care
/// of more than three. Fewer may be [torn](is_torn). Of three the middle one then counts, with its near ones.
/// Of two it is the one nearer to the `usual` cost of other configurations, else the lower, because
/// disturbances seldom make a program faster.
pub fn trusted(values: &[f64], usual: Option<f64>) -> Vec<usize> {
    let log = |value: f64| libm::log(value.max(f64::MIN_POSITIVE));
    let believed = match *values {
        [a, b] if is_torn(a, b) => {
            let far = |value: f64| usual.map_or(value, |usual| (log(value) - log(usual)).abs());
            if far(a) <= far(b) { a } else { b }
        }
        [a, b, c] => median(&mut [a, b, c]),
        _ => return (0..values.len()).collect(),
    };
    let places: Vec<usize> = (0..values.len()).filter(|&place| !is_torn(values[place], believed)).collect();
    assert!(!places.is_empty(), "{believed} itself counts");
    places
}

/// The reach of belief for the logarithm of a single measurement, where those of all configurations have this
/// deviation.
pub fn reach_of(deviation: f64) -> f64 {
    (REACH * deviation).max(REACH_LEAST)
}

/// Draws logarithms of costs in which several others contradict. Of fewer than four none does.
pub fn draw_in(logs: &mut [f64]) {
    if logs.len() >= OUTLIER_AFTER {
        let middle = location(logs);
        let reach = WILD * deviation(logs, middle).max(SPREAD_LEAST);
        logs.iter_mut().for_each(|log| *log = log.clamp(middle - reach, middle + reach));
    }
}

/// The median absolute deviation from a location, as an estimate of the standard deviation.
pub fn deviation(values: &[f64], location: f64) -> f64 {
    let mut distances: Vec<f64> = values.iter().map(|value| (value - location).abs()).collect();
    MAD_TO_DEVIATION * median(&mut distances)
}

/// The median, the mean of the middle two of an even number; 0 of nothing.
pub fn median(values: &mut [f64]) -> f64 {
    let count = values.len();
    if count == 0 {
        return 0.0;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(count / 2, f64::total_cmp);
    if count % 2 == 1 {
        return upper;
    }
    let lower = below.iter().copied().max_by(f64::total_cmp).unwrap_or(upper);
    lower / 2.0 + upper / 2.0
}

/// The median, the lower of the middle two of an even number: always one of the values. `None` of nothing.
pub fn lower_median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().checked_sub(1)? / 2).copied()
}

/// The client of a measurement, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Moment {
    /// A number of its own for each client.
    pub client: u64,
    /// The trial's number, by which time is counted.
    pub time: u64,
}

/// The last measurements of one configuration in one state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    recent: Vec<f64>,
    /// When each was measured, where that is known.
    moments: Vec<Option<Moment>>,
    /// The standard error of each as a share of it, 0 where its client gave none; empty where all gave none.
    #[serde(default)]
    errors: Vec<f64>,
}

/// The kind of a measurement beside the earlier ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deviation {
    /// Nothing out of the common.
    Usual,
    /// It is far from all before.
    Outlier,
    /// Costs have changed by this factor for good; earlier measurements are forgotten.
    Changed(f64),
}

impl Evidence {
    fn check(&self) {
        assert_eq!(self.recent.len(), self.moments.len(), "every measurement has its moment");
        assert!([0, self.recent.len()].contains(&self.errors.len()), "{} errors", self.errors.len());
        assert!(self.recent.len() <= EVIDENCE_MAX, "{} measurements are kept", self.recent.len());
    }

    /// Takes a measurement.
    pub fn push(&mut self, cost: f64, moment: Option<Moment>) -> Deviation {
        let outlier = self.recent.len() >= OUTLIER_AFTER && {
            let usual = location(&self.recent);
            let scale = deviation(&self.recent, usual).max(SHARE_LEAST * usual);
            (cost - usual).abs() > OUTLIER * scale
        };
        if self.recent.len() == EVIDENCE_MAX {
            self.forget(0..1);
        }
        self.recent.push(cost);
        self.moments.push(moment);
        if !self.errors.is_empty() {
            self.errors.push(0.0);
        }
        self.check();
        if let Some(factor) = self.change() {
            self.forget(0..self.recent.len() - RECENT);
            return Deviation::Changed(factor);
        }
        if outlier { Deviation::Outlier } else { Deviation::Usual }
    }

    fn forget(&mut self, places: Range<usize>) {
        self.recent.drain(places.clone());
        self.moments.drain(places.clone());
        if !self.errors.is_empty() {
            self.errors.drain(places);
        }
        self.check();
    }

    /// Notes the standard error of the latest measurement, as a share of it.
    pub fn note_error(&mut self, error: f64) {
        self.errors.resize(self.recent.len(), 0.0);
        if let Some(last) = self.errors.last_mut() {
            *last = error;
        }
        self.check();
    }

    /// The weight of a measurement in usual ones, whose standard deviation as a share is `noise`. Its own
    /// variance adds to theirs.
    pub fn weight(&self, place: usize, noise: f64) -> f64 {
        let (usual, error) = (noise * noise, self.errors.get(place).copied().unwrap_or_default());
        if error > 0.0 { (usual / (usual + error * error)).max(WEIGHT_LEAST) } else { 1.0 }
    }

    /// The mean weight of its measurements; `None` where no standard error is known.
    pub fn mean_weight(&self, noise: impl FnOnce() -> f64) -> Option<f64> {
        if self.errors.is_empty() {
            return None;
        }
        let noise = noise();
        let sum: f64 = (0..self.errors.len()).map(|place| self.weight(place, noise)).sum();
        Some(sum / self.errors.len() as f64)
    }

    /// The factor by which the last measurements differ from those before, if they clearly do. Then no recent
    /// one lies among the older ones but for a single outlier of these, and their locations are far apart.
    fn change(&self) -> Option<f64> {
        let older = self.recent.len().checked_sub(RECENT).filter(|&older| older >= OLDER_LEAST)?;
        let (old, new) = self.recent.split_at(older);
        let (before, now) = (location(old), location(new));
        let scale = deviation(old, before).max(deviation(new, now)).max(SHARE_LEAST * before.min(now));
        let error = scale * (1.0 / old.len() as f64 + 1.0 / RECENT as f64).sqrt();
        let between = old.iter().filter(|&&value| {
            if now > before { new.iter().any(|n| *n <= value) } else { new.iter().any(|n| *n >= value) }
        });
        let apart = (now - before).abs() > (CHANGE * error).max(SHARE_LEAST * before) && between.count() <= 1;
        let factor = now / before;
        (apart && factor.is_finite() && factor > 0.0).then_some(factor)
    }

    /// The measurements, oldest first.
    pub fn values(&self) -> &[f64] {
        &self.recent
    }

    /// When they were made, in their order.
    pub fn moments(&self) -> &[Option<Moment>] {
        &self.moments
    }

    /// The last measurement, and when it was made.
    pub fn latest(&self) -> Option<(f64, Option<Moment>)> {
        Some((*self.recent.last()?, *self.moments.last()?))
    }

    /// Whether there are so few measurements, so far apart, that they alone do not show which of them count.
    pub fn is_torn(&self) -> bool {
        matches!(*self.recent, [a, b] if is_torn(a, b))
    }

    /// The typical cost, beside the `usual` one of other configurations where that is known.
    pub fn location(&self, usual: Option<f64>) -> f64 {
        let believed: Vec<f64> =
            trusted(&self.recent, usual).into_iter().map(|place| self.recent[place]).collect();
        location(&believed)
    }

    /// The standard deviation of the logarithm of one measurement: of what is kept and of `usual`, that of
    /// other configurations, which counts as four measurements. It is above the usual one where a
    /// configuration is restless by itself, as a builder is whose threads meet by chance.
    pub fn log_deviation(&self, usual: f64) -> f64 {
        let believed = trusted(&self.recent, None).into_iter();
        let mut logs: Vec<f64> =
            believed.map(|place| libm::log(self.recent[place].max(f64::MIN_POSITIVE))).collect();
        draw_in(&mut logs);
        let count = logs.len() as f64;
        let mean = logs.iter().sum::<f64>() / count.max(1.0);
        let scatter: f64 = logs.iter().map(|log| (log - mean) * (log - mean)).sum();
        let freedom = USUAL_COUNT + (count - 1.0).max(0.0);
        ((USUAL_COUNT * usual * usual + scatter) / freedom).sqrt()
    }

    /// Multiplies the kept measurements, because the machine has changed its speed.
    pub fn scale(&mut self, factor: f64) {
        for cost in &mut self.recent {
            *cost = (*cost * factor).min(f64::MAX);
        }
    }

    /// Takes the measurement of a trial back, whose cost may have been scaled since. Where it is not known
    /// which trial measured, that is the latest of this cost. `false` where it is not kept.
    pub fn take_back(&mut self, trial: u64, cost: f64) -> bool {
        let is_known = |moment: &Option<Moment>| moment.is_some_and(|moment| moment.time == trial);
        let is_alike = |place: &usize| self.moments[*place].is_none() && self.recent[*place] == cost;
        let place = self.moments.iter().rposition(is_known);
        if let Some(place) = place.or_else(|| (0..self.recent.len()).rev().find(is_alike)) {
            self.forget(place..place + 1);
            return true;
        }
        false
    }

    /// Drops the latest measurement.
    pub fn drop_latest(&mut self) {
        self.forget(self.recent.len().saturating_sub(1)..self.recent.len());
    }

    /// The latest measurements as they are understood now, each with the number of its trial.
    pub fn restate(&mut self, costs: &[(u64, f64)]) {
        let latest = &costs[costs.len().saturating_sub(EVIDENCE_MAX)..];
        let is_of = |trial: u64| move |moment: &Option<Moment>| moment.is_some_and(|one| one.time == trial);
        let known = latest.iter().map(|(trial, _)| self.moments.iter().position(is_of(*trial)));
        let known: Vec<Option<usize>> = known.collect();
        if !self.errors.is_empty() {
            self.errors = known.iter().map(|place| place.map_or(0.0, |place| self.errors[place])).collect();
        }
        self.moments = known.into_iter().map(|place| self.moments[place?]).collect();
        self.recent = latest.iter().map(|(_, cost)| *cost).collect();
        self.check();
    }

    /// The number of kept measurements.
    pub fn count(&self) -> usize {
        self.recent.len()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::randomness::standard_normal as normal;

    fn of(costs: &[f64]) -> Evidence {
        let mut evidence = Evidence::default();
        for cost in costs {
            let _ = evidence.push(*cost, None);
        }
        evidence
    }

    #[test]
    fn the_location_is_that_of_hodges_and_lehmann() {
        assert_eq!(location(&[]), 0.0);
        assert_eq!(location(&[3.0]), 3.0);
        assert_eq!(location(&[1.0, 2.0]), 1.5);
        // Of 1, 2 and 9 the means of two are 1, 1.5, 2, 5, 5.5 and 9.
        assert_eq!(location(&[9.0, 1.0, 2.0]), 3.5);
        assert_eq!(location(&[f64::MAX, f64::MAX]), f64::MAX);
        // Four of fifteen may be wild.
        let mut values = vec![10.0; 11];
        values.extend([1e9, 1e300, 1e12, 1e15]);
        assert_eq!(location(&values), 10.0);
        assert_eq!(deviation(&[8.0, 9.0, 10.0, 11.0, 12.0], 10.0), MAD_TO_DEVIATION);
    }

    #[test]
    fn one_wild_measurement_is_counted_and_does_not_move_the_location() {
        let mut evidence = Evidence::default();
        for step in 0..8 {
            assert_eq!(evidence.push(10.0 + 0.05 * f64::from(step % 3), None), Deviation::Usual);
        }
        assert_eq!(evidence.push(10_000.0, None), Deviation::Outlier);
        assert!((evidence.location(None) - 10.05).abs() < 0.05, "{}", evidence.location(None));
    }

    #[test]
    fn a_change_is_found_within_five_measurements_and_ages_what_was_before() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for factor in [0.5, 1.5] {
            let mut evidence = Evidence::default();
            for _ in 0..12 {
                evidence.push(10.0 * (0.05 * normal(&mut random)).exp(), None);
            }
            let found = (0..7).find_map(|step| match evidence.push(10.0 * factor, None) {
                Deviation::Changed(by) => Some((step, by)),
                _ => None,
            });
            let (step, by) = found.expect("a change by half");
            assert!(step <= 4 && (by / factor - 1.0).abs() < 0.1, "{step} {by}");
            assert!((evidence.location(None) / (10.0 * factor) - 1.0).abs() < 0.05);
        }
    }

    #[test]
    fn a_restless_configuration_has_a_deviation_of_its_own() {
        let deviation = |costs: &[f64]| of(costs).log_deviation(0.05);
        assert_eq!(deviation(&[10.0]), 0.05);
        assert!(deviation(&[10.0, 10.0, 10.0, 10.0]) < 0.04);
        assert!(deviation(&[141.7, 118.2, 155.5, 120.1, 283.7, 121.5, 491.0]) > 0.3);
    }

    #[test]
    fn standard_errors_stay_with_their_measurements() {
        let moment = |time| Some(Moment { client: 1, time });
        let mut evidence = Evidence::default();
        let _ = evidence.push(10.0, moment(1));
        assert_eq!((evidence.weight(0, 0.1), evidence.mean_weight(|| 0.1)), (1.0, None));
        for (time, error) in [(2, 0.1), (3, 0.2)] {
            let _ = evidence.push(10.0, moment(time));
            evidence.note_error(error);
        }
        let _ = evidence.push(10.0, moment(4));
        let weights = |evidence: &Evidence| -> Vec<f64> {
            (0..evidence.count()).map(|place| (100.0 * evidence.weight(place, 0.1)).round()).collect()
        };
        assert_eq!(weights(&evidence), [100.0, 50.0, 20.0, 100.0]);
        assert!((evidence.mean_weight(|| 0.1).expect("two errors") - 0.675).abs() < 1e-12);
        assert!(evidence.take_back(1, 10.0));
        assert_eq!(weights(&evidence), [50.0, 20.0, 100.0]);
        evidence.restate(&[(3, 9.0), (7, 9.0), (2, 9.0)]);
        assert_eq!(weights(&evidence), [20.0, 100.0, 50.0]);
        evidence.drop_latest();
        assert_eq!(weights(&evidence), [20.0, 100.0]);
        for time in 10..10 + EVIDENCE_MAX as u64 {
            let _ = evidence.push(9.0, moment(time));
        }
        assert!(weights(&evidence).iter().all(|weight| *weight == 100.0));
    }

    #[test]
    fn one_absurd_measurement_among_few_is_passed_over() {
        for wild in [0.0, 1e-300, 1.7e15, f64::MAX] {
            for count in 2..8 {
                for place in 0..count {
                    let mut costs = vec![50.0; count];
                    costs[place] = wild;
                    let evidence = of(&costs);
                    let (location, deviation) = (evidence.location(Some(60.0)), evidence.log_deviation(0.05));
                    assert!((location / 50.0 - 1.0).abs() < 1e-9, "{costs:?}: {location}");
                    assert!(deviation < 0.06, "{costs:?}: {deviation}");
                }
            }
        }
        let alone = of(&[1.7e15, 50.0]).location(None);
        assert_eq!(alone, 50.0, "the lower one where nothing else is known");
        assert_eq!(of(&[40.0, 60.0]).location(Some(1.0)), 50.0, "what lies together counts");
        assert_eq!(of(&[0.0, 0.0]).location(Some(1.0)), 0.0);
    }

    #[test]
    fn noise_is_no_change() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let (mut alarms, pushes) = (0, 40_000);
        let mut evidence = Evidence::default();
        for _ in 0..pushes {
            let cost = 10.0 * (0.07 * normal(&mut random)).exp();
            alarms += u32::from(matches!(evidence.push(cost, None), Deviation::Changed(_)));
        }

        assert!(alarms <= 10, "{alarms} alarms in {pushes}");
    }

    #[test]
    fn extremes_stay_finite() {
        for costs in [[0.0, 0.0, 0.0], [f64::MAX, f64::MIN_POSITIVE, 5e-324], [f64::MAX, f64::MAX, 0.0]] {
            let mut evidence = Evidence::default();
            for index in 0..60 {
                if let Deviation::Changed(factor) = evidence.push(costs[(index / 5) % 3], None) {
                    assert!(factor.is_finite() && factor > 0.0);
                }
                assert!(evidence.location(None).is_finite());
            }
            evidence.scale(f64::MAX);
            assert!(evidence.location(None).is_finite() && evidence.count() <= EVIDENCE_MAX);
        }
    }
}
