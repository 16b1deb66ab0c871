//! The rivals of a tuned configuration, the best of all, and the frame at which a search has paid for itself.
//!
//! The best of many noisy single measurements is mostly luck. So it is measured again, in fresh paired
//! rounds, beside the configurations that need no search: the paper's default, native Embree as its tutorials
//! use it and used well, and the best fixed one. Only figures of these rounds are quoted.

use serde::Serialize;
use treewright_accel::NativeQuality;
use treewright_client::Configuration;

use super::who::{NATIVE_DEFAULT, NativeUse, Who};
use super::{objective::Objective, search::SearchOutcome};
use crate::light_sampling::LightSampling;
use crate::measure::{Contender, Standing};
use crate::space::{self, Choice, ConfigurationError, Premises, Preset, Start, TuningSpace};
use crate::statistics::{BreakEven, Ratio, Summary, alternating, fastest_of_other_half};

/// A configuration to be beaten.
#[derive(Clone, Debug)]
pub struct Rival {
    /// Who it is.
    pub contender: Contender,
    /// As a configuration of the searched space; `None` if it is outside of it.
    pub configuration: Option<Configuration>,
}

impl From<Contender> for Rival {
    /// One outside of the searched space.
    fn from(contender: Contender) -> Self {
        Self { contender, configuration: None }
    }
}

impl Rival {
    /// A configuration of a space.
    ///
    /// # Errors
    /// It is none of that space.
    pub fn of(
        who: Who,
        space: &TuningSpace,
        configuration: Configuration,
    ) -> Result<Self, ConfigurationError> {
        let contender = contender(who, space, &configuration)?;
        Ok(Self { contender, configuration: Some(configuration) })
    }

    /// The configuration that a space begins at.
    fn at_start(who: Who, space: &TuningSpace) -> Self {
        let configuration = Some(space.default_configuration());
        Self { contender: named(who, space.default_choice()), configuration }
    }
}

/// The baseline of a run in a space.
pub fn baseline(preset: Preset) -> Contender {
    match preset {
        Preset::Full => named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)),
        Preset::Paper => named(Who::PaperDefault, Choice::paper_default()),
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
    let [low, default, high] =
        NativeQuality::ALL.map(|quality| named(Who::Native(quality), Choice::native(quality)));
    [named(Who::PaperDefault, Choice::paper_default()), low, default, high]
}

/// Native Embree with the stages and packets of the best fixed configuration, for each quality.
pub fn used_well(full: &TuningSpace) -> Vec<Rival> {
    let rival = |quality: NativeQuality| {
        let given = Configuration::new().with("backend", "native").with("native_quality", quality.name());
        native_use(full, &given, NativeUse { quality, fitted: false, by_path: false })
    };
    NativeQuality::ALL.into_iter().filter_map(rival).collect()
}

/// A variant of native Embree used well; `None` where the space has no such configuration.
fn native_use(space: &TuningSpace, given: &Configuration, variant: NativeUse) -> Option<Rival> {
    Rival::of(Who::UsedWellIn(variant), space, space.complete(given).ok()?).ok()
}

/// All rivals of the search's best. `premises` are those of the scene.
pub fn rivals(space: &TuningSpace, premises: &Premises, start: &Start) -> Vec<Rival> {
    match space.preset() {
        Preset::Light => return light_rivals(space, start),
        Preset::Follow => return follow_rivals(space, start),
        Preset::Full | Preset::Paper => {}
    }
    let mut all: Vec<Rival> = natives().map(Rival::from).into();
    let full = TuningSpace::new(Preset::Full, premises);
    let mut own = used_well(&full);
    own.push(Rival::at_start(Who::BestFixed, &full));
    if space.preset() != Preset::Full {
        own.iter_mut().for_each(|rival| rival.configuration = None);
    }
    for rival in &mut all {
        // Path by path, ray by ray: these are configurations of the full space, too.
        let Who::Native(quality) = rival.contender.who else { continue };
        let text = format!("backend=native,native_quality={},staged=false", quality.name());
        rival.configuration = space::parse(&text).ok().and_then(|given| space.complete(&given).ok());
        if let Some(choice) = rival.configuration.as_ref().and_then(|own| space.choice(own).ok()) {
            // Watertight where all are.
            rival.contender.choice = choice;
        }
    }
    if premises.robust && space.preset() == Preset::Full {
        all.retain(|rival| rival.contender.who != Who::Native(NativeQuality::High));
    }
    all.extend(own);
    if matches!(start, Start::Own(_)) {
        all.push(Rival::at_start(Who::YourStart, space));
    }
    all
}

