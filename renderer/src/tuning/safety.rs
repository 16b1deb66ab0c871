//! Which frames of a search or of a flight cost more than its start would have, and how much more.
//!
//! Nobody looks at the frames of a search that runs by itself. In a program that is tuned while it is used,
//! each of them is a frame that a user waits for.

use serde::Serialize;

use crate::statistics::Summary;

/// Frames that cost more than this many times the start are dear.
pub const DEAR_ABOVE: f64 = 1.1;
/// A session counts as safe once at most one in this number of frames was dear.
const FRAMES_PER_DEAR: u64 = 20;
/// Trials of the start that suffice for its cost during a search.
const STARTS_LEAST: usize = 3;

/// The cost of a start while a search ran: the median of enough trials of it, else `otherwise`.
pub fn start_cost(trials: &[f64], otherwise: impl FnOnce() -> Option<f64>) -> Option<f64> {
    match trials.len() >= STARTS_LEAST {
        true => Some(Summary::of(trials).median),
        false => otherwise(),
    }
}

/// The frames of a search beside its start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Safety {
    /// Frames with a cost, or with the bound at which they were stopped.
    pub frames: u64,
    /// Those that cost more than [`DEAR_ABOVE`] times the start.
    pub dear: u64,
    /// Cost of the dearest over that of the start.
    pub worst: f64,
}

impl Safety {
    /// Of frames and costs beside a start's cost in that unit. `None` without either.
    pub fn of(costs: impl IntoIterator<Item = (u32, f64)>, start: f64) -> Option<Self> {
        let mut safety = Self { frames: 0, dear: 0, worst: 0.0 };
        for (frames, cost) in costs {
            let (frames, ratio) = (u64::from(frames), cost / start);
            safety.frames += frames;
            safety.dear += if ratio > DEAR_ABOVE { frames } else { 0 };
            safety.worst = safety.worst.max(ratio);
        }
        (safety.frames > 0 && start > 0.0 && safety.worst.is_finite()).then_some(safety)
    }

    /// Share of dear frames, 0 to 1.
    pub fn share(&self) -> f64 {
        self.dear as f64 / self.frames.max(1) as f64
    }

    /// Frames after which at most one in twenty was dear, if none is after these.
    pub fn safe_after(&self) -> u64 {
        self.frames.max(self.dear * FRAMES_PER_DEAR)
    }

    /// In words, as a clause. `start` is the start's name in a sentence.
    pub fn sentence(&self, start: &str) -> String {
        let Self { frames, dear, worst } = self;
        let percent = 100.0 * self.share();
        let told = format!(
            "{dear} of {frames} frames ({percent:.0} %) cost more than {DEAR_ABOVE} times {start}, \
             the dearest {worst:.2} times"
        );
        match self.safe_after() {
            after if after > *frames => format!("{told}; they are 5 % of a session of {after} frames"),
            _ => told,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dear_frames_are_counted_beside_the_start() {
        let costs = [(1, 10.0), (3, 11.5), (1, 9.0), (5, 10.9), (1, 24.0)];
        let safety = Safety::of(costs, 10.0).expect("there are frames");
        assert_eq!(safety, Safety { frames: 11, dear: 4, worst: 2.4 });
        assert_eq!(safety.safe_after(), 80);
        assert_eq!(
            safety.sentence("the start"),
            "4 of 11 frames (36 %) cost more than 1.1 times the start, the dearest 2.40 times; \
             they are 5 % of a session of 80 frames"
        );
        let calm = Safety::of([(30, 9.0), (1, 11.1)], 10.0).expect("there are frames");
        assert_eq!((calm.dear, calm.safe_after()), (1, 31));
        assert!(calm.sentence("it").ends_with("the dearest 1.11 times"));
    }

    #[test]
    fn a_start_that_was_measured_in_the_search_costs_what_it_cost_there() {
        assert_eq!(start_cost(&[9.0, 12.0, 10.0], || Some(7.0)), Some(10.0));
        assert_eq!(start_cost(&[9.0, 12.0], || Some(7.0)), Some(7.0));
        assert_eq!(start_cost(&[], || None), None);
    }

    #[test]
    fn without_a_start_or_frames_nothing_is_told() {
        assert_eq!(Safety::of([], 10.0), None);
        assert_eq!(Safety::of([(1, 10.0)], 0.0), None);
        assert_eq!(Safety::of([(1, f64::INFINITY)], 1.0), None);
    }
}
