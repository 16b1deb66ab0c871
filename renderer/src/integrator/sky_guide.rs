//! Light learnt while rendering: directions towards the sky, as through windows, and the share of each kind
//! of light at each place.
//!
//! A few frames leave records of paths that looked for light. Each cell of a grid holds a distribution over
//! directions, by the light that came along them (compare Müller, Gross and Novák, Practical Path Guiding,
//! EGSR 2017). Shadow rays are drawn by it beside the surfaces' own sampling, so the expectation of a picture
//! does not depend on it.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{UVec3, Vec3};

use super::{lamp_guide::LampGuide, sampling::AliasTable};
use crate::light_sampling::LearningTimes;

/// Directions have equal solid angles: around, and by height.
const AROUND: usize = 32;
const HEIGHTS: usize = 16;
const BINS: usize = AROUND * HEIGHTS;
/// Density of a direction that is drawn evenly within its bin.
const BIN_DENSITY: f32 = BINS as f32 / (4.0 * PI);
/// Most cells, and the records that each has in the mean where there are fewer.
const CELLS_MAX: f32 = 512.0;
const RECORDS_PER_CELL: f32 = 128.0;
/// Records that a cell of its own needs.
const RECORDS_MIN: usize = 32;
/// Share of a cell's distribution that is that of all cells together.
const COMMON_SHARE: f64 = 0.1;
/// Share of a bin's light that its eight neighbours get together.
const SPREAD: f64 = 0.4;
/// Least share of shadow rays of the sun, of lamps, and of a sky that is a map. Another sky that wants less
/// has none.
const SHARE_MIN: f32 = 0.06;
/// What brings more, relative to the brightness around its pixel, counts as this for the shares: the rest is
/// a few pixels' noise.
const LIGHT_MAX: f64 = 8.0;
/// Factor on what bounces stand for, since a shadow ray by learnt directions finds less than one by the light
/// itself. Of 0, 1, 2 and 4 the best on seven scenes.
const LOSS: f64 = 2.0;
/// Where nothing else shines, shadow rays look for the sky if bounces find it less well than this.
const FOUND_MAX: f64 = 0.25;

#[derive(Clone, Copy, Debug)]
pub(super) struct LightRecord {
    pub(super) position: Vec3,
    pub(super) direction: Vec3,
    /// Luminance that it brought to its path's pixel, relative to that around the pixel; 0 of a bounce that
    /// did not find the sky.
    pub(super) light: f32,
    /// Luminance that a bounce's path carried, relative to that brightness as well.
    pub(super) throughput: f32,
    /// The number of bounces that it stands for; 0 of a shadow ray.
    pub(super) bounces: u32,
    pub(super) kind: Kind,
}

/// What a pilot's shadow rays were for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Looks {
    /// Their shares.
    pub(super) shares: Shares,
    /// Which kinds of light there are.
    pub(super) there: [bool; 3],
    /// The sky is a map, which shadow rays found, too.
    pub(super) map: bool,
    /// Whether learnt shares are used.
    pub(super) used: bool,
}

/// A kind of light that shares of shadow rays turn to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Sky,
    Sun,
    Lamp,
}

/// Shares of shadow rays, by [`Kind`].
pub(super) type Shares = [f32; 3];

#[derive(Clone, Debug, Default)]
pub(crate) struct Learnt {
    /// Where the sky was seen from; nothing where it hardly was, or where bounces find it well enough.
    pub(super) sky: Option<Arc<SkyGuide>>,
    /// Which lamps light which places; nothing where there are few.
    pub(super) lamps: Option<Arc<LampGuide>>,
    /// Mean luminance of the picture; 0 before anything was learnt.
    pub(super) brightness: f32,
    pub(crate) times: LearningTimes,
}

/// Distributions of directions by place.
#[derive(Clone, Debug)]
pub(super) struct SkyGuide {
    low: Vec3,
    /// Cells per unit of length.
    scale: Vec3,
    cells: UVec3,
    of_cell: Vec<u32>,
    distributions: Vec<Distribution>,
    /// Of each distribution.
    shares: Vec<Shares>,
}

#[derive(Clone, Debug)]
struct Distribution {
    table: AliasTable,
    /// Over solid angle, of each bin.
    densities: Vec<f32>,
}

