//! The rivals of a tuned configuration, the best of all, and the frame at which a search has paid for itself.
//!
//! The best of many noisy single measurements is mostly luck. So the search's best is measured again, in
//! fresh paired rounds, beside the configurations that need no search: the paper's default, native Embree as
//! its tutorials use it, native Embree used as well as this renderer can, and the best fixed configuration,
//! where the search began. Only figures of these rounds are quoted, and a configuration that lost to a rival
//! in them is not called tuned.

use serde::Serialize;
use treewright_accel::NativeQuality;
use treewright_client::Configuration;

use super::objective::Objective;
use super::search::SearchOutcome;
use crate::light_sampling::LightSampling;
use crate::measure::{Contender, Standing};
use crate::space::{self, Choice, ConfigurationError, Premises, Preset, Start, TuningSpace};
use crate::statistics::{BreakEven, Ratio};

/// Name of the standing of the paper's recommended default.
pub const PAPER_DEFAULT: &str = "paper default";
/// Name of the standing of Embree's own structure of quality low, used path by path with single rays.
pub const NATIVE_LOW: &str = "native Embree low";
/// Name of the standing of Embree's own structure as `rtcCommitScene` builds it untold.
pub const NATIVE_DEFAULT: &str = "native Embree default";
/// Name of the standing of Embree's own structure of quality high.
pub const NATIVE_HIGH: &str = "native Embree high";
/// Name of the standing of Embree's own structure with our stages and packets, in whichever quality was the
/// fastest.
pub const NATIVE_USED_WELL: &str = "native used well";
/// Name of the standing of the configuration that is recommended for all scenes, the best known by hand,
/// where a search in the full space begins.
pub const BEST_FIXED: &str = "best fixed configuration";
/// Name of the standing of the configuration that is recommended where a tree serves a thousand frames.
pub const FOR_STILLS: &str = "best fixed for stills";
/// Name of the standing of a configuration of the paper's space that was found elsewhere.
pub const PAPER_TUNED: &str = "tuned in the paper's space";
/// Name of the standing of what a search found, as long as it is not known to be the best.
pub const FOUND: &str = "found by the search";
/// Name of the standing of the search's best, once it has beaten all rivals.
pub const TUNED: &str = "tuned";
/// Name of the standing of a configuration of the user's, where the search began.
pub const YOUR_START: &str = "your start";
/// Name of the standing of the recommended tree with light sampled by the renderer's own constants.
pub const PLAIN_LIGHT: &str = "light by the renderer's constants";
/// Name of the standing of the predictor's answer.
pub const PREDICTED: &str = "first prediction";

/// The qualities of [`NATIVE_USED_WELL`].
const QUALITIES: [&str; 3] = ["low", "medium", "high"];

/// More variants of it, where a scene moves and structures are fitted to it.
const FITTED: [&str; 2] = ["low fitted", "medium fitted"];

/// A configuration to be beaten.
#[derive(Clone, Debug)]
pub struct Rival {
    /// With a name.
    pub contender: Contender,
    /// As a configuration of the searched space; `None` if it is outside of it.
    pub configuration: Option<Configuration>,
}

/// The baseline of a run in a space.
pub fn baseline(preset: Preset) -> Contender {
    match preset {
        Preset::Full => named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        Preset::Paper => named(PAPER_DEFAULT, Choice::paper_default()),
        Preset::Light | Preset::Follow => named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
    }
}

/// The baseline of a search that begins at `start`.
pub fn baseline_from(space: &TuningSpace, start: &Start) -> Contender {
    match start {
        Start::Recommended => baseline(space.preset()),
        other => named(start_name(space.preset(), other), space.default_choice()),
    }
}

/// The contenders that everybody has: the paper's default, and Embree's own structures.
pub fn natives() -> [Contender; 4] {
    [
        named(PAPER_DEFAULT, Choice::paper_default()),
        named(NATIVE_LOW, Choice::native(NativeQuality::Low)),
        named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        named(NATIVE_HIGH, Choice::native(NativeQuality::High)),
    ]
}

/// Native Embree with the stages and packets of the best fixed configuration, once for each quality that
/// there is.
pub fn used_well(full: &TuningSpace) -> Vec<Rival> {
    let configurations = QUALITIES.iter().filter_map(|quality| {
        let given = Configuration::new().with("backend", "native").with("native_quality", *quality);
        Some((*quality, full.complete(&given).ok()?))
    });
    let rival = |(quality, configuration): (&str, Configuration)| {
        let contender = contender(&used_well_name(quality), full, &configuration).ok()?;
        Some(Rival { contender, configuration: Some(configuration) })
    };
    configurations.filter_map(rival).collect()
}

