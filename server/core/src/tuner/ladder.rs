//! Cheaper levels of the measurements of one state: which configuration is worth a trial at the next one.
//!
//! A new configuration of the search runs at the cheapest level first. It climbs to the next level if it is
//! among the best third of the latest there, as in the brackets of Hyperband (Li, Jamieson, DeSalvo,
//! Rostamizadeh and Talwalkar, JMLR 18, 2018). Whether a level says anything of full costs is not known
//! beforehand. So the first configurations climb whatever they cost, and a level whose ranks agree too little
//! with those of full trials is given up, for good. A full trial is never replaced: a configuration that does
//! not climb is known to the search alone, as one that costs at least so much.

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::LADDER_ENTRIES_MAX;
use crate::search::Verdict;
use crate::statistics::correlation::spearman;

/// The number of configurations that ran at a level and in full, from which on its ranks are believed.
const PAIRS_LEAST: usize = 6;
/// The number of the latest pairs that count: near the optimum a level may rank worse than elsewhere.
const PAIRS_LATEST: usize = 16;
/// The number of the latest configurations of a level that one is ranked among: all that a search proposes
/// once it has found its way are better than its beginning.
const RANKED_LATEST: usize = 18;
/// The rank correlation below which a level is given up.
const CORRELATION_LEAST: f64 = 0.3;
/// One configuration in this number climbs.
const CLIMBS_ONE_IN: usize = 3;

/// What follows from a trial at a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Climb {
    /// The configuration runs again, at the next level or in full.
    Further,
    /// The same, and the level was given up: verdicts that it gave are taken back.
    FurtherWithOthers,
    /// It does not climb; the search takes this for its result.
    Dropped(Verdict),
}

/// The cheaper levels of one state. Exact through serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Ladder {
    /// The configurations that ran at a cheaper level, in the order of their first trial.
    entries: Vec<LadderEntry>,
    /// The cost of all trials at cheaper levels, in full trials.
    full_trials: f64,
    /// The places of levels that were given up.
    given_up: Vec<u32>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LadderEntry {
    configuration: RawConfiguration,
    /// Its cost at each level that it ran at, by the level's place.
    costs: Vec<(u32, f64)>,
    /// The place of the level that it runs at next, unless that was given up.
    next: u32,
    /// Its cost in a full trial.
    full: Option<f64>,
    /// It does not climb: it cannot be run, or costs at least so much.
    dropped: Option<Dropped>,
}

/// Why a configuration does not climb.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Dropped {
    Infeasible,
    AtLeast(f64),
}

impl Dropped {
    fn verdict(self) -> Verdict {
        match self {
            Dropped::Infeasible => Verdict::Infeasible,
            Dropped::AtLeast(cost) => Verdict::AtLeast(cost),
        }
    }
}

impl LadderEntry {
    fn cost_at(&self, level: u32) -> Option<f64> {
        self.costs.iter().find(|(at, _)| *at == level).map(|(_, cost)| *cost)
    }
}

impl Ladder {
    /// The verdict on a configuration that does not climb.
    pub(super) fn dropped(&self, configuration: &Configuration) -> Option<Verdict> {
        self.entry(configuration)?.dropped.map(Dropped::verdict)
    }

    /// The place of the level, of `levels`, at which a configuration runs next; `None` for a full trial.
    pub(super) fn next(&self, configuration: &Configuration, levels: u32) -> Option<u32> {
        let entry = self.entry(configuration);
        if entry.is_none() && self.entries.len() >= LADDER_ENTRIES_MAX {
            return None;
        }
        (entry.map_or(0, |entry| entry.next)..levels).find(|level| !self.given_up.contains(level))
    }

    /// The cost of the trials at cheaper levels, in whole full trials.
    pub(super) fn full_trials(&self) -> usize {
        self.full_trials as usize
    }

    /// Takes the result of a trial at a level that costs `share` of a full trial. A trial without a verdict
    /// failed: the configuration is tried in full.
    pub(super) fn learn(
        &mut self,
        (level, share): (u32, f64),
        configuration: &Configuration,
        verdict: Option<Verdict>,
    ) -> Climb {
        assert!(share > 0.0 && share < 1.0, "a level that costs {share} of a full trial");
        self.full_trials += share;
        let place = self.place(configuration);
        let cost = match verdict {
            Some(Verdict::Cost(cost) | Verdict::AtLeast(cost)) => cost,
            Some(Verdict::Infeasible) => {
                self.entries[place].dropped = Some(Dropped::Infeasible);
                return Climb::Dropped(Verdict::Infeasible);
            }
            None => {
                self.entries[place].next = u32::MAX;
                return Climb::Further;
            }
        };
        let entry = &mut self.entries[place];
        entry.costs.retain(|(at, _)| *at != level);
        entry.costs.push((level, cost));
        entry.next = entry.next.max(level + 1);
        let pairs = self.pairs(level);
        if pairs.len() < PAIRS_LEAST || self.given_up.contains(&level) {
            return Climb::Further;
        }
        if spearman(&pairs) < CORRELATION_LEAST {
            return if self.give_up(level) { Climb::FurtherWithOthers } else { Climb::Further };
        }
        let costs = self.entries.iter().rev().filter_map(|entry| entry.cost_at(level)).take(RANKED_LATEST);
        let (count, better) =
            costs.fold((0, 0), |(count, better), other| (count + 1, better + usize::from(other < cost)));
        if CLIMBS_ONE_IN * better < count {
            return Climb::Further;
        }
        let dropped = Dropped::AtLeast(at_least(&pairs, cost));
        self.entries[place].dropped = Some(dropped);
        Climb::Dropped(dropped.verdict())
    }

