//! Ways to do one thing, compared in many worlds: the best way of each world beside the one that is best in
//! the worlds of other scenes.
//!
//! Ways are chosen by every other round and judged by the rest, and then the other way round, so that none is
//! chosen by luck and judged by it.

use serde::{Deserialize, Serialize};

/// The number of the way of somebody who tunes nothing, which comes first.
pub const UNTUNED: usize = 0;

/// The number of the way that searches begin with.
pub const RECOMMENDED: usize = 1;

/// What [`Gains::ratios`] are, in their order.
pub const COLUMNS: [&str; 4] = [
    "own over the best fixed way of other scenes",
    "ceiling over it",
    "own over the recommended",
    "own over the untuned",
];

/// A way in a world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WayTimes {
    /// Median of its builds, in milliseconds.
    pub build_ms: f64,
    /// Median of its frames without builds, in milliseconds.
    pub render_ms: f64,
    /// What counts, round by round, without waits for processors, in milliseconds. Empty where the structure
    /// cannot be built.
    pub cost_ms: Vec<f64>,
}

/// All ways in a world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldRow {
    /// The world's name.
    pub world: String,
    /// The name of its scene.
    pub scene: String,
    /// In the order of the ways.
    pub ways: Vec<WayTimes>,
}

/// All ways in all worlds.
#[derive(Clone, Copy, Debug)]
pub struct Ways<'a> {
    /// The names of the ways; [`UNTUNED`] and [`RECOMMENDED`] are two of them.
    pub names: &'a [String],
    /// The worlds.
    pub rows: &'a [WorldRow],
    /// Whether the ways behind these two are winners of searches, each with the name of its world.
    pub are_winners: bool,
}

/// The gains in one world.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// The world's own way: the winner of its search, or the best that ran there.
    pub own: String,
    /// The way that is best in the worlds of other scenes; the recommended one where there are none.
    pub fixed: String,
    /// Speeds, as [`COLUMNS`] says. The ceiling is the best way that ran in this world.
    pub ratios: [f64; 4],
}

impl Ways<'_> {
    /// The gains in the world of this number.
    ///
    /// # Panics
    /// If there is no such world.
    pub fn gains(&self, of: usize) -> Gains {
        let best = |half: usize| self.best(of, half);
        let own = |half: usize| self.winner_of(of).unwrap_or_else(|| best(half));
        let fixed = |half: usize| self.best_fixed(of, half);
        let times = &self.rows[of].ways;
        let gain = |one: &dyn Fn(usize) -> usize, other: &dyn Fn(usize) -> usize| {
            let judged = [0, 1].map(|half| speed(&times[one(half)], &times[other(half)], 1 - half));
            (judged[0] * judged[1]).sqrt()
        };
        let name = |which: &dyn Fn(usize) -> usize| {
            let [first, second] = [0, 1].map(|half| self.names[which(half)].as_str());
            if first == second { first.to_owned() } else { format!("{first} / {second}") }
        };
        Gains {
            own: name(&own),
            fixed: name(&fixed),
            ratios: [
                gain(&own, &fixed),
                gain(&best, &fixed),
                gain(&own, &|_| RECOMMENDED),
                gain(&own, &|_| UNTUNED),
            ],
        }
    }

    /// The way that is the fastest in a world, by half of its rounds.
    fn best(&self, of: usize, half: usize) -> usize {
        let times = &self.rows[of].ways;
        let speed_of = |way: usize| speed(&times[way], &times[UNTUNED], half);
        (0..times.len()).max_by(|a, b| speed_of(*a).total_cmp(&speed_of(*b))).unwrap_or(UNTUNED)
    }

    /// The winner of a world's own search.
    fn winner_of(&self, of: usize) -> Option<usize> {
        let is_own = |way: &usize| self.names[*way] == self.rows[of].world;
        (RECOMMENDED + 1..self.names.len()).find(is_own).filter(|_| self.are_winners)
    }

    /// The way that is the best in the mean over all worlds of other scenes than a world's own, by half of
    /// their rounds. It runs in all worlds, and is no winner of a world of that scene.
    fn best_fixed(&self, of: usize, half: usize) -> usize {
        let scene = &self.rows[of].scene;
        let others: Vec<&WorldRow> = self.rows.iter().filter(|row| row.scene != *scene).collect();
        if others.is_empty() {
            return RECOMMENDED;
        }
        let takes_part = |way: &usize| {
            let is_own = self.are_winners && *way > RECOMMENDED && is_of(&self.names[*way], scene);
            !is_own && self.rows.iter().all(|row| !row.ways[*way].cost_ms.is_empty())
        };
        let mean = |way: usize| {
            let speeds = others.iter().map(|row| speed(&row.ways[way], &row.ways[UNTUNED], half));
            geometric_mean(&speeds.collect::<Vec<_>>())
        };
        let ways = (0..self.names.len()).filter(takes_part);
        ways.max_by(|a, b| mean(*a).total_cmp(&mean(*b))).unwrap_or(RECOMMENDED)
    }
}