/// The recommendation for many frames, a rival where a tree serves some.
pub fn for_stills(objective: Objective, space: &TuningSpace, premises: &Premises) -> Option<Rival> {
    let is_asked = matches!(objective, Objective::Auto(_)) && space.preset() == Preset::Full;
    let stills = TuningSpace::new(Preset::Full, &Premises { builds_each_frame: false, ..*premises });
    let configuration = space.complete(&stills.default_configuration()).ok().filter(|_| is_asked)?;
    Rival::of(Who::ForStills, space, configuration).ok()
}

/// The rivals of light sampling: two trees with the renderer's constants, and the recommendation.
fn light_rivals(space: &TuningSpace, start: &Start) -> Vec<Rival> {
    let untuned = Choice { light: LightSampling::default(), ..space.default_choice() };
    vec![
        named(NATIVE_DEFAULT, Choice::native(NativeQuality::Medium)).into(),
        named(Who::PlainLight, untuned).into(),
        own_start(space, start),
    ]
}

/// The rivals of ways to follow: Embree rebuilt, path by path or well, or fitted; the recommendation.
fn follow_rivals(space: &TuningSpace, start: &Start) -> Vec<Rival> {
    let [_, low, default, _] = natives().map(Rival::from);
    let qualities = [NativeQuality::Low, NativeQuality::Medium];
    let uses = [1, 64].into_iter().flat_map(|period| qualities.map(|quality| (quality, period)));
    let used_well = uses.filter_map(|(quality, period)| {
        let given = space::parse(&format!("tree=native_{},period={period}", quality.name())).ok()?;
        native_use(space, &given, NativeUse { quality, fitted: period > 1, by_path: false })
    });
    [low, default].into_iter().chain(used_well).chain([own_start(space, start)]).collect()
}

fn own_start(space: &TuningSpace, start: &Start) -> Rival {
    let who = if matches!(start, Start::Own(_)) { Who::YourStart } else { Who::BestFixed };
    Rival::at_start(who, space)
}

/// Whether a user who begins at `start` has a rival without any search.
pub fn is_had(rival: &Who, start: &Start) -> bool {
    *start == Start::Recommended || !rival.takes_knowledge()
}

/// Makes one standing of native use: the fastest variant that ran or Embree's default, which stays.
pub fn keep_best_native(mut standings: Vec<Standing>) -> Vec<Standing> {
    let is_variant = |one: &Standing| matches!(one.who, Who::UsedWellIn(_));
    if let Some(first) = standings.iter().position(is_variant) {
        let best = best_use(&standings);
        standings.retain(|one| !is_variant(one));
        if let Some(best) = best {
            standings.insert(first, best);
        }
    }
    standings
}

/// The fastest way to use Embree's own structure: each half of the rounds has the times of the fastest in the
/// other half ([`fastest_of_other_half`]); the faster one of all gives name, builds and memory.
fn best_use(standings: &[Standing]) -> Option<Standing> {
    let works = |one: &&Standing| one.failure.is_none() && !one.undelayed_ms.is_empty();
    let uses: Vec<(NativeUse, &Standing)> =
        standings.iter().filter(works).filter_map(|one| Some((one.who.native_use()?, one))).collect();
    let rounds_ms: Vec<&[f64]> = uses.iter().map(|(_, one)| one.undelayed_ms.as_slice()).collect();
    let [even, odd] = fastest_of_other_half(&rounds_ms)?.map(|place| uses[place]);
    let median = |one: &Standing| Summary::of(&one.undelayed_ms).median;
    let (variant, best) = if median(odd.1) < median(even.1) { odd } else { even };
    let rounds_ms = alternating(&even.1.rounds_ms, &odd.1.rounds_ms);
    let undelayed_ms = alternating(&even.1.undelayed_ms, &odd.1.undelayed_ms);
    Some(Standing {
        who: Who::UsedWell,
        variant: Some(variant),
        frame_ms: Summary::of(&rounds_ms),
        speedup: Summary::of_ratios(&standings.first()?.undelayed_ms, &undelayed_ms),
        rounds_ms,
        undelayed_ms,
        ..best.clone()
    })
}

/// Whether a rival is `who` among standings from which the slower natives have been left out.
pub fn is_of(rival: &Who, who: &Who, standings: &[Standing]) -> bool {
    let variant = standings.iter().find(|one| one.who == *who).and_then(|one| one.variant);
    variant.map_or_else(|| rival == who, |variant| rival.native_use() == Some(variant))
}

