//! Recursive least squares that stays accurate: the triangular factor of the information matrix, updated by
//! Givens rotations.
//!
//! Source: Golub and Van Loan, "Matrix Computations", 4th edition, section 6.5 (adding a row to a QR
//! factorisation); Haykin, "Adaptive Filter Theory", chapter 15. Covariances, which the textbook recursion
//! updates by subtraction, lose their positive definiteness to rounding after some thousand steps; here only
//! rotations touch the factor, whose condition is the root of that of the normal equations. Old lessons fade,
//! and the prior replaces the lost weight, one axis after the other, so that the factor is never worse
//! conditioned than the prior allows (leakage).

use serde::{Deserialize, Serialize};

use crate::matrix::dot;

/// An old lesson's weight after one more.
const FADE: f64 = 1.0 - 1.0 / 20_000.0;

/// Least squares of values over features with a prior of zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Solver {
    size: usize,
    /// Upper triangular, row after row, each row from its diagonal on.
    rows: Vec<f64>,
    /// The right-hand side, a value for each row.
    right: Vec<f64>,
    /// The prior's weight against one lesson.
    prior: f64,
    lessons: u64,
    /// The coefficients after all lessons so far.
    theta: Vec<f64>,
}

impl Solver {
    /// A solver with the prior alone: coefficients of zero, with the weight of `prior` lessons each.
    pub(super) fn new(size: usize, prior: f64) -> Self {
        let mut rows = vec![0.0; size * (size + 1) / 2];
        let mut at = 0;
        for row in 0..size {
            rows[at] = prior.sqrt();
            at += size - row;
        }
        assert_eq!(at, rows.len(), "a triangle of {size} rows");
        Solver { size, rows, right: vec![0.0; size], prior, lessons: 0, theta: vec![0.0; size] }
    }

    /// The number of learnt lessons.
    pub(super) fn lessons(&self) -> u64 {
        self.lessons
    }

    /// Learns `value` at `features`, which it overwrites.
    pub(super) fn learn(&mut self, features: &mut [f64], value: f64) {
        assert_eq!(features.len(), self.size, "a lesson of other features");
        let fade = FADE.sqrt();
        self.rows.iter_mut().chain(&mut self.right).for_each(|x| *x *= fade);
        let axis = (self.lessons % self.size.max(1) as u64) as usize;
        self.lessons += 1;
        self.rotate(features, value, 0);
        if self.size > 0 {
            // The prior that faded from one axis since its last turn.
            features.fill(0.0);
            features[axis] = (self.prior * (1.0 - FADE) * self.size as f64).sqrt();
            self.rotate(features, 0.0, axis);
        }
        self.solve();
    }

    /// Turns a new row into the triangle, from column `from` on.
    fn rotate(&mut self, row: &mut [f64], mut value: f64, from: usize) {
        let n = self.size;
        let mut at = from * n - from * from.saturating_sub(1) / 2;
        for i in from..n {
            let mine = &mut self.rows[at..at + n - i];
            at += n - i;
            let new = row[i];
            if new == 0.0 {
                continue;
            }
            let length = libm::hypot(mine[0], new);
            let (cosine, sine) = (mine[0] / length, new / length);
            for (mine, row) in mine.iter_mut().zip(&mut row[i..]) {
                let old = *mine;
                *mine = cosine * old + sine * *row;
                *row = cosine * *row - sine * old;
            }
            let old = self.right[i];
            self.right[i] = cosine * old + sine * value;
            value = cosine * value - sine * old;
        }
        assert_eq!(at, self.rows.len(), "from row {from} to the last");
    }

    fn solve(&mut self) {
        let n = self.size;
        let mut end = self.rows.len();
        for i in (0..n).rev() {
            let row = &self.rows[end - (n - i)..end];
            end -= n - i;
            assert!(row[0] > 0.0, "{} on the diagonal of row {i}", row[0]);
            self.theta[i] = (self.right[i] - dot(&row[1..], &self.theta[i + 1..])) / row[0];
        }
        assert_eq!(end, 0, "all rows were solved");
    }

    /// The expected value.
    pub(super) fn value(&self, features: &[f64]) -> f64 {
        dot(&self.theta, features)
    }

    /// The distance of the features from the lessons: `phi' P phi`.
    pub(super) fn leverage(&self, features: &[f64]) -> f64 {
        let n = self.size;
        assert_eq!(features.len(), n, "a point of other features");
        let (mut left, mut at, mut sum) = (features.to_vec(), 0, 0.0);
        for i in 0..n {
            let row = &self.rows[at..at + n - i];
            at += n - i;
            let x = left[i] / row[0];
            sum += x * x;
            left[i + 1..].iter_mut().zip(&row[1..]).for_each(|(left, r)| *left -= x * r);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of wildly different size: the normal equations have a condition of 1e12.
    #[test]
    fn a_condition_of_1e12_is_no_trouble() {
        let truth = [3.0, -2.0, 5.0];
        let scales = [1.0, 1e-3, 1e-6];
        let mut solver = Solver::new(3, 1e-18);
        let mut random = 12_345u64;
        let mut draw = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for _ in 0..3000 {
            let x: Vec<f64> = scales.iter().map(|scale| scale * draw()).collect();
            let y = x.iter().zip(&truth).map(|(x, t)| x * t).sum();
            solver.learn(&mut x.clone(), y);
        }
        for ((theta, truth), scale) in solver.theta.iter().zip(&truth).zip(&scales) {
            assert!((theta - truth).abs() * scale < 1e-9, "{:?}", solver.theta);
            assert!((theta - truth).abs() < 1e-3, "{:?}", solver.theta);
        }
    }

    #[test]
    fn coefficients_are_those_of_the_normal_equations() {
        let rows = [[1.0, 2.0], [0.5, -1.0], [3.0, 0.3], [0.1, 0.2]];
        let values = [1.0, -2.0, 0.5, 4.0];
        let (mut solver, prior) = (Solver::new(2, 0.1), 0.1);
        let (mut a, mut b) = ([[prior, 0.0], [0.0, prior]], [0.0; 2]);
        for (row, value) in rows.iter().zip(values) {
            solver.learn(&mut row.to_vec(), value);
            for i in 0..2 {
                b[i] += row[i] * value;
                (0..2).for_each(|j| a[i][j] += row[i] * row[j]);
            }
        }
        let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        let expected = [
            (a[1][1] * b[0] - a[0][1] * b[1]) / determinant,
            (a[0][0] * b[1] - a[1][0] * b[0]) / determinant,
        ];
        for (theta, expected) in solver.theta.iter().zip(expected) {
            // Four lessons fade by two ten-thousandths.
            assert!((theta - expected).abs() < 1e-3, "{theta} against {expected}");
        }
        let leverage = (a[1][1] - 2.0 * a[0][1] + a[0][0]) / determinant;
        assert!((solver.leverage(&[1.0, 1.0]) - leverage).abs() < 1e-3 * leverage);
    }

    #[test]
    fn ten_million_lessons_at_one_point_leave_it_finite_and_right() {
        let mut solver = Solver::new(4, 0.01);
        let features = [0.3, 0.3, 0.1, 0.0];
        for _ in 0..10_000_000 {
            solver.learn(&mut features.clone(), 2.5);
        }
        assert!((solver.value(&features) - 2.5).abs() < 1e-3, "{}", solver.value(&features));
        // An unseen feature still has its prior, and is not wound up.
        let unseen = solver.leverage(&[0.0, 0.0, 0.0, 1.0]);
        assert!(unseen > 50.0 && unseen < 200.0, "{unseen}");
        assert!(solver.leverage(&features) < 1e-3);
    }
}
