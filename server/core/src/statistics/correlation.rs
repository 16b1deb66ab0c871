//! How far two measurements of the same things agree: in value, and in rank.

/// Pearson's correlation; 0 where one side does not vary.
pub(crate) fn pearson(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / n, b + pair.1 / n));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>();
    let (aa, bb) = (sum(&|pair| (pair.0 - a).powi(2)), sum(&|pair| (pair.1 - b).powi(2)));
    let ab = sum(&|pair| (pair.0 - a) * (pair.1 - b));
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Spearman's rank correlation: Pearson's of the ranks, where equals share their mean rank.
pub(crate) fn spearman(pairs: &[(f64, f64)]) -> f64 {
    let (a, b): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let ranked: Vec<(f64, f64)> = ranks(&a).into_iter().zip(ranks(&b)).collect();
    pearson(&ranked)
}

/// The rank of each value, from 1.
fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|other| *other < value).count();
        let equal = values.iter().filter(|other| *other == value).count();
        below as f64 + 0.5 * (equal as f64 + 1.0)
    };
    values.iter().map(rank).collect()
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

    #[test]
    fn ranks_know_no_distances_and_equals_share_theirs() {
        let bent = [(1.0, 1.0), (2.0, 100.0), (3.0, 1e9), (4.0, 1e12)];
        assert!((spearman(&bent) - 1.0).abs() < 1e-12);
        // Ranks 1, 2, 3, 4 and 2, 1, 4, 3: 1 - 6 * 4 / (4 * 15).
        let swapped = [(1.0, 20.0), (2.0, 10.0), (3.0, 40.0), (4.0, 30.0)];
        assert!((spearman(&swapped) - 0.6).abs() < 1e-12);
        // Ranks 1.5, 1.5, 3 and 1, 2, 3: products of deviations 1.5, squares 1.5 and 2.
        let tied = [(7.0, 1.0), (7.0, 2.0), (9.0, 3.0)];
        assert!((spearman(&tied) - 1.5 / 3.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!((spearman(&[]), spearman(&[(1.0, 2.0)])), (0.0, 0.0));
    }
}
