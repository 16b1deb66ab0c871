//! Latin hypercube designs, and a search that measures one after the other.
//!
//! Source: McKay, Beckman and Conover, "A comparison of three methods for selecting values of input variables
//! in the analysis of output from a computer code", Technometrics 21(2), 1979. Each axis is cut into as many
//! strata as there are points. Each stratum of each axis holds exactly one point, at a random place inside
//! it.

use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::randomness::{Purpose, stream};
use crate::search::pending::PendingPoints;
use crate::search::{Feedback, Point, Search, SearchSetup, Step};

/// A design of `count` points in the unit cube.
pub fn design(count: usize, dimension: usize, random: &mut impl Rng) -> Vec<Vec<f64>> {
    let mut points = vec![vec![0.0; dimension]; count];
    let mut strata: Vec<usize> = (0..count).collect();
    for axis in 0..dimension {
        strata.shuffle(random);
        for (point, &stratum) in points.iter_mut().zip(&strata) {
            point[axis] = (stratum as f64 + random.random::<f64>()) / count as f64;
        }
    }
    points
}

/// Points of one design at least, and at most: a design is drawn again for every point asked for, which is
/// cheaper than storing it.
const DESIGN_POINTS: std::ops::RangeInclusive<u32> = 2..=256;

/// The default first, then Latin hypercube designs, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatinHypercubeSearch {
    setup: SearchSetup,
    #[serde(rename = "flight")]
    pending: PendingPoints,
    asked: u64,
}

impl LatinHypercubeSearch {
    /// A fresh search. A design has as many points as the budget leaves after the default.
    pub fn new(setup: SearchSetup) -> Self {
        LatinHypercubeSearch { setup, pending: PendingPoints::default(), asked: 0 }
    }

    fn design_points(&self) -> u64 {
        let wanted = self.setup.budget.saturating_sub(1);
        u64::from(wanted.clamp(*DESIGN_POINTS.start(), *DESIGN_POINTS.end()))
    }
}

impl Search for LatinHypercubeSearch {
    fn ask(&mut self) -> Option<Point> {
        if let Some(point) = self.pending.resume() {
            return Some(point);
        }
        let asked = self.asked;
        self.asked += 1;
        if asked == 0 {
            return Some(self.pending.add(self.setup.start.clone(), Step::Default));
        }
        let (number, index) = ((asked - 1) / self.design_points(), (asked - 1) % self.design_points());
        let mut random = stream(self.setup.seed, Purpose::Search, self.setup.state_id, number);
        let mut points = design(self.design_points() as usize, self.setup.dimension(), &mut random);
        Some(self.pending.add(points.swap_remove(index as usize), Step::LatinHypercube))
    }

    fn tell(&mut self, id: u64, _feedback: Feedback) {
        self.pending.finish(id);
    }

    fn withdraw(&mut self, id: u64) {
        self.pending.withdraw(id);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(crate::testing::cases(256))]

        #[test]
        fn every_stratum_of_every_axis_holds_one_point(count in 1usize..60, dimension in 1usize..12, seed: u64) {
            let points = design(count, dimension, &mut stream(seed, Purpose::Search, 0, 0));
            prop_assert_eq!(points.len(), count);
            for axis in 0..dimension {
                let mut strata: Vec<usize> =
                    points.iter().map(|point| (point[axis] * count as f64) as usize).collect();
                strata.sort_unstable();
                prop_assert_eq!(strata, (0..count).collect::<Vec<_>>());
            }
        }
    }
}
