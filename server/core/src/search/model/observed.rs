//! The measurements of a point, as observations of its cost.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Observed {
    /// Mean of `count` measurements.
    Cost {
        mean: f64,
        count: u32,
    },
    AtLeast(f64),
    Infeasible,
}

impl Observed {
    /// A bound counts as a cost; what cannot be run costs infinitely much.
    pub(super) fn cost(self) -> f64 {
        match self {
            Observed::Cost { mean, .. } => mean,
            Observed::AtLeast(bound) => bound,
            Observed::Infeasible => f64::INFINITY,
        }
    }

    pub(super) fn count(self) -> f64 {
        match self {
            Observed::Cost { count, .. } => f64::from(count),
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ModelSearch;
    use crate::search::{Search as _, SearchSetup, Verdict};

    #[test]
    fn what_a_point_counts_for_is_stored_only_where_it_is_less_than_usual() {
        let mut search = ModelSearch::new(SearchSetup::plain(3, vec![0.5; 2], 40, Vec::new()));
        search.hear(vec![0.25, 0.75], Verdict::Cost(3.0));
        search.weigh(&[0.25, 0.75], 1.0);
        assert_eq!(search.place(0).count, 1.0);
        let stored = |search: &ModelSearch| serde_json::to_string(search).expect("plain data");
        assert!(!stored(&search).contains("lacks"));
        search.weigh(&[0.25, 0.75], 0.25);
        search.weigh(&[0.5, 0.5], 0.125);
        assert_eq!((search.seen.len(), search.place(0).count), (1, 0.25));
        assert_eq!(serde_json::from_str::<ModelSearch>(&stored(&search)).ok(), Some(search));
    }
}
