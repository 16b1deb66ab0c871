//! Tables from a book: the costs of the service's answers over those of configurations without tuning.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use treewright_client::{Configuration, Outcome};
use treewright_renderer::statistics::{Ratio, Summary, alternating, fastest_of_other_half, quantile};
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::safety::{Safety, start_cost};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, NativeUse, Who};

use super::book::{Book, RecordedContender, RecordedRounds, RecordedSearch, RecordedTrial};
use crate::ways::ranked;

pub(crate) const CANDIDATES: &str = "candidates";
pub(crate) const FINAL: &str = "final";
pub(crate) const ALONE: &str = "alone";
pub(crate) const LEFT_OUT: &str = "left-out";
/// The best fixed configuration of the other scenes in final rounds.
pub(crate) const FIXED_OF_OTHERS: Who = Who::Named(Cow::Borrowed("best fixed of the other scenes"));

pub(crate) fn key(kind: &str, objective: Objective, scene: &str, context: &str) -> String {
    format!("{kind} {} {scene} {context}", objective.name())
}

/// Costs of each configuration on a scene, in units of native Embree's default in these rounds.
pub(crate) fn relative_costs(rounds: &RecordedRounds, frames_per_build: u32) -> BTreeMap<Configuration, f64> {
    let Some(native) = rounds.find(&NATIVE_DEFAULT) else { return BTreeMap::new() };
    let native_ms = native.frame_ms(frames_per_build);
    let own = rounds.contenders.iter().filter_map(|one| Some((one, one.configuration.as_ref()?)));
    own.map(|(one, configuration)| {
        let ratio = Ratio::of(&one.frame_ms(frames_per_build), &native_ms);
        (configuration.clone(), if ratio.count > 0 { ratio.median } else { f64::INFINITY })
    })
    .collect()
}

/// Native Embree used well: the fastest of its default and the ways with our stages. Each half of the rounds
/// has the times of the fastest in the other half, so that luck does not choose.
pub(crate) fn used_well(rounds: &RecordedRounds, frames_per_build: u32) -> Option<(NativeUse, Vec<f64>)> {
    let uses = rounds.contenders.iter().filter_map(|one| {
        let frames_ms = one.frame_ms(frames_per_build);
        Some((one.who.native_use()?, frames_ms)).filter(|(_, frames_ms)| !frames_ms.is_empty())
    });
    let uses: Vec<(NativeUse, Vec<f64>)> = uses.collect();
    let frames_ms: Vec<&[f64]> = uses.iter().map(|(_, frames_ms)| frames_ms.as_slice()).collect();
    let [even, odd] = fastest_of_other_half(&frames_ms)?;
    let median = |place: usize| Summary::of(frames_ms[place]).median;
    let faster = if median(odd) < median(even) { odd } else { even };
    Some((uses[faster].0, alternating(frames_ms[even], frames_ms[odd])))
}

/// The configurations that only the search of one scene found; the other scenes do not know them.
pub(crate) fn found_only_in(
    book: &Book,
    objective: Objective,
    scene: &str,
    context: &str,
) -> BTreeSet<String> {
    let answers = |of: &str| -> BTreeSet<String> {
        let search = book.searches.get(&key(ALONE, objective, of, context));
        search.into_iter().flat_map(|search| search.answers.values().map(ToString::to_string)).collect()
    };
    let mut own = answers(scene);
    for other in book.scenes.keys().filter(|other| *other != scene) {
        let known = answers(other);
        own.retain(|one| !known.contains(one));
    }
    own
}

/// The best fixed configuration of a context's other scenes, without what only this one's search found.
pub(crate) fn fixed_of_others(
    book: &Book,
    objective: Objective,
    scene: &str,
    context: &str,
) -> Option<Configuration> {
    let without = found_only_in(book, objective, scene, context);
    let others: Vec<_> = book
        .scenes
        .keys()
        .filter(|other| *other != scene)
        .filter_map(|other| {
            let rounds = book.rounds.get(&key(CANDIDATES, objective, other, context))?;
            Some(relative_costs(rounds, objective.frames_per_build()))
        })
        .collect();
    let ran_on_all = ranked(&others).into_iter().filter(|(_, cost)| cost.is_finite());
    ran_on_all.map(|(one, _)| one).find(|one| !without.contains(&one.to_string()))
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) scene: String,
    pub(crate) objective: Objective,
    pub(crate) context: String,
    pub(crate) disturbed: bool,
    /// Speed of the answer after each number of frames over the best fixed configuration of the other scenes.
    pub(crate) over_fixed: BTreeMap<u32, Ratio>,
    /// Over native Embree used well: see [`used_well`].
    pub(crate) over_used_well: BTreeMap<u32, Ratio>,
    /// Speed over that of the best configuration in these rounds; 1 is the roofline itself.
    pub(crate) of_roofline: BTreeMap<u32, f64>,
    /// The answer after the last frame over native Embree's default.
    pub(crate) over_default: Ratio,
    /// Median milliseconds: native default, used well, the best fixed one of other scenes, the last answer.
    pub(crate) frame_ms: [f64; 4],
    /// The way in which native Embree was the fastest: a quality with our stages, or `medium path by path`.
    pub(crate) native_quality: String,
    /// The best fixed configuration of the other scenes over native Embree's default and used well.
    pub(crate) fixed_over_default: Ratio,
    pub(crate) fixed_over_used_well: Ratio,
    /// Frames of the search that cost more than the recommended start; `None` where either did not run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) safety: Option<Safety>,
}

