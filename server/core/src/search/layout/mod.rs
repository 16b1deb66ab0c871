//! The structure of a space for a model: the ordered axes, the choices, and when each axis counts.
//!
//! Cells of integers, inactive parameters and folded constraints make many points of the cube one
//! configuration. A model of the cube would learn each configuration many times. A [`Layout`] gives it the
//! configuration instead, without names and text: [`Layout::canonical`] is `encode(decode(point))` of the
//! space, some hundred times faster where no constraint is an expression.

pub(crate) mod main_effects;

use std::sync::Arc;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use treewright_model::plain::is_default;

use crate::gp::kernel::{FeatureKind, INACTIVE};
use crate::gp::local_search::Neighbourhood;
use crate::search::layout::main_effects::MainEffects;
use crate::space::{Constraint, Domain, Space};
use crate::value::Value;

/// The meaning of an axis of the cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum AxisKind {
    /// Integers and floats, mapped as the space maps them.
    Number(Domain),
    /// Values in equal cells. `ranks` holds the place of each cell's value among all by size, where the
    /// values are numbers; it is empty where they have no order.
    Choice { levels: u32, ranks: Vec<u32> },
}

/// The condition of an axis: it counts while its `parent` is active and at one of the levels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Gate {
    parent: usize,
    any_of: Vec<i64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LayoutAxis {
    kind: AxisKind,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gate: Option<Gate>,
}

/// The axes of a space, in order. Without any axes, every axis counts as a number.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    axes: Vec<LayoutAxis>,
    /// Pairs of axes whose values must not fall: `(lesser, greater)`.
    order: Vec<(usize, usize)>,
    /// The coordinates of inactive axes.
    default: Vec<f64>,
    /// The space, where a point's configuration needs it. It is not stored.
    #[serde(skip)]
    space: Option<Arc<Space>>,
    /// The prediction of points by other states, a feature. Rows of version 0.1.0 call it `guide`.
    #[serde(rename = "guide", default, skip_serializing_if = "Option::is_none")]
    pub(super) main_effects: Option<MainEffects>,
    /// The number of cheaper levels at which points may be measured. Each is a feature behind all others: 1
    /// where a point was measured there.
    #[serde(default, skip_serializing_if = "is_default")]
    pub(super) cheaper: usize,
    /// The axes whose changes need a set-up, where those of others only need a run. They are not stored.
    #[serde(skip)]
    pub(super) setup: Vec<usize>,
}

/// Most cells that are counted; finer axes pass for continuous.
const CELLS_MAX: u64 = 1 << 16;
/// Least distance of a moved coordinate from the ends of its cell, as a share of the cell.
const INSIDE: f64 = 1e-9;

impl Layout {
    /// The layout of a space.
    pub fn of(space: &Space) -> Self {
        let parameters = space.parameters();
        let place = |name: &str| parameters.iter().position(|parameter| parameter.name == name);
        let axes = parameters.iter().map(|parameter| {
            let gate = parameter.active_if.as_ref().and_then(|condition| {
                let parent = place(&condition.parameter)?;
                let domain = &parameters[parent].domain;
                Some(Gate {
                    parent,
                    any_of: condition.any_of.iter().map(|value| level_of(domain, value)).collect(),
                })
            });
            LayoutAxis { kind: AxisKind::of(&parameter.domain), gate }
        });
        let orders = space.constraints().iter().filter_map(Constraint::as_order);
        let places = |(lesser, greater)| Some((place(lesser)?, place(greater)?));
        let mut layout = Layout {
            axes: axes.collect(),
            order: orders.filter_map(places).collect(),
            default: space.encode(space.default_ref()),
            ..Layout::default()
        };
        let comes_after =
            |(index, axis): (usize, &LayoutAxis)| axis.gate.as_ref().is_none_or(|gate| gate.parent < index);
        assert!(layout.axes.iter().enumerate().all(comes_after), "a parent comes before its children");
        assert_eq!(layout.default.len(), layout.axes.len(), "a place for every axis");
        layout.set_space(space);
        layout
    }

    /// Names the space again, for a layout that was stored.
    pub(super) fn set_space(&mut self, space: &Space) {
        self.space = space.has_expressions().then(|| Arc::new(space.clone()));
        let needs = space.parameters().iter().enumerate().filter(|(_, parameter)| parameter.setup);
        let needs: Vec<usize> = needs.map(|(axis, _)| axis).collect();
        self.setup = if needs.len() < space.dimension() { needs } else { Vec::new() };
    }

