//! Structural similarity of two pictures' luminance.
//!
//! Source: Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to Structural
//! Similarity, IEEE Transactions on Image Processing 13/4, 2004, with its Gaussian window of 11 × 11 pixels
//! and its constants. In double precision, since rounding to the 256 levels of a picture file would hide the
//! noise that remains after a few hundred samples.

/// Standard deviation of the window in pixels.
const WINDOW_SIGMA: f64 = 1.5;

/// Reach of the window to each side, in pixels.
const WINDOW_REACH: usize = 5;

/// (K1 L)² and (K2 L)² for values from 0 to 1.
const STABILISERS: [f64; 2] = [0.01 * 0.01, 0.03 * 0.03];

/// Compares pictures with one, whose own part is computed once.
#[derive(Clone, Debug)]
pub(super) struct Similarity {
    window: Window,
    values: Vec<f64>,
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl Similarity {
    /// Compares with these luminances from 0 to 1, row by row.
    pub(super) fn new(width: usize, values: Vec<f64>) -> Self {
        let window = Window::new(width, values.len() / width.max(1));
        let mean = window.blur(&values);
        let variance = window.covariance(&values, &mean, &values, &mean);
        Self { window, values, mean, variance }
    }

    /// Mean structural similarity to another luminance of the same size: 1 for equal ones.
    pub(super) fn to(&self, other: &[f64]) -> f64 {
        let mean = self.window.blur(other);
        let variance = self.window.covariance(other, &mean, other, &mean);
        let covariance = self.window.covariance(&self.values, &self.mean, other, &mean);
        let [c1, c2] = STABILISERS;
        self.window.mean_inside(|index| {
            let (a, b) = (self.mean[index], mean[index]);
            (2.0 * a * b + c1) * (2.0 * covariance[index] + c2)
                / ((a * a + b * b + c1) * (self.variance[index] + variance[index] + c2))
        })
    }
}

/// The Gaussian window of structural similarity.
#[derive(Clone, Debug)]
struct Window {
    width: usize,
    height: usize,
    kernel: [f64; 2 * WINDOW_REACH + 1],
}

impl Window {
    fn new(width: usize, height: usize) -> Self {
        let kernel = std::array::from_fn(|tap| {
            let distance = tap as f64 - WINDOW_REACH as f64;
            (-0.5 * (distance / WINDOW_SIGMA).powi(2)).exp()
        });
        Self { width, height, kernel }
    }

    /// Weighted means around each pixel. At the borders the window is cut and its weights are normalised
    /// again.
    fn blur(&self, values: &[f64]) -> Vec<f64> {
        let pass = |values: &[f64], length: usize, step: usize, place: &dyn Fn(usize) -> usize| {
            (0..values.len())
                .map(|index| {
                    let at = place(index);
                    let (mut sum, mut total) = (0.0, 0.0);
                    for (tap, weight) in self.kernel.iter().enumerate() {
                        // Both are shifted by the reach so that nothing is negative.
                        let neighbour = at + tap;
                        if neighbour >= WINDOW_REACH && neighbour < length + WINDOW_REACH {
                            sum += weight * values[index + tap * step - WINDOW_REACH * step];
                            total += weight;
                        }
                    }
                    sum / total
                })
                .collect::<Vec<f64>>()
        };
        let across = pass(values, self.width, 1, &|index| index % self.width);
        pass(&across, self.height, self.width, &|index| index / self.width)
    }

    /// Covariances of two pictures around each pixel.
    fn covariance(&self, a: &[f64], mean_a: &[f64], b: &[f64], mean_b: &[f64]) -> Vec<f64> {
        let products: Vec<f64> = a.iter().zip(b).map(|(a, b)| a * b).collect();
        let means = mean_a.iter().zip(mean_b).map(|(a, b)| a * b);
        self.blur(&products).into_iter().zip(means).map(|(product, mean)| product - mean).collect()
    }

    /// Mean over the pixels whose window is whole, as Wang et al. take it; over all where there is none.
    fn mean_inside(&self, value: impl Fn(usize) -> f64) -> f64 {
        let margin = if self.width.min(self.height) > 2 * WINDOW_REACH { WINDOW_REACH } else { 0 };
        let rows = margin..self.height - margin;
        let count = (rows.len() * (self.width - 2 * margin)).max(1);
        let columns = margin..self.width - margin;
        let sum: f64 = rows
            .flat_map(|y| columns.clone().map(move |x| (x, y)))
            .map(|(x, y)| value(y * self.width + x))
            .sum();
        sum / count as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize, value: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        (0..width * height).map(|index| value(index % width, index / width)).collect()
    }

    #[test]
    fn the_same_is_the_same_and_constants_follow_the_formula() {
        let grey = |level: f64| picture(20, 13, |_, _| level);
        let similarity = Similarity::new(20, grey(0.4));
        assert!((similarity.to(&grey(0.4)) - 1.0).abs() < 1e-12);
        // Without structure only the first factor is left.
        let [c1, _] = STABILISERS;
        let expected = (2.0 * 0.4 * 0.6 + c1) / (0.4 * 0.4 + 0.6 * 0.6 + c1);
        assert!((similarity.to(&grey(0.6)) - expected).abs() < 1e-9);
    }

    #[test]
    fn it_agrees_with_another_implementation() {
        // Values of scikit-image 0.26, structural_similarity(gaussian_weights=True, sigma=1.5,
        // use_sample_covariance=False, data_range=1), on the same formulas.
        let first = picture(24, 17, |x, y| ((7 * x + 3 * y) % 11) as f64 / 10.0);
        let pattern = picture(24, 17, |x, y| ((5 * x + 2 * y) % 7) as f64 / 6.0);
        let disturbed: Vec<f64> = first
            .iter()
            .zip(&pattern)
            .map(|(a, b)| (a * 0.8 + 0.1 + 0.15 * (b - 0.5)).clamp(0.0, 1.0))
            .collect();
        let faded: Vec<f64> = first.iter().map(|a| a * 0.9 + 0.05).collect();
        let similarity = Similarity::new(24, first);
        assert!((similarity.to(&disturbed) - 0.958_374_373_071_555_5).abs() < 1e-9);
        assert!((similarity.to(&faded) - 0.994_498_105_850_992_1).abs() < 1e-9);
    }

    #[test]
    fn pictures_smaller_than_the_window_are_compared_too() {
        for (width, height) in [(1, 1), (3, 2), (40, 2), (11, 11)] {
            let similarity =
                Similarity::new(width, picture(width, height, |x, y| ((x + y) % 2) as f64 * 0.5));
            assert!((similarity.to(&similarity.values) - 1.0).abs() < 1e-9);
            assert!(similarity.to(&picture(width, height, |x, _| x as f64 / width as f64 + 0.1)) < 1.0);
        }
    }
}
