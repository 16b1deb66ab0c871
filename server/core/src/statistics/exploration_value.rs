//! The value of the next few trials: whether they pay for themselves.
//!
//! A search gains most in its first trials and less with every doubling of their number, so its value is
//! weighed octave by octave. A horizon ends when the number of trials has doubled once or several times. Its
//! gain for all later frames is compared with the cost of its trials above the reference. The search goes on
//! while any horizon pays, but only to the end of the first octave. Then it is weighed again. This is the
//! knowledge gradient with a look ahead of several steps (Frazier, Powell and Dayanik, "The
//! knowledge-gradient policy for correlated normal beliefs", INFORMS Journal on Computing 21, 2009). One step
//! is not enough where the first measurements gain little (Frazier and Powell, "Paradoxes in learning and the
//! marginal value of information", Decision Analysis 7, 2010).
//!
//! The expected gain of an octave is its gain in other states, drawn towards a prior while there are few of
//! them, times the ratio of this state's gain so far to its expectation. So the search leaves a landscape
//! without gains after a few trials, and goes on where gains continue.

/// Octaves: up to 2^17 trials in a state.
pub const OCTAVES: usize = 17;
/// The prior gain of all octaves together: the paper's average gain over its scenes (section 7.1.2), after 80
/// trials.
const GAIN_PRIOR: f64 = 0.11;
const OCTAVES_PRIOR: f64 = 6.0;
/// Weight of the prior, in states.
const STATES_PRIOR: f64 = 1.0;
/// Gain, found or expected, that weighs as much as the prior of a state. Less of it would leave flat ground
/// sooner, where further trials cost nothing, and miss gains that come late.
const GAIN_COUNTED: f64 = 0.03;

/// The gains of octaves of searches in other states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gains {
    sums: [f64; OCTAVES],
    counts: [f64; OCTAVES],
}

impl Gains {
    /// Takes the gain of one state's search in an octave: the share by which the best cost fell.
    pub fn note(&mut self, octave: usize, gain: f64) {
        if octave < OCTAVES {
            self.sums[octave] += gain.clamp(0.0, 1.0);
            self.counts[octave] += 1.0;
        }
    }

    /// The expected gain of an octave in a state without trials.
    pub fn expected(&self, octave: usize) -> f64 {
        let prior = if (octave as f64) < OCTAVES_PRIOR { GAIN_PRIOR / OCTAVES_PRIOR } else { 0.0 };
        let octave = octave.min(OCTAVES - 1);
        assert!(self.sums[octave] <= self.counts[octave], "no state gains more than all of its cost");
        let expected = (STATES_PRIOR * prior + self.sums[octave]) / (STATES_PRIOR + self.counts[octave]);
        assert!((0.0..=1.0).contains(&expected), "a gain of {expected}");
        expected
    }
}

/// The progress of the search of one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchProgress<'a> {
    /// The estimated share by which each of its completed octaves lowered the best cost.
    pub gained: &'a [f64],
    /// Configurations tried so far.
    pub tried: usize,
    /// Configurations that may be tried at most.
    pub budget: usize,
    /// The number of frames that are still to come.
    pub frames: f64,
    /// The cost of an exploring trial above the reference, as a share of that.
    pub excess: f64,
}

/// The expected gain and cost of going on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outlook {
    /// The number of trials before it is weighed again; 0 where exploring does not pay.
    pub trials: usize,
    /// The expected fall of costs over the best horizon, as a share.
    pub gain: f64,
    /// The cost of that horizon's trials, in frames of the reference.
    pub exploring_cost: f64,
    /// Its benefit less its cost, in frames of the reference.
    pub value: f64,
}

