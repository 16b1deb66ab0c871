//! Estimates of the true costs of a state's configurations, and of the gain of the best.
//!
//! The lowest of many noisy measurements is mostly luck: on a landscape of equal costs, the best of 80
//! measurements with 7 % noise looks 15 % better than the rest. The cure is a posterior with a prior that the
//! measurements themselves shape. A choice among posteriors does not inflate its expected value (Smith and
//! Winkler, "The optimizer's curse: skepticism and postdecision surprise in decision analysis", Management
//! Science 52, 2006; empirical Bayes: Efron and Morris, "Stein's estimation rule and its competitors", JASA
//! 68, 1973).
//!
//! The logarithm of a configuration's cost is a level plus a Gaussian process over configurations plus noise.
//! So similar configurations speak for each other, and repeats for themselves. In some of the models a part
//! of a configuration's cost is its own, not even shared with the most similar one: cliffs, and valleys
//! narrower than the distances between measurements (the nugget effect of geostatistics, without error of
//! measurement: Cressie, "Statistics for spatial data", 1993). Repeats separate this part from noise, because
//! it does not change between them. Without it a rough landscape would seem noisy, and real gains would be
//! shrunk away as luck.
//!
//! Machines change their speed, often by more than the gain in question: clocks rise and fall, neighbours
//! come and go. In some of the models all costs of a client are therefore multiplied by one factor whose
//! logarithm wanders about its usual value (a process of Ornstein and Uhlenbeck over the trials; its
//! covariance falls off exponentially with their distance). Trials next to each other then compare well, and
//! trials at different times badly, as with blocks in the design of experiments. Without these models a
//! configuration that only ran in a fast minute would seem fast.
//!
//! The reach of likeness, the landscape's roughness, and the ratio of differences to noise are averaged over
//! a grid of models, each weighed by its marginal likelihood (Hoeting, Madigan, Raftery and Volinsky,
//! "Bayesian model averaging", Statistical Science 14, 1999). The scale is integrated out in closed form
//! (Rasmussen and Williams, "Gaussian processes for machine learning", 2006, section 2.7 for the level). In
//! some of the models all costs are equal: where these are not refuted, the estimated gain is small.

use std::rc::Rc;

use crate::limits::{CELLS_MAX, DRIFT_CELLS_LEAST};
use crate::matrix::{Factor, dot, matern};
use crate::robust::{Moment, NOISE_PRIOR};
use crate::statistics::distribution::{student_cdf, student_excess};

/// Models in which costs differ.
struct Family {
    /// Their probability, all of them together, before anything is measured.
    probability: f64,
    /// The share of the differences' variance that is each configuration's own.
    roughness: f64,
    /// The lengths of likeness: distances in the space of features, in which a parameter's whole range is 1.
    lengths: &'static [f64],
    /// Variances of the differences between configurations, in variances of the noise.
    ratios: &'static [f64],
}

/// The wandering of a machine's speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drift {
    /// Its variance, in variances of the noise.
    variance: f64,
    /// The distance in trials at which the covariance has fallen to 1/e.
    trials: f64,
}

/// The smooth and the rough. The value of the roughness matters little: shares of a tenth or a half give
/// equal results. Rough models have no small ratios, because differences as small as the noise do not stand
/// out, and they have fewer lengths. With a higher prior probability they would believe more luck on flat or
/// smooth landscapes. On rough ones even a small prior is soon overruled.
const FAMILIES: [Family; 2] = [SMOOTH, ROUGH];
const SMOOTH: Family = Family {
    probability: 0.72,
    roughness: 0.0,
    lengths: &[0.15, 0.4, 1.0, 2.5, 6.0],
    ratios: &[0.1, 0.4, 2.0, 10.0, 60.0, 400.0, 4000.0],
};
const ROUGH: Family = Family {
    probability: 0.08,
    roughness: 0.2,
    lengths: &[0.4, 2.5],
    ratios: &[2.0, 10.0, 60.0, 400.0, 4000.0],
};
/// The families on a machine whose speed wanders: fewer models, since each has several drifts.
const FAMILIES_DRIFTING: [Family; 2] = [
    Family { lengths: &[0.4, 1.5, 6.0], ratios: &[0.4, 2.0, 10.0, 60.0, 400.0], ..SMOOTH },
    Family { ratios: &[10.0, 60.0, 400.0], ..ROUGH },
];
/// A machine that is restless from trial to trial, and one that is so from minute to minute.
const DRIFTS: [Drift; 2] = [Drift { variance: 3.0, trials: 8.0 }, Drift { variance: 10.0, trials: 20.0 }];
/// The probability, before anything is measured, that the speed of a machine wanders.
const DRIFT_PRIOR: f64 = 0.4;
/// The probability, before anything is measured, that all costs are equal.
const FLAT_PRIOR: f64 = 0.2;
/// The weight of the prior noise, in measurements.
const NOISE_PRIOR_COUNT: f64 = 3.0;
/// Measurements of a configuration form one cell where they ran within this number of trials: speed does not
/// wander far in that time.
const CELL_TRIALS: u64 = 2;
/// Models of less weight beside the heaviest are left out.
const WEIGHT_LEAST: f64 = 1e-3;
/// Probability that 95 % intervals leave out on either side.
const TAIL: f64 = 0.025;
/// Halvings when a quantile is sought.
const HALVINGS: usize = 50;

