//! Ways to do one thing, compared in many worlds: the best way of each world beside the one that is best in
//! the worlds of other scenes.
//!
//! Ways are chosen by every other round and judged by the rest, and then the other way round, so that none is
//! chosen by luck and judged by it.

use std::collections::BTreeMap;

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

/// Parameters of the space `light`, and values of each that are tried while all others stay as recommended.
pub const EACH_OF_LIGHT: &[(&str, &[&str])] = &[
    ("candidates", &["candidates=1", "candidates=4", "candidates=8", "candidates=16"]),
    ("lamps", &["lamps=learnt"]),
    ("lamp_weight", &["lamp_weight=2.0", "lamp_weight=4.0", "lamp_weight=16.0"]),
    ("sky", &["sky=plain"]),
    ("shadow_roulette", &["shadow_roulette=0.0", "shadow_roulette=0.1", "shadow_roulette=0.4"]),
    ("path_roulette", &["path_roulette=0.0", "path_roulette=0.2", "path_roulette=0.8"]),
];

/// As [`EACH_OF_LIGHT`], of the space `follow`.
pub const EACH_OF_FOLLOW: &[(&str, &[&str])] = &[
    ("tree", &["tree=middle", "tree=good", "tree=native_low", "tree=native_medium"]),
    ("period", &["period=1", "period=4", "period=16"]),
    ("repair_above", &["repair_above=1.02", "repair_above=1.3", "repair_above=2.0", "repair_above=4.0"]),
];

/// The name of a way that changes one parameter alone: `candidates: candidates=2`.
pub fn named_by_lever(lever: &str, text: &str) -> String {
    format!("{lever}{OF_LEVER}{text}")
}

/// Between a parameter's name and its value.
const OF_LEVER: &str = ": ";

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

    /// The parameters that some ways change alone, in the order of the ways.
    pub fn levers(&self) -> Vec<&str> {
        let names = self.names.iter().filter_map(|name| Some(name.split_once(OF_LEVER)?.0));
        let mut levers: Vec<&str> = names.collect();
        levers.dedup();
        levers
    }

    /// The gains in each world where nothing but this parameter is chosen. The recommended way is one of its
    /// values, and counts as the untuned one.
    pub fn gains_of(&self, lever: &str) -> Vec<Gains> {
        let is_value =
            |way: &usize| self.names[*way].strip_prefix(lever).is_some_and(|rest| rest.starts_with(OF_LEVER));
        let values = (0..self.names.len()).filter(is_value);
        let kept: Vec<usize> = [RECOMMENDED; 2].into_iter().chain(values).collect();
        let names: Vec<String> = kept.iter().map(|way| self.names[*way].clone()).collect();
        let row = |row: &WorldRow| WorldRow {
            world: row.world.clone(),
            scene: row.scene.clone(),
            ways: kept.iter().map(|way| row.ways[*way].clone()).collect(),
        };
        let rows: Vec<WorldRow> = self.rows.iter().map(row).collect();
        let ways = Ways { names: &names, rows: &rows, are_winners: false };
        (0..rows.len()).map(|world| ways.gains(world)).collect()
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

/// Of all that ran in each of some groups, the mean logarithm of its costs there, the least first.
pub(crate) fn ranked<K: Ord + Clone>(groups: &[BTreeMap<K, f64>]) -> Vec<(K, f64)> {
    let in_all = |one: &K| -> Option<f64> {
        let logarithms: Option<Vec<f64>> = groups.iter().map(|group| Some(group.get(one)?.ln())).collect();
        Some(logarithms?.iter().sum::<f64>() / groups.len() as f64)
    };
    let ran = groups.first().into_iter().flat_map(BTreeMap::keys);
    let mut all: Vec<(K, f64)> = ran.filter_map(|one| Some((one.clone(), in_all(one)?))).collect();
    all.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    all
}

/// The geometric mean; 1 of no values.
pub fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len().max(1) as f64).exp()
}

#[cfg(test)]
mod tests {
    use treewright_renderer::space::{Premises, Preset, TuningSpace, parse};

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
    fn a_lever_alone_is_chosen_among_its_own_values() {
        let names = names(["tree: tree=good", "period: period=1"]);
        let rows = rows();
        let ways = Ways { names: &names, rows: &rows, are_winners: false };
        assert_eq!(ways.levers(), ["tree", "period"]);
        // The good tree is the best in the hall alone: nobody would have chosen it for the city.
        let tree = ways.gains_of("tree");
        agree(&tree[0], "tree: tree=good", "recommended", [2.0, 2.0, 2.0, 2.0]);
        agree(&tree[1], "recommended", "tree: tree=good", [4.0, 4.0, 1.0, 1.0]);
        let period = ways.gains_of("period");
        agree(&period[0], "period: period=1", "period: period=1", [1.0; 4]);
        assert_eq!(period[1].fixed, "period: period=1", "it is level with the recommended one in the hall");
    }

    #[test]
    fn each_value_is_a_way_of_its_own_in_its_space() {
        for (preset, levers) in [(Preset::Light, EACH_OF_LIGHT), (Preset::Follow, EACH_OF_FOLLOW)] {
            let space = TuningSpace::new(preset, &Premises::all());
            let mut known = vec![space.default_choice()];
            for text in levers.iter().flat_map(|(_, texts)| *texts) {
                let choice = space.choice(&parse(text).expect(text)).expect(text);
                assert!(!known.contains(&choice), "{text} is there already");
                known.push(choice);
            }
            let parameters = space.space().parameters().iter().map(|parameter| parameter.name.as_str());
            assert!(parameters.eq(levers.iter().map(|(lever, _)| *lever)), "{levers:?}");
        }
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