/// Weighs whether to go on.
pub fn outlook(gains: &Gains, progress: &SearchProgress<'_>) -> Outlook {
    let SearchProgress { gained, tried, budget, frames, excess } = *progress;
    let expected: f64 = (0..gained.len()).map(|octave| gains.expected(octave)).sum();
    let found: f64 = gained.iter().map(|gain| gain.clamp(0.0, 1.0)).sum();
    let rate = (GAIN_COUNTED + found) / (GAIN_COUNTED + expected);
    let first = tried.max(1).ilog2() as usize;
    let (mut best, mut cost_left) = (Outlook { value: f64::NEG_INFINITY, ..Outlook::default() }, 1.0);
    for octave in first..OCTAVES {
        // The rest of the first octave, and the part of the last that the budget allows.
        let (begin, until) = (tried.max(1 << octave), budget.min(1 << (octave + 1)));
        if until <= begin {
            break;
        }
        let share = (until - begin) as f64 / (1u64 << octave) as f64;
        cost_left *= 1.0 - (rate * gains.expected(octave) * share).min(0.9);
        let trials = (until - tried) as f64;
        let gain = 1.0 - cost_left;
        let exploring_cost = excess * trials;
        let value = gain * (frames - trials).max(0.0) - exploring_cost;
        if value > best.value {
            best = Outlook { gain, exploring_cost, value, ..best };
        }
    }
    if best.value > 0.0 {
        best.trials = (1 << (first + 1)).min(budget) - tried;
    } else if best.value == f64::NEG_INFINITY {
        best.value = 0.0;
    }
    assert!(tried + best.trials <= budget.max(tried), "{} more than {tried}", best.trials);
    best
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Follows the rule through a stay of `frames` frames in a state whose octaves gain `octaves`. Returns
    /// the number of explored trials.
    fn explored(gains: &Gains, octaves: &[f64], frames: usize, excess: f64) -> usize {
        let (mut tried, mut frame) = (1usize, 1);
        while frame < frames {
            let known = octaves.len().min(tried.ilog2() as usize);
            let frames = (frames - frame) as f64;
            let progress = SearchProgress { gained: &octaves[..known], tried, budget: 80, frames, excess };
            let trials = outlook(gains, &progress).trials;
            if trials == 0 {
                break;
            }
            tried += trials;
            frame += trials;
        }
        tried
    }

    /// The gains after `states` states that gained `octaves` in their octaves.
    fn known(states: usize, octaves: &[f64]) -> Gains {
        let mut gains = Gains::default();
        for _ in 0..states {
            octaves.iter().enumerate().for_each(|(octave, &gain)| gains.note(octave, gain));
        }
        gains
    }

    #[test]
    fn where_nothing_is_gained_it_ends_after_a_few_frames() {
        let flat = [0.0; 7];
        let alone = explored(&Gains::default(), &flat, 300, 0.2);
        let taught = explored(&known(5, &flat), &flat, 300, 0.2);
        assert!(alone <= 16 && taught <= 4 && taught <= alone, "{alone} {taught}");
    }

    #[test]
    fn where_much_is_gained_it_goes_on() {
        // 15 % in all.
        let rich = [0.05, 0.04, 0.03, 0.02, 0.01, 0.01, 0.0];
        assert!(explored(&Gains::default(), &rich, 300, 0.2) >= 16);
        assert!(explored(&known(3, &rich), &rich, 300, 0.2) >= 32);
        assert!(explored(&known(3, &rich), &rich, 100_000, 0.2) >= 64);
        // In so short a stay nothing pays.
        assert!(explored(&known(3, &rich), &rich, 4, 0.5) <= 2);
    }

    #[test]
    fn a_late_gain_is_waited_for_where_others_had_it() {
        let late = [0.0, 0.0, 0.0, 0.2, 0.05, 0.0, 0.0];
        assert!(explored(&known(6, &late), &late, 400, 0.2) >= 16);
    }

    #[test]
    fn eight_trials_without_a_gain_do_not_end_a_search_that_has_time_for_a_late_one() {
        let late = [0.0, 0.0, 0.0, 0.2, 0.05, 0.0, 0.0];
        assert!(explored(&Gains::default(), &late, 300, 0.2) >= 32);
    }

    proptest! {
        #![proptest_config(crate::testing::cases(128))]

        #[test]
        fn more_frames_never_explore_less_and_everything_is_finite(
            octaves in proptest::collection::vec(0.0..0.2f64, 0..8),
            tried in 0usize..100,
            frames in 0.0..1e6f64,
            excess in 0.0..10.0f64,
        ) {
            let gains = known(2, &octaves);
            let gained = &octaves[..octaves.len().min(tried.max(1).ilog2() as usize)];
            let at = |frames: f64| outlook(&gains, &SearchProgress { gained, tried, budget: 80, frames, excess });
            let (few, many) = (at(frames), at(2.0 * frames + 1.0));
            prop_assert!(few.value.is_finite() && few.gain.is_finite() && few.exploring_cost.is_finite());
            prop_assert!((0.0..1.0).contains(&few.gain));
            prop_assert!(many.trials >= few.trials);
            prop_assert!(tried + few.trials <= tried.max(80));
        }
    }
}
