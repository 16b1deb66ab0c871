//! The little linear algebra that models need: symmetric positive definite matrices, dense, of at most a few
//! hundred rows, and what fills them.

/// A symmetric positive definite matrix as its lower Cholesky factor, row after row, full rows.
#[derive(Clone, Debug)]
pub(crate) struct Factor {
    size: usize,
    rows: Vec<f64>,
}

/// Added to the diagonal, relative to its largest entry, when a factorisation fails; tenfold each time.
const JITTER: f64 = 1e-10;

impl Factor {
    /// Factorises `matrix` (`size` by `size`, lower triangle used). Where rounding has made it indefinite,
    /// the diagonal is raised until it is definite; `None` only for entries that are not finite.
    pub(crate) fn of(matrix: &[f64], size: usize) -> Option<Factor> {
        assert_eq!(matrix.len(), size * size, "a matrix is square");
        let largest = (0..size).map(|i| matrix[i * size + i]).fold(0.0, f64::max);
        let mut jitter = 0.0;
        for _ in 0..10 {
            let mut rows = matrix.to_vec();
            (0..size).for_each(|i| rows[i * size + i] += jitter);
            if factorise(&mut rows, size) {
                return Some(Factor { size, rows });
            }
            jitter = if jitter == 0.0 { JITTER * largest } else { 10.0 * jitter };
        }
        None
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.rows[i * self.size..i * self.size + i + 1]
    }

    /// Row `i` of `L` times `v`.
    pub(crate) fn times_row(&self, i: usize, v: &[f64]) -> f64 {
        assert_eq!(v.len(), self.size, "a vector of another size");
        dot(self.row(i), &v[..i + 1])
    }

    pub(crate) fn half_log_determinant(&self) -> f64 {
        (0..self.size).map(|i| libm::log(self.row(i)[i])).sum()
    }

    /// Solves `L y = b` in place.
    pub(crate) fn forward(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.size, "a right-hand side of another size");
        for i in 0..self.size {
            let row = self.row(i);
            b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
        }
    }

    /// Solves `Lᵀ x = b` in place.
    pub(crate) fn backward(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.size, "a right-hand side of another size");
        for i in (0..self.size).rev() {
            let row = self.row(i);
            b[i] /= row[i];
            let x = b[i];
            b[..i].iter_mut().zip(row).for_each(|(b, l)| *b -= l * x);
        }
    }

    /// The inverse of the matrix, full.
    pub(crate) fn inverse(&self) -> Vec<f64> {
        let n = self.size;
        // Row j of `columns` is column j of the inverse factor: zero before j.
        let mut columns = vec![0.0; n * n];
        for j in 0..n {
            let column = &mut columns[j * n..(j + 1) * n];
            column[j] = 1.0 / self.row(j)[j];
            for i in j + 1..n {
                let row = self.row(i);
                column[i] = -dot(&row[j..i], &column[j..i]) / row[i];
            }
        }
        let mut inverse = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                // Both columns are zero before the later one begins.
                let sum = dot(&columns[i * n + i..(i + 1) * n], &columns[j * n + i..(j + 1) * n]);
                inverse[i * n + j] = sum;
                inverse[j * n + i] = sum;
            }
        }
        inverse
    }
}

fn factorise(a: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        let (above, rest) = a.split_at_mut(i * n);
        let row = &mut rest[..n];
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        // A pivot of rounding errors alone is no pivot.
        if !pivot.is_finite() || pivot <= 1e-14 * row[i].abs() {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
}

/// The scalar product, in eight partial sums: the order of summation is fixed, and the loop vectorises.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    debug_assert_eq!(a.len(), b.len(), "vectors of one length");
    let mut sums = [0.0; 8];
    let (chunks, others) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = chunks.remainder().iter().zip(others.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in chunks.zip(others) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f64>() + tail
}

pub(crate) fn distance_2(a: &[f64], b: &[f64]) -> f64 {
    debug_assert_eq!(a.len(), b.len(), "points of one space");
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The correlation at a squared distance, and its derivative by the squared distance: Matérn 5/2.
pub(crate) fn matern(squared: f64) -> (f64, f64) {
    debug_assert!(squared.is_nan() || squared >= 0.0, "a squared distance of {squared}");
    let a = (5.0 * squared).sqrt();
    let decay = libm::exp(-a);
    ((1.0 + a + a * a / 3.0) * decay, -5.0 / 6.0 * (1.0 + a) * decay)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_the_identity() {
        for n in [1, 2, 7, 40] {
            // Correlations that fall off with the distance of rows.
            let entry = |k: usize| (-((k / n) as f64 - (k % n) as f64).powi(2)).exp();
            let matrix: Vec<f64> = (0..n * n).map(entry).collect();
            let factor = Factor::of(&matrix, n).expect("positive definite");
            let inverse = factor.inverse();
            for i in 0..n {
                for j in 0..n {
                    let entry: f64 = (0..n).map(|k| matrix[i * n + k] * inverse[k * n + j]).sum();
                    assert!((entry - f64::from(u8::from(i == j))).abs() < 1e-8, "{n}: {i}, {j}");
                }
            }
            let v: Vec<f64> = (0..n).map(|i| (i as f64).sin() + 0.1).collect();
            let mut solved = v.clone();
            factor.forward(&mut solved);
            let by_factor = dot(&solved, &solved);
            let direct: f64 = (0..n).map(|i| v[i] * dot(&inverse[i * n..(i + 1) * n], &v)).sum();
            assert!((direct - by_factor).abs() < 1e-6 * by_factor);
            factor.backward(&mut solved);
            let by_inverse = |i: usize| dot(&inverse[i * n..(i + 1) * n], &v);
            assert!((0..n).all(|i| (solved[i] - by_inverse(i)).abs() < 1e-8 * (1.0 + solved[i].abs())));
        }
    }
}
