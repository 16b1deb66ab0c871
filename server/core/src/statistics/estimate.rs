//! What the configurations of a state really cost, and what the best of them gains.
//!
//! The lowest of many noisy measurements is mostly luck: on a landscape where everything costs the same, the best of 80
//! measurements with 7 % noise looks 15 % better than the rest. The cure is a posterior with a prior that the
//! measurements themselves shape: expected values of a choice among posteriors are not inflated by the choice (Smith and
//! Winkler, "The optimizer's curse: skepticism and postdecision surprise in decision analysis", Management Science 52,
//! 2006; empirical Bayes: Efron and Morris, "Stein's estimation rule and its competitors", JASA 68, 1973).
//!
//! The logarithm of a configuration's cost is a level plus a Gaussian process over configurations plus noise; similar
//! configurations so speak for each other, and repeats for themselves. In some of the models a part of what a
//! configuration costs is its own, shared with not even the most similar one: cliffs, and valleys narrower than the
//! distances between what was measured (the nugget effect of geostatistics, as far as it is not error of measurement:
//! Cressie, "Statistics for spatial data", 1993). Unlike noise that is the same in each repeat, which tells the two apart;
//! without it a rough landscape is taken for a noisy one, and what was really found is shrunk away as luck.
//!
//! How far likeness reaches, how rough the landscape is, and how large the differences are beside the noise is not
//! estimated but averaged over a grid, each model weighed by its marginal likelihood (Hoeting, Madigan, Raftery and
//! Volinsky, "Bayesian model averaging", Statistical Science 14, 1999), and the scale is integrated out in closed form
//! (Rasmussen and Williams, "Gaussian processes for machine learning", 2006, section 2.7 for the level). One of the
//! models says that all configurations cost the same: where it is not refuted, little gain is told.

use crate::matrix::Factor;
use crate::statistics::distribution::student_cdf;

/// Models in which costs differ.
struct Family {
    /// Their probability, all of them together, before anything is measured.
    probability: f64,
    /// The share of the differences' variance that is each configuration's own.
    roughness: f64,
    /// How far likeness reaches: distances in the space of features, in which a parameter's whole range is 1.
    lengths: &'static [f64],
    /// Variances of the differences between configurations, in variances of the noise.
    ratios: &'static [f64],
}

/// The smooth and the rough. How rough matters little: shares of a tenth or a half find the same. Differences as small as
/// the noise are not told apart from it, so that rough models are left out there, and their lengths can be fewer. The more
/// probable they are beforehand, the more luck is believed where the landscape is flat or smooth; where it is rough, even a
/// small probability is soon overruled.
const FAMILIES: [Family; 2] = [
    Family {
        probability: 0.72,
        roughness: 0.0,
        lengths: &[0.15, 0.4, 1.0, 2.5, 6.0],
        ratios: &[0.1, 0.4, 2.0, 10.0, 60.0, 400.0, 4000.0],
    },
    Family {
        probability: 0.08,
        roughness: 0.2,
        lengths: &[0.4, 2.5],
        ratios: &[2.0, 10.0, 60.0, 400.0, 4000.0],
    },
];
/// The probability, before anything is measured, that all configurations cost the same.
const FLAT_PRIOR: f64 = 0.2;
/// The noise of logarithms of costs that is expected beforehand, and how many measurements that is worth.
const NOISE_PRIOR: f64 = 0.05;
const NOISE_PRIOR_COUNT: f64 = 3.0;
/// Models of less weight beside the heaviest are left out.
const WEIGHT_LEAST: f64 = 1e-3;
/// What 95 % intervals leave out on either side.
const TAIL: f64 = 0.025;
/// Halvings when a quantile is sought.
const HALVINGS: usize = 50;

/// The measurements of one configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigurationSample {
    /// Its place among the configurations.
    pub features: Vec<f64>,
    /// Mean of the logarithms of its costs.
    pub mean: f64,
    /// How many measurements there are; of a configuration that is more restless than others, fewer than it ran.
    pub count: f64,
    /// The sum of their squared deviations from the mean.
    pub scatter: f64,
}

/// One model of the grid, fitted.
#[derive(Clone, Debug)]
struct Model {
    weight: f64,
    /// `None` for the model in which everything costs the same.
    factor: Option<Factor>,
    /// CostPosterior means of the logarithms of costs.
    means: Vec<f64>,
    /// How much the level moves each mean, and the variance of the level in variances of the noise.
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
    counts: Vec<f64>,
}

