//! Set-ups that are kept. Where changes of some parameters need a build and those of others only a run,
//! points that keep the build cost little: after each new one some are chosen along the other axes alone.

use super::{MeasuredPoint, ModelSearch, Observed, coordinates};

impl ModelSearch {
    /// The axes that the next point keeps, with their coordinates: those of the last new configuration, if it
    /// ran, until `setup_held` more have had them. None while another client runs a point: each has a set-up
    /// of its own, and which of them asks next is not known.
    pub(super) fn held(&self) -> Vec<(usize, f64)> {
        let ran = self.seen.last().filter(|last| matches!(last.observed, Observed::Cost { .. }));
        let Some(last) = ran.filter(|_| self.pending.is_empty()) else { return Vec::new() };
        let axes = &self.setup.layout.setup;
        let keeps = |seen: &&MeasuredPoint| axes.iter().all(|&axis| seen.x[axis] == last.x[axis]);
        if self.seen.iter().rev().take_while(keeps).count() > self.setup.setup_held {
            return Vec::new();
        }
        let x = coordinates(&last.x);
        axes.iter().map(|&axis| (axis, x[axis])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::{Feedback, Point, Search, SearchSetup, Step, Verdict};
    use crate::space::Space;

    const TRIALS: usize = 40;

    fn search(setup_held: usize) -> (Space, ModelSearch) {
        let space = Space::builder().integer("layout", 1..=9).default(1).setup();
        let space = space.categorical("builder", ["a", "b", "c"]).default("a").setup();
        let space = space.integer("threads", 1..=64).default(8).float("share", 0.0..=1.0).default(0.5);
        let space = space.build().expect("a space");
        let setup = SearchSetup { setup_held, ..SearchSetup::of(&space, 3, 1, TRIALS as u32) };
        (space, ModelSearch::new(setup))
    }

    fn tell(search: &mut ModelSearch, point: &Point) {
        let cost = 1.0 + point.x.iter().map(|x| (x - 0.4).powi(2)).sum::<f64>();
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
    }

    /// The numbers of points by the model that keep a set-up, and that are free.
    fn kept(setup_held: usize) -> (usize, usize) {
        let (_, mut search) = search(setup_held);
        let (mut kept, mut free) = (0, 0);
        for _ in 0..TRIALS {
            let held = search.held();
            let point = search.ask().expect("nothing is out");
            match (point.step, held.is_empty()) {
                (Step::Model, false) => {
                    assert!(held.iter().all(|&(axis, at)| (point.x[axis] - at).abs() < 1e-6), "{point:?}");
                    kept += 1;
                }
                (Step::Model | Step::Local, true) => free += 1,
                (step, _) => assert!(!matches!(step, Step::Local), "it would move what is held"),
            }
            tell(&mut search, &point);
        }
        (kept, free)
    }

    #[test]
    fn a_new_set_up_is_kept_for_some_points() {
        let (few, free) = kept(2);
        assert!(few > 3 && free > 3, "{few} points keep a set-up, {free} are free");
        assert_eq!(kept(0).0, 0);
    }

    #[test]
    fn nothing_is_held_beside_another_client_or_after_a_failure() {
        let (space, mut search) = search(2);
        for _ in 0..10 {
            let point = search.ask().expect("nothing is out");
            tell(&mut search, &point);
        }
        while search.held().is_empty() {
            let point = search.ask().expect("nothing is out");
            tell(&mut search, &point);
        }
        let text = serde_json::to_string(&search).expect("plain data");
        let mut stored: ModelSearch = serde_json::from_str(&text).expect("own output");
        assert!(!text.contains("setup_held") && stored.held().is_empty(), "the space says what is held");
        stored.set_space(&space);
        assert_eq!((stored.held(), &stored), (search.held(), &search));
        let point = search.ask().expect("nothing is out");
        assert!(search.held().is_empty(), "another client is at work");
        search.tell(point.id, Feedback { verdict: Verdict::Infeasible, fresh: true });
        assert!(search.held().is_empty(), "it could not be set up");
    }
}
