//! Whom a tuned configuration is compared with, and when its search has paid for itself. Winners are measured again
//! before anything is claimed.
//!
//! The best of many noisy single measurements is mostly luck. So the best few configurations of the search
//! first run against each other; the winner of that is then measured once more, in fresh paired rounds,
//! against the paper's default and Embree's own structures. Only these figures are quoted.

use treewright_accel::NativeQuality;
use treewright_client::Configuration;

use super::objective::Objective;
use super::search::SearchOutcome;
use crate::measure::{Contender, Standing};
use crate::space::{Choice, ConfigurationError, Preset, TuningSpace};
use crate::statistics::BreakEven;

/// Name of the standing of the paper's recommended default.
pub const PAPER_DEFAULT: &str = "paper default";
/// Name of the standing of Embree's own structure of quality low, used path by path with single rays.
pub const NATIVE_LOW: &str = "native Embree low";
/// Name of the standing of Embree's own structure as `rtcCommitScene` builds it untold.
pub const NATIVE_DEFAULT: &str = "native Embree default";
/// Name of the standing of Embree's own structure of quality high.
pub const NATIVE_HIGH: &str = "native Embree high";
/// Name of the standing of the full space's default.
pub const BY_HAND: &str = "best by hand";
/// Name of the standing of a configuration of the paper's space that was found elsewhere.
pub const PAPER_TUNED: &str = "tuned in the paper's space";
/// Name of the winner's standing.
pub const TUNED: &str = "tuned";
/// Name of the standing of the predictor's answer.
pub const PREDICTED: &str = "first prediction";

/// What a run in a space is compared with.
pub fn baseline(preset: Preset) -> Contender {
    match preset {
        Preset::Full => named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        Preset::Paper => named(PAPER_DEFAULT, Choice::paper_default()),
    }
}

/// What everybody has: the paper's default, and Embree's own structures.
pub fn natives() -> Vec<Contender> {
    vec![
        named(PAPER_DEFAULT, Choice::paper_default()),
        named(NATIVE_LOW, Choice::native(NativeQuality::Low)),
        named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        named(NATIVE_HIGH, Choice::native(NativeQuality::High)),
    ]
}

/// Everybody that a winner has to be compared with: what everybody has, and for the full space where its search
/// began.
pub fn peers(space: &TuningSpace) -> Vec<Contender> {
    let mut peers = natives();
    if space.preset() == Preset::Full {
        peers.push(named(BY_HAND, space.default_choice()));
    }
    peers
}

fn named(name: &str, choice: Choice) -> Contender {
    Contender { name: name.to_owned(), choice }
}

/// A configuration with a name.
pub fn contender(
    name: &str,
    space: &TuningSpace,
    configuration: &Configuration,
) -> Result<Contender, ConfigurationError> {
    Ok(named(name, space.choice(configuration)?))
}

/// Break-even from what was measured. The search's own costs are those of its time; frames with the
/// baseline are taken at the reference of that time, `frames` of them a trial, and tuned ones at that over the
/// speed-up that was measured again.
pub fn break_even(
    found: &SearchOutcome,
    objective: Objective,
    frames: u32,
    standings: &[Standing],
    baseline: &str,
) -> BreakEven {
    let find = |name: &str| standings.iter().find(|standing| standing.name == name);
    let setup = |name: &str| match find(name) {
        Some(standing) if !objective.builds_each_frame() => standing.build_ms.median,
        _ => 0.0,
    };
    let pair = find(TUNED).zip(find(baseline));
    let speedup = pair.map_or(1.0, |(tuned, baseline)| tuned.speedup_over(baseline).median);
    let trials = &found.trials;
    BreakEven {
        tuning_ms: trials.iter().map(|trial| trial.total_ms).sum(),
        frames_while_tuning: frames * trials.iter().filter(|trial| trial.times.is_some()).count() as u32,
        tuned_setup_ms: setup(TUNED),
        tuned_frame_ms: found.reference_ms / speedup,
        default_setup_ms: setup(baseline),
        default_frame_ms: found.reference_ms,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::Summary;
    use crate::tuning::run_off::testing::trial;

    #[test]
    fn break_even_counts_builds_where_they_fall() {
        let standing = |name: &str, build: f64, speedup: f64| Standing {
            name: name.into(),
            build_ms: Summary::of(&[build]),
            render_ms: Summary::of(&[50.0]),
            frame_ms: Summary::of(&[50.0]),
            speedup: Summary::of(&[speedup]),
            rounds_ms: vec![50.0 / speedup],
            failure: None,
        };
        let standings = [standing(PAPER_DEFAULT, 20.0, 1.0), standing(TUNED, 30.0, 1.25)];
        let trials = vec![trial(Some(10.0), 1), trial(None, 2), trial(Some(8.0), 3)];
        let found = SearchOutcome { trials, reference_ms: 10.0 };
        let render = break_even(&found, Objective::Render, 1, &standings, PAPER_DEFAULT);
        assert_eq!((render.tuning_ms, render.frames_while_tuning), (36.0, 2));
        assert_eq!((render.default_setup_ms, render.tuned_setup_ms), (20.0, 30.0));
        // 36 + 30 + (n - 2) * 8 <= 20 + n * 10
        assert_eq!(render.frame(), Some(15));
        let total = break_even(&found, Objective::Total, 1, &standings, PAPER_DEFAULT);
        assert_eq!((total.default_setup_ms, total.tuned_setup_ms), (0.0, 0.0));
    }
}
