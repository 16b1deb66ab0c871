//! Lamps learnt before the other frames: which of them light which places.
//!
//! A grid of cells, wider the farther from the eye, covers the places of pilot frames' paths. Of all groups
//! of lamps a cell keeps the few that bring it most. Lamps are drawn from these, and by power alone, so the
//! expectation of a picture does not depend on what was learnt. Compare Vévoda, Kondapaneni and Křivánek,
//! Bayesian Online Regression for Adaptive Direct Illumination Sampling (SIGGRAPH 2018).

use glam::Vec3;
use rayon::prelude::*;

use super::{lamp::Lamp, lamp::LightSample, lamp_groups::LampGroups, random::PathRandom, surface::Surface};
use crate::limits::{LAMP_CELLS_MAX, LAMP_GROUPS_PER_CELL_MAX};

/// Places of a cell from which its lamps are tried.
const PROBES: usize = 8;
/// Places that a cell of its own needs, and the share of all places that must be in such cells.
const PLACES_MIN: usize = 4;
const COVERED_MIN: f32 = 0.9;
/// The grid is made finer by the factor `FINER`, at most `REFINEMENTS` times.
const FINER: f32 = 1.4;
const REFINEMENTS: u32 = 12;
/// Where the eye is in a grid, in cells: more than a grid of any fineness has to either side.
const CENTRE: f32 = 1024.0;
/// Places nearer to the eye than this share of the distance of the farthest have cells of one width.
const NEAREST: f32 = 1e-3;
/// Least and greatest share of draws by power alone.
const PLAIN_MIN: f32 = 0.2;
const PLAIN_MAX: f32 = 0.8;
/// Greatest factor on the weight of sampled lamps.
const GAIN_MAX: f32 = 64.0;

#[derive(Clone, Debug)]
pub(super) struct LampGuide {
    grid: Grid,
    /// Keys of cells and numbers of their tables, by hash: a power of two, half of them [`EMPTY`].
    slots: Vec<(u64, u32)>,
    tables: Vec<LampTable>,
    /// Of all tables.
    entries: Vec<Entry>,
    groups: LampGroups,
    gain: f32,
}

const EMPTY: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
pub(super) struct LampTable {
    /// Its first entry, and the one after its last. There is one at least.
    first: u32,
    end: u32,
    /// Share of draws by power alone.
    plain: f32,
    /// Of lamps that only these draws find.
    others: Odds,
}

/// A group of lamps in a table; those of a table are in the order of their numbers.
#[derive(Clone, Copy, Debug)]
struct Entry {
    group: u32,
    /// Probability that a draw from the table falls on this entry or one before it.
    until: f32,
    odds: Odds,
}

#[derive(Clone, Copy, Debug)]
struct Odds {
    /// Probability of a lamp by power alone over that with which it is drawn.
    ratio: f32,
    /// See [`LampDraw::worth`].
    worth: f32,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct LampDraw {
    pub(super) lamp: usize,
    /// Its probability by power alone over that with which it was drawn.
    pub(super) ratio: f32,
    /// The factor, by whether its light arrives, on its unshadowed light. Drawn lamps are compared by it.
    pub(super) worth: f32,
}

/// Cells by place and side, as wide as the power of two at or below their distance, over the fineness.
#[derive(Clone, Copy, Debug)]
struct Grid {
    eye: Vec3,
    nearest: f32,
    fineness: f32,
}

impl Grid {
    /// The finest whose cells have enough places: with the key and the number of each place, sorted.
    fn fitting(eye: Vec3, places: &[Surface]) -> (Self, Vec<(u64, u32)>) {
        let farthest = places.iter().map(|place| place.position.distance(eye)).fold(0.0, f32::max);
        let nearest = (farthest * NEAREST).clamp(1e-15, 1e15);
        let mut grid = Self { eye, nearest, fineness: 1.0 };
        let mut sorted = grid.sorted(places);
        for _ in 0..REFINEMENTS {
            let finer = Self { fineness: grid.fineness * FINER, ..grid };
            let next = finer.sorted(places);
            let (cells, covered) =
                cells(&next).fold((0, 0), |(cells, covered), cell| (cells + 1, covered + cell.len()));
            if cells > LAMP_CELLS_MAX || (covered as f32) < COVERED_MIN * places.len() as f32 {
                break;
            }
            (grid, sorted) = (finer, next);
        }
        (grid, sorted)
    }