    /// Axes that count as numbers in 0..1 or, where `levels` is not 0, as choices between `levels` values of
    /// equal shares.
    #[cfg(test)]
    pub(crate) fn plain(default: Vec<f64>, levels: &[u32]) -> Self {
        let axis = |index: usize| {
            let kind = match levels.get(index).copied().unwrap_or(0) {
                0 => AxisKind::Number(Domain::Float { min: 0.0, max: 1.0, scale: Default::default() }),
                levels => AxisKind::Choice { levels, ranks: (0..levels).collect() },
            };
            LayoutAxis { kind, gate: None }
        };
        Layout { axes: (0..default.len()).map(axis).collect(), default, ..Layout::default() }
    }

    /// The features of a full measurement as those of one at a cheaper level.
    pub(super) fn at_cheaper(&self, level: usize, features: &[f64]) -> Vec<f64> {
        assert!(level < self.cheaper, "level {level} of {}", self.cheaper);
        let mut features = features.to_vec();
        let place = self.kinds().len() - self.cheaper + level;
        features[place] = 1.0;
        features
    }

    pub(crate) fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// The comparison of the values of each feature.
    pub(crate) fn kinds(&self) -> Vec<FeatureKind> {
        let kind = |axis: &LayoutAxis| match &axis.kind {
            AxisKind::Choice { ranks, .. } if ranks.is_empty() => FeatureKind::Categorical,
            _ => FeatureKind::Ordered,
        };
        let twice = self.axes.iter().filter(|axis| axis.is_seen_twice()).map(|_| FeatureKind::Categorical);
        let main_effects = self.main_effects.iter().map(|_| FeatureKind::Linear);
        let cheaper = (0..self.cheaper).map(|_| FeatureKind::Categorical);
        self.axes.iter().map(kind).chain(twice).chain(main_effects).chain(cheaper).collect()
    }

    /// The number of values of an axis; 0 for a continuous one.
    pub(crate) fn cells(&self, axis: usize) -> u32 {
        match &self.axes[axis].kind {
            AxisKind::Choice { levels, .. } => *levels,
            AxisKind::Number(Domain::Integer { min, max, .. }) if max.abs_diff(*min) < CELLS_MAX => {
                max.abs_diff(*min) as u32 + 1
            }
            AxisKind::Number(_) => 0,
        }
    }

    /// The coordinate of the value that is the `rank`th by size (by listing where there is no order).
    pub(crate) fn at_rank(&self, axis: usize, rank: u32) -> f64 {
        match &self.axes[axis].kind {
            AxisKind::Choice { levels, ranks } => {
                let cell = ranks.iter().position(|&other| other == rank).map_or(rank, |cell| cell as u32);
                (f64::from(cell) + 0.5) / f64::from(*levels)
            }
            AxisKind::Number(domain @ Domain::Integer { min, .. }) => {
                domain.encode(&Value::Integer(min + i64::from(rank)))
            }
            AxisKind::Number(_) => 0.5,
        }
    }

    /// The rank of the value at a canonical coordinate.
    pub(crate) fn rank(&self, axis: usize, x: f64) -> u32 {
        match &self.axes[axis].kind {
            AxisKind::Choice { levels, ranks } => {
                let cell = cell(x, *levels);
                ranks.get(cell as usize).copied().unwrap_or(cell)
            }
            AxisKind::Number(domain @ Domain::Integer { min, .. }) => match domain.decode(x) {
                Value::Integer(integer) => (integer - min) as u32,
                _ => 0,
            },
            AxisKind::Number(_) => 0,
        }
    }

    /// The place of the value at a canonical coordinate among all by size, 0 to 1; the coordinate itself
    /// where there is no other order.
    pub(super) fn by_size(&self, axis: usize, x: f64) -> f64 {
        match &self.axes[axis].kind {
            AxisKind::Choice { levels, ranks } if !ranks.is_empty() => {
                (f64::from(ranks[cell(x, *levels) as usize]) + 0.5) / f64::from(*levels)
            }
            _ => x,
        }
    }

    /// A point of the cube, with the values of lists of numbers along their axes by size, not as listed.
    pub(super) fn sized(&self, x: &[f64]) -> Vec<f64> {
        self.reordered(x, |ranks, cell| ranks[cell as usize])
    }

