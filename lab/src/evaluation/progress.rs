//! Error of the tuner against run time: the cost of the best configuration so far over that of the roofline,
//! after each milestone of trials, beside the answers without a search. All costs are of shared, interleaved
//! rounds, since the least of many single measurements is partly luck.

use serde::Serialize;
use treewright_renderer::{statistics::quantile, tuning::objective::Objective};

use super::measure::{ALL, MILESTONES, best_within};
use super::record::{GroupKind, Record, Search};
use super::summary::{Mean, mean, mean_of};
use super::{folds::Split, judge::Verdict};

/// Whose cost it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Moment {
    /// A predictor, a fixed configuration, or `search`.
    pub(crate) who: String,
    /// Trials before; 0 for who needs none.
    pub(crate) trials: usize,
    /// Building and rendering before, in seconds: the median of the cameras.
    pub(crate) seconds: f64,
    /// Cost over that of the roofline; absent where it was not measured in shared rounds.
    pub(crate) cost: Option<Mean>,
    /// Cameras behind that.
    pub(crate) cameras: usize,
}

/// Names of the searches and of the recommended default.
pub(crate) const SEARCH: &str = "search";
pub(crate) const DEFAULT: &str = "default";

/// The answers without a search: the default, the best fixed one, and these predictors.
pub(crate) fn without_search(verdict: &Verdict, predictors: &[&str]) -> Vec<Moment> {
    let at_once = |who: &str, cost: Option<Mean>, cameras| Moment {
        who: who.to_owned(),
        trials: 0,
        seconds: 0.0,
        cost,
        cameras,
    };
    let fixed = |who: &str, ratios: &[f64]| {
        let is_known = verdict.is_whole() && !ratios.is_empty();
        at_once(who, is_known.then(|| mean_of(ratios)), if is_known { ratios.len() } else { 0 })
    };
    let over_default: Vec<f64> = verdict.grounds.iter().map(|ground| ground.search_over_default).collect();
    let mut all =
        vec![fixed(DEFAULT, &over_default), fixed("best fixed configuration", &verdict.search_over_fixed)];
    for name in predictors {
        let own = verdict.rows.iter().filter(|row| row.split == Split::Random && row.entrant == *name);
        let own: Vec<_> = own.collect();
        let mut places: Vec<_> = own.iter().map(|row| &row.place).collect();
        places.sort_unstable();
        places.dedup();
        if !own.is_empty() {
            all.push(at_once(name, Some(mean(&own, |row| 1.0 / row.of_roofline)), places.len()));
        }
    }
    all
}

/// Searches after each milestone, and at their end.
pub(crate) fn of_searches(record: &Record, verdict: &Verdict) -> Vec<Moment> {
    let judged = |search: &&Search| verdict.grounds.iter().any(|ground| ground.place == search.place);
    let own = record.searches.iter().filter(|search| search.objective == verdict.objective.name());
    let searches: Vec<&Search> = own.filter(judged).collect();
    let longest = searches.iter().map(|search| search.iterations.len()).max().unwrap_or(0);
    let milestones = MILESTONES.into_iter().filter(|trials| *trials < longest).chain([longest]);
    let at = |trials: usize| {
        let mut seconds: Vec<f64> = searches.iter().map(|search| spent_s(search, trials)).collect();
        seconds.sort_by(f64::total_cmp);
        let ratios: Vec<f64> = match verdict.is_whole() {
            true => searches
                .iter()
                .filter_map(|search| ratio(record, search, trials, verdict.objective))
                .collect(),
            false => Vec::new(),
        };
        Moment {
            who: SEARCH.to_owned(),
            trials,
            seconds: quantile(&seconds, 0.5),
            cost: (!ratios.is_empty()).then(|| mean_of(&ratios)),
            cameras: ratios.len(),
        }
    };
    milestones.filter(|trials| *trials > 0).map(at).collect()
}

