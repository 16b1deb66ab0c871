//! Net benefit: the savings in a day of the study's answers over the default everywhere, less the cost of
//! exploring. The costs of measured frames are known. The default's costs in their place are uncertain; each
//! state's standing gives them with an interval.

use std::collections::BTreeMap;
use std::ops::AddAssign;

use treewright_core::standing::Standing;
use treewright_proto::v1;

pub(super) const DAY_S: f64 = 86_400.0;
/// Of a normal distribution, for 95 %.
const DEVIATIONS: f64 = 1.96;

/// The cost of a frame of the default in a state, with a standard error, in the objective's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DefaultCost {
    mean: f64,
    error: f64,
}

impl DefaultCost {
    /// From the answer's cost and its gain over the default; `None` where the default was not measured.
    pub(super) fn of(standing: &Standing) -> Option<Self> {
        let gain = standing.gain?;
        // A share of 1 would allow any cost of the default.
        let default = |share: f64| standing.cost / (1.0 - share.min(0.999));
        let mean = default(gain.share);
        let error = match (gain.low, gain.high) {
            (Some(low), Some(high)) => (default(high) - default(low)).abs() / (2.0 * DEVIATIONS),
            _ => return None,
        };
        Some(Self { mean, error })
    }
}

/// Seconds saved in a day; negative where exploring cost more than it has brought so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Benefit {
    saved_s: f64,
    variance: f64,
    frames: usize,
}

impl Benefit {
    /// The benefit in one state, from the costs of its frames in units of `unit_s` seconds, within `window_s`
    /// seconds.
    pub(super) fn of(default: DefaultCost, costs: &[f64], unit_s: f64, window_s: f64) -> Self {
        assert!(!costs.is_empty() && unit_s > 0.0, "{} frames of {unit_s} s", costs.len());
        let frames = costs.len() as f64;
        let a_day = unit_s * DAY_S / window_s.max(1.0);
        let saved = frames * default.mean - costs.iter().sum::<f64>();
        let variance = (frames * default.error * a_day).powi(2);
        Self { saved_s: saved * a_day, variance, frames: costs.len() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// As in `120 s [110, 130]`.
    pub(super) fn words(&self) -> String {
        let half = DEVIATIONS * self.variance.sqrt();
        let figure = super::charts::figure;
        format!(
            "{} s [{}, {}]",
            figure(self.saved_s),
            figure(self.saved_s - half),
            figure(self.saved_s + half)
        )
    }
}

/// States are independent of each other.
impl AddAssign for Benefit {
    fn add_assign(&mut self, other: Self) {
        self.saved_s += other.saved_s;
        self.variance += other.variance;
        self.frames += other.frames;
    }
}

/// The last words of names of times, and their units in seconds.
const UNITS: [(&[&str], f64); 6] = [
    (&["ns", "nanoseconds"], 1e-9),
    (&["us", "microseconds"], 1e-6),
    (&["ms", "msec", "milliseconds"], 1e-3),
    (&["s", "sec", "secs", "seconds"], 1.0),
    // `min` is the least of something, too.
    (&["minutes"], 60.0),
    (&["hours"], 3600.0),
];

/// One unit of an objective in seconds of a trial, all of its frames together, by the last words of its
/// metrics' names. `None` where it is no time, or where a metric is maximised. A count in a time
/// (`errors_per_s`) is no time.
pub(super) fn unit_s(objective: Option<&v1::Objective>) -> Option<f64> {
    let objective = objective.filter(|objective| objective.maximised.is_empty())?;
    let unit = |name: &str| {
        let mut words = name.rsplit('_');
        let (last, before) = (words.next()?, words.next());
        let is_time = before.is_none_or(|before| before != "per");
        let found = UNITS.iter().find(|(names, _)| is_time && names.contains(&last));
        found.map(|(_, seconds)| *seconds)
    };
    let units: Option<Vec<f64>> = objective.terms.iter().map(|term| unit(&term.metric)).collect();
    let units = units?;
    let first = *units.first()?;
    let frames = f64::from(objective.episode_frames.max(1));
    units.iter().all(|unit| *unit == first).then_some(first * frames)
}

/// A configuration that serves all states: its values as text, and its cost in each state where it was
/// measured.
pub(super) struct Fixed {
    pub(super) configuration: String,
    pub(super) by_state: BTreeMap<i64, f64>,
}

/// The configuration with the lowest mean ratio to the default (geometric, over the states where it was
/// measured), of those that were measured in at least half of the states. `None` with fewer than two states.
/// Runs are state, values and cost.
pub(super) fn best_fixed(runs: &[(i64, String, f64)], defaults: &BTreeMap<i64, f64>) -> Option<Fixed> {
    let mut means: BTreeMap<&str, BTreeMap<i64, (f64, u32)>> = BTreeMap::new();
    for (state, configuration, cost) in runs.iter().filter(|run| defaults.contains_key(&run.0)) {
        let sum = means.entry(configuration).or_default().entry(*state).or_default();
        *sum = (sum.0 + cost, sum.1 + 1);
    }
    let enough = defaults.len().div_ceil(2).max(2);
    let candidates = means.into_iter().filter(|(_, states)| states.len() >= enough);
    let scored = candidates.map(|(configuration, states)| {
        let by_state: BTreeMap<i64, f64> =
            states.into_iter().map(|(state, (sum, count))| (state, sum / f64::from(count))).collect();
        let logs = by_state.iter().map(|(state, mean)| (mean / defaults[state]).max(f64::MIN_POSITIVE).ln());
        let score = logs.sum::<f64>() / by_state.len() as f64;
        (score, Fixed { configuration: configuration.to_owned(), by_state })
    });
    scored.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, fixed)| fixed)
}