    /// The point of the cube that is `x` once it is [`sized`](Self::sized).
    pub(super) fn listed(&self, x: &[f64]) -> Vec<f64> {
        let cell_of = |ranks: &[u32], rank| ranks.iter().position(|&other| other == rank);
        self.reordered(x, |ranks, rank| cell_of(ranks, rank).map_or(rank, |cell| cell as u32))
    }

    /// Moves each coordinate of an ordered choice to its place in another cell.
    fn reordered(&self, x: &[f64], other: impl Fn(&[u32], u32) -> u32) -> Vec<f64> {
        let mut x = x.to_vec();
        for (x, axis) in x.iter_mut().zip(&self.axes) {
            let AxisKind::Choice { levels, ranks } = &axis.kind else { continue };
            let from = cell(*x, *levels);
            if let Some(to) = (!ranks.is_empty()).then(|| other(ranks, from)).filter(|to| *to != from) {
                // Off the ends of the cell, which rounding could take for the next one.
                let within = (*x * f64::from(*levels) - f64::from(from)).clamp(INSIDE, 1.0 - INSIDE);
                *x = (f64::from(to) + within) / f64::from(*levels);
            }
        }
        x
    }

    /// Whether each axis counts at a point whose parents are canonical.
    pub(crate) fn active(&self, x: &[f64]) -> Vec<bool> {
        assert_eq!(x.len(), self.axes.len(), "a coordinate for every axis");
        let mut active = vec![true; x.len()];
        for (index, axis) in self.axes.iter().enumerate() {
            if let Some(Gate { parent, any_of }) = &axis.gate {
                active[index] = active[*parent] && any_of.contains(&self.axes[*parent].level(x[*parent]));
            }
        }
        active
    }

    /// Moves a point to where its configuration is encoded: cells to their middles, folded constraints
    /// unfolded, inactive axes to their defaults. Where a constraint can only be repaired by narrowing
    /// ranges the point is left where it is.
    pub(crate) fn canonical(&self, x: &mut [f64]) -> Vec<bool> {
        if let Some(space) = &self.space {
            return space.canonical(x);
        }
        for (x, axis) in x.iter_mut().zip(&self.axes) {
            *x = axis.snap(*x);
        }
        let mut active = self.active(x);
        for _ in 0..self.order.len() {
            let mut moved = false;
            for &(lesser, greater) in &self.order {
                moved |= active[lesser] && active[greater] && self.unfold(x, lesser, greater);
            }
            if !moved {
                break;
            }
            active = self.active(x);
        }
        for (index, is_active) in active.iter().enumerate() {
            if !is_active {
                x[index] = self.default[index];
            }
        }
        active
    }

    fn unfold(&self, x: &mut [f64], lesser: usize, greater: usize) -> bool {
        let (AxisKind::Number(a), AxisKind::Number(b)) = (&self.axes[lesser].kind, &self.axes[greater].kind)
        else {
            return false;
        };
        let (low, high) = (a.decode(x[lesser]), b.decode(x[greater]));
        if low.as_number() <= high.as_number() || !a.contains(&high) || !b.contains(&low) {
            return false;
        }
        (x[lesser], x[greater]) = (a.encode(&high), b.encode(&low));
        true
    }

    /// The features of a canonical point, measured in full: the place of each value by size in 0..1, the cell
    /// of a choice without order, [`INACTIVE`] where the axis does not count. Choices among more than two
    /// numbers are seen twice, by size and by cell: values such as block sizes follow their order in part
    /// only, and the model weighs the two. Then come the prediction of other states, the levels, and the
    /// parts of that prediction.
    pub(crate) fn features(&self, x: &[f64], active: &[bool]) -> Vec<f64> {
        let feature = |index: usize| match &self.axes[index].kind {
            _ if !active[index] => INACTIVE,
            AxisKind::Choice { levels, ranks } if ranks.is_empty() => f64::from(cell(x[index], *levels)),
            _ => self.by_size(index, x[index]),
        };
        let cell_of = |(index, axis): (usize, &LayoutAxis)| match &axis.kind {
            _ if !axis.is_seen_twice() => None,
            _ if !active[index] => Some(INACTIVE),
            AxisKind::Choice { levels, .. } => Some(f64::from(cell(x[index], *levels))),
            AxisKind::Number(_) => None,
        };
        let twice = self.axes.iter().enumerate().filter_map(cell_of);
        let main_effects = self.main_effects.iter().map(|effects| effects.at(self, x, active));
        let cheaper = (0..self.cheaper).map(|_| 0.0);
        let parts = self.main_effects.iter().flat_map(|effects| effects.parts(self, x, active));
        let features: Vec<f64> =
            (0..x.len()).map(feature).chain(twice).chain(main_effects).chain(cheaper).chain(parts).collect();
        let parts = if self.main_effects.is_some() { x.len() } else { 0 };
        debug_assert_eq!(features.len(), self.kinds().len() + parts, "every feature has its kind");
        features
    }
}