    fn sorted(&self, places: &[Surface]) -> Vec<(u64, u32)> {
        let key = |place: &Surface| self.key(place.position, place.geometric_normal);
        let mut sorted: Vec<(u64, u32)> = places.iter().map(key).zip(0..).collect();
        sorted.par_sort_unstable();
        sorted
    }

    #[inline]
    fn key(&self, position: Vec3, normal: Vec3) -> u64 {
        let offset = position - self.eye;
        // In this order a distance that is no number becomes the nearest.
        let exponent = offset.length().max(self.nearest).min(1e30).to_bits() >> 23;
        let per_length = f32::from_bits((254 - exponent) << 23) * self.fineness;
        // Above 0, where cutting off the fraction is rounding down, which would be a call by itself.
        let cell = offset * per_length + Vec3::splat(CENTRE);
        let [x, y, z] = cell.to_array().map(|at| at as i32 as u64 & 0xffff);
        x | y << 16 | z << 32 | side(normal) << 48 | u64::from(exponent) << 56
    }
}

/// Which of six sides a normal looks to.
#[inline]
fn side(normal: Vec3) -> u64 {
    let axis = normal.abs().max_position();
    2 * axis as u64 + u64::from(normal[axis] < 0.0)
}

/// The cells that have enough of the sorted places.
fn cells(sorted: &[(u64, u32)]) -> impl Iterator<Item = &[(u64, u32)]> {
    sorted.chunk_by(|a, b| a.0 == b.0).filter(|cell| cell.len() >= PLACES_MIN)
}

struct Lesson<'a, F> {
    lamps: &'a [Lamp],
    groups: &'a LampGroups,
    places: &'a [Surface],
    seed: u64,
    arrives: F,
}

struct CellLamps {
    /// Groups in the order of their numbers, the light that each should bring, and its worth.
    lamps: Vec<(u32, f32, f32)>,
    /// Light of all others.
    others: f32,
}

impl<F: Fn(&Surface, &LightSample) -> bool> Lesson<'_, F> {
    /// The lamps that light a cell. `None` where none does.
    fn learn(&self, number: usize, cell: &[(u64, u32)]) -> Option<CellLamps> {
        let step = cell.len().div_ceil(PROBES);
        let places: Vec<&Surface> =
            cell.iter().step_by(step).map(|(_, place)| &self.places[*place as usize]).collect();
        let light = |place: &&Surface, group: usize| {
            self.groups.all()[group].reach(place.position, place.geometric_normal)
        };
        let mut expected: Vec<(u32, f32)> = (0..self.groups.all().len())
            .map(|group| (group as u32, places.iter().map(|place| light(place, group)).sum::<f32>()))
            .collect();
        let total: f32 = expected.iter().map(|(_, light)| light).sum();
        if expected.len() > LAMP_GROUPS_PER_CELL_MAX {
            let by_light = |a: &(u32, f32), b: &(u32, f32)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
            expected.select_nth_unstable_by(LAMP_GROUPS_PER_CELL_MAX, by_light);
            expected.truncate(LAMP_GROUPS_PER_CELL_MAX);
        }
        expected.retain(|(_, light)| *light > 0.0);
        expected.sort_unstable_by_key(|(group, _)| *group);
        if expected.is_empty() {
            return None;
        }
        let kept: f32 = expected.iter().map(|(_, light)| light).sum();
        let lamps: Vec<(u32, f32, f32)> = expected
            .into_iter()
            .zip(0..)
            .map(|(group, turn)| self.try_out(group, &places, number as u32, turn))
            .collect();
        let worth = lamps.iter().map(|(.., worth)| worth).sum::<f32>() / lamps.len() as f32;
        // In that unit: the mean of the places.
        let others = (total - kept).max(0.0) / places.len() as f32 * worth;
        Some(CellLamps { lamps, others })
    }

    /// Tries a group of lamps from some places: its number, its mean light, and its worth. Noise is least if
    /// a lamp is drawn in proportion to the root of the share of places where it arrives.
    fn try_out(
        &self,
        (group, light): (u32, f32),
        places: &[&Surface],
        cell: u32,
        turn: u32,
    ) -> (u32, f32, f32) {
        let (about, mut sum) = (self.groups.all()[group as usize], 0.0);
        let (mut tried, mut arrived) = (0_u8, 0_u8);
        for (&place, sample) in places.iter().zip(0..) {
            let random = PathRandom::new(self.seed, cell, sample);
            let ([within, _], u) = (random.pair(2 * turn), random.pair(2 * turn + 1));
            let lamp = &self.lamps[self.groups.draw(group, within)];
            let reach = lamp.reach(place.position, place.geometric_normal, u);
            if reach > 0.0 {
                sum += about.power * reach.min(about.reach_max());
                tried += 1;
                arrived += u8::from((self.arrives)(place, &lamp.sample(place.position, u)));
            }
        }
        // The expectation counts like one more place, and as if of two more rays one had arrived.
        let count = places.len() as f32;
        let light = (light / count + sum) / (count + 1.0);
        let worth = ((f32::from(arrived) + 1.0) / (f32::from(tried) + 2.0)).sqrt();
        (group, light * worth, worth)
    }
}