#[cfg(test)]
mod tests {
    use treewright_core::standing::Gain;

    use super::*;

    fn standing(gain: Option<Gain>) -> Standing {
        Standing { cost: 8.0, cost_low: 7.9, cost_high: 8.1, gain, ..Standing::default() }
    }

    #[test]
    fn what_is_saved_counts_what_exploring_cost() {
        let gain = Gain { share: 0.2, low: Some(0.15), high: Some(0.25), probability_better: None };
        let default = DefaultCost::of(&standing(Some(gain))).expect("the default was measured");
        assert!((default.mean - 10.0).abs() < 1e-9 && default.error > 0.0);
        let good = Benefit::of(default, &[8.0; 100], 1e-3, DAY_S);
        assert!(good.words().starts_with("0.200 s ["), "{}", good.words());
        let mut all = good;
        all += Benefit::of(default, &[60.0; 10], 1e-3, DAY_S);
        assert!(all.saved_s < 0.0, "ten frames at six times the default's cost: {}", all.words());
        assert!(DefaultCost::of(&standing(None)).is_none());
        let hour = Benefit::of(default, &[8.0; 100], 1e-3, DAY_S / 24.0);
        assert!((hour.saved_s / good.saved_s - 24.0).abs() < 1e-9);
    }

    #[test]
    fn only_times_are_seconds() {
        let objective = |metrics: &[&str]| {
            let term = |metric: &&str| v1::ObjectiveTerm { metric: (*metric).to_owned(), weight: 1.0 };
            v1::Objective { terms: metrics.iter().map(term).collect(), ..v1::Objective::default() }
        };
        assert_eq!(unit_s(Some(&objective(&["build_ms", "render_ms"]))), Some(1e-3));
        for (metric, unit) in [
            ("wall_s", 1.0),
            ("seconds", 1.0),
            ("wall_seconds", 1.0),
            ("ms", 1e-3),
            ("frame_us", 1e-6),
            ("kernel_ns", 1e-9),
            ("epoch_minutes", 60.0),
            ("run_hours", 3600.0),
        ] {
            assert_eq!(unit_s(Some(&objective(&[metric]))), Some(unit), "{metric}");
        }
        for metric in ["errors_per_s", "latency_min", "loss", "items", "sms", "memory_mb"] {
            assert_eq!(unit_s(Some(&objective(&[metric]))), None, "{metric}");
        }
        let long = v1::Objective { episode_frames: 24, ..objective(&["wall_s"]) };
        assert_eq!(unit_s(Some(&long)), Some(24.0), "a trial's frames");
        assert_eq!(unit_s(Some(&objective(&["build_ms", "loss"]))), None);
        assert_eq!(unit_s(Some(&objective(&["build_ms", "render_s"]))), None);
        assert_eq!(unit_s(None), None);
        let rate = v1::Objective { maximised: vec!["rays_per_s".into()], ..objective(&["rays_per_s"]) };
        assert_eq!(unit_s(Some(&rate)), None, "rays a second are no seconds");
    }

    #[test]
    fn best_fixed_is_measured_in_many_states() {
        let run = |state, of: &str, cost| (state, of.to_owned(), cost);
        let runs = [
            run(1, "a", 1.0),
            run(1, "b", 8.0),
            run(1, "b", 6.0),
            run(2, "b", 50.0),
            run(1, "c", 9.0),
            run(2, "c", 90.0),
        ];
        let defaults = BTreeMap::from([(1, 10.0), (2, 100.0)]);
        let best = best_fixed(&runs, &defaults).expect("two were measured in both");
        assert_eq!((best.configuration.as_str(), best.by_state[&1]), ("b", 7.0));
        assert!(best_fixed(&runs[..1], &defaults).is_none());
    }
}
