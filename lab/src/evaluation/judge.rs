//! The speed of predictors' answers, from a record alone (paper, section 7).
//!
//! At every camera that examines, an answer is held against the mean of the search's iterations (Figures 12
//! and 15), the best that the search found (the roofline, Figures 13 and 16), the best fixed configuration by
//! the cameras that teach, and the recommended default. A search's best of eighty is partly luck; so it was
//! measured again in shared rounds with the answers. The paper's single measurement stands beside it.

use std::collections::BTreeMap;

use serde::Serialize;
use treewright_client::Configuration;
use treewright_render_cli::error::{CliError, Result};
use treewright_renderer::tuning::objective::Objective;

use super::answers::Answers;
use super::folds::{Fold, Split};
use super::measure::{ALL, MILESTONES, best_within};
use super::record::{Group, GroupKind, Place, Record, Search, cost};
use crate::ways::ranked;

/// Break-even points beyond this many iterations are counted and not drawn, as in the paper.
pub(crate) const BREAK_EVEN_MAX: f64 = 10_000.0;

/// When the search, all its iterations counted, has taken less time than the prediction would have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum BreakEven {
    /// After this number of iterations.
    At(f64),
    /// After more than are drawn.
    Late,
    /// Never: the prediction is at least as good as what the search found.
    Never,
}

/// A search at one camera, and the costs that all answers are compared with there.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Ground {
    pub(crate) place: Place,
    /// Mean of the iterations that were measured, in milliseconds.
    pub(crate) search_mean_ms: f64,
    pub(crate) measured: usize,
    /// Iterations that could not be built.
    pub(crate) failed: usize,
    /// The best of them all in its single measurement: the paper's roofline.
    pub(crate) roofline_once_ms: f64,
    /// Its configuration measured again.
    pub(crate) roofline_ms: f64,
    /// Its speed over that of the recommended default, in shared rounds.
    pub(crate) search_over_default: f64,
    /// Cost of every iteration, in milliseconds; absent where it failed.
    pub(crate) curve_ms: Vec<Option<f64>>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    pub(crate) split: Split,
    pub(crate) fold: usize,
    pub(crate) entrant: String,
    pub(crate) place: Place,
    pub(crate) answer: String,
    /// Median of its rounds, in milliseconds.
    pub(crate) predicted_ms: f64,
    /// Its speed over the mean of the search's iterations.
    pub(crate) over_search: f64,
    /// Its speed over that of the roofline, measured in shared rounds: 1 is level, more is better.
    pub(crate) of_roofline: f64,
    /// Its speed over the roofline's single measurement.
    pub(crate) of_roofline_once: f64,
    pub(crate) over_default: f64,
    pub(crate) over_fixed: f64,
    pub(crate) break_even: BreakEven,
    /// Milliseconds of the search's frames and the answer's beyond those of the faster of their ends.
    pub(crate) search_overhead_ms: f64,
    pub(crate) prediction_overhead_ms: f64,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Verdict {
    pub(crate) objective: Objective,
    /// Cameras that were searched.
    pub(crate) cameras: usize,
    /// Those of them where the search and the default can be compared.
    pub(crate) grounds: Vec<Ground>,
    /// A camera has none where the roofline was not measured in shared rounds.
    pub(crate) rows: Vec<Row>,
    /// The best fixed configuration over all cameras, for people.
    pub(crate) fixed: Option<String>,
    /// Speed of the search's best over the best fixed one of the other cameras, camera by camera.
    pub(crate) search_over_fixed: Vec<f64>,
    /// Answers that cannot be run at the camera they were given for.
    pub(crate) infeasible: usize,
    /// Number of unmeasured answers of an entrant. Such an entrant has no rows.
    pub(crate) unmeasured: BTreeMap<String, usize>,
    /// Cameras whose default, best fixed one and searches' best ran in shared rounds with the answers.
    pub(crate) same_rounds: usize,
}

impl Verdict {
    /// Whether all were measured in shared rounds at every camera.
    pub(crate) fn is_whole(&self) -> bool {
        self.same_rounds == self.cameras
    }
}