impl Row {
    /// Speed of the best configuration in these rounds over the best fixed one of the other scenes: the most
    /// that choosing by scene can win. `None` where one of them was not measured.
    pub(crate) fn ceiling(&self) -> Option<f64> {
        let [.., fixed_ms, answer_ms] = self.frame_ms;
        let (_, of_roofline) = self.of_roofline.last_key_value()?;
        Some(fixed_ms / (of_roofline * answer_ms)).filter(|ceiling| ceiling.is_finite())
    }
}

/// Every final run of rounds as a row.
pub(crate) fn rows(book: &Book, objectives: &[Objective]) -> Vec<Row> {
    let mut all = Vec::new();
    for (name, rounds) in &book.rounds {
        let mut words = name.split(' ');
        let (Some(FINAL), Some(objective), Some(scene), Some(context)) =
            (words.next(), words.next(), words.next(), words.next())
        else {
            continue;
        };
        let Some(objective) = objectives.iter().find(|one| one.name() == objective) else { continue };
        let fixed = fixed_of_others(book, *objective, scene, context);
        let search = book.searches.get(&key(LEFT_OUT, *objective, scene, context));
        let safety = search.and_then(|search| safety(search, rounds, *objective));
        let row = row(rounds, fixed.as_ref(), *objective, scene, context);
        all.extend(row.map(|row| Row { safety, ..row }));
    }
    all
}

/// The frames of a search that cost more than the recommended start.
fn safety(search: &RecordedSearch, rounds: &RecordedRounds, objective: Objective) -> Option<Safety> {
    let start = rounds.find(&Who::BestFixed)?;
    let cost = |trial: &RecordedTrial| match trial.outcome {
        Outcome::Aborted { lower_bound } => Some(lower_bound),
        _ => Some(objective.cost(trial.times?)),
    };
    let is_start = |trial: &&RecordedTrial| start.configuration.as_ref() == Some(&trial.configuration);
    let of_start: Vec<f64> = search.trials.iter().filter(is_start).filter_map(cost).collect();
    let in_rounds = || {
        let frames_ms = start.frame_ms(objective.frames_per_build());
        (!frames_ms.is_empty()).then(|| Summary::of(&frames_ms).median)
    };
    let frames = |trial: &RecordedTrial| trial.times.and_then(|times| times.frames).unwrap_or(1);
    let costs = search.trials.iter().filter_map(|trial| Some((frames(trial), cost(trial)?)));
    Safety::of(costs, start_cost(&of_start, in_rounds)?)
}