/// The standing with which a search in a space begins.
pub fn start_name(preset: Preset, start: &Start) -> Who {
    match (preset, start) {
        (_, Start::Own(_)) => Who::YourStart,
        (_, Start::Native) => NATIVE_DEFAULT,
        (Preset::Full | Preset::Light | Preset::Follow, Start::Recommended) => Who::BestFixed,
        (_, Start::Paper) | (Preset::Paper, Start::Recommended) => Who::PaperDefault,
    }
}

/// Chooses the standing to use: `start`, unless one for which `may_win` holds is shown to be faster, by the
/// interval of pairs or, for the search's best, by the service's race (`is_proven`). The search's best then
/// becomes [`Who::Tuned`], and stays [`Who::Found`] otherwise.
pub fn crown(
    standings: &mut [Standing],
    start: &Who,
    is_proven: bool,
    may_win: impl Fn(&Who) -> bool,
) -> Who {
    let works = |one: &&Standing| one.failure.is_none() && one.frame_ms.count > 0;
    let find = |who: &Who| standings.iter().filter(works).find(|one| one.who == *who);
    // Where the start cannot be built, the search's best has no incumbent to beat.
    let Some(incumbent) = find(start).or_else(|| find(&Who::Found)) else { return Who::Nobody };
    let is_shown = |one: &Standing, gain: &Ratio| {
        gain.is_gain() || is_proven && one.who == Who::Found && gain.median > 1.0
    };
    let better = standings
        .iter()
        .filter(works)
        .filter(|one| may_win(&one.who))
        .map(|one| (one, one.gain_over(incumbent)))
        .filter(|(one, gain)| is_shown(one, gain))
        .max_by(|(_, a), (_, b)| a.median.total_cmp(&b.median));
    let best = better.map_or(incumbent, |(one, _)| one).who.clone();
    if best != Who::Found {
        return best;
    }
    standings.iter_mut().filter(|one| one.who == Who::Found).for_each(|one| one.who = Who::Tuned);
    Who::Tuned
}

/// In words, where it is worth a word: how many of the `wanted` rounds there was time for.
pub fn fewer_rounds_note(standings: &[Standing], wanted: u32) -> Option<String> {
    let rounds = standings.iter().map(|one| one.rounds_ms.len()).max().filter(|rounds| *rounds > 0)?;
    (rounds < wanted as usize)
        .then(|| format!("the final comparison has {rounds} rounds of {wanted}, because each takes long"))
}

/// Gains of a run's best configuration over its rivals. All ratios are medians of pairs of shared rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Gains {
    /// The best fixed configuration, where the search began, over native Embree's default.
    pub start: Option<Ratio>,
    /// The gain by the search: the best over the best fixed configuration.
    pub over_best_fixed: Option<Ratio>,
    /// Both together: the best over native Embree's default.
    pub over_native_default: Option<Ratio>,
    /// The best over native Embree used well: the fastest of its default and of all ways with our stages.
    pub over_native_used_well: Option<Ratio>,
    /// The best over where the search began.
    pub over_start: Option<Ratio>,
}

impl Gains {
    /// Of the standing of `best`, found by a search that began at `start`.
    pub fn of(standings: &[Standing], best: &Who, start: &Who) -> Self {
        let find = |who: &Who| standings.iter().find(|one| one.who == *who);
        let ratio = |one: &Who, other: &Who| {
            let ratio = find(one)?.gain_over(find(other)?);
            (ratio.count > 0).then_some(ratio)
        };
        Self {
            start: ratio(&Who::BestFixed, &NATIVE_DEFAULT),
            over_best_fixed: ratio(best, &Who::BestFixed),
            over_native_default: ratio(best, &NATIVE_DEFAULT),
            over_native_used_well: ratio(best, &Who::UsedWell),
            over_start: ratio(best, start),
        }
    }
}

fn named(who: Who, choice: Choice) -> Contender {
    Contender { who, choice }
}

/// A configuration as a contender.
pub fn contender(
    who: Who,
    space: &TuningSpace,
    configuration: &Configuration,
) -> Result<Contender, ConfigurationError> {
    Ok(named(who, space.choice(configuration)?))
}