/// A measurement of a configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// The logarithm of its cost.
    pub log_cost: f64,
    /// Its client and time; `None` where these are not known.
    pub moment: Option<Moment>,
    /// Its weight in usual measurements: 1, or less for one whose client knows that it is poor.
    pub weight: f64,
}

/// The weighed mean of the logarithms of costs, the sum of the weights, and the weighed sum of squared
/// deviations from the mean.
fn moments_of(measurements: &[Measurement]) -> (f64, f64, f64) {
    let count = measurements.iter().map(|one| one.weight).sum::<f64>();
    let mean = measurements.iter().map(|one| one.weight * one.log_cost).sum::<f64>() / count;
    let square = |one: &Measurement| one.weight * ((one.log_cost - mean) * (one.log_cost - mean));
    (mean, count, measurements.iter().map(square).sum())
}

/// The measurements of one configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigurationSample {
    /// Its place among the configurations.
    pub features: Vec<f64>,
    /// Its measurements, oldest first; at least one.
    pub measurements: Vec<Measurement>,
    /// The weight of each of them: 1, or less for a configuration that is more restless than others.
    pub weight: f64,
}

impl ConfigurationSample {
    /// The weighed sum of squared deviations of the logarithms of its costs from their mean.
    pub fn scatter(&self) -> f64 {
        moments_of(&self.measurements).2
    }
}

/// Measurements of one configuration that ran close to each other.
#[derive(Clone, Debug)]
struct Cell {
    configuration: usize,
    /// The mean of the logarithms of costs.
    mean: f64,
    /// The weighed number of measurements.
    count: f64,
    /// The weighed sum of squared deviations from the mean.
    scatter: f64,
    /// `None` for cells without a time.
    moment: Option<Moment>,
}

/// One model of the grid, fitted.
#[derive(Clone, Debug)]
struct Model {
    weight: f64,
    /// The configuration of each of its cells.
    cells: Rc<[usize]>,
    /// The factor of the covariance between cells.
    factor: Factor,
    /// The likeness of configurations; `None` for a model in which all costs are equal.
    likeness: Option<Rc<[f64]>>,
    /// The variance that like configurations share, and each one's own variance, in variances of the noise.
    shared: f64,
    own: f64,
    #[cfg(test)]
    drifts: bool,
    /// Posterior means of the logarithms of costs.
    means: Vec<f64>,
    /// The part of the level in each mean, and the variance of the level in variances of the noise.
    by_level: Vec<f64>,
    level_variance: f64,
    /// Variance of the noise, and the degrees of freedom of it.
    noise_2: f64,
    freedom: f64,
}

/// The posterior of all configurations of a state.
#[derive(Clone, Debug)]
pub struct CostPosterior {
    models: Vec<Model>,
    configurations: usize,
}

/// The comparison of one configuration with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// The share by which the cost of the first is expected to be below the other's.
    pub gain: f64,
    /// The 95 % interval of that share.
    pub gain_low: f64,
    /// Its upper end.
    pub gain_high: f64,
    /// The probability that the first is the cheaper one; an equal one is not cheaper.
    pub probability_better: f64,
    /// The expected distance of the first below the other, counted as 0 where it is above: a logarithm of a
    /// ratio.
    pub expected_gain: f64,
    /// The expected distance of the first above the other: the expected loss.
    pub expected_loss: f64,
}

