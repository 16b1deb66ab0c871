//! Sums that stay exact over tens of millions of terms.

use serde::{Deserialize, Serialize};

/// A compensated sum: what rounding takes from the running sum is kept and put back at the end (Neumaier,
/// "Rundungsfehleranalyse einiger Verfahren zur Summation endlicher Summen", ZAMM 54, 1974). Its error does not
/// grow with the number of terms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    /// Adds a term.
    pub fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.lost +=
            if self.sum.abs() >= term.abs() { (self.sum - sum) + term } else { (term - sum) + self.sum };
        self.sum = sum;
    }

    /// The sum so far.
    pub fn value(&self) -> f64 {
        self.sum + self.lost
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