/// How one configuration compares with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// By which share the cost of the first is expected to be below the other's.
    pub gain: f64,
    /// The 95 % interval of that share.
    pub gain_low: f64,
    /// Its upper end.
    pub gain_high: f64,
    /// The probability that the first is the cheaper one; what is equal is not cheaper.
    pub probability_better: f64,
}

/// The covariance of Matérn with smoothness 5/2 at a squared distance in lengths.
fn matern(distance_2: f64) -> f64 {
    let r = (5.0 * distance_2).sqrt();
    (1.0 + r + r * r / 3.0) * libm::exp(-r)
}

impl CostPosterior {
    /// The posterior of what was measured. `distance_2` gives the squared distance between features. `None` for no
    /// samples. The work grows with the cube of their number.
    pub fn of(
        samples: &[ConfigurationSample],
        distance_2: impl Fn(&[f64], &[f64]) -> f64,
    ) -> Option<CostPosterior> {
        let n = samples.len();
        if n == 0 {
            return None;
        }
        let mut distances = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..i {
                distances[i * n + j] = distance_2(&samples[i].features, &samples[j].features);
            }
        }
        let fits = |likeness: &[f64], ratio: f64, roughness: f64| -> Option<(f64, Model)> {
            let shared = ratio * (1.0 - roughness);
            let mut matrix: Vec<f64> = likeness.iter().map(|alike| shared * alike).collect();
            (0..n).for_each(|i| matrix[i * n + i] = ratio + 1.0 / samples[i].count);
            fit(samples, Some(Factor::of(&matrix, n)?))
        };
        let mut fitted: Vec<(f64, Model)> = Vec::new();
        if let Some((evidence, model)) = fit(samples, None) {
            fitted.push((evidence + libm::log(FLAT_PRIOR), model));
        }
        // With one configuration there are no differences.
        for Family { probability, roughness, lengths, ratios } in FAMILIES.iter().filter(|_| n > 1) {
            let each = libm::log(probability / (lengths.len() * ratios.len()) as f64);
            for length in *lengths {
                let mut likeness = vec![0.0; n * n];
                for i in 1..n {
                    let row = i * n..i * n + i;
                    let below = likeness[row.clone()].iter_mut().zip(&distances[row]);
                    below.for_each(|(alike, distance_2)| *alike = matern(distance_2 / (length * length)));
                }
                let models = ratios.iter().filter_map(|&ratio| fits(&likeness, ratio, *roughness));
                fitted.extend(models.map(|(evidence, model)| (evidence + each, model)));
            }
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
        models.iter_mut().for_each(|model| model.weight /= sum);
        let counts = samples.iter().map(|sample| sample.count).collect();
        (!models.is_empty()).then_some(CostPosterior { models, counts })
    }

    /// The expected logarithm of the cost of each configuration.
    pub fn means(&self) -> Vec<f64> {
        let mut means = vec![0.0; self.counts.len()];
        for model in &self.models {
            means.iter_mut().zip(&model.means).for_each(|(mean, own)| *mean += model.weight * own);
        }
        means
    }

    /// The noise of the logarithm of one measurement: a standard deviation.
    pub fn noise(&self) -> f64 {
        self.models.iter().map(|model| model.weight * model.noise_2).sum::<f64>().sqrt()
    }

    /// The probability that all configurations cost the same.
    pub fn flat_probability(&self) -> f64 {
        self.models.iter().filter(|model| model.factor.is_none()).map(|model| model.weight).sum()
    }

    /// Compares the cost of one configuration with that of another.
    pub fn compare(&self, one: usize, other: usize) -> Comparison {
        let parts: Vec<StudentT> = self.models.iter().map(|model| self.part(model, one, other)).collect();
        // The logarithm of a ratio of costs; above zero the first is cheaper.
        let mean: f64 = parts.iter().map(|part| part.weight * part.mean).sum();
        let (low, high) = interval(&parts);
        let share = |log_ratio: f64| -libm::expm1(-log_ratio);
        // Where the atom of equal costs covers a quantile, halving comes to within rounding of it.
        let settled = |x: f64| if x.abs() <= 1e-9 * (1.0 + mean.abs()) { 0.0 } else { x };
        Comparison {
            gain: share(mean),
            gain_low: share(settled(low)),
            gain_high: share(settled(high)),
            probability_better: 1.0 - parts.iter().map(|part| part.at_most(0.0)).sum::<f64>(),
        }
    }

