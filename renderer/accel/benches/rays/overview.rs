//! Results over all scenes: the recommended tree over each other kind of structure, by class of rays.
//!
//! A ratio is one of medians over the rounds. Where several structures or packings stand on one side, the
//! fastest in each scene and class counts: the best available choice.

use std::fmt;

use treewright_accel::recording::RayClass;

use crate::contenders::{Maker, RECOMMENDED};
use crate::summary::{Row, SceneResults, SetResults, Spread, table, threads_in_words};

/// A comparison: its words, and the rows on its two sides.
type Comparison = (&'static str, fn(&Row) -> bool, fn(&Row) -> bool);

const COMPARISONS: [Comparison; 6] = [
    (
        "single rays over native's best",
        |row| is_recommended(row) && !row.packed,
        |row| is_native(row) && !row.packed,
    ),
    ("any packing over native's best", is_recommended, is_native),
    (
        "single rays over tinybvh's best",
        |row| is_recommended(row) && !row.packed,
        |row| row.name.starts_with("tinybvh"),
    ),
    (
        "single rays over obvhs's best",
        |row| is_recommended(row) && !row.packed,
        |row| row.name.starts_with("obvhs"),
    ),
    (
        "robust over not robust, single rays",
        |row| is_robust(row) && !row.packed,
        |row| row.name == RECOMMENDED,
    ),
    ("robust over native robust, any packing", is_robust, |row| row.maker == Maker::Native && row.robust),
];

fn is_recommended(row: &Row) -> bool {
    row.maker == Maker::Treewright && row.name.starts_with(RECOMMENDED) && !row.robust
}

fn is_robust(row: &Row) -> bool {
    row.maker == Maker::Treewright && row.name.starts_with(RECOMMENDED) && row.robust
}

fn is_native(row: &Row) -> bool {
    row.maker == Maker::Native && !row.robust
}

/// All scenes on one number of threads.
pub(crate) struct Overview {
    threads: usize,
    scenes: usize,
    /// By comparison and class, the ratio of each scene that has both sides.
    ratios: Vec<ByClass>,
    /// By quantity and class, what a single ray visits in the recommended tree, in each scene.
    visits: Vec<ByClass>,
}

/// A figure of each scene, by class of rays.
type ByClass = [Vec<f64>; RayClass::ALL.len()];

/// A cost of a ray: its name, and the figure from a set and its speed in million rays a second.
type Quantity = (&'static str, fn(&SetResults, f64) -> f64);

const QUANTITIES: [Quantity; 4] = [
    ("nodes a ray", |set, _| set.visits.nodes as f64 / set.rays as f64),
    ("blocks of triangles a ray", |set, _| set.visits.blocks as f64 / set.rays as f64),
    ("KiB a ray", |set, _| set.visits.bytes as f64 / set.rays as f64 / 1024.0),
    ("GB/s of single rays", |set, speed| set.visits.bytes as f64 / set.rays as f64 * speed / 1e3),
];

impl Overview {
    pub(crate) fn new(scenes: &[SceneResults], threads: usize) -> Self {
        let scenes: Vec<&SceneResults> = scenes.iter().filter(|scene| scene.threads == threads).collect();
        let ratios = COMPARISONS.iter().map(|(_, ours, theirs)| {
            RayClass::ALL.map(|class| {
                let ratio = |scene: &&SceneResults| {
                    Some(fastest(&scene.rows, *ours, class)? / fastest(&scene.rows, *theirs, class)?)
                };
                scenes.iter().filter_map(ratio).collect()
            })
        });
        let visits = QUANTITIES.iter().map(|(_, quantity)| {
            RayClass::ALL.map(|class| {
                let figure = |scene: &&SceneResults| {
                    let set = scene.sets.iter().find(|set| set.class == class && set.rays > 0)?;
                    Some(quantity(set, fastest(&scene.rows, |row| row.name == RECOMMENDED, class)?))
                };
                scenes.iter().filter_map(figure).collect()
            })
        });
        Self { threads, scenes: scenes.len(), ratios: ratios.collect(), visits: visits.collect() }
    }
}

/// Million rays a second of the fastest of some rows.
fn fastest(rows: &[Row], of: impl Fn(&Row) -> bool, class: RayClass) -> Option<f64> {
    let cells = rows.iter().filter(|row| of(row)).flat_map(|row| &row.cells);
    cells.filter(|cell| cell.class == class).map(|cell| cell.million_rays_per_s.median).reduce(f64::max)
}

impl fmt::Display for Overview {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = threads_in_words(self.threads);
        writeln!(
            formatter,
            "all {} scenes, {threads}: the best of the recommended trees over the best of the others, class by class: median (least, most)",
            self.scenes
        )?;
        let heads = RayClass::ALL.iter().map(|class| class.name().to_owned());
        let mut table = table(std::iter::once(String::new()).chain(heads));
        let comparisons = COMPARISONS.iter().map(|(name, ..)| *name).zip(&self.ratios);
        let quantities = QUANTITIES.iter().map(|(name, _)| *name).zip(&self.visits);
        for (name, ratios) in comparisons.chain(quantities) {
            let cells = ratios.iter().map(|ratios| {
                let range =
                    ratios.iter().copied().reduce(f64::min).zip(ratios.iter().copied().reduce(f64::max));
                range.map_or("–".to_owned(), |(least, most)| {
                    format!("{:.2} ({least:.2}, {most:.2})", Spread::of(ratios).median)
                })
            });
            table.add_row(std::iter::once(name.to_owned()).chain(cells));
        }
        write!(formatter, "{table}")
    }
}
