//! Looks at branches of the space that other states speak against.
//!
//! A search beside known states begins with what served those, and its models follow them. Where a state is
//! unlike all of them, the parameters that it needs may not act in any of these points, so that nothing shows
//! the error for fifty trials. So a few early points go to configurations of other states in which parameters
//! act that have not acted here yet. Each look opens as many of them as possible, so that a deep branch shows
//! those on the way to it as well. No parameter is opened twice. The rule follows the interleaved random
//! configurations of SMAC (Hutter, Hoos and Leyton-Brown, LION 5, 2011), by which no region is left out
//! because a model is wrong.

use serde::{Deserialize, Serialize};

use super::{ModelSearch, coordinates};

/// The first point that may be a look, the number of points from one to the next, and the point from which on
/// there are none. The best of other states, the default and one more come first.
const LOOKS_FROM: u64 = 3;
const LOOK_EVERY: u64 = 2;
const LOOKS_UNTIL: u64 = 16;
/// The most looks of a search, and the part of its budget beyond which it has no more than one.
const LOOKS_MAX: usize = 4;
const LOOKS_PART: usize = 8;

/// The looks of a search.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Looks {
    /// Points of other states that may be looked at, the most promising first.
    pub(super) left: Vec<Vec<f64>>,
    /// Those that were, in steps of the grid.
    asked: Vec<Vec<u32>>,
}

impl Looks {
    /// Whether a place of the grid was looked at.
    pub(super) fn has_asked(&self, x: &[u32]) -> bool {
        self.asked.iter().any(|asked| asked == x)
    }
}

impl ModelSearch {
    /// The axes that act at a point.
    fn acting(&self, x: &[f64]) -> Vec<bool> {
        let mut x = x.to_vec();
        self.setup.layout.canonical(&mut x)
    }

    /// The place of the look that is due: the one that opens most axes, the most promising among equals. An
    /// axis is open once it acts at a point that was measured, is pending, or is still to come from other
    /// states.
    pub(super) fn due_look(&self) -> Option<usize> {
        let added = self.pending.added();
        let is_turn =
            (LOOKS_FROM..LOOKS_UNTIL).contains(&added) && (added - LOOKS_FROM).is_multiple_of(LOOK_EVERY);
        let most = (self.setup.budget as usize / LOOKS_PART).clamp(1, LOOKS_MAX);
        if !is_turn || self.looks.left.is_empty() || self.looks.asked.len() >= most {
            return None;
        }
        let seen = self.seen.iter().map(|seen| coordinates(&seen.x));
        let pending = self.pending.points().map(|point| point.x.clone());
        let mut open = vec![false; self.setup.dimension()];
        for x in seen.chain(pending).chain(self.elsewhere.iter().cloned()) {
            open.iter_mut().zip(self.acting(&x)).for_each(|(open, acts)| *open |= acts);
        }
        let opened = |x: &Vec<f64>| {
            self.acting(x).into_iter().zip(&open).filter(|(acts, open)| *acts && !**open).count()
        };
        let opened = self.looks.left.iter().map(opened).enumerate();
        let (place, count) = opened.reduce(|best, one| if one.1 > best.1 { one } else { best })?;
        (count > 0).then_some(place)
    }