/// Seconds of building and rendering in the first `trials` iterations.
fn spent_s(search: &Search, trials: usize) -> f64 {
    let times = search.iterations.iter().take(trials).filter_map(|one| one.times.as_ref());
    times.map(|times| times.build_ms + times.render_ms).sum::<f64>() / 1000.0
}

/// Cost of the best of the first `trials` iterations over that of the best of all, in the final rounds.
fn ratio(record: &Record, search: &Search, trials: usize, objective: Objective) -> Option<f64> {
    let group = record.groups.get(&(GroupKind::Answers, search.place.clone()))?;
    let again = |trials| {
        let (found, _) = best_within(search, trials, objective)?;
        group.cost(&found.configuration, objective)
    };
    Some(again(trials)? / again(ALL)?)
}

/// When the searches have come below a cost: the first of their moments.
pub(crate) fn reached(moments: &[Moment], cost: f64) -> Option<&Moment> {
    moments.iter().find(|moment| moment.cost.is_some_and(|own| own.mean <= cost))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use treewright_client::Configuration;

    use super::super::record::{Line, Place};
    use super::super::testing::{conditions, group, numbered, place, search};
    use super::super::{answers::Answers, folds::Fold, judge::judge};
    use super::*;

    const SCENES: [&str; 3] = ["attic", "barn", "cellar"];

    /// Searches of twelve trials, whose best took 120, 110 and 100 ms after five, ten and all.
    fn record(is_whole: bool) -> Record {
        let mut record = Record::new(conditions(12));
        for (number, scene) in SCENES.into_iter().enumerate() {
            let end = numbered(20 + number as i64);
            let tried = (1..=12).map(|trial| match trial {
                12 => (end.clone(), Some(10.0)),
                3 => (numbered(3), None),
                _ => (numbered(trial), Some(300.0 - 20.0 * trial as f64)),
            });
            record.take(Line::Search(search(scene, &tried.collect::<Vec<_>>())));
            let fixed = [(numbered(1), &[160.0][..]), (numbered(2), &[140.0]), (end.clone(), &[100.0])];
            record.take(Line::Group(group(GroupKind::Fixed, scene, &fixed)));
            let mut again = vec![
                (numbered(1), &[150.0, 149.0, 170.0][..]),
                (numbered(2), &[130.0]),
                (numbered(5), &[120.0, 90.0, 500.0]),
                (end, &[100.0]),
            ];
            if is_whole || number > 0 {
                again.push((numbered(10), &[110.0]));
            }
            record.take(Line::Group(group(GroupKind::Answers, scene, &again)));
        }
        record
    }

    /// Each scene left out once, and all of them in a random split; all answers are equal.
    fn verdict(record: &Record, answers: &[(&str, Configuration)]) -> Verdict {
        let all: Vec<Place> = SCENES.map(place).to_vec();
        let answered = |places: &[Place]| -> Answers {
            let one = |place: &Place| {
                let own = |(name, answer): &(&str, Configuration)| {
                    ((place.clone(), (*name).to_owned()), answer.clone())
                };
                answers.iter().map(own).collect::<Vec<_>>()
            };
            places.iter().flat_map(one).collect()
        };
        let mut folds =
            vec![(Fold { split: Split::Random, teach: all.clone(), examine: all.clone() }, answered(&all))];
        for left_out in &all {
            let teach = all.iter().filter(|place| *place != left_out).cloned().collect();
            let fold = Fold { split: Split::Scene, teach, examine: vec![left_out.clone()] };
            folds.push((fold, answered(std::slice::from_ref(left_out))));
        }
        let searches: BTreeMap<Place, &Search> =
            record.searches.iter().map(|search| (search.place.clone(), search)).collect();
        judge(record, Objective::Render, &searches, &folds).expect("it is judged")
    }

    fn rounded(moments: &[Moment]) -> Vec<(String, usize, Option<f64>)> {
        let cost = |moment: &Moment| moment.cost.map(|cost| (cost.mean * 1e6).round() / 1e6);
        moments.iter().map(|moment| (moment.who.clone(), moment.trials, cost(moment))).collect()
    }

    #[test]
    fn everybody_is_held_against_the_roofline_in_the_same_rounds() {
        let record = record(true);
        let verdict = verdict(&record, &[("nearest_neighbour", numbered(5))]);
        let searched = of_searches(&record, &verdict);
        let search = |trials, cost| (SEARCH.to_owned(), trials, Some(cost));
        assert_eq!(rounded(&searched), [search(5, 1.2), search(10, 1.1), search(12, 1.0)]);
        // Four of the first five could be built: half a second each, and 280, 260, 220 and 200 ms.
        assert!((searched[0].seconds - 2.96).abs() < 1e-9 && searched[0].cameras == 3, "{searched:?}");
        let beside = without_search(&verdict, &["nearest_neighbour", "auto"]);
        let at_once = |who: &str, cost| (who.to_owned(), 0, Some(cost));
        assert_eq!(
            rounded(&beside),
            [
                at_once(DEFAULT, 1.5),
                at_once("best fixed configuration", 1.3),
                at_once("nearest_neighbour", 1.2)
            ]
        );
        let cost = beside[0].cost.expect("it was measured");
        assert_eq!(cost.interval.map(|ends| ends.map(|end| (end * 1e6).round() / 1e6)), Some([1.5; 2]));
        assert_eq!(reached(&searched, 1.2).map(|moment| moment.trials), Some(5));
        assert_eq!(reached(&searched, 1.15).map(|moment| moment.trials), Some(10));
        assert_eq!(reached(&searched, 0.9), None);
    }

    #[test]
    fn where_one_camera_lacks_a_milestone_no_other_rounds_stand_in() {
        let record = record(false);
        let verdict = verdict(&record, &[("nearest_neighbour", numbered(5))]);
        assert_eq!((verdict.same_rounds, verdict.grounds.len()), (2, 3));
        let costs = |moments: &[Moment]| moments.iter().map(|one| one.cost.is_some()).collect::<Vec<_>>();
        assert_eq!(costs(&of_searches(&record, &verdict)), [false; 3]);
        assert_eq!(costs(&without_search(&verdict, &["nearest_neighbour"])), [false, false, true]);
    }

    #[test]
    fn a_camera_whose_roofline_was_not_measured_in_the_same_rounds_has_no_rows() {
        let mut record = record(true);
        let attic = place(SCENES[0]);
        let without_the_roofline = |record: &mut Record, kind| {
            let group = record.groups.get_mut(&(kind, place(SCENES[0]))).expect("it is there");
            group.members.retain(|member| member.configuration != numbered(20));
        };
        let answered = [("nearest_neighbour", numbered(5))];
        without_the_roofline(&mut record, GroupKind::Answers);
        let own = verdict(&record, &answered);
        assert_eq!((own.cameras, own.grounds.len(), own.same_rounds), (3, 3, 2));
        assert!(own.rows.len() == 4 && own.rows.iter().all(|row| row.place != attic), "{:?}", own.rows);
        // One that cannot be compared at all does not count as one that was.
        without_the_roofline(&mut record, GroupKind::Fixed);
        let own = verdict(&record, &answered);
        assert_eq!((own.cameras, own.grounds.len(), own.same_rounds), (3, 2, 2));
        assert!(!own.is_whole(), "{own:?}");
    }

    #[test]
    fn who_gave_an_answer_that_was_not_measured_is_left_out() {
        let record = record(true);
        let verdict = verdict(&record, &[("nearest_neighbour", numbered(5)), ("auto", numbered(7))]);
        assert_eq!(verdict.unmeasured, BTreeMap::from([("auto".to_owned(), 6)]));
        assert!(verdict.rows.iter().all(|row| row.entrant == "nearest_neighbour"));
        assert_eq!(verdict.rows.len(), 6);
    }
}
