//! Sums that stay exact over tens of millions of terms.

use serde::{Deserialize, Serialize};

/// A compensated sum: the rounding errors of the running sum are kept and added at the end (Neumaier,
/// "Rundungsfehleranalyse einiger Verfahren zur Summation endlicher Summen", ZAMM 54, 1974). Its error does
/// not grow with the number of terms. Serialised as the running sum and its rounding error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sum(f64, f64);

impl From<f64> for Sum {
    /// A sum of one term.
    fn from(term: f64) -> Self {
        Sum(term, 0.0)
    }
}

impl Sum {
    /// Adds a term.
    pub fn add(&mut self, term: f64) {
        let Sum(sum, lost) = *self;
        let total = sum + term;
        let rounded_off = if sum.abs() >= term.abs() { (sum - total) + term } else { (term - total) + sum };
        *self = Sum(total, lost + rounded_off);
    }

    /// The sum so far.
    pub fn value(&self) -> f64 {
        self.0 + self.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_million_terms_lose_nothing() {
        let (mut compensated, mut plain) = (Sum::default(), 0.0);
        compensated.add(1e9);
        plain += 1e9;
        for _ in 0..10_000_000 {
            compensated.add(1e-9);
            plain += 1e-9;
        }
        assert_eq!(plain, 1e9, "each term alone is lost");
        assert!((compensated.value() - (1e9 + 0.01)).abs() < 2e-7);
    }
}