impl LampGuide {
    /// Learns which lamps, of these powers, light places, seen from `eye`. `arrives` says whether light comes
    /// through. `None` for too few places. At most [`PROBES`] rays for each group that a cell keeps.
    pub(super) fn new(
        lamps: &[Lamp],
        powers: &[f64],
        places: &[Surface],
        eye: Vec3,
        seed: u64,
        arrives: impl Fn(&Surface, &LightSample) -> bool + Sync,
    ) -> Option<Self> {
        if lamps.is_empty() || places.len() < PLACES_MIN {
            return None;
        }
        let groups = LampGroups::new(lamps, powers);
        let (grid, sorted) = Grid::fitting(eye, places);
        let cells: Vec<&[(u64, u32)]> = cells(&sorted).take(LAMP_CELLS_MAX).collect();
        let lesson = Lesson { lamps, groups: &groups, places, seed, arrives };
        let learned: Vec<Option<CellLamps>> =
            cells.par_iter().enumerate().map(|(number, cell)| lesson.learn(number, cell)).collect();
        let slots = vec![(0, EMPTY); (2 * cells.len()).next_power_of_two().max(2)];
        let mut guide = Self { grid, slots, tables: Vec::new(), entries: Vec::new(), groups, gain: 1.0 };
        let logarithms: Vec<f32> = cells
            .iter()
            .zip(learned)
            .filter_map(|(cell, learned)| guide.add(cell[0].0, &learned?))
            .map(f32::ln)
            .collect();
        if logarithms.is_empty() {
            return None;
        }
        let mean = logarithms.iter().sum::<f32>() / logarithms.len() as f32;
        guide.gain = mean.exp().clamp(1.0, GAIN_MAX);
        Some(guide)
    }

    /// Adds a cell's table. Returns how much sooner its light is drawn; `None` if none could be.
    fn add(&mut self, key: u64, learned: &CellLamps) -> Option<f32> {
        let total: f32 = learned.lamps.iter().map(|(_, light, _)| light).sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let plain = (learned.others / (learned.others + total)).clamp(PLAIN_MIN, PLAIN_MAX);
        let first = self.entries.len();
        let (mut sum, mut before, mut gain) = (0.0, 0.0, 0.0);
        for (place, &(group, light, worth)) in learned.lamps.iter().enumerate() {
            sum += light;
            let is_last = place + 1 == learned.lamps.len();
            let until = if is_last { 1.0 } else { (sum / total).clamp(before, 1.0) };
            let power = self.groups.all()[group as usize].power;
            let ratio = 1.0 / (plain + (1.0 - plain) * (until - before) / power);
            self.entries.push(Entry { group, until, odds: Odds { ratio, worth } });
            gain += light / total / ratio.max(f32::MIN_POSITIVE);
            before = until;
        }
        let worths = learned.lamps.iter().map(|(.., worth)| worth).sum::<f32>();
        let others = Odds { ratio: 1.0 / plain, worth: worths / learned.lamps.len() as f32 };
        let mut slot = self.slot(key);
        while self.slots[slot].1 != EMPTY {
            slot = self.after(slot);
        }
        self.slots[slot] = (key, self.tables.len() as u32);
        let end = self.entries.len() as u32;
        self.tables.push(LampTable { first: first as u32, end, plain, others });
        Some(gain)
    }