impl Comparison {
    /// Whether the expected gain by the first is at least `times` times the expected loss. Equal costs count
    /// as neither, so that a landscape that may be flat is no reason to stay. This is the ratio Omega at a
    /// threshold of no gain (Keating and Shadwick, "A universal performance measure", Journal of Performance
    /// Measurement 6, 2002).
    pub fn is_worth(&self, times: f64) -> bool {
        self.expected_gain > 0.0 && self.expected_gain >= times * self.expected_loss
    }
}

impl CostPosterior {
    /// The posterior of the samples. `distance_2` gives the squared distance between features. `None` for no
    /// samples. The work grows with the cube of their number.
    pub fn of(
        samples: &[ConfigurationSample],
        distance_2: impl Fn(&[f64], &[f64]) -> f64,
    ) -> Option<CostPosterior> {
        let n = samples.len();
        if n == 0 {
            return None;
        }
        let is_measured = |one: &ConfigurationSample| !one.measurements.is_empty() && one.weight > 0.0;
        assert!(samples.iter().all(is_measured), "every configuration was measured");
        let mut distances = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..i {
                let distance = distance_2(&samples[i].features, &samples[j].features);
                assert!(distance >= 0.0, "a squared distance of {distance}");
                (distances[i * n + j], distances[j * n + i]) = (distance, distance);
            }
        }
        let cells = cells(samples);
        assert!(cells.len() >= n, "every configuration has a cell");
        // Only configurations that ran more than once, at different times, show whether speed wanders.
        let in_time = cells.iter().filter(|cell| cell.moment.is_some()).count();
        let may_drift = n > 1 && in_time >= n + DRIFT_CELLS_LEAST;
        let steady = if may_drift { 1.0 - DRIFT_PRIOR } else { 1.0 };
        let mut fitted = Grid::merged(samples, &cells, &distances).fit(&FAMILIES, None, steady);
        let drifts = DRIFTS.into_iter().filter(|_| may_drift);
        let grid = Grid::new(cells, n, &distances);
        for drift in drifts {
            fitted.extend(grid.fit(&FAMILIES_DRIFTING, Some(drift), DRIFT_PRIOR / DRIFTS.len() as f64));
        }
        let heaviest = fitted.iter().map(|(evidence, _)| *evidence).fold(f64::NEG_INFINITY, f64::max);
        let mut models: Vec<Model> = Vec::new();
        for (evidence, mut model) in fitted {
            model.weight = libm::exp(evidence - heaviest);
            if model.weight >= WEIGHT_LEAST {
                models.push(model);
            }
        }
        let sum: f64 = models.iter().map(|model| model.weight).sum();
        assert!(models.is_empty() || sum >= 1.0, "the heaviest alone weighs 1, of {sum}");
        models.iter_mut().for_each(|model| model.weight /= sum);
        (!models.is_empty()).then_some(CostPosterior { models, configurations: n })
    }

    /// The expected logarithm of the cost of each configuration.
    pub fn means(&self) -> Vec<f64> {
        let mut means = vec![0.0; self.configurations];
        for model in &self.models {
            means.iter_mut().zip(&model.means).for_each(|(mean, own)| *mean += model.weight * own);
        }
        means
    }

    /// The noise of the logarithm of one measurement: a standard deviation.
    pub fn noise(&self) -> f64 {
        self.models.iter().map(|model| model.weight * model.noise_2).sum::<f64>().sqrt()
    }

    /// Compares the cost of one configuration with that of another.
    pub fn compare(&self, one: usize, other: usize) -> Comparison {
        let parts: Vec<StudentT> = self.models.iter().map(|model| self.part(model, one, other)).collect();
        // The logarithm of a ratio of costs; above zero the first is cheaper.
        let mean: f64 = parts.iter().map(|part| part.weight * part.mean).sum();
        let (low, high) = interval(&parts);
        let share = |log_ratio: f64| -libm::expm1(-log_ratio);
        // Where the atom of equal costs covers a quantile, halving ends within rounding of it.
        let settled = |x: f64| if x.abs() <= 1e-9 * (1.0 + mean.abs()) { 0.0 } else { x };
        let probability_better = 1.0 - parts.iter().map(|part| part.at_most(0.0)).sum::<f64>();
        assert!((-1e-9..=1.0 + 1e-9).contains(&probability_better), "a probability of {probability_better}");
        Comparison {
            gain: share(mean),
            gain_low: share(settled(low)),
            gain_high: share(settled(high)),
            probability_better,
            expected_gain: parts.iter().map(|part| part.excess(1.0)).sum(),
            expected_loss: parts.iter().map(|part| part.excess(-1.0)).sum(),
        }
    }

    /// The 95 % interval of the logarithm of the cost of a configuration.
    pub fn interval(&self, one: usize) -> (f64, f64) {
        let parts: Vec<StudentT> = self.models.iter().map(|model| self.part_of(model, one)).collect();
        interval(&parts)
    }

    /// One model's distribution of the logarithm of a cost.
    fn part_of(&self, model: &Model, one: usize) -> StudentT {
        let prior = model.shared + model.own;
        let own = model.likeness.as_ref().map_or(0.0, |likeness| {
            let mut with_cells = self.with_cells(model, likeness, one);
            model.factor.forward(&mut with_cells);
            (prior - dot(&with_cells, &with_cells)).max(0.0)
        });
        let by_level = model.by_level[one];
        let variance = own + by_level * by_level * model.level_variance;
        let deviation = (model.noise_2 * variance).sqrt();
        StudentT { weight: model.weight, mean: model.means[one], deviation, freedom: model.freedom }
    }

    /// One model's distribution of the logarithm of a ratio of costs.
    fn part(&self, model: &Model, one: usize, other: usize) -> StudentT {
        let mean = model.means[other] - model.means[one];
        let Some(likeness) = model.likeness.as_ref().filter(|_| one != other) else {
            return StudentT { weight: model.weight, mean, deviation: 0.0, freedom: model.freedom };
        };
        // The variance of the difference: the prior one, less the part that the measurements explain, plus
        // that of the level.
        let mut difference = self.with_cells(model, likeness, one);
        difference.iter_mut().zip(self.with_cells(model, likeness, other)).for_each(|(a, b)| *a -= b);
        model.factor.forward(&mut difference);
        let prior =
            2.0 * model.shared * (1.0 - likeness[one * self.configurations + other]) + 2.0 * model.own;
        let by_level = model.by_level[one] - model.by_level[other];
        let left = (prior - dot(&difference, &difference)).max(0.0);
        let deviation = (model.noise_2 * (left + by_level * by_level * model.level_variance)).sqrt();
        StudentT { weight: model.weight, mean, deviation, freedom: model.freedom }
    }

    /// The covariance of a configuration with each cell.
    fn with_cells(&self, model: &Model, likeness: &[f64], one: usize) -> Vec<f64> {
        let row = &likeness[one * self.configurations..(one + 1) * self.configurations];
        let own = |cell: usize| if cell == one { model.own } else { 0.0 };
        model.cells.iter().map(|&cell| model.shared * row[cell] + own(cell)).collect()
    }
}

