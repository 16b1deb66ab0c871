//! The few statistics that timings need: quantiles, ratios of pairs, the break-even frame.
//!
//! Frame times are skewed and have outliers, so results are medians and quartiles, never means. Two
//! configurations are compared by the ratios of pairs measured right after one another, which share the
//! machine's momentary speed.

use serde::Serialize;

/// Median and quartiles of some measurements. All zero when there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// A quarter lies below.
    pub lower_quartile: f64,
    /// Half lies below.
    pub median: f64,
    /// A quarter lies above.
    pub upper_quartile: f64,
    /// The number of values.
    pub count: usize,
}

impl Summary {
    /// Summarises finite values.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self {
            lower_quartile: quantile(&sorted, 0.25),
            median: quantile(&sorted, 0.5),
            upper_quartile: quantile(&sorted, 0.75),
            count: sorted.len(),
        }
    }

    /// Summarises the ratios `numerators[i] / denominators[i]`.
    pub fn of_ratios(numerators: &[f64], denominators: &[f64]) -> Self {
        let ratios: Vec<f64> = numerators.iter().zip(denominators).map(|(a, b)| a / b).collect();
        Self::of(&ratios)
    }
}

/// The ratio of two speeds: the median of pairs, with the 95 % interval of the true median.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Ratio {
    /// Median of the ratios within pairs; 0 when there are none.
    pub median: f64,
    /// Lower and upper end of the interval; `None` for fewer than six pairs, which cannot have one.
    pub interval: Option<[f64; 2]>,
    /// The number of pairs.
    pub count: usize,
}

/// The probability outside of an interval on either side.
const TAIL: f64 = 0.025;

impl Ratio {
    /// Of the ratios `numerators[i] / denominators[i]`, with an interval between two sorted ones for any
    /// distribution (Hahn and Meeker, Statistical Intervals, 1991, section 5.2).
    pub fn of(numerators: &[f64], denominators: &[f64]) -> Self {
        let mut ratios: Vec<f64> = numerators.iter().zip(denominators).map(|(a, b)| a / b).collect();
        ratios.sort_by(f64::total_cmp);
        let interval = outside(ratios.len()).map(|rank| [ratios[rank], ratios[ratios.len() - 1 - rank]]);
        Self { median: quantile(&ratios, 0.5), interval, count: ratios.len() }
    }

    /// Whether it is shown to be above 1.
    pub fn is_gain(&self) -> bool {
        self.interval.is_some_and(|[low, _]| low > 1.0)
    }
}

/// `1.21 × [1.18, 1.25]`.
impl std::fmt::Display for Ratio {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{:.2} ×", self.median)?;
        match self.interval {
            Some([low, high]) => write!(formatter, " [{low:.2}, {high:.2}]"),
            None => Ok(()),
        }
    }
}

/// The sorted values of `count` to leave out on each side: the median lies below rank `k` with the
/// probability that of `count` throws of a coin at most `k` show heads.
fn outside(count: usize) -> Option<usize> {
    let mut term = 0.5_f64.powi(i32::try_from(count).unwrap_or(i32::MAX));
    let mut below = term;
    let mut rank = None;
    // Where the first term is no number above 0 any more, the normal distribution serves.
    if term < f64::MIN_POSITIVE {
        let half = count as f64 / 2.0;
        return Some((half - 1.96 * half.sqrt() / std::f64::consts::SQRT_2 - 0.5).max(0.0) as usize);
    }
    for heads in 0..count {
        if below > TAIL {
            break;
        }
        rank = Some(heads);
        term *= (count - heads) as f64 / (heads + 1) as f64;
        below += term;
    }
    rank
}

/// A quantile of sorted values, interpolated (Hyndman and Fan 1996, definition 7). Zero of none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let place = share.clamp(0.0, 1.0) * last as f64;
    let low = place as usize;
    let high = (low + 1).min(last);
    sorted[low] + (sorted[high] - sorted[low]) * (place - low as f64)
}

