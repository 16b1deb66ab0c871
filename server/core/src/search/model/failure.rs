//! The model of failure: the probability that a point can be run, by successes and failures.
//!
//! It begins with the successes and failures of other states. They count for less than trials here, and are
//! forgotten where they do not hold.

use serde::{Deserialize, Serialize};

use super::cheaper::CheaperPoint;
use super::{ModelSearch, ModelledPoint, Observed, PRIOR, coordinates};
use crate::gp::{Process, Sample, Schedule};

/// Weight of a point that failed or ran in another state, in measurements.
const ELSEWHERE_COUNT: f64 = 0.25;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct RunElsewhere {
    /// Canonical coordinates, in steps of the grid.
    pub(super) x: Vec<u32>,
    pub(super) failed: bool,
}

impl ModelSearch {
    /// Fits the model of failure: 1 for points that could not be run, 0 for all others. A point that ran at a
    /// cheaper level counts as one that ran.
    pub(super) fn failures(
        &mut self,
        places: &[ModelledPoint],
        cheaper: &[CheaperPoint],
        schedule: Schedule,
    ) -> Option<Process> {
        let places: Vec<&ModelledPoint> =
            places.iter().chain(cheaper.iter().map(|cheaper| &cheaper.place)).collect();
        let label = |failed: bool| f64::from(u8::from(failed));
        let layout = &self.setup.layout;
        let elsewhere = self.runs_elsewhere.iter().map(|run| {
            let x = coordinates(&run.x);
            (layout.features(&x, &layout.active(&x)), run.failed)
        });
        let elsewhere: Vec<(Vec<f64>, bool)> = elsewhere.collect();
        let mut points: Vec<&[f64]> = places.iter().map(|place| place.features.as_slice()).collect();
        let failed = |place: &&ModelledPoint| label(place.observed == Observed::Infeasible);
        let mut labels: Vec<f64> = places.iter().map(failed).collect();
        let mut counts = vec![1.0; points.len()];
        for (features, failed) in &elsewhere {
            points.push(features);
            labels.push(label(*failed));
            counts.push(ELSEWHERE_COUNT);
        }
        let sample = Sample::new(layout.kinds(), &points, counts).prepared();
        let fit = Process::learn(sample, &[(labels, 0.0)], &mut self.failure, &PRIOR, schedule);
        fit.map(|(process, _)| process)
    }

    /// Forgets the runs of other states where they do not hold here. Then two configurations or more, and a
    /// third of those that were tried in both, had another result.
    pub(super) fn test_elsewhere(&mut self) {
        let of_both = self.runs_elsewhere.iter().filter_map(|run| {
            let seen = self.seen.iter().find(|seen| seen.x == run.x)?;
            Some((seen.observed == Observed::Infeasible) == run.failed)
        });
        let (right, wrong): (Vec<bool>, Vec<bool>) = of_both.partition(|agrees| *agrees);
        if wrong.len() >= 2 && 2 * wrong.len() > right.len() {
            self.runs_elsewhere.clear();
        }
    }
}