/// `fixed` is the best fixed one of the other scenes; where it did not run, the rounds name it.
fn row(
    rounds: &RecordedRounds,
    fixed: Option<&Configuration>,
    objective: Objective,
    scene: &str,
    context: &str,
) -> Option<Row> {
    let per_build = objective.frames_per_build();
    let of = |one: &RecordedContender| one.frame_ms(per_build);
    let median = |one: &RecordedContender| {
        let times = of(one);
        if times.is_empty() { f64::INFINITY } else { Summary::of(&times).median }
    };
    let named = rounds.find(&FIXED_OF_OTHERS)?;
    let same = |one: &&RecordedContender| fixed.is_some() && one.configuration.as_ref() == fixed;
    // Answers that are this configuration come earlier, and are runs of their own.
    let fixed = if same(&named) { named } else { rounds.contenders.iter().rfind(same).unwrap_or(named) };
    let (way, used_well_ms) = used_well(rounds, per_build)?;
    let best_ms = rounds.contenders.iter().map(median).fold(f64::INFINITY, f64::min);
    let answers: Vec<(u32, &RecordedContender)> = rounds
        .contenders
        .iter()
        .filter_map(|one| match one.who {
            Who::AfterFrames(frames) => Some((frames, one)),
            _ => None,
        })
        .collect();
    let over = |other_ms: &[f64]| {
        answers.iter().map(|(frames, one)| (*frames, Ratio::of(other_ms, &of(one)))).collect()
    };
    let native = rounds.find(&NATIVE_DEFAULT)?;
    let (_, last) = answers.iter().max_by_key(|(frames, _)| *frames)?;
    Some(Row {
        over_default: Ratio::of(&of(native), &of(last)),
        frame_ms: [median(native), Summary::of(&used_well_ms).median, median(fixed), median(last)],
        native_quality: way.to_string(),
        scene: scene.to_owned(),
        objective,
        context: context.to_owned(),
        disturbed: rounds.disturbed,
        over_fixed: over(&of(fixed)),
        over_used_well: over(&used_well_ms),
        of_roofline: answers.iter().map(|(frames, one)| (*frames, best_ms / median(one))).collect(),
        fixed_over_default: Ratio::of(&of(native), &of(fixed)),
        fixed_over_used_well: Ratio::of(&used_well_ms, &of(fixed)),
        safety: None,
    })
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Overall {
    pub(crate) median: f64,
    pub(crate) least: f64,
    pub(crate) mean: f64,
}

impl Overall {
    pub(crate) fn of(ratios: impl Iterator<Item = f64>) -> Self {
        let mut all: Vec<f64> = ratios.filter(|ratio| *ratio > 0.0).collect();
        all.sort_by(f64::total_cmp);
        let mean = (all.iter().map(|ratio| ratio.ln()).sum::<f64>() / all.len().max(1) as f64).exp();
        Self { median: quantile(&all, 0.5), least: all.first().copied().unwrap_or(0.0), mean }
    }
}

#[cfg(test)]
mod tests {
    use treewright_renderer::frame::FrameTimes;

    use super::*;

    const NATIVE: &str = "native Embree default";

    /// As it is read from a book.
    fn contender(name: &str, render_ms: f64) -> RecordedContender {
        let who: Who = serde_json::from_value(name.into()).expect("it is a text");
        let configuration = (who != NATIVE_DEFAULT).then(|| Configuration::new().with("name", name));
        let (build_ms, render_ms) = (vec![1000.0; 9], vec![render_ms; 9]);
        RecordedContender { who, configuration, build_ms, render_ms, failure: None }
    }

    fn rounds(all: &[(&str, f64)]) -> RecordedRounds {
        let contenders = all.iter().map(|(name, render_ms)| contender(name, *render_ms)).collect();
        RecordedRounds { contenders, disturbed: false }
    }

    #[test]
    fn the_best_fixed_one_ran_everywhere_and_is_best_in_the_mean() {
        let scenes = [
            rounds(&[(NATIVE, 99.0), ("a", 49.0), ("b", 29.0), ("c", 9.0)]),
            rounds(&[(NATIVE, 99.0), ("a", 49.0), ("b", 199.0)]),
        ];
        let costs: Vec<_> = scenes.iter().map(|rounds| relative_costs(rounds, 1000)).collect();
        let all = ranked(&costs);
        let names: Vec<String> = all.iter().map(|(one, _)| one.to_string()).collect();
        assert_eq!(names, ["name=a", "name=b"]);
        assert!((all[0].1.exp() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn what_others_found_as_well_is_known_without_a_scene() {
        let search = |names: &[&str]| {
            let answers = names.iter().map(|name| Configuration::new().with("name", *name));
            RecordedSearch { answers: (1..).zip(answers).collect(), ..RecordedSearch::default() }
        };
        let mut book = Book::default();
        for (scene, found) in [("hall", ["start", "own"]), ("city", ["start", "start"])] {
            let facts = super::super::book::SceneFacts { triangles: 1, instanced: false };
            book.scenes.insert(scene.to_owned(), facts);
            book.searches.insert(key(ALONE, Objective::Render, scene, "2@320x240"), search(&found));
            let ran = rounds(&[(NATIVE, 99.0), ("start", 49.0), ("own", 39.0), ("poor", 59.0)]);
            book.rounds.insert(key(CANDIDATES, Objective::Render, scene, "2@320x240"), ran);
        }
        let best =
            |scene| fixed_of_others(&book, Objective::Render, scene, "2@320x240").expect("there is one");
        assert_eq!(best("hall").to_string(), "name=start", "its own find is not known to others");
        assert_eq!(best("city").to_string(), "name=own");
    }

    #[test]
    fn answers_are_compared_with_what_anybody_could_have_had() {
        let final_rounds = rounds(&[
            (NATIVE, 99.0),
            ("native used well low", 79.0),
            ("native used well high", 59.0),
            ("best fixed of the other scenes", 49.0),
            ("after 1 frames", 54.0),
            ("after 60 frames", 39.0),
            ("best of all", 38.0),
        ]);
        let name = key(FINAL, Objective::Render, "hall", "2@320x240");
        let book = Book { rounds: BTreeMap::from([(name, final_rounds)]), ..Book::default() };
        let all = rows(&book, &[Objective::Render, Objective::Total]);
        assert_eq!((all.len(), all[0].native_quality.as_str()), (1, "high"));
        let at = |map: &BTreeMap<u32, Ratio>, frames: u32| map[&frames].median;
        assert!((at(&all[0].over_fixed, 60) - 1.25).abs() < 1e-9);
        assert!((at(&all[0].over_fixed, 1) - 50.0 / 55.0).abs() < 1e-9);
        assert!((at(&all[0].over_used_well, 60) - 1.5).abs() < 1e-9);
        assert!((all[0].of_roofline[&60] - 39.0 / 40.0).abs() < 1e-9);
        let ceiling = all[0].ceiling().expect("both ran");
        assert!((ceiling - 50.0 / 39.0).abs() < 1e-9, "{ceiling}");
        assert_eq!(all[0].safety, None, "no search was recorded");
        let overall = Overall::of([1.0, 4.0].into_iter());
        assert_eq!((overall.median, overall.least, overall.mean), (2.5, 1.0, 2.0));
    }

    #[test]
    fn the_default_is_native_embree_used_well_where_it_is_faster() {
        let mut final_rounds = rounds(&[
            (NATIVE, 44.0),
            ("native used well low", 79.0),
            ("native used well high", 59.0),
            ("best fixed of the other scenes", 49.0),
            ("after 60 frames", 29.0),
        ]);
        let row_of = |rounds: &RecordedRounds| {
            row(rounds, None, Objective::Render, "hall", "2@320x240").expect("all ran")
        };
        let by_path = row_of(&final_rounds);
        assert_eq!(by_path.native_quality, "medium path by path");
        assert!((by_path.over_used_well[&60].median - 1.5).abs() < 1e-9);
        assert!((by_path.fixed_over_used_well.median - 0.9).abs() < 1e-9);
        assert_eq!(by_path.frame_ms[..2], [45.0, 45.0]);
        // A staged way with luck in the even rounds: the odd ones are told against it, the even ones are not.
        let lucky = |round: usize| if round.is_multiple_of(2) { 29.0 } else { 59.0 };
        final_rounds.contenders[2].render_ms = (0..9).map(lucky).collect();
        let (_, frames_ms) = used_well(&final_rounds, 1000).expect("they ran");
        assert_eq!(frames_ms[..3], [45.0, 60.0, 45.0]);
    }

    #[test]
    fn dear_frames_of_a_search_are_those_above_the_recommended_start() {
        let final_rounds = rounds(&[
            (NATIVE, 99.0),
            ("native used well low", 79.0),
            ("best fixed of the other scenes", 49.0),
            ("best fixed configuration", 49.0),
            ("after 60 frames", 39.0),
        ]);
        let name = |kind| key(kind, Objective::Render, "hall", "2@320x240");
        // A thousandth of the build of a second is 1 ms.
        let trial = |name: &str, render_ms: f64, frames: Option<u32>| RecordedTrial {
            configuration: Configuration::new().with("name", name),
            outcome: Outcome::Ok,
            times: Some(FrameTimes { frames, ..FrameTimes::of(1000.0, render_ms) }),
        };
        let stopped =
            RecordedTrial { outcome: Outcome::aborted(120.0), times: None, ..trial("b", 0.0, None) };
        let search = RecordedSearch {
            trials: vec![trial("a", 52.0, None), trial("c", 74.0, Some(3)), stopped, trial("d", 39.0, None)],
            ..RecordedSearch::default()
        };
        let mut book = Book {
            rounds: BTreeMap::from([(name(FINAL), final_rounds)]),
            searches: BTreeMap::from([(name(LEFT_OUT), search)]),
            ..Book::default()
        };
        let of = |book: &Book| rows(book, &[Objective::Render])[0].safety.expect("both ran");
        assert_eq!(of(&book), Safety { frames: 6, dear: 4, worst: 2.4 }, "the start takes 50 ms");
        // On a machine that was half as fast meanwhile, the start took 100 ms.
        let own = (0..3).map(|_| trial("best fixed configuration", 99.0, None));
        book.searches.get_mut(&name(LEFT_OUT)).expect("it is there").trials.extend(own);
        assert_eq!(of(&book), Safety { frames: 9, dear: 1, worst: 1.2 });
    }
}