    /// Gives a level up. Configurations that it did not let climb may run again; whether there are any.
    fn give_up(&mut self, level: u32) -> bool {
        self.given_up.push(level);
        let mut any = false;
        for entry in &mut self.entries {
            let is_of_level = entry.costs.last().is_some_and(|(at, _)| *at == level);
            if is_of_level && matches!(entry.dropped, Some(Dropped::AtLeast(_))) {
                (entry.dropped, any) = (None, true);
            }
        }
        any
    }

    /// Enters the cost of a full trial. `false` for a configuration that never ran at a cheaper level.
    pub(super) fn pair(&mut self, configuration: &Configuration, cost: f64) -> bool {
        let known = self.entries.iter_mut().find(|entry| entry.configuration == *configuration.values());
        known.map(|entry| entry.full = Some(cost)).is_some()
    }

    /// The latest costs at a level and in full of the configurations that ran at both.
    fn pairs(&self, level: u32) -> Vec<(f64, f64)> {
        let both = self.entries.iter().filter_map(|entry| entry.cost_at(level).zip(entry.full));
        let mut pairs: Vec<(f64, f64)> = both.rev().take(PAIRS_LATEST).collect();
        pairs.reverse();
        pairs
    }

    fn entry(&self, configuration: &Configuration) -> Option<&LadderEntry> {
        self.entries.iter().find(|entry| entry.configuration == *configuration.values())
    }

    /// The place of a configuration's entry, which is new where it has none.
    fn place(&mut self, configuration: &Configuration) -> usize {
        let known = self.entries.iter().position(|entry| entry.configuration == *configuration.values());
        known.unwrap_or_else(|| {
            if self.entries.len() >= LADDER_ENTRIES_MAX {
                self.entries.remove(0);
            }
            let configuration = configuration.to_raw();
            self.entries.push(LadderEntry {
                configuration,
                costs: Vec::new(),
                next: 0,
                full: None,
                dropped: None,
            });
            self.entries.len() - 1
        })
    }
}