pub(crate) fn judge(
    record: &Record,
    objective: Objective,
    searches: &BTreeMap<Place, &Search>,
    folds: &[(Fold, Answers)],
) -> Result<Verdict> {
    let view = View { record, objective };
    let grounds: BTreeMap<&Place, Ground> =
        searches.iter().filter_map(|(place, search)| Some((place, view.ground(search)?))).collect();
    let (mut rows, mut infeasible, mut unmeasured) = (Vec::new(), 0, BTreeMap::<String, usize>::new());
    let (mut search_over_fixed, mut fixed_at) = (Vec::new(), BTreeMap::new());
    for (number, (fold, answers)) in folds.iter().enumerate() {
        let fixed = view.best_fixed(&fold.teach);
        if fold.split == Split::Scene {
            for place in &fold.examine {
                let found = grounds.get(place).map(|_| searches[place]);
                search_over_fixed.extend(found.and_then(|search| view.over_found(search, fixed.as_ref()?)));
                fixed_at.insert(place, fixed.clone());
            }
        }
        for ((place, entrant), answer) in answers {
            let Some(ground) = grounds.get(place) else { continue };
            let group = view.group(GroupKind::Answers, place)?;
            let Some(predicted_ms) = view.cost_in(group, answer) else {
                match group.member(answer) {
                    Some(_) => infeasible += 1,
                    None => *unmeasured.entry(entrant.clone()).or_default() += 1,
                }
                continue;
            };
            let row = view.row(ground, group, fixed.as_ref(), predicted_ms);
            let Some(row) = row else { continue };
            let (entrant, answer) = (entrant.clone(), answer.to_string());
            rows.push(Row { split: fold.split, fold: number, entrant, answer, ..row });
        }
    }
    // An entrant that is judged by a part of the cameras is not comparable.
    rows.retain(|row| !unmeasured.contains_key(&row.entrant));
    if rows.is_empty() && !unmeasured.is_empty() {
        return Err(CliError::Failed("no answer was measured; run `evaluate verify` first".to_owned()));
    }
    let is_same =
        |place: &&Place| view.is_same(searches[*place], fixed_at.get(*place).and_then(Option::as_ref));
    let same_rounds = grounds.keys().copied().filter(is_same).count();
    let all: Vec<Place> = searches.keys().cloned().collect();
    let fixed = view.best_fixed(&all).map(|fixed| fixed.to_string());
    Ok(Verdict {
        objective,
        cameras: searches.len(),
        grounds: grounds.into_values().collect(),
        rows,
        fixed,
        search_over_fixed,
        infeasible,
        unmeasured,
        same_rounds,
    })
}

/// The fixed configuration with the least geometric mean over the default, by some places.
pub(crate) fn best_fixed(record: &Record, objective: Objective, places: &[Place]) -> Option<Configuration> {
    View { record, objective }.best_fixed(places)
}

struct View<'a> {
    record: &'a Record,
    objective: Objective,
}

