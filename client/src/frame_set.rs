//! A trial of several frames. The first frames, which warm up caches and clocks, do not count; the median of
//! the others does. A configuration above its cost bound ends early.

use crate::Suggestion;

/// Collects the costs of a trial's frames. The result is their median.
///
/// ```no_run
/// # use treewright_client::{FrameSet, FrameSetResult, Measurements, Outcome, Suggestion, ClientError};
/// # fn frame() -> f64 { 1.0 }
/// # fn trial(suggestion: Suggestion) -> Result<(), ClientError> {
/// let mut frames = FrameSet::new(&suggestion, 5).leave_out(1);
/// while frames.goes_on() {
///     frames.push(frame());
/// }
/// match frames.result() {
///     FrameSetResult::Measured(render_ms) => suggestion.report([("render_ms", render_ms)].into(), Outcome::Ok),
///     FrameSetResult::Stopped { lower_bound } => {
///         suggestion.report(Measurements::new(), Outcome::aborted(lower_bound))
///     }
/// }
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct FrameSet {
    planned: usize,
    warm_up: usize,
    abort_above: Option<f64>,
    costs: Vec<f64>,
    /// The least cost of a frame that was itself stopped, and so is known from below only.
    stopped_from: f64,
}

/// The result of a trial of several frames, in the units of the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameSetResult {
    /// The median of all frames that count.
    Measured(f64),
    /// It was ended early; the median would have been at least this.
    Stopped {
        /// The bound.
        lower_bound: f64,
    },
}

impl FrameSet {
    /// A trial of `frames` frames (at least one) that ends early where the suggestion's cap says so. Costs of
    /// frames are in the objective's units.
    pub fn new(suggestion: &Suggestion, frames: usize) -> Self {
        Self::with_cap(suggestion.abort_above(), frames)
    }

    /// A trial of `frames` frames with a cap of one's own.
    pub fn with_cap(abort_above: Option<f64>, frames: usize) -> Self {
        let planned = frames.max(1);
        Self { planned, warm_up: 0, abort_above, costs: Vec::new(), stopped_from: f64::INFINITY }
    }

    /// Plans for more frames than so far, where a frame turns out to cost little beside its preparation.
    pub fn plan_at_least(&mut self, frames: usize) {
        self.planned = self.planned.max(frames);
    }

    /// The number of frames that have counted so far.
    pub fn counted(&self) -> usize {
        self.costs.len()
    }

    /// Runs `frames` more frames before those that count.
    #[must_use]
    pub fn leave_out(mut self, frames: usize) -> Self {
        self.warm_up = frames;
        self
    }

    /// Takes the cost of a frame.
    pub fn push(&mut self, cost: f64) {
        if self.warm_up > 0 {
            self.warm_up -= 1;
        } else {
            self.costs.push(cost);
        }
    }

    /// Takes a frame that was left unfinished because it had cost more than the cap: it would have cost at
    /// least this.
    pub fn push_stopped(&mut self, lower_bound: f64) {
        if self.warm_up == 0 {
            self.stopped_from = self.stopped_from.min(lower_bound);
        }
        self.push(lower_bound);
    }

    /// Whether another frame is to be run.
    pub fn goes_on(&self) -> bool {
        self.costs.len() < self.planned && self.stopped_at().is_none()
    }

    /// The lower bound of the median, once that is above the cap: more than half of all planned frames have
    /// cost as much, so the costs of the others do not matter.
    fn stopped_at(&self) -> Option<f64> {
        let needed = self.planned / 2 + 1;
        let mut sorted = self.costs.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let bound = *sorted.get(needed - 1)?;
        (bound > self.abort_above?).then_some(bound)
    }

