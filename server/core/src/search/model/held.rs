//! Set-ups that are kept. Where changes of some parameters need a build and those of others only a run,
//! points that keep the build cost little. After each new one some are chosen along the other axes alone.

use super::{GRID, MeasuredPoint, ModelSearch, Observed, coordinates};

/// Most points that keep the set-up of the point before them, where a client searches alone.
const SETUP_HELD: usize = 2;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HeldAxis {
    pub(super) axis: usize,
    /// Its canonical coordinate.
    pub(super) at: f64,
    is_active: bool,
}

impl HeldAxis {
    pub(super) fn is_kept(&self, x: &[f64], active: &[bool]) -> bool {
        (x[self.axis] - self.at).abs() < 1.0 / GRID && active[self.axis] == self.is_active
    }
}

impl ModelSearch {
    /// The axes that the next point keeps: those of the last new configuration, if it ran here, until
    /// [`SETUP_HELD`] more have had them. None while another client runs a point: each has a set-up of its
    /// own, and which of them asks next is not known. None after points at cheaper levels, of which there may
    /// be many.
    pub(super) fn held(&self) -> Vec<HeldAxis> {
        let is_alone = self.pending.is_empty() && !self.last_is_heard && self.cheaper.spent <= 0.0;
        let ran = self.seen.last().filter(|last| matches!(last.observed, Observed::Cost { .. }));
        let Some(last) = ran.filter(|_| is_alone && !self.setup.layout.setup.is_empty()) else {
            return Vec::new();
        };
        let held = self.set_up(last);
        let keeps = |seen: &&MeasuredPoint| self.set_up(seen) == held;
        let is_over = self.seen.iter().rev().take_while(keeps).count() > SETUP_HELD;
        if is_over { Vec::new() } else { held }
    }

    fn set_up(&self, seen: &MeasuredPoint) -> Vec<HeldAxis> {
        let (layout, x) = (&self.setup.layout, coordinates(&seen.x));
        let active = layout.active(&x);
        let held = |&axis: &usize| HeldAxis { axis, at: x[axis], is_active: active[axis] };
        layout.setup.iter().map(held).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::RawConfiguration;
    use crate::search::{Feedback, Point, Search, SearchSetup, Step, Verdict};
    use crate::space::Space;

    const TRIALS: usize = 40;

    fn search() -> (Space, ModelSearch) {
        let space = Space::builder().integer("layout", 1..=9).default(1).setup();
        let space = space.categorical("builder", ["a", "b", "c"]).default("a").setup();
        let space = space.integer("threads", 1..=64).default(8).float("share", 0.0..=1.0).default(0.5);
        let space = space.build().expect("a space");
        let search = ModelSearch::new(SearchSetup::of(&space, 3, 1, TRIALS as u32));
        (space, search)
    }

    fn tell(search: &mut ModelSearch, point: &Point) {
        let cost = 1.0 + point.x.iter().map(|x| (x - 0.4).powi(2)).sum::<f64>();
        search.tell(point.id, Feedback { verdict: Verdict::Cost(cost), fresh: true });
    }

    #[test]
    fn a_new_set_up_is_kept_for_some_points() {
        let (_, mut search) = search();
        let (mut kept, mut free) = (0, 0);
        for _ in 0..TRIALS {
            let held = search.held();
            let point = search.ask().expect("nothing is out");
            match (point.step, held.is_empty()) {
                (Step::Model, false) => {
                    assert!(held.iter().all(|one| (point.x[one.axis] - one.at).abs() < 1e-6), "{point:?}");
                    kept += 1;
                }
                (Step::Model | Step::Local, true) => free += 1,
                (step, _) => assert!(!matches!(step, Step::Local), "it would move what is held"),
            }
            tell(&mut search, &point);
        }
        assert!(kept > 3 && free > 3, "{kept} points keep a set-up, {free} are free");
    }

    #[test]
    fn nothing_is_held_beside_another_client_or_after_a_failure() {
        let (space, mut search) = search();
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
        assert!(stored.held().is_empty(), "the space says what is held");
        stored.set_space(&space);
        assert_eq!((stored.held(), &stored), (search.held(), &search));
        let point = search.ask().expect("nothing is out");
        assert!(search.held().is_empty(), "another client is at work");
        search.tell(point.id, Feedback { verdict: Verdict::Infeasible, fresh: true });
        assert!(search.held().is_empty(), "it could not be set up");
    }

    #[test]
    fn what_was_measured_elsewhere_is_not_held() {
        let (_, mut search) = search();
        let point = search.ask().expect("nothing is out");
        tell(&mut search, &point);
        assert!(!search.held().is_empty(), "the default was set up");
        search.hear(vec![0.9; 4], Verdict::Cost(9.0));
        let text = serde_json::to_string(&search).expect("plain data");
        assert!(search.held().is_empty() && text.contains("last_is_heard"), "nothing was set up for it here");
    }

    #[test]
    fn points_at_cheaper_levels_hold_nothing() {
        let (_, mut search) = search();
        let point = search.ask().expect("nothing is out");
        tell(&mut search, &point);
        search.open_levels(&[0.1]);
        let cheap = search.ask().expect("nothing is out");
        assert_eq!(cheap.level, Some(0));
        search.tell_cheaper(cheap.id, Some(Verdict::Cost(0.1)));
        assert!(search.held().is_empty(), "ten of them may come before the next in full");
    }

    #[test]
    fn a_condition_that_switches_a_parameter_is_another_set_up() {
        let space = Space::builder().boolean("tiled").default(false).integer("tile", 1..=9).default(5);
        let space = space.active_if("tiled", [true]).setup().integer("threads", 1..=64).default(8);
        let space = space.build().expect("a space");
        let mut search = ModelSearch::new(SearchSetup::of(&space, 3, 1, TRIALS as u32));
        let point = search.ask().expect("nothing is out");
        tell(&mut search, &point);
        let mut tiled = search.clone();
        let mut x = tiled.setup.start.clone();
        x[0] = 0.75;
        let (x, observed) = (tiled.grid(&x).0, Observed::Cost { mean: 1.0, count: 1 });
        tiled.seen.extend(vec![tiled.seen[0].clone(); SETUP_HELD]);
        tiled.seen.push(MeasuredPoint { x, observed, lacks: 0.0 });
        assert!(!tiled.held().is_empty(), "the tile's default is new where it counts");
        let mut last = RawConfiguration::new();
        for _ in 0..TRIALS {
            let held = !search.held().is_empty();
            let point = search.ask().expect("nothing is out");
            let needs = space.setup_part(space.decode(&point.x).values());
            assert!(!held || point.step != Step::Model || needs == last, "{needs:?} after {last:?}");
            if search.seen.iter().all(|seen| seen.x != search.grid(&point.x).0) {
                last = needs;
            }
            tell(&mut search, &point);
        }
    }
}