    /// Where to look for a key first.
    #[inline]
    fn slot(&self, key: u64) -> usize {
        let mixed = (key ^ key >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> (64 - self.slots.len().trailing_zeros())) as usize
    }

    /// Where to look after that.
    #[inline]
    fn after(&self, slot: usize) -> usize {
        (slot + 1) & (self.slots.len() - 1)
    }

    /// The factor of what was learnt on the weight of sampled lamps over that of their density by power.
    pub(super) fn gain(&self) -> f32 {
        self.gain
    }

    /// The lamps at a position on a surface with this geometric normal. `None` where nothing was learnt.
    #[inline]
    pub(super) fn table(&self, position: Vec3, normal: Vec3) -> Option<&LampTable> {
        let key = self.grid.key(position, normal);
        let mut slot = self.slot(key);
        loop {
            match self.slots[slot] {
                (_, EMPTY) => return None,
                (found, table) if found == key => return Some(&self.tables[table as usize]),
                _ => slot = self.after(slot),
            }
        }
    }

    /// Draws a lamp from a table by a number in [0, 1). `by_power` draws one among all by power.
    #[inline]
    pub(super) fn draw(&self, table: &LampTable, pick: f32, by_power: impl Fn(f32) -> usize) -> LampDraw {
        let entries = &self.entries[table.first as usize..table.end as usize];
        if pick < table.plain {
            let lamp = by_power((pick / table.plain).min(1.0 - f32::EPSILON));
            let Odds { ratio, worth } = self.odds(table, lamp);
            return LampDraw { lamp, ratio, worth };
        }
        let at = ((pick - table.plain) / (1.0 - table.plain)).min(1.0 - f32::EPSILON);
        let place = entries.partition_point(|entry| entry.until <= at).min(entries.len() - 1);
        let before = if place > 0 { entries[place - 1].until } else { 0.0 };
        let Entry { group, until, odds: Odds { ratio, worth } } = entries[place];
        let lamp = self.groups.draw(group, (at - before) / (until - before));
        LampDraw { lamp, ratio, worth }
    }

