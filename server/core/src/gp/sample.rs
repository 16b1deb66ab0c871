//! The points that a process is fitted to, and the correlations between them.

use super::hyper::Hyperparameters;
use super::kernel::{FeatureKind, add_squared_distances, centred, linear_terms, squared_distance};
use crate::matrix::{dot, matern};

/// The points, and the number of measurements of each.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    pub(super) kinds: Vec<FeatureKind>,
    /// Features, point by point.
    rows: Vec<f64>,
    /// Features, feature by feature.
    pub(super) columns: Vec<Vec<f64>>,
    pub(super) counts: Vec<f64>,
    /// Features as the trend sees them, point by point.
    centred: Vec<f64>,
    pub(super) linear: Option<usize>,
    /// The linear feature and its parts of all points, term by term (see [`linear_terms`]).
    pub(super) terms: Vec<Vec<f64>>,
    /// Squared distances along each feature of each pair of points `p > q`, pair by pair; see
    /// [`Sample::prepared`].
    pairs: Option<Vec<f64>>,
}

impl Sample {
    /// `points` are features, one for each of `kinds`, and then the parts of the linear feature, if it has
    /// any. `counts`, above 0, are the numbers of measurements of each point, by which its noise is divided.
    pub(crate) fn new(kinds: Vec<FeatureKind>, points: &[&[f64]], counts: Vec<f64>) -> Self {
        assert_eq!(points.len(), counts.len(), "every point has its count");
        let width = kinds.len();
        let parts = points.first().map_or(0, |point| point.len().saturating_sub(width));
        assert!(points.iter().all(|point| point.len() == width + parts), "{width} features, {parts} parts");
        debug_assert!(counts.iter().all(|count| *count >= 0.0), "counts are not below zero");
        let columns: Vec<Vec<f64>> =
            (0..width).map(|axis| points.iter().map(|point| point[axis]).collect()).collect();
        let centred = points.iter().flat_map(|point| centred(&kinds, *point)).collect();
        let linear = kinds.iter().position(|kind| *kind == FeatureKind::Linear);
        assert!(kinds.iter().filter(|kind| **kind == FeatureKind::Linear).count() <= 1, "one linear feature");
        assert!(parts == 0 || linear.is_some(), "{parts} parts of nothing");
        let by_point: Vec<Vec<f64>> = points.iter().map(|point| linear_terms(&kinds, *point)).collect();
        let count = by_point.first().map_or(0, Vec::len);
        let terms = (0..count).map(|term| by_point.iter().map(|terms| terms[term]).collect()).collect();
        let rows = points.iter().flat_map(|point| &point[..width]).copied().collect();
        Sample { rows, columns, counts, centred, linear, terms, pairs: None, kinds }
    }

    /// Computes the distances of all pairs once, for a sample that will be fitted many times.
    pub(crate) fn prepared(mut self) -> Self {
        let mut pairs = Vec::with_capacity(self.len() * self.len() / 2 * self.dimension());
        for p in 0..self.len() {
            for q in 0..p {
                pairs.extend(self.distances_of(p, q));
            }
        }
        self.pairs = Some(pairs);
        self
    }

    pub(crate) fn len(&self) -> usize {
        self.counts.len()
    }

    pub(super) fn dimension(&self) -> usize {
        self.kinds.len()
    }

    pub(super) fn parts(&self) -> usize {
        self.terms.len().saturating_sub(1)
    }

    fn row(&self, point: usize) -> &[f64] {
        &self.rows[point * self.dimension()..(point + 1) * self.dimension()]
    }

    pub(super) fn centred(&self, point: usize) -> &[f64] {
        &self.centred[point * self.dimension()..(point + 1) * self.dimension()]
    }

    fn distances_of(&self, p: usize, q: usize) -> impl Iterator<Item = f64> + '_ {
        let features = self.row(p).iter().zip(self.row(q));
        self.kinds.iter().zip(features).map(|(&kind, (&a, &b))| squared_distance(kind, a, b))
    }

    /// Squared distances of points `p > q` along each feature, not weighted.
    pub(super) fn distances<'a>(&'a self, p: usize, q: usize, scratch: &'a mut Vec<f64>) -> &'a [f64] {
        assert!(q < p && p < self.len(), "{q} and {p} are no pair");
        let dimension = self.dimension();
        match &self.pairs {
            Some(pairs) => {
                let pair = p * (p - 1) / 2 + q;
                &pairs[pair * dimension..(pair + 1) * dimension]
            }
            None => {
                scratch.clear();
                scratch.extend(self.distances_of(p, q));
                scratch
            }
        }
    }

    /// The correlations of all points, with noise on the diagonal, and the derivatives of the kernel by the
    /// squared distance: full rows, whose lower triangle counts.
    pub(super) fn correlations(&self, hyper: &Hyperparameters) -> (Vec<f64>, Vec<f64>) {
        let (n, dimension) = (self.len(), self.dimension());
        let (weights, trend) = (hyper.weights(dimension), hyper.trend(dimension));
        let (mut matrix, mut slopes) = (vec![0.0; n * n], vec![0.0; n * n]);
        for p in 0..n {
            let row = &mut matrix[p * n..p * n + p];
            match &self.pairs {
                Some(pairs) => {
                    let pairs =
                        pairs[p * p.saturating_sub(1) / 2 * dimension..].chunks_exact(dimension.max(1));
                    row.iter_mut().zip(pairs).for_each(|(squared, pair)| *squared = dot(&weights, pair));
                }
                None => add_squared_distances(&self.kinds, &weights, self.row(p), &self.columns, row),
            }
            for (entry, slope) in row.iter_mut().zip(&mut slopes[p * n..]) {
                (*entry, *slope) = matern(*entry);
            }
            matrix[p * n + p] = 1.0 + hyper.noise(dimension) / self.counts[p];
            if let Some(linear) = self.linear {
                for column in &self.terms {
                    let own = weights[linear] * column[p];
                    let row = matrix[p * n..=p * n + p].iter_mut();
                    row.zip(column).for_each(|(sum, other)| *sum += own * other);
                }
            }
            if trend > 0.0 {
                let weighted: Vec<f64> = weights.iter().zip(self.centred(p)).map(|(w, x)| w * x).collect();
                for q in 0..=p {
                    let root = 1.0 + dot(&weighted, self.centred(q));
                    matrix[p * n + q] += trend * (root * root);
                }
            }
        }
        (matrix, slopes)
    }
}