impl Neighbourhood for Layout {
    fn moved(&self, axis: usize, x: f64, radius: f64, random: &mut ChaCha8Rng) -> f64 {
        let cells = self.cells(axis);
        if cells == 1 {
            return x;
        }
        if cells == 0 {
            let towards = random.random::<f64>() + random.random::<f64>() + random.random::<f64>() - 1.5;
            return (x + 2.0 * radius * towards).clamp(0.0, 1.0);
        }
        let rank = self.rank(axis, x);
        assert!(rank < cells, "rank {rank} of {cells}");
        let reach = ((f64::from(cells) * radius) as u32).max(1);
        let other = if cells <= 8 || random.random::<f64>() < 0.2 {
            (rank + random.random_range(1..cells)) % cells
        } else {
            let step = random.random_range(1..=reach);
            if random.random::<bool>() { rank.saturating_sub(step) } else { (rank + step).min(cells - 1) }
        };
        self.at_rank(axis, other)
    }
}

impl AxisKind {
    fn of(domain: &Domain) -> Self {
        match domain {
            Domain::Boolean => AxisKind::Choice { levels: 2, ranks: vec![0, 1] },
            Domain::Categorical { values } => {
                let mut sorted: Vec<usize> = (0..values.len()).collect();
                sorted.sort_by(|&a, &b| values[a].cmp(&values[b]));
                let numbers = values.iter().all(|value| value.as_number().is_some());
                let rank = |cell: usize| sorted.iter().position(|&other| other == cell).unwrap_or(0) as u32;
                let ranks = if numbers { (0..values.len()).map(rank).collect() } else { Vec::new() };
                AxisKind::Choice { levels: values.len() as u32, ranks }
            }
            number => AxisKind::Number(number.clone()),
        }
    }
}

impl LayoutAxis {
    fn is_seen_twice(&self) -> bool {
        matches!(&self.kind, AxisKind::Choice { ranks, .. } if ranks.len() > 2)
    }

    fn snap(&self, x: f64) -> f64 {
        match &self.kind {
            AxisKind::Number(domain @ Domain::Integer { .. }) => domain.encode(&domain.decode(x)),
            AxisKind::Number(Domain::Float { min, max, .. }) if min == max => 0.5,
            AxisKind::Number(_) => x.clamp(0.0, 1.0),
            AxisKind::Choice { levels, .. } => (f64::from(cell(x, *levels)) + 0.5) / f64::from(*levels),
        }
    }

    fn level(&self, x: f64) -> i64 {
        match &self.kind {
            AxisKind::Number(domain) => level_of(domain, &domain.decode(x)),
            AxisKind::Choice { levels, .. } => i64::from(cell(x, *levels)),
        }
    }
}

/// A number for a value of a domain, different for different values.
fn level_of(domain: &Domain, value: &Value) -> i64 {
    match (domain, value) {
        (Domain::Categorical { values }, value) => {
            values.iter().position(|other| other == value).map_or(-1, |cell| cell as i64)
        }
        (_, Value::Integer(integer)) => *integer,
        (_, Value::Float(float)) => float.to_bits() as i64,
        (_, Value::Boolean(boolean)) => i64::from(*boolean),
        (_, Value::Text(_)) => -1,
    }
}