/// Whether a world of this name is of a scene.
fn is_of(world: &str, scene: &str) -> bool {
    world.strip_prefix(scene).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
}

/// Speed of `one` over `other` in the geometric mean, by every other round from that of the number `half` on;
/// 0 where they did not run.
fn speed(one: &WayTimes, other: &WayTimes, half: usize) -> f64 {
    let pairs = other.cost_ms.iter().zip(&one.cost_ms).skip(half).step_by(2);
    let ratios: Vec<f64> = pairs.map(|(other, one)| other / one).collect();
    if ratios.is_empty() { 0.0 } else { geometric_mean(&ratios) }
}

/// The geometric mean; 1 of no values.
pub fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len().max(1) as f64).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(scene: &str, costs_ms: &[&[f64]]) -> WorldRow {
        let way = |cost_ms: &&[f64]| WayTimes { build_ms: 1.0, render_ms: 1.0, cost_ms: cost_ms.to_vec() };
        WorldRow {
            world: format!("{scene}-sway-0.25"),
            scene: scene.to_owned(),
            ways: costs_ms.iter().map(way).collect(),
        }
    }

    fn names(others: [&str; 2]) -> Vec<String> {
        ["untuned", "recommended"].into_iter().chain(others).map(str::to_owned).collect()
    }

    fn agree(found: &Gains, own: &str, fixed: &str, ratios: [f64; 4]) {
        assert_eq!((found.own.as_str(), found.fixed.as_str()), (own, fixed));
        for (found, expected) in found.ratios.iter().zip(ratios) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} for {expected}");
        }
    }

    fn rows() -> Vec<WorldRow> {
        vec![
            row("hall", &[&[4.0; 4], &[2.0; 4], &[1.0; 4], &[2.0; 4]]),
            row("city", &[&[4.0; 4], &[2.0; 4], &[8.0; 4], &[1.0; 4]]),
        ]
    }

    #[test]
    fn the_fixed_way_is_the_best_of_other_scenes() {
        let (names, rows) = (names(["refit", "rebuild"]), rows());
        let ways = Ways { names: &names, rows: &rows, are_winners: false };
        agree(&ways.gains(0), "refit", "rebuild", [2.0, 2.0, 2.0, 4.0]);
        agree(&ways.gains(1), "rebuild", "refit", [8.0, 8.0, 2.0, 4.0]);
        // Where there is no other scene, nothing could be chosen there.
        let alone = Ways { rows: &rows[..1], ..ways };
        agree(&alone.gains(0), "refit", "recommended", [2.0, 2.0, 2.0, 4.0]);
    }

    #[test]
    fn a_winner_stands_for_its_world_and_for_no_other_of_its_scene() {
        // The search of the city found what is best for the hall.
        let (names, mut rows) = (names(["city-sway-0.25", "hall-sway-0.25"]), rows());
        let ways = Ways { names: &names, rows: &rows, are_winners: true };
        agree(&ways.gains(0), "hall-sway-0.25", "recommended", [1.0, 2.0, 1.0, 2.0]);
        // What cannot be built in some world is no way for all.
        rows[0].ways[RECOMMENDED].cost_ms.clear();
        let ways = Ways { names: &names, rows: &rows, are_winners: true };
        assert_eq!(ways.gains(0).fixed, "untuned");
        assert!(is_of("hall", "hall") && is_of("hall-sway-1", "hall") && !is_of("hallway", "hall"));
    }

    #[test]
    fn luck_is_not_judged_by_the_rounds_that_chose_it() {
        let names = names(["lucky", "slow"]);
        let rows = [row("hall", &[&[2.0; 4], &[2.0; 4], &[1.0, 4.0, 1.0, 4.0], &[3.0; 4]])];
        let ways = Ways { names: &names, rows: &rows, are_winners: false };
        let gains = ways.gains(0);
        assert_eq!(gains.own, "lucky / recommended");
        assert!((gains.ratios[1] - 0.5_f64.sqrt()).abs() < 1e-9, "{gains:?}");
    }
}
