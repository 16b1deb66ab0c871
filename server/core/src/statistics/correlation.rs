//! How far two measurements of the same things agree.

/// Pearson's correlation; 0 where one side does not vary.
pub(crate) fn pearson(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / n, b + pair.1 / n));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>();
    let (aa, bb) = (sum(&|pair| (pair.0 - a).powi(2)), sum(&|pair| (pair.1 - b).powi(2)));
    let ab = sum(&|pair| (pair.0 - a) * (pair.1 - b));
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_are_pearsons() {
        assert_eq!(pearson(&[(1.0, 5.0), (2.0, 5.0)]), 0.0, "one side does not vary");
        // Means 1 and 5/3; sums of squares 2 and 26/3; of products 4.
        let three = pearson(&[(0.0, 0.0), (1.0, 1.0), (2.0, 4.0)]);
        assert!((three - 4.0 / (2.0_f64 * 26.0 / 3.0).sqrt()).abs() < 1e-12, "{three}");
        let far = pearson(&[(100.0, -7.0), (101.0, -8.0), (102.0, -9.0)]);
        assert!((far + 1.0).abs() < 1e-9, "{far}");
    }
}