    /// The odds of a lamp, however it is drawn.
    #[inline]
    fn odds(&self, table: &LampTable, lamp: usize) -> Odds {
        let entries = &self.entries[table.first as usize..table.end as usize];
        let found = entries.binary_search_by_key(&self.groups.of(lamp), |entry| entry.group);
        found.map_or(table.others, |place| entries[place].odds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::sampling::AliasTable;

    /// A street of lanterns, two triangles each, those farther along the brighter.
    fn street() -> (Vec<Lamp>, Vec<f64>) {
        let lamps = (0..200).map(|number| {
            let corner = Vec3::new((number / 2) as f32, 3.0, 0.1 * (number % 2) as f32);
            let edges = [Vec3::X * 0.1, Vec3::Z * 0.1];
            Lamp { corner, edges, normal: Vec3::NEG_Y, emission: Vec3::ONE, density: 1.0 }
        });
        (lamps.collect(), (0..200).map(|number| 1.0 + f64::from(number) * 0.02).collect())
    }

    fn at(x: f32, z: f32) -> Surface {
        let (position, up) = (Vec3::new(x, 0.0, z), Vec3::Y);
        Surface { position, geometric_normal: up, shading_normal: up, offset: 1e-4 }
    }

    /// Places all along the street.
    fn guide(arrives: impl Fn(&Surface, &LightSample) -> bool + Sync) -> LampGuide {
        let (lamps, powers) = street();
        let places: Vec<Surface> =
            (0..20_000).map(|place| at(place as f32 * 0.005, (place % 7) as f32 - 3.0)).collect();
        let eye = Vec3::new(-2.0, 1.7, 0.0);
        LampGuide::new(&lamps, &powers, &places, eye, 5, arrives).expect("there are places and lamps")
    }

    /// The probability of each lamp at a place, as the draws tell it.
    fn told(guide: &LampGuide, table: &LampTable) -> Vec<f64> {
        let powers = street().1;
        let total: f64 = powers.iter().sum();
        let of = |(lamp, power): (usize, &f64)| power / total / f64::from(guide.odds(table, lamp).ratio);
        powers.iter().enumerate().map(of).collect()
    }

    #[test]
    fn lamps_are_drawn_as_often_as_is_told() {
        let guide = guide(|place, light| place.position.x < 50.0 || light.direction.z > 0.0);
        let by_power = AliasTable::new(&street().1).expect("there is power");
        for place in [at(20.0, 0.0), at(40.0, 2.0), at(80.0, -3.0)] {
            let table = guide.table(place.position, Vec3::Y).expect("it was met");
            let told = told(&guide, table);
            assert!((told.iter().sum::<f64>() - 1.0).abs() < 1e-4, "{}", told.iter().sum::<f64>());
            let (mut counts, draws) = (vec![0_u32; told.len()], 400_000);
            for draw in 0..draws {
                let drawn = guide.draw(table, draw as f32 / draws as f32, |u| by_power.sample(u));
                let odds = guide.odds(table, drawn.lamp);
                assert_eq!((drawn.ratio, drawn.worth), (odds.ratio, odds.worth));
                counts[drawn.lamp] += 1;
            }
            for (lamp, (count, told)) in counts.iter().zip(&told).enumerate() {
                // Draws lie evenly; either way can be off by a few at the ends of a lamp's parts.
                let expected = told * f64::from(draws);
                assert!(
                    (f64::from(*count) - expected).abs() < 10.0 + 0.01 * expected,
                    "{lamp}: {count} {told}"
                );
            }
        }
    }

    #[test]
    fn near_lamps_are_drawn_most_and_hidden_ones_less() {
        // Lamps up to six metres from a place, before or behind it.
        let near = |guide: &LampGuide, side: f32| -> f64 {
            let table = guide.table(Vec3::new(20.0, 0.0, 0.0), Vec3::Y).expect("it was met");
            let told = told(guide, table);
            let is_near = |lamp: &usize| (0.5..6.0).contains(&(((lamp / 2) as f32 - 20.0) * side));
            (0..200).filter(is_near).map(|lamp| told[lamp]).sum()
        };
        let (open, walled) = (guide(|_, _| true), guide(|_, light| light.direction.x < 0.0));
        let [before, behind] = [-1.0, 1.0].map(|side| near(&open, side));
        assert!(before > 0.2 && behind > 0.2 && behind > 0.7 * before, "{before} {behind}");
        let [before, behind] = [-1.0, 1.0].map(|side| near(&walled, side));
        assert!(behind < 0.6 * before, "{before} {behind}");
        assert!(open.gain() > 2.0, "{}", open.gain());
    }

    #[test]
    fn a_place_or_a_side_that_was_not_met_has_no_table() {
        let guide = guide(|_, _| true);
        assert!(guide.table(Vec3::new(20.0, 0.0, 0.0), Vec3::Y).is_some());
        assert!(guide.table(Vec3::new(20.0, 0.0, 0.0), Vec3::NEG_Y).is_none());
        assert!(guide.table(Vec3::new(20.0, 900.0, 0.0), Vec3::Y).is_none());
        assert!(guide.table(Vec3::NAN, Vec3::NAN).is_none());
        assert!(guide.tables.len() <= LAMP_CELLS_MAX && 2 * guide.tables.len() <= guide.slots.len());
        let (lamps, powers) = street();
        assert!(LampGuide::new(&lamps, &powers, &[at(1.0, 0.0); 3], Vec3::ZERO, 1, |_, _| true).is_none());
    }
}