fn cell(x: f64, levels: u32) -> u32 {
    assert!(levels > 0, "a choice among nothing");
    ((x * f64::from(levels)) as u32).min(levels - 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn each_level_has_an_equal_part_and_the_end_belongs_to_the_last() {
        assert_eq!([0.0, 0.24, 0.25, 0.99, 1.0].map(|x| cell(x, 4)), [0, 0, 1, 3, 3]);
    }

    fn space() -> Space {
        let custom = ["custom", "other"];
        let space = Space::builder().categorical("backend", ["a", "custom", "other"]).default("a");
        let space = space.integer("quality", 1..=3).default(2).active_if("backend", custom);
        let space = space.categorical("width", [8, 2, 4]).default(2).active_if("backend", custom);
        let space = space.integer("least", 1..=32).log().default(1).active_if("backend", custom);
        let space = space.integer("most", 1..=32).log().default(32).active_if("backend", custom);
        let space = space.float("cost", 0.1..=10.0).log().default(1.0).active_if("quality", [3]);
        let space = space.boolean("robust").default(false);
        let space = space.integer("bits", 4..=24).default(12).active_if("robust", [true]);
        space.less_or_equal("least", "most").build().expect("a valid space")
    }

    proptest! {
        #![proptest_config(crate::testing::cases(512))]

        #[test]
        fn the_canonical_point_is_that_of_the_configuration(x in prop::collection::vec(0.0f64..=1.0, 8)) {
            let space = space();
            let layout = Layout::of(&space);
            let configuration = space.decode(&x);
            let mut point = x;
            let active = layout.canonical(&mut point);
            for (index, (own, theirs)) in point.iter().zip(space.encode(&configuration)).enumerate() {
                // Floats are decoded to twelve digits.
                prop_assert!((own - theirs).abs() < 1e-9, "axis {}: {} and {}", index, own, theirs);
                let name = &space.parameters()[index].name;
                prop_assert_eq!(active[index], configuration.get(name).is_some());
                if layout.cells(index) > 0 && active[index] {
                    let back = layout.at_rank(index, layout.rank(index, *own));
                    prop_assert!((back - own).abs() < 1e-12, "axis {}", index);
                }
            }
        }
    }

    #[test]
    fn expressions_are_repaired_as_the_space_repairs_them() {
        let space = Space::builder()
            .integer("x", 1..=64)
            .default(8)
            .integer("y", 1..=64)
            .default(8)
            .constraint("x * y <= 64 and x % 2 == 0")
            .build()
            .expect("a space");
        let layout = Layout::of(&space);
        let text = serde_json::to_string(&layout).expect("plain data");
        let mut stored: Layout = serde_json::from_str(&text).expect("own output");
        stored.set_space(&space);
        assert_eq!(stored, layout);
        for point in [[0.9, 0.9], [0.1, 0.99], [0.4, 0.02]] {
            let (mut x, configuration) = (point, space.decode(&point));
            assert_eq!(layout.canonical(&mut x), [true, true]);
            assert_eq!(x.to_vec(), space.encode(&configuration));
        }
    }

    #[test]
    fn listed_numbers_have_neighbours() {
        let sizes = (0..16).rev().map(|power| 1 << power);
        let space = Space::builder().categorical("block", sizes).default(64).build().expect("a valid space");
        let layout = Layout::of(&space);
        let mut random = crate::randomness::stream(1, crate::randomness::Purpose::Unseen, 1, 0);
        let start = space.encode(&space.default_configuration())[0];
        let mut near = 0;
        for _ in 0..1000 {
            let moved = layout.moved(0, start, 0.05, &mut random);
            let size = space.decode(&[moved]).integer("block").expect("a size");
            near += u32::from([32, 128].contains(&size));
        }
        assert!(near > 750, "{near} of 1000 moves from 64 go to 32 or 128");
    }

    #[test]
    fn a_list_of_numbers_lies_by_size_and_comes_back() {
        let layout = Layout::of(&space());
        // Cells of 8, 2 and 4, each at its lower end; other axes stay.
        for (listed, sized) in [(0.0, 2.0), (1.0, 0.0), (2.0, 1.0)] {
            let x = [0.4, 0.5, (listed + 0.25) / 3.0, 0.0, 1.0, 0.5, 0.0, 0.5];
            let moved = layout.sized(&x);
            assert!((moved[2] - (sized + 0.25) / 3.0).abs() < 1e-12, "{moved:?}");
            let back = layout.listed(&moved);
            assert!(back.iter().zip(&x).all(|(back, x)| (back - x).abs() < 1e-12), "{back:?}");
            assert_eq!((back[0], back[6]), (x[0], x[6]));
        }
    }

    #[test]
    fn features_order_numbers_by_size_and_mark_what_is_inactive() {
        let layout = Layout::of(&space());
        let mut x = vec![0.5, 0.5, 0.1, 0.0, 1.0, 0.5, 0.0, 0.5];
        let active = layout.canonical(&mut x);
        let features = layout.features(&x, &active);
        assert_eq!(layout.kinds()[0], FeatureKind::Categorical);
        assert_eq!(features[0], 1.0);
        // The first cell holds 8, the largest of the three.
        assert_eq!((x[2], features[2]), (1.0 / 6.0, 2.5 / 3.0));
        assert_eq!((features[5], features[7]), (INACTIVE, INACTIVE));
    }
}