fn used_well_name(quality: &str) -> String {
    format!("{NATIVE_USED_WELL} {quality}")
}

/// All rivals of the search's best. `premises` are those of the scene.
pub fn rivals(space: &TuningSpace, premises: &Premises, start: &Start) -> Vec<Rival> {
    let outside = |contender| Rival { contender, configuration: None };
    match space.preset() {
        Preset::Light => return light_rivals(space, start),
        Preset::Follow => return follow_rivals(space, start),
        Preset::Full | Preset::Paper => {}
    }
    let mut all: Vec<Rival> = natives().into_iter().map(outside).collect();
    let full = TuningSpace::new(Preset::Full, premises);
    let mut own = used_well(&full);
    let fixed = full.default_configuration();
    own.push(Rival { contender: named(BEST_FIXED, full.default_choice()), configuration: Some(fixed) });
    if space.preset() != Preset::Full {
        own.iter_mut().for_each(|rival| rival.configuration = None);
    }
    for rival in &mut all {
        // Path by path, ray by ray: these are configurations of the full space, too.
        let quality = match rival.contender.name.as_str() {
            NATIVE_LOW => "low",
            NATIVE_DEFAULT => "medium",
            NATIVE_HIGH => "high",
            _ => continue,
        };
        let text = format!("backend=native,native_quality={quality},staged=false,tile=16");
        rival.configuration = space::parse(&text).ok().and_then(|given| space.complete(&given).ok());
        if let Some(choice) = rival.configuration.as_ref().and_then(|own| space.choice(own).ok()) {
            // Watertight where all are.
            rival.contender.choice = choice;
        }
    }
    if premises.robust && space.preset() == Preset::Full {
        all.retain(|rival| rival.contender.name != NATIVE_HIGH);
    }
    all.extend(own);
    if matches!(start, Start::Own(_)) {
        let contender = named(YOUR_START, space.default_choice());
        all.push(Rival { contender, configuration: Some(space.default_configuration()) });
    }
    all
}

/// The recommendation for many frames, where a tree serves some. It is a rival beside the recommendation for
/// one frame, at which the search begins.
pub fn for_stills(objective: Objective, space: &TuningSpace, premises: &Premises) -> Option<Rival> {
    let is_asked = matches!(objective, Objective::Auto(_)) && space.preset() == Preset::Full;
    let stills = TuningSpace::new(Preset::Full, &Premises { builds_each_frame: false, ..*premises });
    let configuration = space.complete(&stills.default_configuration()).ok().filter(|_| is_asked)?;
    let contender = contender(FOR_STILLS, space, &configuration).ok()?;
    Some(Rival { contender, configuration: Some(configuration) })
}