/// The measurements as cells. With too many, those of a configuration are one cell without a time.
fn cells(samples: &[ConfigurationSample]) -> Vec<Cell> {
    let mut cells = Vec::new();
    for (configuration, sample) in samples.iter().enumerate() {
        let mut begin = 0;
        for end in 1..=sample.measurements.len() {
            let goes_on = sample.measurements.get(end).is_some_and(|next| {
                let moments = sample.measurements[begin].moment.zip(next.moment);
                moments.is_some_and(|(first, next)| {
                    first.client == next.client && next.time.abs_diff(first.time) < CELL_TRIALS
                })
            });
            if !goes_on {
                cells.push(Cell::of(configuration, &sample.measurements[begin..end], sample.weight));
                begin = end;
            }
        }
    }
    if cells.len() <= CELLS_MAX { cells } else { whole(samples) }
}

/// All measurements of a configuration as one cell, without a time.
fn whole(samples: &[ConfigurationSample]) -> Vec<Cell> {
    let whole = samples.iter().enumerate().map(|(configuration, sample)| Cell {
        moment: None,
        ..Cell::of(configuration, &sample.measurements, sample.weight)
    });
    whole.collect()
}

impl Cell {
    fn of(configuration: usize, measurements: &[Measurement], weight: f64) -> Cell {
        let (mean, count, scatter) = moments_of(measurements);
        let moment = measurements.first().and_then(|first| first.moment);
        Cell { configuration, mean, count: weight * count, scatter: weight * scatter, moment }
    }
}

