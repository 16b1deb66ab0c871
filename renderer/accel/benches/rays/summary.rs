//! The results: a table for people, JSON for programs.

use std::fmt;

use comfy_table::{CellAlignment, LineStyle, Table, presets};
use serde::Serialize;
use treewright_accel::recording::{RayClass, Recording};
use treewright_accel::{Packets, Visits};

use crate::answers::Answers;
use crate::bandwidth::Bandwidth;
use crate::contenders::Maker;

/// Everything that was measured.
#[derive(Debug, Serialize)]
pub(crate) struct Results {
    pub(crate) embree: (u32, u32, u32),
    pub(crate) instruction_set: String,
    /// 0 is one a core.
    pub(crate) build_threads: usize,
    pub(crate) rounds: u32,
    pub(crate) builds: u32,
    /// On as many threads as scenes were measured on.
    pub(crate) bandwidth: Vec<Bandwidth>,
    pub(crate) scenes: Vec<SceneResults>,
}

/// One scene on one number of threads.
#[derive(Debug, Serialize)]
pub(crate) struct SceneResults {
    scene: String,
    triangles: usize,
    pub(crate) threads: usize,
    pub(crate) sets: Vec<SetResults>,
    pub(crate) rows: Vec<Row>,
}

/// A set of rays, the number of hits that native medium finds, and the visits for them.
#[derive(Debug, Serialize)]
pub(crate) struct SetResults {
    pub(crate) class: RayClass,
    pub(crate) rays: usize,
    hits: usize,
    /// Nodes and blocks that its rays, one by one, visit in the recommended tree.
    pub(crate) visits: Visits,
}

/// One structure.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) name: String,
    pub(crate) maker: Maker,
    pub(crate) robust: bool,
    /// Whether the best packing of each class was chosen; otherwise every ray goes alone.
    pub(crate) packed: bool,
    pub(crate) build_ms: Spread,
    pub(crate) cells: Vec<Cell>,
}

/// One structure on one set of rays.
#[derive(Debug, Serialize)]
pub(crate) struct Cell {
    pub(crate) class: RayClass,
    pub(crate) packets: Packets,
    pub(crate) million_rays_per_s: Spread,
    /// Ratio within a round.
    pub(crate) over_native_medium: Spread,
}

/// Median and quartiles.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Spread {
    pub(crate) lower_quartile: f64,
    pub(crate) median: f64,
    pub(crate) upper_quartile: f64,
}

impl Spread {
    /// Of at least one value.
    pub(crate) fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * (sorted.len() - 1) as f64;
            let (below, part) = (place.floor() as usize, place.fract());
            let above = (below + 1).min(sorted.len() - 1);
            sorted[below] * (1.0 - part) + sorted[above] * part
        };
        Self { lower_quartile: at(0.25), median: at(0.5), upper_quartile: at(0.75) }
    }
}

impl SceneResults {
    pub(crate) fn new(
        scene: &str,
        recording: &Recording,
        (expected, visits): (&[Answers], &[Visits]),
        threads: usize,
        rows: Vec<Row>,
    ) -> Self {
        let sets = recording.sets.iter().zip(expected).zip(visits).map(|((set, expected), visits)| {
            SetResults { class: set.class, rays: set.rays.len(), hits: expected.hits(), visits: *visits }
        });
        Self {
            scene: scene.to_owned(),
            triangles: recording.triangles.len(),
            threads,
            sets: sets.collect(),
            rows,
        }
    }
}

impl fmt::Display for SceneResults {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = threads_in_words(self.threads);
        writeln!(formatter, "{}: {} triangles, {threads}", self.scene, self.triangles)?;
        writeln!(formatter, "million rays a second (over native medium, median [quartiles])")?;
        let heads =
            self.sets.iter().map(|set| format!("{}\n{} rays, {} hit", set.class.name(), set.rays, set.hits));
        let mut table = table(["structure".to_owned(), "build ms".to_owned()].into_iter().chain(heads));
        for row in &self.rows {
            let cells = row.cells.iter().map(|cell| {
                let ratio = cell.over_native_medium;
                format!(
                    "{:.2} ({:.2} [{:.2}, {:.2}]){}",
                    cell.million_rays_per_s.median,
                    ratio.median,
                    ratio.lower_quartile,
                    ratio.upper_quartile,
                    packing(cell.packets)
                )
            });
            table.add_row([row.name.clone(), format!("{:.1}", row.build_ms.median)].into_iter().chain(cells));
        }
        write!(formatter, "{table}")
    }
}

pub(crate) fn threads_in_words(threads: usize) -> String {
    if threads == 1 { "one thread".into() } else { format!("{threads} threads") }
}

/// A table with a heading; all columns but the first are numbers.
pub(crate) fn table(heading: impl Iterator<Item = String>) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none())).set_header(heading);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// A packing in short: the width, and c for coherent.
fn packing(packets: Packets) -> &'static str {
    match packets {
        Packets::Single => "",
        Packets::Four => " 4",
        Packets::Eight => " 8",
        Packets::EightCoherent => " 8c",
        Packets::Sixteen => " 16",
        Packets::SixteenCoherent => " 16c",
    }
}
