//! The table: how fast the answers of each predictor are. Nothing is measured here.

use std::collections::BTreeSet;

use serde::Serialize;
use treewright_renderer::statistics::Ratio;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

use super::machines::Level;
use super::measure::{OWN_SEARCH, RECOMMENDED, answer, frame_ms};
use super::record::{At, Record};
use crate::converge::bootstrap::{Interval, geometric, interval};
use crate::leave_scene_out::book::RecordedRounds;

/// Speed-ups of an answer over all machines and unseen scenes, with intervals by resampling scenes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    /// The group whose machines were asked; absent for all of the fleet.
    pub(crate) group: Option<String>,
    /// Whose measurements the predictor knows; absent for the machine's own search in the scene itself.
    pub(crate) knows: Option<Level>,
    /// Frames in the scene before the answer.
    pub(crate) frames: u32,
    /// Number of answers that ran; others could not be built.
    pub(crate) answers: usize,
    /// Over the renderer's recommended configuration.
    pub(crate) over_recommended: Option<Interval>,
    /// Over native Embree's default.
    pub(crate) over_native: Option<Interval>,
    /// Over the predictor that knows less: the gain from the node itself, its group, or the fleet.
    pub(crate) over_less: Option<Interval>,
    /// Over what the machine's own search found in the scene.
    pub(crate) over_search: Option<Interval>,
}

/// All rows: of the fleet, then group by group.
pub(crate) fn rows(record: &Record) -> Vec<Row> {
    let groups: BTreeSet<&str> =
        record.conditions.machines.iter().map(|machine| machine.isa.as_str()).collect();
    std::iter::once(None)
        .chain(groups.into_iter().map(Some))
        .flat_map(|group| rows_of(record, group))
        .collect()
}

fn rows_of(record: &Record, group: Option<&str>) -> Vec<Row> {
    let is_asked = |one: &&At<RecordedRounds>| group.is_none_or(|group| one.machine.isa == group);
    let asked: Vec<&At<RecordedRounds>> = record.answers.iter().filter(is_asked).collect();
    let row = |knows, frames, who: &Who, less: Option<Who>| {
        let answers = asked.iter().filter(|one| !frame_ms(&one.measured, who).is_empty()).count();
        Row {
            group: group.map(str::to_owned),
            knows,
            frames,
            answers,
            over_recommended: speedup(&asked, who, &RECOMMENDED),
            over_native: speedup(&asked, who, &NATIVE_DEFAULT),
            over_less: less.and_then(|less| speedup(&asked, who, &less)),
            over_search: speedup(&asked, who, &OWN_SEARCH),
        }
    };
    let mut rows = Vec::new();
    for frames in [0, record.conditions.first_frames] {
        let mut less = None;
        for level in Level::ALL {
            let who = answer(level, frames);
            rows.push(row(Some(level), frames, &who, less.replace(who.clone())));
        }
    }
    rows.push(row(None, record.conditions.frames, &OWN_SEARCH, None));
    rows
}

/// The geometric mean of the speed of `who` over `other` within rounds. `None` where none is shared.
fn speedup(asked: &[&At<RecordedRounds>], who: &Who, other: &Who) -> Option<Interval> {
    let scenes: BTreeSet<&str> = asked.iter().map(|one| one.scene.as_str()).collect();
    let of_scene = |scene: &str| {
        let here = asked.iter().filter(|one| one.scene == scene).filter_map(|one| {
            let ratio = Ratio::of(&frame_ms(&one.measured, other), &frame_ms(&one.measured, who));
            (ratio.count > 0).then(|| ratio.median.ln())
        });
        here.fold((0.0, 0), |(sum, count), logarithm| (sum + logarithm, count + 1))
    };
    let scenes: Vec<(f64, usize)> =
        scenes.into_iter().map(of_scene).filter(|(_, count)| *count > 0).collect();
    interval(scenes.len(), |drawn| geometric(&scenes, drawn))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fleet::record::tests::conditions, leave_scene_out::book::RecordedContender};

    /// Builds are too short to count.
    fn contender(who: Who, render_ms: f64) -> RecordedContender {
        let failure = (render_ms == 0.0).then(|| "too deep".to_owned());
        let (build_ms, render_ms) = (vec![0.0], vec![render_ms; 3]);
        RecordedContender { who, configuration: None, build_ms, render_ms, failure }
    }

    /// Two machines in three scenes: `avx2` gains from the fleet; one answer of `sse2` cannot be built.
    fn record() -> Record {
        let conditions = conditions();
        let mut answers = Vec::new();
        for scene in ["city", "hall", "sea"] {
            for machine in &conditions.machines {
                let (node, fleet) = if machine.isa == "sse2" { (8.0, 8.0) } else { (16.0, 4.0) };
                let failing = if machine.isa == "sse2" && scene == "sea" { 0.0 } else { fleet };
                let contenders = vec![
                    contender(NATIVE_DEFAULT, 32.0),
                    contender(RECOMMENDED, 16.0),
                    contender(OWN_SEARCH, 4.0),
                    contender(answer(Level::Nothing, 0), 16.0),
                    contender(answer(Level::Node, 0), node),
                    contender(answer(Level::Group, 0), node),
                    contender(answer(Level::Fleet, 0), failing),
                ];
                let measured = RecordedRounds { contenders, disturbed: false };
                answers.push(At::of(machine, scene, measured));
            }
        }
        Record { conditions, searches: Vec::new(), answers }
    }

    /// As a power of two, in halves: all ratios of this record are such.
    fn halvings(interval: Option<Interval>) -> Option<f64> {
        interval.map(|found| (found.estimate.log2() * 2.0).round() / 2.0)
    }

    #[test]
    fn each_level_is_compared_with_defaults_with_less_and_with_a_search() {
        let rows = rows(&record());
        assert_eq!(rows.len(), 3 * 9, "the fleet and two groups");
        let find = |group: Option<&str>, knows: Level| {
            let is =
                |row: &&Row| row.group.as_deref() == group && row.knows == Some(knows) && row.frames == 0;
            rows.iter().find(is).expect("there is a row").clone()
        };
        let nothing = find(None, Level::Nothing);
        assert_eq!((halvings(nothing.over_recommended), nothing.over_less), (Some(0.0), None));
        let node = find(None, Level::Node);
        let over = [node.over_recommended, node.over_native, node.over_search].map(halvings);
        assert_eq!(over, [Some(0.5), Some(1.5), Some(-1.5)]);
        let range = node.over_less.and_then(|found| found.range).expect("three scenes");
        assert!(range.iter().all(|end| (end - 2.0_f64.sqrt()).abs() < 1e-9), "{range:?}");
        assert_eq!(halvings(find(None, Level::Group).over_less), Some(0.0));
        let avx2 = find(Some("avx2"), Level::Fleet);
        assert_eq!(
            (halvings(avx2.over_less), halvings(avx2.over_search), avx2.answers),
            (Some(2.0), Some(0.0), 3)
        );
        let sse2 = find(Some("sse2"), Level::Fleet);
        assert_eq!((halvings(sse2.over_less), sse2.answers), (Some(0.0), 2));
        let own = rows.iter().find(|row| row.knows.is_none()).expect("a search stands beside them");
        assert_eq!((halvings(own.over_native), own.frames), (Some(3.0), 24));
    }

    #[test]
    fn what_was_not_measured_has_no_figure() {
        let rows = rows(&Record { answers: Vec::new(), ..record() });
        assert!(rows.iter().all(|row| row.answers == 0 && row.over_recommended.is_none()));
    }
}