/// The data that models are fitted to.
struct Grid<'a> {
    cells: Vec<Cell>,
    of: Rc<[usize]>,
    configurations: usize,
    /// Squared distances between configurations.
    distances: &'a [f64],
    /// A term of the logarithm of a likelihood, which makes likelihoods of different cells comparable.
    offset: f64,
}

impl<'a> Grid<'a> {
    fn new(cells: Vec<Cell>, configurations: usize, distances: &'a [f64]) -> Self {
        assert_eq!(distances.len(), configurations * configurations, "a distance of every two");
        assert!(cells.iter().all(|cell| cell.configuration < configurations), "{configurations} are known");
        let of = cells.iter().map(|cell| cell.configuration).collect();
        Grid { cells, of, configurations, distances, offset: 0.0 }
    }

    /// Merges the cells of each configuration, which suffices for a steady machine's models. For these the
    /// means of a configuration's cells are repeats, whose likelihood given their mean does not depend on the
    /// model.
    fn merged(samples: &[ConfigurationSample], cells: &[Cell], distances: &'a [f64]) -> Self {
        let whole = whole(samples);
        let logs = |cells: &[Cell]| cells.iter().map(|cell| libm::log(cell.count)).sum::<f64>();
        let offset = 0.5 * (logs(cells) - logs(&whole));
        Grid { offset, ..Grid::new(whole, samples.len(), distances) }
    }

    /// Fits all models of families, which have a probability together, and the flat one.
    fn fit(&self, families: &[Family], drift: Option<Drift>, probability: f64) -> Vec<(f64, Model)> {
        let n = self.cells.len();
        let noise = self.noise(drift);
        let mut fitted = Vec::new();
        if let Some((evidence, model)) = self.model(noise.clone(), None, (0.0, 0.0)) {
            fitted.push((evidence + libm::log(FLAT_PRIOR * probability), model));
        }
        // With one configuration there are no differences.
        for family in families.iter().filter(|_| self.configurations > 1) {
            let models = (family.lengths.len() * family.ratios.len()) as f64;
            let each = libm::log(family.probability * probability / models);
            for length in family.lengths {
                let alike = self.distances.iter().map(|distance_2| matern(distance_2 / (length * length)).0);
                let alike: Rc<[f64]> = alike.collect();
                for ratio in family.ratios {
                    let (shared, own) = (ratio * (1.0 - family.roughness), ratio * family.roughness);
                    let mut matrix = noise.clone();
                    for i in 0..n {
                        let of = self.cells[i].configuration;
                        let row = &alike[of * self.configurations..(of + 1) * self.configurations];
                        for (entry, cell) in matrix[i * n..=i * n + i].iter_mut().zip(&self.cells) {
                            let rough = if cell.configuration == of { own } else { 0.0 };
                            *entry += shared * row[cell.configuration] + rough;
                        }
                    }
                    let model = self.model(matrix, Some(Rc::clone(&alike)), (shared, own));
                    fitted.extend(model.map(|(evidence, model)| (evidence + each, model)));
                }
            }
        }
        #[cfg(test)]
        fitted.iter_mut().for_each(|(_, model)| model.drifts = drift.is_some());
        fitted
    }

    /// The covariance of the cells' errors, in variances of the noise; the lower triangle.
    fn noise(&self, drift: Option<Drift>) -> Vec<f64> {
        let n = self.cells.len();
        let mut matrix = vec![0.0; n * n];
        for (i, cell) in self.cells.iter().enumerate() {
            matrix[i * n + i] = 1.0 / cell.count + drift.map_or(0.0, |drift| drift.variance);
            let Some((drift, now)) = drift.zip(cell.moment) else { continue };
            for (j, other) in self.cells[..i].iter().enumerate() {
                if let Some(then) = other.moment.filter(|then| then.client == now.client) {
                    let distance = now.time.abs_diff(then.time) as f64;
                    matrix[i * n + j] = drift.variance * libm::exp(-distance / drift.trials);
                }
            }
        }
        matrix
    }