impl SkyGuide {
    /// Learns from records. `None` if there are too few, or if bounces find the sky well enough everywhere
    /// and at most one kind of light shines beside it.
    pub(super) fn new(records: &[LightRecord], looks: &Looks) -> Option<Self> {
        let found = records.iter().filter(|record| record.light > 0.0);
        let found_count = found.clone().count();
        if found.clone().filter(|record| record.kind == Kind::Sky).count() < RECORDS_MIN {
            return None;
        }
        let low = found.clone().fold(Vec3::INFINITY, |low, record| low.min(record.position));
        let high = found.fold(Vec3::NEG_INFINITY, |high, record| high.max(record.position));
        let size = (high - low).max(Vec3::splat((high - low).max_element() * 1e-3 + f32::MIN_POSITIVE));
        let count = (found_count as f32 / RECORDS_PER_CELL).clamp(1.0, CELLS_MAX);
        let edge = (size.x * size.y * size.z / count).cbrt();
        let cells = (size / edge).round().clamp(Vec3::ONE, Vec3::splat(64.0)).as_uvec3();
        let scale = cells.as_vec3() / size;
        let mut guide =
            Self { low, scale, cells, of_cell: Vec::new(), distributions: Vec::new(), shares: Vec::new() };
        let count = (cells.x * cells.y * cells.z) as usize;
        let mut by_cell: Vec<Vec<&LightRecord>> = vec![Vec::new(); count];
        for record in records {
            by_cell[guide.cell(record.position)].push(record);
        }
        let common = histogram(records);
        guide.distributions.push(Distribution::new(&common)?);
        guide.shares.push(shares(records, looks));
        guide.of_cell = by_cell
            .iter()
            .map(|records| {
                if records.iter().filter(|record| record.light > 0.0).count() < RECORDS_MIN {
                    return 0;
                }
                let weights = mixed(&histogram(records.iter().copied()), &common);
                Distribution::new(&weights).map_or(0, |own| {
                    guide.distributions.push(own);
                    guide.shares.push(shares(records.iter().copied(), looks));
                    guide.distributions.len() as u32 - 1
                })
            })
            .collect();
        // What sends all shadow rays to one kind of light, or none, is better left to the constants.
        let is_of_use = |[sky, sun, lamp]: &Shares| *sky > 0.0 || (looks.used && *sun > 0.0 && *lamp > 0.0);
        guide.shares.iter().any(is_of_use).then_some(guide)
    }

    #[inline]
    fn cell(&self, position: Vec3) -> usize {
        let last = (self.cells - UVec3::ONE).as_vec3();
        let [x, y, z] = ((position - self.low) * self.scale).clamp(Vec3::ZERO, last).as_uvec3().to_array();
        ((z * self.cells.y + y) * self.cells.x + x) as usize
    }

    #[inline]
    pub(super) fn shares(&self, position: Vec3) -> Shares {
        self.shares[self.of_cell[self.cell(position)] as usize]
    }

    #[inline]
    fn distribution(&self, position: Vec3) -> &Distribution {
        &self.distributions[self.of_cell[self.cell(position)] as usize]
    }

    /// Draws a direction from a position: with its density over solid angle.
    #[inline]
    pub(super) fn sample(&self, position: Vec3, pick: f32, [u, v]: [f32; 2]) -> (Vec3, f32) {
        let distribution = self.distribution(position);
        let bin = distribution.table.sample(pick);
        let azimuth = ((bin % AROUND) as f32 + u) / AROUND as f32 * TAU - PI;
        let height = ((bin / AROUND) as f32 + v) / HEIGHTS as f32 * 2.0 - 1.0;
        let across = (1.0 - height * height).max(0.0).sqrt();
        let (sine, cosine) = azimuth.sin_cos();
        (Vec3::new(across * cosine, height, across * sine), distribution.densities[bin])
    }

    #[inline]
    pub(super) fn density(&self, position: Vec3, direction: Vec3) -> f32 {
        self.distribution(position).densities[bin(direction)]
    }
}

#[inline]
fn bin(direction: Vec3) -> usize {
    let around = (direction.z.atan2(direction.x) + PI) * (AROUND as f32 / TAU);
    let height = (direction.y + 1.0) * (0.5 * HEIGHTS as f32);
    (height as usize).min(HEIGHTS - 1) * AROUND + (around as usize).min(AROUND - 1)
}