/// What a configuration costs at least in full, which costs `cost` at a level: one deviation below the line
/// through the pairs, and no less than the best of them.
fn at_least(pairs: &[(f64, f64)], cost: f64) -> f64 {
    let n = pairs.len() as f64;
    let (x, y) = pairs.iter().fold((0.0, 0.0), |(x, y), pair| (x + pair.0 / n, y + pair.1 / n));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>();
    let (xx, xy) = (sum(&|pair| (pair.0 - x).powi(2)), sum(&|pair| (pair.0 - x) * (pair.1 - y)));
    let slope = if xx > 0.0 { (xy / xx).max(0.0) } else { 0.0 };
    let deviation = (sum(&|pair| (pair.1 - y - slope * (pair.0 - x)).powi(2)) / n).sqrt();
    let best = pairs.iter().map(|pair| pair.1).fold(f64::INFINITY, f64::min);
    let bound = (y + slope * (cost - x) - deviation).max(best);
    if bound.is_finite() { bound } else { best }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Space;
    use crate::value::Value;

    fn space() -> Space {
        Space::builder().integer("level", 1..=1000).default(1).build().expect("valid")
    }

    fn level(space: &Space, value: i64) -> Configuration {
        let raw = [("level".to_owned(), Value::Integer(value))].into_iter().collect();
        space.configuration(raw).expect("valid")
    }

    /// Runs a configuration at the only level; in full, too, where it climbs.
    fn run(ladder: &mut Ladder, configuration: &Configuration, cheap: f64, full: f64) -> Climb {
        assert_eq!(ladder.next(configuration, 1), Some(0));
        let climb = ladder.learn((0, 0.25), configuration, Some(Verdict::Cost(cheap)));
        if let Climb::Dropped(verdict) = climb {
            assert_eq!(ladder.dropped(configuration), Some(verdict));
        } else {
            assert_eq!(ladder.next(configuration, 1), None, "next is a full trial");
            assert!(ladder.pair(configuration, full) && ladder.dropped(configuration).is_none());
        }
        climb
    }

    #[test]
    fn a_third_climbs_once_a_level_is_believed() {
        let (space, mut ladder) = (space(), Ladder::default());
        for value in 1..=6 {
            let cost = value as f64;
            let climb = run(&mut ladder, &level(&space, value), cost, 10.0 * cost);
            assert_eq!(climb, Climb::Further, "it is not known yet");
        }
        // The line says 10 times as much, without a deviation.
        let Climb::Dropped(Verdict::AtLeast(bound)) = run(&mut ladder, &level(&space, 7), 5.5, 55.0) else {
            panic!("five of six are better")
        };
        assert!((bound - 55.0).abs() < 1e-6, "{bound}");
        assert_eq!(run(&mut ladder, &level(&space, 8), 0.5, 5.0), Climb::Further, "it is the best");
        assert_eq!(run(&mut ladder, &level(&space, 9), 1.5, 15.0), Climb::Further, "2 of 9 are better");
        let climb = run(&mut ladder, &level(&space, 10), 3.0, 30.0);
        assert!(matches!(climb, Climb::Dropped(_)), "4 of 10 are better");
        assert_eq!(ladder.full_trials(), 2, "ten quarters");
    }

    #[test]
    fn only_the_latest_are_compared() {
        let (space, mut ladder) = (space(), Ladder::default());
        // Each is better than all before it, so all climb.
        for value in 1..=40 {
            let cost = 100.0 - value as f64;
            assert_eq!(run(&mut ladder, &level(&space, value), cost, cost), Climb::Further, "{value}");
        }
        // Better than the first 33, and the eighth best of the latest.
        let climb = run(&mut ladder, &level(&space, 41), 66.5, 66.5);
        assert!(matches!(climb, Climb::Dropped(_)), "{climb:?}");
    }

    #[test]
    fn a_level_that_ranks_otherwise_is_given_up() {
        let (space, mut ladder) = (space(), Ladder::default());
        for value in 1..=6 {
            run(&mut ladder, &level(&space, value), value as f64, 10.0 - value as f64);
        }
        let climb = run(&mut ladder, &level(&space, 7), 9.0, 1.0);
        assert_eq!(climb, Climb::Further, "it climbs although it is the worst");
        assert_eq!(ladder.next(&level(&space, 8), 1), None, "full trials from now on");
        assert_eq!(ladder.next(&level(&space, 8), 2), Some(1), "another level is not concerned");
    }

    #[test]
    fn a_level_that_is_given_up_takes_its_verdicts_back() {
        let (space, mut ladder) = (space(), Ladder::default());
        for value in 1..=6 {
            run(&mut ladder, &level(&space, value), value as f64, value as f64);
        }
        let dropped = level(&space, 7);
        assert!(matches!(run(&mut ladder, &dropped, 6.5, 6.5), Climb::Dropped(_)));
        // The best at the level is the worst in full: a correlation of 0.25.
        assert_eq!(run(&mut ladder, &level(&space, 8), 0.9, 9.0), Climb::Further);
        assert_eq!(run(&mut ladder, &level(&space, 9), 0.8, 8.0), Climb::FurtherWithOthers);
        assert_eq!(ladder.dropped(&dropped), None);
    }

    #[test]
    fn what_cannot_run_is_dropped_and_what_failed_is_tried_in_full() {
        let (space, mut ladder) = (space(), Ladder::default());
        let (crashes, fails) = (level(&space, 1), level(&space, 2));
        let climb = ladder.learn((0, 0.1), &crashes, Some(Verdict::Infeasible));
        assert_eq!(climb, Climb::Dropped(Verdict::Infeasible));
        assert_eq!(ladder.dropped(&crashes), Some(Verdict::Infeasible));
        assert_eq!(ladder.learn((0, 0.1), &fails, None), Climb::Further);
        assert_eq!((ladder.dropped(&fails), ladder.next(&fails, 4)), (None, None));
        assert!(!ladder.pair(&level(&space, 3), 1.0), "it never ran at a cheaper level");
    }

    #[test]
    fn it_is_stored_exactly_and_does_not_grow() {
        let (space, mut ladder) = (space(), Ladder::default());
        for value in 1..=LADDER_ENTRIES_MAX as i64 {
            let configuration = level(&space, value);
            ladder.learn((0, 0.1), &configuration, Some(Verdict::Cost((value * 37 % 101) as f64 / 3.0)));
            ladder.pair(&configuration, (value * 37 % 101) as f64 / 7.0);
        }
        let packed = crate::packed::pack(&ladder);
        assert_eq!(crate::packed::unpack::<Ladder>(&packed), Ok(ladder.clone()));
        let one_more = level(&space, 1000);
        assert_eq!(ladder.next(&one_more, 1), None, "there is no room");
        ladder.learn((0, 0.1), &one_more, Some(Verdict::Cost(1.0)));
        assert_eq!(ladder.entries.len(), LADDER_ENTRIES_MAX);
    }
}