    /// The look that is due.
    pub(super) fn next_look(&mut self) -> Option<Vec<f64>> {
        let place = self.due_look()?;
        let x = self.looks.left.remove(place);
        let grid = self.grid(&x).0;
        assert!(!self.looks.has_asked(&grid), "a second look opens nothing");
        self.looks.asked.push(grid);
        Some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::{Feedback, Layout, Search, SearchSetup, Step, Verdict};
    use crate::space::Space;

    const BUDGET: u32 = 40;
    const BRANCHES: usize = 4;

    /// Four back ends, of which all but the first have a parameter of their own, and a share for all.
    fn space() -> Space {
        let space = Space::builder().categorical("backend", ["a", "b", "c", "d"]).default("a");
        let space = space.float("share", 0.0..=1.0).default(0.5);
        let space = space.integer("b_depth", 1..=9).default(5).active_if("backend", ["b"]);
        let space = space.integer("c_depth", 1..=9).default(5).active_if("backend", ["c"]);
        let space = space.integer("d_depth", 1..=9).default(5).active_if("backend", ["d"]);
        space.build().expect("a valid space")
    }

    fn point(backend: usize, share: f64) -> Vec<f64> {
        vec![(backend as f64 + 0.5) / BRANCHES as f64, share, 0.5, 0.5, 0.5]
    }

    fn backend(x: &[f64]) -> usize {
        ((x[0] * BRANCHES as f64) as usize).min(BRANCHES - 1)
    }

    fn search(space: &Space, seed: u64, budget: u32) -> ModelSearch {
        ModelSearch::new(SearchSetup::of(space, seed, 1, budget))
    }

    fn tell(search: &mut ModelSearch, id: u64, cost: f64) {
        search.tell(id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
    }

    #[test]
    fn every_branch_has_one_look_unless_it_was_tried() {
        let space = space();
        let layout = Layout::of(&space);
        for seed in 0..8 {
            let mut search = search(&space, seed, BUDGET);
            let twice = (1..BRANCHES).flat_map(|backend| [point(backend, 0.2), point(backend, 0.8)]);
            search.look_at(twice.collect());
            let (mut open, mut looks) = (vec![false; layout.dimension()], 0);
            for number in 0..30 {
                let text = serde_json::to_string(&search).expect("plain data");
                let stored: ModelSearch = serde_json::from_str(&text).expect("own output");
                assert_eq!(stored.due_look(), search.due_look(), "a stored search goes on");
                let due = search.due_look().is_some();
                assert!(!due || search.is_ready(), "no model has to be fitted for a look");
                let asked = search.ask().expect("nothing is out");
                let mut x = asked.x.clone();
                let acting = layout.canonical(&mut x);
                assert_eq!(asked.step == Step::Elsewhere, due, "seed {seed}, point {number}");
                if due {
                    let opens = acting.iter().zip(&open).any(|(acts, open)| *acts && !*open);
                    assert!(opens && number >= 3, "seed {seed}, point {number} opens nothing");
                    looks += 1;
                }
                open.iter_mut().zip(acting).for_each(|(open, acts)| *open |= acts);
                assert!(number < 9 || open.iter().all(|open| *open), "seed {seed}, point {number}: {open:?}");
                tell(&mut search, asked.id, if backend(&asked.x) == 3 { 0.5 } else { 1.0 + asked.x[1] });
            }
            assert!(looks < BRANCHES, "seed {seed}: {looks} looks at three branches");
        }
    }

    #[test]
    fn a_small_budget_has_one_look() {
        let space = space();
        for seed in 0..4 {
            let mut search = search(&space, seed, 8);
            search.look_at((1..BRANCHES).map(|backend| point(backend, 0.2)).collect());
            let mut looks = 0;
            for _ in 0..20 {
                let asked = search.ask().expect("nothing is out");
                looks += usize::from(asked.step == Step::Elsewhere);
                tell(&mut search, asked.id, 1.0 + asked.x[1]);
            }
            assert!(looks <= 1, "seed {seed}: {looks} looks");
        }
    }

    #[test]
    fn looks_at_dear_branches_are_no_doubt_of_other_states() {
        let space = space();
        let mut search = search(&space, 1, BUDGET);
        search.elsewhere = (1..=5).map(|place| point(0, 0.1 * f64::from(place))).collect();
        search.look_at((1..BRANCHES).map(|backend| point(backend, 0.2)).collect());
        let mut asked = Vec::new();
        for _ in 0..9 {
            let point = search.ask().expect("nothing is out");
            tell(&mut search, point.id, if backend(&point.x) == 0 { 1.0 } else { 10.0 });
            asked.push((backend(&point.x), point.step));
        }
        let (known, look) = ((0, Step::Elsewhere), |backend| (backend, Step::Elsewhere));
        let first = [known, (0, Step::Default), known, look(1), known, look(2), known, look(3), known];
        assert_eq!(asked, first);
    }
}