/// Light by bin, some of it spread to the neighbours.
fn histogram<'a>(records: impl IntoIterator<Item = &'a LightRecord>) -> Vec<f64> {
    let mut sums = vec![0.0; BINS];
    for record in records.into_iter().filter(|record| record.kind == Kind::Sky) {
        sums[bin(record.direction)] += f64::from(record.light);
    }
    let mut spread: Vec<f64> = sums.iter().map(|sum| sum * (1.0 - SPREAD)).collect();
    for (place, sum) in sums.iter().enumerate().filter(|(_, sum)| **sum > 0.0) {
        let (column, row) = (place % AROUND, place / AROUND);
        for (across, up) in [0, 1, 2].into_iter().flat_map(|across| [0, 1, 2].map(|up| (across, up))) {
            let row = (row + up).saturating_sub(1).min(HEIGHTS - 1);
            if (across, up) != (1, 1) {
                spread[row * AROUND + (column + across + AROUND - 1) % AROUND] += sum * SPREAD / 8.0;
            }
        }
    }
    spread
}

fn mixed(own: &[f64], common: &[f64]) -> Vec<f64> {
    let (own_sum, common_sum): (f64, f64) = (own.iter().sum(), common.iter().sum());
    if own_sum <= 0.0 {
        return common.to_vec();
    }
    let (own_share, common_share) = ((1.0 - COMMON_SHARE) / own_sum, COMMON_SHARE / common_sum);
    own.iter().zip(common).map(|(own, common)| own * own_share + common * common_share).collect()
}