/// Break-even from the measurements: the search costs its own time, later frames what the final rounds say.
/// `frames` is the number of frames of each trial that does not name its own.
pub fn break_even(
    found: &SearchOutcome,
    objective: Objective,
    frames: u32,
    standings: &[Standing],
    best: &Who,
    baseline: &Who,
) -> BreakEven {
    let find = |who: &Who| standings.iter().find(|standing| standing.who == *who);
    let setup = |who: &Who| match find(who) {
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
        frames_while_tuning: trials.iter().map(|trial| trial.frames(frames)).sum(),
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
    use crate::frame::FrameTimes;
    use crate::measure::{Measured, standings};
    use crate::statistics::Summary;
    use crate::tuning::search::testing::trial;

    const WELL_LOW: Who = used(NativeQuality::Low, false);
    const WELL_HIGH: Who = used(NativeQuality::High, false);

    const fn used(quality: NativeQuality, fitted: bool) -> Who {
        Who::UsedWellIn(NativeUse { quality, fitted, by_path: false })
    }

    fn measured(who: Who, render_ms: f64) -> Measured {
        let rounds = (0..9).map(|round| render_ms * (1.0 + 0.01 * f64::from(round)));
        of_rounds(who, &rounds.collect::<Vec<f64>>())
    }

    fn of_rounds(who: Who, rounds_ms: &[f64]) -> Measured {
        let frames = rounds_ms.iter().map(|render_ms| FrameTimes::of(2.0, *render_ms)).collect();
        Measured { who, frames, ..Measured::default() }
    }

    fn table<const N: usize>(frames: [(Who, f64); N]) -> Vec<Standing> {
        let all = frames.map(|(who, ms)| measured(who, ms));
        keep_best_native(standings(&all, 1000))
    }

    #[test]
    fn what_moves_is_compared_with_fitted_structures_too() {
        let premises = Premises::all();
        let space = TuningSpace::new(Preset::Follow, &premises);
        let all = rivals(&space, &premises, &Start::Recommended);
        let uses = [false, true].map(|fitted| used(NativeQuality::Medium, fitted));
        let rival = |who: Who| all.iter().find(|rival| rival.contender.who == who).expect("it takes part");
        let [built, fitted] = uses.clone().map(rival);
        assert_eq!(built.contender.choice.update, treewright_accel::Update::Rebuild);
        assert_eq!(fitted.contender.choice.update, treewright_accel::Update::Refit);
        assert!(built.configuration.is_some() && fitted.configuration.is_some(), "they join the race");
        let [built, fitted] = uses;
        let of_table = table([(built, 3.0), (fitted.clone(), 2.0)]);
        assert_eq!(
            of_table.iter().map(Standing::title).collect::<Vec<_>>(),
            ["native used well (medium fitted)"]
        );
        assert!(is_of(&fitted, &Who::UsedWell, &of_table));
    }

    #[test]
    fn a_loser_is_not_called_tuned() {
        let mut lost =
            table([(WELL_LOW, 40.0), (WELL_HIGH, 30.0), (Who::BestFixed, 31.0), (Who::Found, 32.0)]);
        let names: Vec<String> = lost.iter().map(Standing::title).collect();
        assert_eq!(names, ["native used well (high)", "best fixed configuration", "found by the search"]);
        assert_eq!(crown(&mut lost, &Who::BestFixed, true, |_| true), Who::UsedWell);
        assert!(lost.iter().all(|one| one.who != Who::Tuned));
        // A result that only equals its start is not a finding.
        let mut level = table([(Who::BestFixed, 31.0), (Who::Found, 31.0)]);
        assert_eq!(crown(&mut level, &Who::BestFixed, true, |_| true), Who::BestFixed);
        let mut won =
            table([(NATIVE_DEFAULT, 60.0), (WELL_LOW, 40.0), (Who::BestFixed, 31.0), (Who::Found, 25.0)]);
        assert_eq!(crown(&mut won, &Who::BestFixed, false, |_| true), Who::Tuned);
        let gains = Gains::of(&won, &Who::Tuned, &Who::BestFixed);
        let median = |ratio: Option<Ratio>| ratio.map_or(0.0, |ratio| ratio.median);
        assert!(
            (median(gains.start) * median(gains.over_best_fixed) - median(gains.over_native_default)).abs()
                < 1e-3
        );
        assert!((median(gains.over_native_used_well) - 1.6).abs() < 1e-3);
        assert!(gains.over_best_fixed.is_some_and(|ratio| ratio.is_gain()));
    }

    #[test]
    fn native_used_well_is_the_faster_of_the_default_and_the_staged_ways() {
        let names = |all: &[Standing]| all.iter().map(Standing::title).collect::<Vec<_>>();
        let gain = |all: &[Standing]| Gains::of(all, &Who::Found, &Who::BestFixed).over_native_used_well;
        let staged = table([(NATIVE_DEFAULT, 60.0), (WELL_LOW, 48.0), (WELL_HIGH, 40.0), (Who::Found, 20.0)]);
        assert_eq!(names(&staged)[..2], ["native Embree default", "native used well (high)"]);
        assert!(gain(&staged).is_some_and(|ratio| (ratio.median - 2.0).abs() < 1e-3));
        assert!(!is_of(&NATIVE_DEFAULT, &Who::UsedWell, &staged));
        let by_path =
            table([(NATIVE_DEFAULT, 30.0), (WELL_LOW, 48.0), (WELL_HIGH, 40.0), (Who::Found, 20.0)]);
        assert_eq!(names(&by_path)[..2], ["native Embree default", "native used well (medium path by path)"]);
        assert!(gain(&by_path).is_some_and(|ratio| (ratio.median - 1.5).abs() < 1e-3));
        assert!(is_of(&NATIVE_DEFAULT, &Who::UsedWell, &by_path) && by_path.len() == 3);
        // Those that cannot be built are no reference, and without any staged way there is none.
        let broken = Measured { failure: Some("out of memory".into()), ..of_rounds(WELL_LOW, &[]) };
        let left = keep_best_native(standings(&[broken, measured(NATIVE_DEFAULT, 30.0)], 1000));
        assert_eq!(names(&left), ["native used well (medium path by path)", "native Embree default"]);
        assert_eq!(names(&table([(NATIVE_DEFAULT, 30.0)])), ["native Embree default"]);
        // Lucky rounds choose for the other half alone.
        let even = of_rounds(NATIVE_DEFAULT, &[20.0, 40.0, 20.0, 40.0]);
        let odd = of_rounds(WELL_LOW, &[41.0, 21.0, 41.0, 21.0]);
        let mixed = keep_best_native(standings(&[even, odd], 1000));
        assert!(mixed[1].rounds_ms.iter().all(|round_ms| *round_ms > 40.0), "{:?}", mixed[1].rounds_ms);
    }

    #[test]
    fn missing_rounds_are_told() {
        let measured = [measured(Who::BestFixed, 3.0)];
        let all = standings(&measured, 1000);
        assert_eq!(fewer_rounds_note(&all, 9), None);
        assert!(fewer_rounds_note(&all, 21).expect("nine of 21").contains("9 rounds of 21"));
        assert_eq!(fewer_rounds_note(&[], 21), None, "nobody could be built");
    }

    #[test]
    fn a_lucky_few_rounds_replace_nothing() {
        let start = of_rounds(Who::BestFixed, &[30.0; 9]);
        // Faster in five rounds of nine.
        let lucky = [26.0, 27.0, 26.0, 28.0, 29.0, 31.0, 33.0, 36.0, 34.0];
        let low = Who::Native(NativeQuality::Low);
        let native = [start.clone(), of_rounds(low.clone(), &lucky), of_rounds(Who::Found, &[30.5; 9])];
        assert_eq!(crown(&mut standings(&native, 1000), &Who::BestFixed, false, |_| true), Who::BestFixed);
        let found = [start.clone(), of_rounds(Who::Found, &lucky)];
        assert_eq!(crown(&mut standings(&found, 1000), &Who::BestFixed, false, |_| true), Who::BestFixed);
        // A result that the service's own race has proven needs no second proof, but no contradiction either.
        assert_eq!(crown(&mut standings(&found, 1000), &Who::BestFixed, true, |_| true), Who::Tuned);
        let slower = [start.clone(), of_rounds(Who::Found, &[31.0; 9])];
        assert_eq!(crown(&mut standings(&slower, 1000), &Who::BestFixed, true, |_| true), Who::BestFixed);
        // Fewer rounds than have an interval show nothing.
        let few = [of_rounds(Who::BestFixed, &[30.0; 5]), of_rounds(Who::Found, &[20.0; 5])];
        assert_eq!(crown(&mut standings(&few, 1000), &Who::BestFixed, false, |_| true), Who::BestFixed);
        // A start that cannot be built is never chosen.
        let broken = Measured { failure: Some("out of memory".into()), ..of_rounds(Who::BestFixed, &[]) };
        let alone = [broken, of_rounds(low, &[40.0; 9]), of_rounds(Who::Found, &[31.0; 9])];
        assert_eq!(crown(&mut standings(&alone, 1000), &Who::BestFixed, false, |_| true), Who::Tuned);
        assert_eq!(crown(&mut [], &Who::BestFixed, false, |_| true), Who::Nobody);
    }

    #[test]
    fn rivals_of_the_full_space_are_configurations_of_it() {
        let premises = Premises::all();
        let full = TuningSpace::new(Preset::Full, &premises);
        for rival in rivals(&full, &premises, &Start::Recommended) {
            let Some(configuration) = rival.configuration else {
                assert_eq!(rival.contender.who, Who::PaperDefault);
                continue;
            };
            let own = full.choice(&configuration).expect("it is of the space");
            assert_eq!(own, rival.contender.choice, "{}", rival.contender.who);
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
        for (start, who) in [
            (Start::Native, NATIVE_DEFAULT),
            (Start::Paper, Who::PaperDefault),
            (Start::Own(own.clone()), Who::YourStart),
        ] {
            let begun = full.beginning_at(&start).expect("it is one of the space");
            let rivals = rivals(&begun, &premises, &start);
            let first = rivals.iter().find(|rival| rival.contender.who == who).expect("it takes part");
            assert_eq!(first.contender.choice, baseline_from(&begun, &start).choice, "{who}");
            assert_eq!(baseline_from(&begun, &start).who, who);
            // The recommended configuration still runs beside it, unchanged.
            let is_fixed = |rival: &&Rival| rival.contender.who == Who::BestFixed;
            let fixed = rivals.iter().find(is_fixed).expect("it runs");
            assert_eq!(fixed.contender.choice, full.default_choice());
            let had = |rival: &&Rival| is_had(&rival.contender.who, &start);
            assert!(!rivals.iter().filter(had).any(|rival| is_fixed(&rival)));
            assert_eq!(rivals.iter().filter(had).count(), if who == Who::YourStart { 5 } else { 4 });
        }
        let mut standings =
            table([(NATIVE_DEFAULT, 60.0), (WELL_LOW, 40.0), (Who::BestFixed, 31.0), (Who::Found, 45.0)]);
        let may_win = |who: &Who| is_had(who, &Start::Native);
        assert_eq!(crown(&mut standings, &NATIVE_DEFAULT, false, may_win), Who::Tuned);
        let gains = Gains::of(&standings, &Who::Tuned, &NATIVE_DEFAULT);
        assert!(gains.over_start.is_some_and(|ratio| ratio.is_gain()));
        let is_loss = |ratio: Ratio| ratio.interval.is_some_and(|[_, high]| high < 1.0);
        assert!(gains.over_best_fixed.is_some_and(is_loss));
    }

    #[test]
    fn break_even_counts_builds_where_they_fall() {
        let standing = |who: Who, build: f64, speedup: f64| Standing {
            who,
            variant: None,
            build_ms: Summary::of(&[build]),
            render_ms: Summary::of(&[10.0 / speedup]),
            frame_ms: Summary::of(&[10.0 / speedup]),
            speedup: Summary::of(&[speedup]),
            rounds_ms: vec![10.0 / speedup],
            undelayed_ms: vec![10.0 / speedup],
            structure_bytes: None,
            failure: None,
            processes: None,
        };
        let standings = [standing(Who::PaperDefault, 20.0, 1.0), standing(Who::Tuned, 30.0, 1.25)];
        let mut trials = vec![trial(Some(10.0), 1), trial(None, 2), trial(Some(8.0), 3)];
        // The machine's speed in another minute says nothing of frames to come.
        let disturbance = Disturbance::default();
        let found = SearchOutcome { trials: trials.clone(), reference_ms: 17.0, disturbance };
        let costs = |of| break_even(&found, of, 1, &standings, &Who::Tuned, &Who::PaperDefault);
        let render = costs(Objective::Render);
        assert_eq!((render.tuning_ms, render.frames_while_tuning), (36.0, 2));
        assert_eq!((render.default_setup_ms, render.tuned_setup_ms), (20.0, 30.0));
        // 36 + 30 + (n - 2) * 8 <= 20 + n * 10
        assert_eq!(render.frame(), Some(15));
        let total = costs(Objective::Total);
        assert_eq!((total.default_setup_ms, total.tuned_setup_ms), (0.0, 0.0));
        // Frames that followed a slow build were shown, too.
        trials[0].times = Some(FrameTimes { frames: Some(4), ..FrameTimes::of(5.0, 10.0) });
        let found = SearchOutcome { trials, ..found };
        let more = break_even(&found, Objective::Render, 1, &standings, &Who::Tuned, &Who::PaperDefault);
        assert_eq!(more.frames_while_tuning, 5);
    }
}