impl View<'_> {
    fn group(&self, kind: GroupKind, place: &Place) -> Result<&Group> {
        self.record.groups.get(&(kind, place.clone())).ok_or_else(|| {
            CliError::Failed(format!(
                "camera {} of {} was not measured again; run `evaluate verify` first",
                place.camera, place.scene
            ))
        })
    }

    /// Median over the rounds; `None` for who is not there or cannot be run.
    fn cost_in(&self, group: &Group, configuration: &Configuration) -> Option<f64> {
        group.cost(configuration, self.objective)
    }

    /// The worth of an answer that took `predicted_ms`. `None` where the roofline was not measured.
    fn row(
        &self,
        ground: &Ground,
        group: &Group,
        fixed: Option<&Configuration>,
        predicted_ms: f64,
    ) -> Option<Row> {
        let best_ms = self.best_cost(self.search(&ground.place)?, group)?;
        let frames = ground.measured as f64;
        let search_ms = ground.search_mean_ms * frames;
        let bound_ms = best_ms.min(predicted_ms);
        let over_fixed = || self.over_found(self.search(&ground.place)?, fixed?);
        Some(Row {
            split: Split::Random,
            fold: 0,
            entrant: String::new(),
            place: ground.place.clone(),
            answer: String::new(),
            predicted_ms,
            over_search: ground.search_mean_ms / predicted_ms,
            of_roofline: best_ms / predicted_ms,
            of_roofline_once: ground.roofline_once_ms / predicted_ms,
            over_default: ground.search_over_default * best_ms / predicted_ms,
            over_fixed: over_fixed().map_or(f64::NAN, |other| other * best_ms / predicted_ms),
            break_even: break_even(&ground.curve_ms, best_ms, predicted_ms),
            search_overhead_ms: (search_ms - frames * bound_ms).max(0.0),
            prediction_overhead_ms: frames * (predicted_ms - bound_ms),
        })
    }

    fn search(&self, place: &Place) -> Option<&Search> {
        let mut own = self.record.searches.iter().filter(|one| one.place == *place);
        own.find(|one| one.objective == self.objective.name())
    }

    /// The best of a search, measured in a group.
    fn best_cost(&self, search: &Search, group: &Group) -> Option<f64> {
        let (found, _) = best_within(search, ALL, self.objective)?;
        self.cost_in(group, &found.configuration)
    }

    fn ground(&self, search: &Search) -> Option<Ground> {
        let (_, once) = best_within(search, ALL, self.objective)?;
        let fixed = self.record.groups.get(&(GroupKind::Fixed, search.place.clone()))?;
        let answers = self.record.groups.get(&(GroupKind::Answers, search.place.clone()));
        let again = answers.and_then(|group| self.best_cost(search, group));
        let again = again.or_else(|| self.best_cost(search, fixed))?;
        // The default is the first of the group.
        let search_over_default = self.over_found(search, &fixed.members.first()?.configuration)?;
        let curve_ms: Vec<Option<f64>> = search
            .iterations
            .iter()
            .map(|iteration| Some(cost(self.objective, iteration.times.as_ref()?)))
            .collect();
        let measured = curve_ms.iter().flatten().count();
        Some(Ground {
            place: search.place.clone(),
            search_mean_ms: curve_ms.iter().flatten().sum::<f64>() / measured.max(1) as f64,
            measured,
            failed: curve_ms.len() - measured,
            roofline_once_ms: once,
            roofline_ms: again,
            search_over_default,
            curve_ms,
        })
    }

    fn best_fixed(&self, places: &[Place]) -> Option<Configuration> {
        let over_default = |place: &Place| {
            let group = self.record.groups.get(&(GroupKind::Fixed, place.clone()))?;
            let default_ms = self.cost_in(group, &group.members.first()?.configuration)?;
            let members = group.members.iter().map(|member| &member.configuration);
            Some(members.filter_map(|one| Some((one, self.cost_in(group, one)? / default_ms))).collect())
        };
        // The best of a search stands beside them at its own camera alone.
        let groups: Vec<BTreeMap<&Configuration, f64>> = places.iter().filter_map(over_default).collect();
        ranked(&groups).first().map(|(configuration, _)| (*configuration).clone())
    }

    /// Speed of a search's best over another in the rounds of the answers, else of the fixed ones.
    fn over_found(&self, search: &Search, other: &Configuration) -> Option<f64> {
        [GroupKind::Answers, GroupKind::Fixed].into_iter().find_map(|kind| {
            let group = self.record.groups.get(&(kind, search.place.clone()))?;
            Some(self.cost_in(group, other)? / self.best_cost(search, group)?)
        })
    }

    /// Whether the rounds of the answers hold all configurations that are compared at a search's place.
    fn is_same(&self, search: &Search, fixed: Option<&Configuration>) -> bool {
        let group = |kind| self.record.groups.get(&(kind, search.place.clone()));
        let Some(answers) = group(GroupKind::Answers) else { return false };
        let default = group(GroupKind::Fixed).and_then(|group| group.members.first());
        let so_far = MILESTONES
            .into_iter()
            .chain([ALL])
            .filter_map(|trials| best_within(search, trials, self.objective));
        let mut all = so_far.map(|(found, _)| &found.configuration);
        self.best_cost(search, answers).is_some()
            && all.all(|one| answers.member(one).is_some())
            && default.is_some_and(|one| answers.member(&one.configuration).is_some())
            && fixed.is_none_or(|one| answers.member(one).is_some())
    }
}

/// From when on the search, which goes on with its best after its last iteration, has taken less time in all.
fn break_even(curve_ms: &[Option<f64>], best_ms: f64, predicted_ms: f64) -> BreakEven {
    if predicted_ms <= best_ms {
        return BreakEven::Never;
    }
    let (mut behind_ms, mut last, mut count) = (0.0, 0, 0);
    for cost in curve_ms.iter().flatten() {
        count += 1;
        behind_ms += cost - predicted_ms;
        if behind_ms > 0.0 {
            last = count;
        }
    }
    let at = match last == count {
        true => f64::from(count) + behind_ms / (predicted_ms - best_ms),
        false => f64::from(last + 1),
    };
    if at > BREAK_EVEN_MAX { BreakEven::Late } else { BreakEven::At(at) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_is_ahead_once_its_detours_are_paid_for() {
        let curve = |costs: &[f64]| -> Vec<Option<f64>> { costs.iter().copied().map(Some).collect() };
        // Ten iterations cost 20 each; each later frame saves 1: behind by 10 * 9, so 90 more.
        assert_eq!(break_even(&curve(&[20.0; 10]), 10.0, 11.0), BreakEven::At(100.0));
        assert_eq!(break_even(&curve(&[20.0; 10]), 10.0, 10.0), BreakEven::Never);
        assert_eq!(break_even(&curve(&[20.0; 10]), 10.0, 10.001), BreakEven::Late);
        // Behind in the first only.
        assert_eq!(break_even(&curve(&[12.0, 5.0, 5.0]), 5.0, 10.0), BreakEven::At(2.0));
        assert_eq!(break_even(&curve(&[5.0, 5.0]), 5.0, 10.0), BreakEven::At(1.0));
        assert_eq!(break_even(&[None, Some(20.0), None], 10.0, 15.0), BreakEven::At(2.0));
    }
}
