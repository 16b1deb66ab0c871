//! The little linear algebra that predictors need: symmetric positive definite matrices, dense, of at most a
//! few hundred rows.

/// A symmetric positive definite matrix as its lower Cholesky factor, row after row, full rows.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    size: usize,
    rows: Vec<f64>,
}

/// Added to the diagonal, relative to its largest entry, when a factorisation fails; tenfold each time.
const JITTER: f64 = 1e-10;

impl Factor {
    /// Factorises `matrix` (`size` by `size`, lower triangle used). Where rounding has made it indefinite the
    /// diagonal is raised until it is not; `None` only for entries that are not finite.
    pub(super) fn of(matrix: &[f64], size: usize) -> Option<Factor> {
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

    /// Solves `L y = b` in place.
    pub(super) fn forward(&self, b: &mut [f64]) {
        for i in 0..b.len() {
            let row = &self.rows[i * self.size..i * self.size + i + 1];
            b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
        }
    }

    /// Solves `Lᵀ x = b` in place.
    pub(super) fn backward(&self, b: &mut [f64]) {
        for i in (0..b.len()).rev() {
            let row = &self.rows[i * self.size..i * self.size + i + 1];
            b[i] /= row[i];
            let x = b[i];
            b[..i].iter_mut().zip(row).for_each(|(b, l)| *b -= l * x);
        }
    }

    /// The inverse of the matrix, full.
    pub(super) fn inverse(&self) -> Vec<f64> {
        let n = self.size;
        let mut inverse = vec![0.0; n * n];
        for j in 0..n {
            let column = &mut inverse[j * n..(j + 1) * n];
            column[j] = 1.0;
            self.forward(column);
            self.backward(column);
        }
        inverse
    }
}

fn factorise(rows: &mut [f64], size: usize) -> bool {
    for i in 0..size {
        let (done, rest) = rows.split_at_mut(i * size);
        let row = &mut rest[..size];
        for j in 0..i {
            let other = &done[j * size..j * size + j + 1];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
}

/// The scalar product. Eight sums side by side, always in the same order: the compiler may use vectors, and
/// every machine gets the same bits.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut sums, n) = ([0.0; 8], a.len().min(b.len()));
    let (a_eights, b_eights) = (a[..n].chunks_exact(8), b[..n].chunks_exact(8));
    let rest: f64 = a_eights.remainder().iter().zip(b_eights.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_eights.zip(b_eights) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let pairs = [sums[0] + sums[4], sums[1] + sums[5], sums[2] + sums[6], sums[3] + sums[7]];
    (pairs[0] + pairs[2]) + (pairs[1] + pairs[3]) + rest
}