/// Shadow rays for each kind of light, so that the variance becomes small; none at all where the sky alone
/// shines and bounces find it.
///
/// Let one sample estimate a sum, whose terms it draws with shares. Its variance is least with shares by the
/// root mean squares of the terms. So it is with a kind that only shadow rays find. The sky is found by
/// bounces, too. Let *m* be its mean, and *m² / r* the mean square of what bounces find: *r* is one where all
/// of them find an equal light. With a share *s* of shadow rays, drawn by the light, the mean square becomes
/// about *m² / (r + s)*. Then the sum is best with a weight of *m* for the sky, and *r* less than its share.
fn shares<'a>(records: impl IntoIterator<Item = &'a LightRecord>, looks: &Looks) -> Shares {
    let (mut sums, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
    let (mut count, mut carried, mut seen) = (0.0, 0.0, 0.0);
    for record in records {
        let (light, throughput) = (f64::from(record.light), f64::from(record.throughput));
        sums[record.kind as usize] += light;
        squares[record.kind as usize] += light.min(LIGHT_MAX).powi(2);
        if record.kind == Kind::Sky {
            count += f64::from(record.bounces);
            carried += throughput * f64::from(record.bounces);
            seen += light * light / throughput;
        }
    }
    let [sky, sun, lamp] = sums;
    if looks.map {
        // Without a sun, light that shadow rays found at infinity came from the map.
        let sums = if looks.there[1] { sums } else { [sky + sun, 0.0, lamp] };
        return with_least(sums, looks, 0.0);
    }
    let found = if seen > 0.0 { sky * sky / (carried * seen) } else { 0.0 };
    let root = |kind: Kind| {
        let drawn = f64::from(looks.shares[kind as usize]);
        (drawn * squares[kind as usize] * f64::max(count, 1.0)).sqrt()
    };
    let roots = [sky, root(Kind::Sun), root(Kind::Lamp)];
    if !(looks.there[Kind::Sun as usize] || looks.there[Kind::Lamp as usize]) {
        return [f32::from(u8::from(found < FOUND_MAX)), 0.0, 0.0];
    }
    with_least(roots, looks, LOSS * found)
}

/// Shares by weights with a least share of each kind that there is, and none of the others; they add up to
/// one. Bounces stand for a share `found` of the sky's.
fn with_least(weights: [f64; 3], looks: &Looks, found: f64) -> Shares {
    let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut all = weights.map(|weight| weight / total);
    let wanted = (1.0 + found) * all[0] - found;
    all[0] = if wanted < f64::from(SHARE_MIN) { 0.0 } else { wanted };
    let rest = (all[1] + all[2]).max(f64::MIN_POSITIVE);
    let others = [1, 2].map(|kind| all[kind] * (1.0 - all[0]) / rest);
    (all[1], all[2]) = (others[0], others[1]);
    let least = [if looks.map { SHARE_MIN } else { 0.0 }, SHARE_MIN, SHARE_MIN];
    let all = [0, 1, 2].map(|kind| if looks.there[kind] { (all[kind] as f32).max(least[kind]) } else { 0.0 });
    let sum: f32 = all.iter().sum();
    all.map(|share| share / sum.max(f32::MIN_POSITIVE))
}

impl Distribution {
    fn new(weights: &[f64]) -> Option<Self> {
        let table = AliasTable::new(weights)?;
        let total: f64 = weights.iter().sum();
        let densities = weights.iter().map(|weight| (weight / total) as f32 * BIN_DENSITY).collect();
        Some(Self { table, densities })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn densities_are_those_of_the_draws_and_add_up_to_one() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut unit = || random.random::<f32>();
        // Two windows, each seen from its own half of a room.
        let records: Vec<LightRecord> = (0..4000)
            .map(|_| {
                let position = Vec3::new(unit() * 8.0 - 4.0, unit() * 3.0, unit() * 6.0);
                let side = position.x.signum();
                let direction = Vec3::new(side, 0.3 * unit(), 0.2 * unit()).normalize();
                LightRecord {
                    position,
                    direction,
                    light: unit(),
                    throughput: 1.0,
                    bounces: 1,
                    kind: Kind::Sky,
                }
            })
            .collect();
        let looks = Looks { shares: [0.0, 0.5, 0.5], there: [true; 3], map: false, used: true };
        let guide = SkyGuide::new(&records, &looks).expect("there are enough");
        assert!(guide.shares.iter().all(|[sky, sun, lamp]| *sky > 0.8 && sun + lamp < 0.2));
        for position in [Vec3::new(-3.0, 1.0, 2.0), Vec3::new(3.0, 1.0, 2.0), Vec3::splat(100.0)] {
            let (mut wrong, mut own) = (0, 0);
            for _ in 0..20_000 {
                let (direction, density) = guide.sample(position, unit(), [unit(), unit()]);
                assert!((direction.length() - 1.0).abs() < 1e-4 && density > 0.0);
                // Rounding may move what lies on a bin's edge.
                wrong += u32::from((guide.density(position, direction) / density - 1.0).abs() > 1e-4);
                own += u32::from(direction.x.signum() == position.x.signum());
            }
            assert!(wrong < 20, "{wrong}");
            assert!(own > 17_000, "nearly all to the window of their half: {own}");
        }
        let sum: f32 = guide.distributions[0].densities.iter().map(|density| density / BIN_DENSITY).sum();
        assert!((sum - 1.0).abs() < 1e-4);
        assert!(SkyGuide::new(&records[..8], &looks).is_none());
    }

    fn record(kind: Kind, light: f32) -> LightRecord {
        let bounces = u32::from(kind == Kind::Sky);
        LightRecord { position: Vec3::ZERO, direction: Vec3::Y, light, throughput: 1.0, bounces, kind }
    }

    /// What a hundred bounces brought, some of which found the sky, and as many shadow rays that went to sun
    /// and lamps in turn.
    fn of_hundred(sky: (usize, f32), sun: f32, lamp: (usize, f32)) -> Vec<LightRecord> {
        let every = |at: usize, (of, light): (usize, f32)| if at.is_multiple_of(of) { light } else { 0.0 };
        (0..100)
            .flat_map(|at| {
                let bounce = record(Kind::Sky, every(at, sky));
                let half = if at % 2 == 0 {
                    record(Kind::Sun, sun)
                } else {
                    record(Kind::Lamp, every(at / 2, lamp))
                };
                [bounce, half]
            })
            .collect()
    }

    #[test]
    fn shadow_rays_go_where_they_lessen_the_variance() {
        let half = [0.0, 0.5, 0.5];
        let all = Looks { shares: half, there: [true; 3], map: false, used: true };
        let share = |records: &[LightRecord], looks: &Looks| shares(records, looks);

        // As much light of each kind. Each bounce finds the sky, each shadow ray the sun, one in ten a lamp.
        let [sky, sun, lamp] = share(&of_hundred((1, 0.1), 0.2, (10, 2.0)), &all);
        assert!(sky == 0.0 && lamp / sun > 2.5 && lamp / sun < 3.8, "{sky} {sun} {lamp}");
        // One bounce in twenty finds it, through a window.
        let [sky, sun, _] = share(&of_hundred((20, 2.0), 0.2, (1, 0.0)), &all);
        assert!((sky - sun).abs() < 0.1, "{sky} {sun}");

        // Nothing but the sky: it is looked for behind windows only.
        let alone = Looks { shares: [0.0; 3], there: [true, false, false], map: false, used: true };
        assert_eq!(share(&of_hundred((20, 20.0), 0.0, (1, 0.0)), &alone), [1.0, 0.0, 0.0]);
        let open = of_hundred((1, 1.0), 0.0, (1, 0.0));
        assert_eq!(share(&open, &alone), [0.0; 3]);
        assert!(SkyGuide::new(&open, &alone).is_none());
        // A map is always looked for: bounces may never meet its sun.
        assert_eq!(share(&open, &Looks { map: true, ..alone }), [1.0, 0.0, 0.0]);
    }
}
