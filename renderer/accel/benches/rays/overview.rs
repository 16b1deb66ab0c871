//! Results over all scenes: the recommended tree over each other kind of structure, by class of rays, and
//! what a ray costs in it.
//!
//! A ratio is one of medians over the rounds. Where several structures or packings stand on one side, the
//! fastest in each scene and class counts: the best available choice.

use comfy_table::{CellAlignment, LineStyle, Table, presets};
use treewright_accel::{Visits, recording::RayClass};

use crate::contenders::{Maker, RECOMMENDED};
use crate::measure::{Speed, median};

/// One scene on one number of threads.
pub(crate) struct Scene {
    pub(crate) threads: usize,
    /// Class and number of the rays of each set, and what they visit.
    pub(crate) visits: Vec<(RayClass, usize, Visits)>,
    pub(crate) speeds: Vec<Speed>,
}

/// A comparison: its words, and the measurements on its two sides.
type Comparison = (&'static str, fn(&Speed) -> bool, fn(&Speed) -> bool);

const COMPARISONS: [Comparison; 7] = [
    (
        "single rays over native's best",
        |one| is_ours(one) && !one.packed,
        |one| is_native(one) && !one.packed,
    ),
    ("the recommended tree alone", is_recommended, |one| is_native(one) && !one.packed),
    ("any packing over native's best", is_ours, is_native),
    (
        "single rays over tinybvh's best",
        |one| is_ours(one) && !one.packed,
        |one| one.name.starts_with("tinybvh"),
    ),
    ("single rays over obvhs's best", |one| is_ours(one) && !one.packed, |one| one.name.starts_with("obvhs")),
    ("robust over not robust, single rays", |one| is_robust(one) && !one.packed, is_recommended),
    ("robust over native robust, any packing", is_robust, |one| one.maker == Maker::Native && one.robust),
];

fn is_ours(one: &Speed) -> bool {
    one.maker == Maker::Treewright && !one.robust
}

fn is_robust(one: &Speed) -> bool {
    one.maker == Maker::Treewright && one.robust
}

fn is_native(one: &Speed) -> bool {
    one.maker == Maker::Native && !one.robust
}

fn is_recommended(one: &Speed) -> bool {
    one.name == RECOMMENDED && !one.packed
}

/// A cost of a ray: its name, and the figure from visits and the million single rays a second.
type Quantity = (&'static str, fn(&Visits, f64, f64) -> f64);

const QUANTITIES: [Quantity; 5] = [
    ("nodes a ray", |visits, rays, _| visits.nodes as f64 / rays),
    ("blocks of triangles a ray", |visits, rays, _| visits.blocks as f64 / rays),
    ("KiB a ray", |visits, rays, _| visits.bytes as f64 / rays / 1024.0),
    ("GB/s of single rays", |visits, rays, speed| visits.bytes as f64 / rays * speed / 1e3),
    ("million single rays a second", |_, _, speed| speed),
];

pub(crate) fn table(scenes: &[Scene], threads: usize) -> Table {
    let scenes: Vec<&Scene> = scenes.iter().filter(|scene| scene.threads == threads).collect();
    let mut table = Table::new();
    table
        .load_style(presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none()))
        .set_header(std::iter::once("median (least, most)").chain(RayClass::ALL.map(RayClass::name)));
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (name, ours, theirs) in COMPARISONS {
        let ratio =
            |scene: &Scene, class| Some(fastest(scene, ours, class)? / fastest(scene, theirs, class)?);
        table.add_row(row(name, |class| scenes.iter().filter_map(|scene| ratio(scene, class)).collect()));
    }
    for (name, quantity) in QUANTITIES {
        let figure = |scene: &Scene, class| {
            let (_, rays, visits) = scene.visits.iter().find(|(of, rays, _)| *of == class && *rays > 0)?;
            Some(quantity(visits, *rays as f64, fastest(scene, is_recommended, class)?))
        };
        table.add_row(row(name, |class| scenes.iter().filter_map(|scene| figure(scene, class)).collect()));
    }
    table
}

fn row(name: &str, of: impl Fn(RayClass) -> Vec<f64>) -> Vec<String> {
    let cells = RayClass::ALL.map(|class| {
        let values = of(class);
        let range = values.iter().copied().reduce(f64::min).zip(values.iter().copied().reduce(f64::max));
        range.map_or("–".to_owned(), |(least, most)| {
            format!("{:.2} ({least:.2}, {most:.2})", median(&values))
        })
    });
    std::iter::once(name.to_owned()).chain(cells).collect()
}

/// Million rays a second of the fastest of some structures.
fn fastest(scene: &Scene, of: fn(&Speed) -> bool, class: RayClass) -> Option<f64> {
    let some = scene.speeds.iter().filter(|one| one.class == class && of(one));
    some.map(|one| one.million_rays_per_s).reduce(f64::max)
}