    /// The 95 % interval of the logarithm of the cost of a configuration.
    pub fn interval(&self, one: usize) -> (f64, f64) {
        let parts: Vec<StudentT> = self.models.iter().map(|model| self.part_of(model, one)).collect();
        interval(&parts)
    }

    /// What one model says of the logarithm of a cost.
    fn part_of(&self, model: &Model, one: usize) -> StudentT {
        let own = model.factor.as_ref().map_or(0.0, |factor| {
            let mut noise = vec![0.0; self.counts.len()];
            noise[one] = 1.0 / self.counts[one];
            factor.forward(&mut noise);
            let explained: f64 = noise.iter().map(|x| x * x).sum();
            (1.0 / self.counts[one] - explained).max(0.0)
        });
        let by_level = model.by_level[one];
        let variance = own + by_level * by_level * model.level_variance;
        let deviation = (model.noise_2 * variance).sqrt();
        StudentT { weight: model.weight, mean: model.means[one], deviation, freedom: model.freedom }
    }

    /// What one model says of the logarithm of a ratio of costs.
    fn part(&self, model: &Model, one: usize, other: usize) -> StudentT {
        let mean = model.means[other] - model.means[one];
        let Some(factor) = model.factor.as_ref().filter(|_| one != other) else {
            return StudentT { weight: model.weight, mean, deviation: 0.0, freedom: model.freedom };
        };
        let n = self.counts.len();
        // Of the difference: both noises, less what the process explains, and what the level adds.
        let mut difference = vec![0.0; n];
        difference[one] = 1.0 / self.counts[one];
        difference[other] = -1.0 / self.counts[other];
        let own = 1.0 / self.counts[one] + 1.0 / self.counts[other];
        factor.forward(&mut difference);
        let explained: f64 = difference.iter().map(|x| x * x).sum();
        let by_level = model.by_level[one] - model.by_level[other];
        let variance = (own - explained).max(0.0) + by_level * by_level * model.level_variance;
        let deviation = (model.noise_2 * variance).sqrt();
        StudentT { weight: model.weight, mean, deviation, freedom: model.freedom }
    }
}

/// What one model says of a logarithm: a variable of Student's.
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
    (quantile(TAIL), quantile(1.0 - TAIL))
}

/// Fits one model: the logarithm of its marginal likelihood, and its posterior. Without a factor everything costs the
/// same.
fn fit(samples: &[ConfigurationSample], factor: Option<Factor>) -> Option<(f64, Model)> {
    let n = samples.len();
    // The inverse of the covariance of the means, times something.
    let solved = |mut b: Vec<f64>| {
        match &factor {
            Some(factor) => {
                factor.forward(&mut b);
                factor.backward(&mut b);
            }
            None => b.iter_mut().zip(samples).for_each(|(b, sample)| *b *= sample.count),
        }
        b
    };
    let half_log_determinant = match &factor {
        Some(factor) => factor.half_log_determinant(),
        None => -0.5 * samples.iter().map(|sample| libm::log(sample.count)).sum::<f64>(),
    };
    let of_ones = solved(vec![1.0; n]);
    let precision: f64 = of_ones.iter().sum();
    let level = of_ones.iter().zip(samples).map(|(w, sample)| w * sample.mean).sum::<f64>() / precision;
    let residuals: Vec<f64> = samples.iter().map(|sample| sample.mean - level).collect();
    let weights = solved(residuals.clone());
    let misfit: f64 = weights.iter().zip(&residuals).map(|(w, r)| w * r).sum();
    let repeats: f64 = samples.iter().map(|sample| sample.count - 1.0).sum();
    let scatter: f64 = samples.iter().map(|sample| sample.scatter).sum();
    let freedom = NOISE_PRIOR_COUNT + (n - 1) as f64 + repeats;
    let sum = NOISE_PRIOR_COUNT * NOISE_PRIOR * NOISE_PRIOR + misfit.max(0.0) + scatter;
    let evidence = -half_log_determinant - 0.5 * libm::log(precision) - 0.5 * freedom * libm::log(sum);
    let is_flat = factor.is_none();
    let means = samples.iter().zip(&weights).map(|(sample, w)| match is_flat {
        true => level,
        false => sample.mean - w / sample.count,
    });
    let model = Model {
        weight: 0.0,
        means: means.collect(),
        by_level: of_ones.iter().zip(samples).map(|(w, sample)| w / sample.count).collect(),
        level_variance: 1.0 / precision,
        noise_2: sum / freedom,
        freedom,
        factor,
    };
    evidence.is_finite().then_some((evidence, model))
}

#[cfg(test)]
mod tests;