/// The rivals of light sampling: Embree's default and the recommended tree, both with the renderer's own
/// constants, and the recommendation for all scenes.
fn light_rivals(space: &TuningSpace, start: &Start) -> Vec<Rival> {
    let own = |name, choice| Rival { contender: named(name, choice), configuration: None };
    let untuned = Choice { light: LightSampling::default(), ..space.default_choice() };
    vec![
        own(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        own(PLAIN_LIGHT, untuned),
        own_start(space, start),
    ]
}

/// The rivals of ways to follow: Embree's structures rebuilt for each frame, path by path; Embree used well,
/// rebuilt or fitted; and the recommendation for all scenes.
fn follow_rivals(space: &TuningSpace, start: &Start) -> Vec<Rival> {
    let [_, low, default, _] = natives().map(|contender| Rival { contender, configuration: None });
    let used_well = [
        ("low", "tree=native_low,period=1"),
        ("medium", "tree=native_medium,period=1"),
        (FITTED[0], "tree=native_low,period=64"),
        (FITTED[1], "tree=native_medium,period=64"),
    ];
    let used_well = used_well.into_iter().filter_map(|(variant, text)| {
        let configuration = space.complete(&space::parse(text).ok()?).ok()?;
        let contender = contender(&used_well_name(variant), space, &configuration).ok()?;
        Some(Rival { contender, configuration: Some(configuration) })
    });
    [low, default].into_iter().chain(used_well).chain([own_start(space, start)]).collect()
}

/// Where a search begins.
fn own_start(space: &TuningSpace, start: &Start) -> Rival {
    let name = if matches!(start, Start::Own(_)) { YOUR_START } else { BEST_FIXED };
    let configuration = Some(space.default_configuration());
    Rival { contender: named(name, space.default_choice()), configuration }
}

/// Whether a user who begins at `start` has a rival without any search. A user who does not begin at the
/// recommended configuration does not know it, nor how to use native Embree well.
pub fn is_had(rival: &str, start: &Start) -> bool {
    *start == Start::Recommended
        || ![BEST_FIXED, FOR_STILLS].contains(&rival) && !rival.starts_with(NATIVE_USED_WELL)
}

/// Keeps of native Embree used well the quality with the lowest median, under one name. It is chosen by the
/// rounds whose figures are shown, which favours it a little.
pub fn keep_best_native(standings: Vec<Standing>) -> Vec<Standing> {
    let variants = || QUALITIES.into_iter().chain(FITTED);
    let quality_of = |name: &str| variants().find(|quality| name == used_well_name(quality));
    let works = |one: &&Standing| one.failure.is_none() && one.frame_ms.count > 0;
    let best = standings
        .iter()
        .filter(|one| quality_of(&one.name).is_some())
        .filter(works)
        .min_by(|a, b| a.frame_ms.median.total_cmp(&b.frame_ms.median))
        .map(|one| one.name.clone());
    let keep = |mut one: Standing| match quality_of(&one.name) {
        None => Some(one),
        Some(quality) if best.as_ref() == Some(&one.name) => {
            one.variant = Some(quality.to_owned());
            one.name = NATIVE_USED_WELL.to_owned();
            Some(one)
        }
        Some(_) => None,
    };
    standings.into_iter().filter_map(keep).collect()
}

/// Whether a rival stands under this name among standings from which the slower natives have been left out.
pub fn is_of(rival: &str, name: &str, standings: &[Standing]) -> bool {
    let variant = standings.iter().find(|one| one.name == name).and_then(|one| one.variant.as_ref());
    variant.map_or_else(|| rival == name, |variant| rival == used_well_name(variant))
}

/// Name of the standing with which a search in a space begins.
pub fn start_name(preset: Preset, start: &Start) -> &'static str {
    match (preset, start) {
        (_, Start::Own(_)) => YOUR_START,
        (_, Start::Native) => NATIVE_DEFAULT,
        (Preset::Full | Preset::Light | Preset::Follow, Start::Recommended) => BEST_FIXED,
        (_, Start::Paper) | (Preset::Paper, Start::Recommended) => PAPER_DEFAULT,
    }
}

/// Chooses the standing to use. That is the one called `start` unless another is shown to be faster: by the
/// interval of pairs with it, or, for the search's best, by the service's race (`is_proven`) and the median
/// of the pairs together. Of several for which `may_win` holds it is the one with the highest median. So a
/// few lucky rounds replace nothing.
///
/// The search's best is renamed [`TUNED`] if it is chosen, and keeps the name [`FOUND`] otherwise. Returns
/// the name of the chosen standing.
pub fn crown(
    standings: &mut [Standing],
    start: &str,
    is_proven: bool,
    may_win: impl Fn(&str) -> bool,
) -> String {
    let works = |one: &&Standing| one.failure.is_none() && one.frame_ms.count > 0;
    let find = |name: &str| standings.iter().filter(works).find(|one| one.name == name);
    // Where the start cannot be built, the search's best has no incumbent to beat.
    let Some(incumbent) = find(start).or_else(|| find(FOUND)) else {
        return String::new();
    };
    let is_shown =
        |one: &Standing, gain: &Ratio| gain.is_gain() || is_proven && one.name == FOUND && gain.median > 1.0;
    let better = standings
        .iter()
        .filter(works)
        .filter(|one| may_win(&one.name))
        .map(|one| (one, one.gain_over(incumbent)))
        .filter(|(one, gain)| is_shown(one, gain))
        .max_by(|(_, a), (_, b)| a.median.total_cmp(&b.median));
    let best = better.map_or(incumbent, |(one, _)| one).name.clone();
    if best != FOUND {
        return best;
    }
    standings.iter_mut().filter(|one| one.name == FOUND).for_each(|one| one.name = TUNED.to_owned());
    TUNED.to_owned()
}