    /// The median, or the bound where the trial was ended early. 0 before the first frame that counts.
    pub fn result(&self) -> FrameSetResult {
        if self.costs.len() < self.planned
            && let Some(lower_bound) = self.stopped_at()
        {
            return FrameSetResult::Stopped { lower_bound };
        }
        let mut sorted = self.costs.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        let median = match sorted.len() {
            0 => 0.0,
            count if count % 2 == 1 => sorted[middle],
            _ => sorted[middle - 1] / 2.0 + sorted[middle] / 2.0,
        };
        // Costs above the middle may be higher still.
        if sorted.get(middle).is_some_and(|&cost| cost >= self.stopped_from) {
            return FrameSetResult::Stopped { lower_bound: median };
        }
        FrameSetResult::Measured(median)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(mut frames: FrameSet, costs: &[f64]) -> (usize, FrameSetResult) {
        let mut count = 0;
        while frames.goes_on() {
            frames.push(costs[count]);
            count += 1;
        }
        (count, frames.result())
    }

    #[test]
    fn the_median_of_the_frames_that_count() {
        let costs = [900.0, 5.0, 1.0, 3.0, 7.0];
        assert_eq!(run(FrameSet::with_cap(None, 3).leave_out(1), &costs), (4, FrameSetResult::Measured(3.0)));
        assert_eq!(run(FrameSet::with_cap(None, 4).leave_out(1), &costs), (5, FrameSetResult::Measured(4.0)));
        assert_eq!(FrameSet::with_cap(None, 0).result(), FrameSetResult::Measured(0.0));
    }

    #[test]
    fn more_frames_may_be_planned_once_the_first_is_known() {
        let mut frames = FrameSet::with_cap(None, 1);
        frames.push(9.0);
        frames.plan_at_least(3);
        assert_eq!((frames.goes_on(), frames.counted()), (true, 1));
        frames.push(1.0);
        frames.push(2.0);
        frames.plan_at_least(2);
        assert_eq!((frames.goes_on(), frames.result()), (false, FrameSetResult::Measured(2.0)));
    }

    #[test]
    fn a_trial_ends_as_soon_as_its_median_must_exceed_the_cap() {
        let costs = [30.0, 10.0, 25.0, 40.0, 9.0];
        let (count, result) = run(FrameSet::with_cap(Some(20.0), 5), &costs);
        assert_eq!((count, result), (4, FrameSetResult::Stopped { lower_bound: 25.0 }));
        // The bound holds for any cost of the last frame.
        assert_eq!(run(FrameSet::with_cap(None, 5), &costs), (5, FrameSetResult::Measured(25.0)));
        assert_eq!(run(FrameSet::with_cap(Some(50.0), 5), &costs).1, FrameSetResult::Measured(25.0));
        // One frame cannot be ended early but by itself.
        assert_eq!(run(FrameSet::with_cap(Some(1.0), 1), &costs), (1, FrameSetResult::Measured(30.0)));
    }

    #[test]
    fn frames_that_were_stopped_count_from_below() {
        let mut one = FrameSet::with_cap(Some(20.0), 1);
        one.push_stopped(20.5);
        assert!(!one.goes_on());
        assert_eq!(one.result(), FrameSetResult::Stopped { lower_bound: 20.5 });
        // One of three does not move the median, two of four do.
        let mut three = FrameSet::with_cap(Some(20.0), 3);
        three.push_stopped(21.0);
        three.push(10.0);
        three.push(12.0);
        assert_eq!((three.goes_on(), three.result()), (false, FrameSetResult::Measured(12.0)));
        let mut four = FrameSet::with_cap(Some(20.0), 4);
        four.push_stopped(22.0);
        four.push(10.0);
        four.push_stopped(21.0);
        four.push(12.0);
        assert_eq!(four.result(), FrameSetResult::Stopped { lower_bound: 16.5 });
        // Warm-up frames count for nothing.
        let mut warm = FrameSet::with_cap(Some(20.0), 1).leave_out(1);
        warm.push_stopped(30.0);
        warm.push(10.0);
        assert_eq!(warm.result(), FrameSetResult::Measured(10.0));
    }
}