/// Who of several is the fastest in shared rounds, as places in `rounds_ms`: for even and for odd rounds,
/// each chosen by its median in the other half, so that luck does not choose. `None` for none.
pub fn fastest_of_other_half(rounds_ms: &[&[f64]]) -> Option<[usize; 2]> {
    let fastest_in = |first: usize| {
        let median = |one: &[f64]| {
            let half: Vec<f64> = one.iter().skip(first).step_by(2).copied().collect();
            // A single round is in no other half.
            Summary::of(if half.is_empty() { one } else { &half }).median
        };
        let medians = rounds_ms.iter().map(|one| median(one)).enumerate();
        medians.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(place, _)| place)
    };
    Some([fastest_in(1)?, fastest_in(0)?])
}

/// The even rounds of one, and the odd rounds of another.
pub fn alternating(even_ms: &[f64], odd_ms: &[f64]) -> Vec<f64> {
    let pairs = even_ms.iter().zip(odd_ms).enumerate();
    pairs.map(|(round, (even, odd))| if round.is_multiple_of(2) { *even } else { *odd }).collect()
}

/// The frames after which the total time, tuning included, falls below never tuning (cf. Figure 14).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BreakEven {
    /// Everything spent while tuning: builds, frames, waiting for the service.
    pub tuning_ms: f64,
    /// Frames that were shown meanwhile.
    pub frames_while_tuning: u32,
    /// Spent once before frames with the tuned configuration: its build, where it is built once.
    pub tuned_setup_ms: f64,
    /// Each frame with the tuned configuration.
    pub tuned_frame_ms: f64,
    /// Spent once before frames with the default configuration.
    pub default_setup_ms: f64,
    /// Each frame with the default configuration.
    pub default_frame_ms: f64,
}

impl BreakEven {
    /// The first frame since the begin of tuning after which it has paid off, if it ever does.
    pub fn frame(&self) -> Option<u64> {
        let gain_ms = self.default_frame_ms - self.tuned_frame_ms;
        let tuned_begin_ms =
            self.tuning_ms + self.tuned_setup_ms - f64::from(self.frames_while_tuning) * self.tuned_frame_ms;
        let needed = (tuned_begin_ms - self.default_setup_ms) / gain_ms;
        let frame = needed.ceil().max(f64::from(self.frames_while_tuning));
        // No gain leaves a negative number, infinity or NaN.
        (gain_ms > 0.0 && frame.is_finite()).then_some(frame as u64)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let summary = Summary::of(&[4.0, 1.0, 3.0, 2.0]);
        assert_eq!((summary.lower_quartile, summary.median, summary.upper_quartile), (1.75, 2.5, 3.25));
        assert_eq!(Summary::of(&[7.0]).median, 7.0);
        assert_eq!(Summary::of(&[]), Summary::default());
        assert_eq!(Summary::of(&[3.0, 1.0, 2.0]).median, 2.0);
    }

    #[test]
    fn ratios_are_taken_pair_by_pair() {
        assert_eq!(Summary::of_ratios(&[2.0, 40.0, 6.0], &[1.0, 10.0, 6.0]).median, 2.0);
    }

    #[test]
    fn the_intervals_of_a_median_are_those_of_the_tables() {
        // Ranks from 0 of two-sided 95 % intervals of a median (Conover, table A3).
        for (count, rank) in
            [(5, None), (6, Some(0)), (9, Some(1)), (15, Some(3)), (21, Some(5)), (100, Some(39))]
        {
            assert_eq!(outside(count), rank, "{count}");
        }
        assert!(outside(4000).is_some_and(|rank| (1930..=1940).contains(&rank)), "{:?}", outside(4000));
        let nine: Vec<f64> = (1..=9).map(f64::from).collect();
        let ratio = Ratio::of(&nine, &[1.0; 9]);
        assert_eq!((ratio.median, ratio.interval, ratio.count), (5.0, Some([2.0, 8.0]), 9));
        assert!(ratio.is_gain());
        let loss = Ratio::of(&[1.0; 9], &nine);
        assert_eq!((loss.interval, loss.is_gain()), (Some([0.125, 0.5]), false));
        assert!(!Ratio::of(&[1.0; 9], &[1.0; 9]).is_gain(), "an interval that touches 1 shows nothing");
        assert!(!Ratio::of(&[2.0; 5], &[1.0; 5]).is_gain(), "five pairs show nothing");
        assert_eq!(ratio.to_string(), "5.00 × [2.00, 8.00]");
        assert_eq!(Ratio::of(&[], &[]).count, 0);
    }