/// Gains of a run's best configuration over its rivals. All ratios are medians of pairs of the same rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Gains {
    /// The best fixed configuration, where the search began, over native Embree's default.
    pub start: Option<Ratio>,
    /// The gain by the search: the best over the best fixed configuration.
    pub over_best_fixed: Option<Ratio>,
    /// Both together: the best over native Embree's default.
    pub over_native_default: Option<Ratio>,
    /// The best over native Embree used well.
    pub over_native_used_well: Option<Ratio>,
    /// The best over where the search began.
    pub over_start: Option<Ratio>,
}

impl Gains {
    /// Of the standing called `best`, found by a search that began at the one called `start`.
    pub fn of(standings: &[Standing], best: &str, start: &str) -> Self {
        let find = |name: &str| standings.iter().find(|one| one.name == name);
        let ratio = |one: &str, other: &str| {
            let ratio = find(one)?.gain_over(find(other)?);
            (ratio.count > 0).then_some(ratio)
        };
        Self {
            start: ratio(BEST_FIXED, NATIVE_DEFAULT),
            over_best_fixed: ratio(best, BEST_FIXED),
            over_native_default: ratio(best, NATIVE_DEFAULT),
            over_native_used_well: ratio(best, NATIVE_USED_WELL),
            over_start: ratio(best, start),
        }
    }
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

/// Break-even from the measurements. The search's own costs are those of its time. Later frames of the
/// baseline have its cost in the final rounds, and those of the best configuration that cost over its
/// speed-up in these rounds. `frames` is the number of frames of each trial.
pub fn break_even(
    found: &SearchOutcome,
    objective: Objective,
    frames: u32,
    standings: &[Standing],
    best: &str,
    baseline: &str,
) -> BreakEven {
    let find = |name: &str| standings.iter().find(|standing| standing.name == name);
    let setup = |name: &str| match find(name) {
        Some(standing) if !objective.builds_each_frame() => standing.build_ms.median,
        _ => 0.0,
    };
    let pair = find(best).zip(find(baseline));
    let speedup = pair.map_or(1.0, |(tuned, baseline)| tuned.speedup_over(baseline).median);
    let baseline_ms = find(baseline).map_or(0.0, |standing| standing.frame_ms.median);
    let frame_ms = if baseline_ms > 0.0 { baseline_ms } else { found.reference_ms };
    let trials = &found.trials;
    BreakEven {
        tuning_ms: trials.iter().map(|trial| trial.total_ms).sum(),
        frames_while_tuning: frames * trials.iter().filter(|trial| trial.times.is_some()).count() as u32,
        tuned_setup_ms: setup(best),
        tuned_frame_ms: frame_ms / speedup,
        default_setup_ms: setup(baseline),
        default_frame_ms: frame_ms,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disturbance::Disturbance;
    use crate::measure::{Measured, standings};
    use crate::statistics::Summary;
    use crate::tuning::search::testing::trial;

    fn measured(name: &str, render_ms: f64) -> Measured {
        let rounds = (0..9).map(|round| render_ms * (1.0 + 0.01 * f64::from(round))).collect();
        Measured { name: name.into(), build_ms: vec![2.0], render_ms: rounds, ..Measured::default() }
    }

    fn table(frames: &[(&str, f64)]) -> Vec<Standing> {
        let all: Vec<Measured> = frames.iter().map(|(name, ms)| measured(name, *ms)).collect();
        keep_best_native(standings(&all, 1000))
    }

    #[test]
    fn what_moves_is_compared_with_fitted_structures_too() {
        let premises = Premises::all();
        let space = TuningSpace::new(Preset::Follow, &premises);
        let all = rivals(&space, &premises, &Start::Recommended);
        let named =
            |name: &str| all.iter().find(|rival| rival.contender.name == name).expect("it takes part");
        let [built, fitted] = ["native used well medium", "native used well medium fitted"].map(named);
        assert_eq!(built.contender.choice.update, treewright_accel::Update::Rebuild);
        assert_eq!(fitted.contender.choice.update, treewright_accel::Update::Refit);
        assert!(built.configuration.is_some() && fitted.configuration.is_some(), "they join the race");
        let of_table = table(&[("native used well medium", 3.0), ("native used well medium fitted", 2.0)]);
        assert_eq!(
            of_table.iter().map(Standing::title).collect::<Vec<_>>(),
            ["native used well (medium fitted)"]
        );
        assert!(is_of("native used well medium fitted", NATIVE_USED_WELL, &of_table));
    }

    #[test]
    fn a_loser_is_not_called_tuned() {
        let beaten = [
            ("native used well low", 40.0),
            ("native used well high", 30.0),
            (BEST_FIXED, 31.0),
            (FOUND, 32.0),
        ];
        let mut lost = table(&beaten);
        let names: Vec<String> = lost.iter().map(Standing::title).collect();
        assert_eq!(names, ["native used well (high)", BEST_FIXED, FOUND]);
        assert_eq!(crown(&mut lost, BEST_FIXED, true, |_| true), NATIVE_USED_WELL);
        assert!(lost.iter().all(|one| one.name != TUNED));
        // A result that only equals its start is not a finding.
        let mut level = table(&[(BEST_FIXED, 31.0), (FOUND, 31.0)]);
        assert_eq!(crown(&mut level, BEST_FIXED, true, |_| true), BEST_FIXED);
        let mut won = table(&[
            (NATIVE_DEFAULT, 60.0),
            ("native used well low", 40.0),
            (BEST_FIXED, 31.0),
            (FOUND, 25.0),
        ]);
        assert_eq!(crown(&mut won, BEST_FIXED, false, |_| true), TUNED);
        let gains = Gains::of(&won, TUNED, BEST_FIXED);
        let median = |ratio: Option<Ratio>| ratio.map_or(0.0, |ratio| ratio.median);
        assert!(
            (median(gains.start) * median(gains.over_best_fixed) - median(gains.over_native_default)).abs()
                < 1e-3
        );
        assert!((median(gains.over_native_used_well) - 1.6).abs() < 1e-3);
        assert!(gains.over_best_fixed.is_some_and(|ratio| ratio.is_gain()));
    }

    #[test]
    fn a_lucky_few_rounds_replace_nothing() {
        let of = |name: &str, rounds_ms: &[f64]| Measured {
            name: name.into(),
            build_ms: vec![2.0],
            render_ms: rounds_ms.to_vec(),
            ..Measured::default()
        };
        let start = of(BEST_FIXED, &[30.0; 9]);
        // Faster in five rounds of nine.
        let lucky = [26.0, 27.0, 26.0, 28.0, 29.0, 31.0, 33.0, 36.0, 34.0];
        let native = [start.clone(), of(NATIVE_LOW, &lucky), of(FOUND, &[30.5; 9])];
        assert_eq!(crown(&mut standings(&native, 1000), BEST_FIXED, false, |_| true), BEST_FIXED);
        let found = [start.clone(), of(FOUND, &lucky)];
        assert_eq!(crown(&mut standings(&found, 1000), BEST_FIXED, false, |_| true), BEST_FIXED);
        // A result that the service's own race has proven needs no second proof, but no contradiction either.
        assert_eq!(crown(&mut standings(&found, 1000), BEST_FIXED, true, |_| true), TUNED);
        let slower = [start.clone(), of(FOUND, &[31.0; 9])];
        assert_eq!(crown(&mut standings(&slower, 1000), BEST_FIXED, true, |_| true), BEST_FIXED);
        // Fewer rounds than have an interval show nothing.
        let few = [of(BEST_FIXED, &[30.0; 5]), of(FOUND, &[20.0; 5])];
        assert_eq!(crown(&mut standings(&few, 1000), BEST_FIXED, false, |_| true), BEST_FIXED);
        // A start that cannot be built is never chosen.
        let broken = Measured { failure: Some("out of memory".into()), ..of(BEST_FIXED, &[]) };
        let alone = [broken, of(NATIVE_LOW, &[40.0; 9]), of(FOUND, &[31.0; 9])];
        assert_eq!(crown(&mut standings(&alone, 1000), BEST_FIXED, false, |_| true), TUNED);
        assert_eq!(crown(&mut [], BEST_FIXED, false, |_| true), "");
    }

    #[test]
    fn rivals_of_the_full_space_are_configurations_of_it() {
        let premises = Premises::all();
        let full = TuningSpace::new(Preset::Full, &premises);
        for rival in rivals(&full, &premises, &Start::Recommended) {
            let Some(configuration) = rival.configuration else {
                assert_eq!(rival.contender.name, PAPER_DEFAULT);
                continue;
            };
            let own = full.choice(&configuration).expect("it is of the space");
            assert_eq!(own, rival.contender.choice, "{}", rival.contender.name);
        }
        assert_eq!(used_well(&full).len(), 3);
        let robust = TuningSpace::new(Preset::Full, &Premises { robust: true, ..premises });
        assert_eq!(used_well(&robust).len(), 2, "a watertight structure of quality high is one of medium");
        let paper = rivals(&TuningSpace::paper(), &premises, &Start::Recommended);
        assert!(paper.len() == 8 && paper.iter().all(|rival| rival.configuration.is_none()));
    }

    #[test]
    fn who_begins_elsewhere_is_not_supposed_to_know_the_recommended_configuration() {
        let premises = Premises::all();
        let full = TuningSpace::new(Preset::Full, &premises);
        let own = space::parse("quality=3,collapse=builder").expect("words");
        for (start, name) in [
            (Start::Native, NATIVE_DEFAULT),
            (Start::Paper, PAPER_DEFAULT),
            (Start::Own(own.clone()), YOUR_START),
        ] {
            let begun = full.beginning_at(&start).expect("it is one of the space");
            let rivals = rivals(&begun, &premises, &start);
            let first = rivals.iter().find(|rival| rival.contender.name == name).expect("it takes part");
            assert_eq!(first.contender.choice, baseline_from(&begun, &start).choice, "{name}");
            assert_eq!(baseline_from(&begun, &start).name, name);
            // The recommended configuration still runs beside it, unchanged.
            let fixed = rivals.iter().find(|rival| rival.contender.name == BEST_FIXED).expect("it runs");
            assert_eq!(fixed.contender.choice, full.default_choice());
            let had = |rival: &&Rival| is_had(&rival.contender.name, &start);
            assert!(!rivals.iter().filter(had).any(|rival| rival.contender.name == BEST_FIXED));
            assert_eq!(rivals.iter().filter(had).count(), if name == YOUR_START { 5 } else { 4 });
        }
        let frames =
            [(NATIVE_DEFAULT, 60.0), ("native used well low", 40.0), (BEST_FIXED, 31.0), (FOUND, 45.0)];
        let mut standings = table(&frames);
        let may_win = |name: &str| is_had(name, &Start::Native);
        assert_eq!(crown(&mut standings, NATIVE_DEFAULT, false, may_win), TUNED);
        let gains = Gains::of(&standings, TUNED, NATIVE_DEFAULT);
        assert!(gains.over_start.is_some_and(|ratio| ratio.is_gain()));
        let is_loss = |ratio: Ratio| ratio.interval.is_some_and(|[_, high]| high < 1.0);
        assert!(gains.over_best_fixed.is_some_and(is_loss));
    }

    #[test]
    fn break_even_counts_builds_where_they_fall() {
        let standing = |name: &str, build: f64, speedup: f64| Standing {
            name: name.into(),
            variant: None,
            build_ms: Summary::of(&[build]),
            render_ms: Summary::of(&[10.0 / speedup]),
            frame_ms: Summary::of(&[10.0 / speedup]),
            speedup: Summary::of(&[speedup]),
            rounds_ms: vec![10.0 / speedup],
            undelayed_ms: vec![10.0 / speedup],
            failure: None,
        };
        let standings = [standing(PAPER_DEFAULT, 20.0, 1.0), standing(TUNED, 30.0, 1.25)];
        let trials = vec![trial(Some(10.0), 1), trial(None, 2), trial(Some(8.0), 3)];
        // The machine's speed in another minute says nothing of frames to come.
        let found = SearchOutcome { trials, reference_ms: 17.0, disturbance: Disturbance::default() };
        let render = break_even(&found, Objective::Render, 1, &standings, TUNED, PAPER_DEFAULT);
        assert_eq!((render.tuning_ms, render.frames_while_tuning), (36.0, 2));
        assert_eq!((render.default_setup_ms, render.tuned_setup_ms), (20.0, 30.0));
        // 36 + 30 + (n - 2) * 8 <= 20 + n * 10
        assert_eq!(render.frame(), Some(15));
        let total = break_even(&found, Objective::Total, 1, &standings, TUNED, PAPER_DEFAULT);
        assert_eq!((total.default_setup_ms, total.tuned_setup_ms), (0.0, 0.0));
    }
}