    /// Fits one model: the logarithm of its marginal likelihood, without the terms that all models share, and
    /// its posterior.
    fn model(
        &self,
        matrix: Vec<f64>,
        likeness: Option<Rc<[f64]>>,
        (shared, own): (f64, f64),
    ) -> Option<(f64, Model)> {
        let cells = &self.cells;
        let factor = Factor::of(&matrix, cells.len())?;
        let solved = |mut b: Vec<f64>| {
            factor.forward(&mut b);
            factor.backward(&mut b);
            b
        };
        let of_ones = solved(vec![1.0; cells.len()]);
        let precision: f64 = of_ones.iter().sum();
        let level = of_ones.iter().zip(cells).map(|(w, cell)| w * cell.mean).sum::<f64>() / precision;
        let residuals: Vec<f64> = cells.iter().map(|cell| cell.mean - level).collect();
        let weights = solved(residuals.clone());
        let misfit = dot(&weights, &residuals);
        let count: f64 = cells.iter().map(|cell| cell.count).sum();
        let scatter: f64 = cells.iter().map(|cell| cell.scatter).sum();
        let freedom = NOISE_PRIOR_COUNT + (count - 1.0).max(0.0);
        assert!(freedom >= NOISE_PRIOR_COUNT && scatter >= 0.0, "a scatter of {scatter} in {freedom}");
        let sum = NOISE_PRIOR_COUNT * NOISE_PRIOR * NOISE_PRIOR + misfit.max(0.0) + scatter;
        let evidence = self.offset
            - factor.half_log_determinant()
            - 0.5 * libm::log(precision)
            - 0.5 * freedom * libm::log(sum);
        // The expectation of each configuration apart from the level, and the part of the level that its own
        // measurements leave open.
        let (mut means, mut by_level) = (vec![level; self.configurations], vec![1.0; self.configurations]);
        if let Some(likeness) = &likeness {
            let (mut of_misfits, mut of_levels) =
                (vec![0.0; self.configurations], vec![0.0; self.configurations]);
            for (cell, (w, one)) in cells.iter().zip(weights.iter().zip(&of_ones)) {
                of_misfits[cell.configuration] += w;
                of_levels[cell.configuration] += one;
            }
            for i in 0..self.configurations {
                let row = &likeness[i * self.configurations..(i + 1) * self.configurations];
                means[i] += shared * dot(row, &of_misfits) + own * of_misfits[i];
                by_level[i] -= shared * dot(row, &of_levels) + own * of_levels[i];
            }
        }
        let model = Model {
            weight: 0.0,
            cells: Rc::clone(&self.of),
            factor,
            likeness,
            shared,
            own,
            #[cfg(test)]
            drifts: false,
            means,
            by_level,
            level_variance: 1.0 / precision,
            noise_2: sum / freedom,
            freedom,
        };
        evidence.is_finite().then_some((evidence, model))
    }
}

/// One model's distribution of a logarithm: Student's t.
#[derive(Clone, Copy, Debug)]
struct StudentT {
    weight: f64,
    mean: f64,
    deviation: f64,
    freedom: f64,
}

impl StudentT {
    fn at_most(&self, x: f64) -> f64 {
        let probability = if self.deviation > 0.0 {
            student_cdf((x - self.mean) / self.deviation, self.freedom)
        } else if x >= self.mean {
            1.0
        } else {
            0.0
        };
        self.weight * probability
    }

    /// Its expected distance above zero, counted as 0 where it is below; with `sign` -1 the other way round.
    fn excess(&self, sign: f64) -> f64 {
        let mean = sign * self.mean;
        let excess = if self.deviation > 0.0 {
            self.deviation * student_excess(-mean / self.deviation, self.freedom)
        } else {
            mean.max(0.0)
        };
        self.weight * excess
    }
}

/// The middle 95 % of a mixture.
fn interval(parts: &[StudentT]) -> (f64, f64) {
    let mean: f64 = parts.iter().map(|part| part.weight * part.mean).sum();
    let reach =
        parts.iter().map(|part| (part.mean - mean).abs() + 40.0 * part.deviation).fold(1e-9, f64::max);
    let quantile = |probability: f64| {
        let (mut low, mut high) = (mean - reach, mean + reach);
        for _ in 0..HALVINGS {
            let middle = low + (high - low) / 2.0;
            let at_most: f64 = parts.iter().map(|part| part.at_most(middle)).sum();
            if at_most < probability { low = middle } else { high = middle }
        }
        high
    };
    let (low, high) = (quantile(TAIL), quantile(1.0 - TAIL));
    assert!(low <= high, "an interval from {low} to {high}");
    (low, high)
}

#[cfg(test)]
mod tests;