    #[test]
    fn the_fastest_of_equals_is_not_favoured_by_its_luck() {
        let mut state = 1_u64;
        let mut round_ms = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            1.0 + 0.2 * (state >> 40) as f64 / (1_u64 << 24) as f64
        };
        let (mut least, mut fair) = (0.0, 0.0);
        for _ in 0..2000 {
            let mut one = || (0..9).map(|_| round_ms()).collect::<Vec<f64>>();
            let (all, other) = ([one(), one(), one(), one()], one());
            let rounds = all.each_ref().map(Vec::as_slice);
            let [even, odd] = fastest_of_other_half(&rounds).expect("there are four");
            let over_other = |ms: &[f64]| Ratio::of(ms, &other).median.ln() / 2000.0;
            fair += over_other(&alternating(rounds[even], rounds[odd]));
            let medians = rounds.map(|ms| Summary::of(ms).median);
            let place = (0..4).min_by(|a, b| medians[*a].total_cmp(&medians[*b])).expect("there are four");
            least += over_other(rounds[place]);
        }
        assert!(least < -0.015, "the least median seems {least} faster than its equal");
        assert!(fair.abs() < 0.004, "{fair}");
    }

    #[test]
    fn who_is_really_faster_is_taken_in_all_rounds() {
        let [slow, fast] = [[3.0, 5.0, 4.0], [2.0, 2.5, 2.2]];
        assert_eq!(fastest_of_other_half(&[&slow, &fast]), Some([1, 1]));
        assert_eq!(fastest_of_other_half(&[&[3.0], &[2.0]]), Some([1, 1]), "a single round");
        assert_eq!(fastest_of_other_half(&[]), None);
        assert_eq!(alternating(&slow, &fast), [3.0, 2.5, 4.0]);
    }

    const CASE: BreakEven = BreakEven {
        tuning_ms: 2000.0,
        frames_while_tuning: 10,
        tuned_setup_ms: 100.0,
        tuned_frame_ms: 50.0,
        default_setup_ms: 200.0,
        default_frame_ms: 100.0,
    };

    #[test]
    fn break_even_is_where_the_curves_cross() {
        // 2000 + 100 + (n - 10) * 50 <= 200 + n * 100  <=>  1400 <= 50 n.
        assert_eq!(CASE.frame(), Some(28));
        assert_eq!(BreakEven { tuned_frame_ms: 100.0, ..CASE }.frame(), None);
        assert_eq!(BreakEven { tuned_frame_ms: 120.0, ..CASE }.frame(), None);
        assert_eq!(BreakEven { tuning_ms: 500.0, ..CASE }.frame(), Some(10), "not before tuning has ended");
    }

    proptest! {
        #[test]
        fn at_break_even_tuning_is_no_dearer_and_just_before_it_is(
            tuning_ms in 0.0_f64..1e5, frames in 1_u32..200, tuned in 1.0_f64..50.0, gain in 0.1_f64..50.0, setup in 0.0_f64..1e3,
        ) {
            let case = BreakEven {
                tuning_ms,
                frames_while_tuning: frames,
                tuned_setup_ms: setup,
                tuned_frame_ms: tuned,
                default_setup_ms: 10.0,
                default_frame_ms: tuned + gain,
            };
            let frame = case.frame().expect("there is a gain") as f64;
            let with = |n: f64| tuning_ms + setup + (n - f64::from(frames)) * tuned;
            let without = |n: f64| 10.0 + n * (tuned + gain);
            prop_assert!(with(frame) <= without(frame) + 1e-6);
            prop_assert!(frame <= f64::from(frames) || with(frame - 1.0) > without(frame - 1.0) - 1e-6);
        }
    }
}
