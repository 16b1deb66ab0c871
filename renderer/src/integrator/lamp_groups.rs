//! Emissive triangles in groups of neighbours: what is learnt of a lantern holds for all its triangles.

use std::{cmp::Reverse, collections::BinaryHeap, ops::Range};

use glam::Vec3;

use super::lamp::Lamp;
use crate::limits::LAMP_GROUPS_MAX;

/// Emissive triangles in groups, within which they are drawn by power.
#[derive(Clone, Debug)]
pub(super) struct LampGroups {
    members: Vec<u32>,
    /// Of each member: the share of its group's power that it has together with those before it.
    shares: Vec<f32>,
    of_lamp: Vec<u32>,
    groups: Vec<LampGroup>,
}

/// Emissive triangles that lie close together.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampGroup {
    /// Its first member, and the one after its last.
    first: u32,
    end: u32,
    /// Middle of its box, and half the diagonal.
    middle: Vec3,
    radius: f32,
    /// Its share of the power of all; above 0.
    pub(super) power: f32,
}

/// A range of members that may be split. The greatest is split first: much power, far apart.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Part {
    /// The bits of power times width, which are in the order of these numbers.
    worth: u64,
    first: Reverse<usize>,
    end: usize,
}

impl Part {
    fn new(range: Range<usize>, members: &[u32], lamps: &[Lamp], powers: &[f64]) -> Self {
        let members = &members[range.clone()];
        let [low, high] = bounds(members.iter().map(|&lamp| middle(&lamps[lamp as usize])));
        let power: f64 = members.iter().map(|&lamp| powers[lamp as usize]).sum();
        let worth = (power * f64::from((high - low).length())).to_bits();
        Self { worth, first: Reverse(range.start), end: range.end }
    }

    fn range(&self) -> Range<usize> {
        self.first.0..self.end
    }
}

fn middle(lamp: &Lamp) -> Vec3 {
    lamp.corner + (lamp.edges[0] + lamp.edges[1]) / 3.0
}

fn bounds(points: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    let nothing = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points.fold(nothing, |[low, high], point| [low.min(point), high.max(point)])
}

/// Sorts a range of members into two halves by place: where the second begins. `None` if all lie together.
fn split(range: &Range<usize>, members: &mut [u32], lamps: &[Lamp]) -> Option<usize> {
    let members = &mut members[range.clone()];
    let [low, high] = bounds(members.iter().map(|&lamp| middle(&lamps[lamp as usize])));
    let axis = (high - low).max_position();
    let half = 0.5 * (low[axis] + high[axis]);
    let (near, far): (Vec<u32>, Vec<u32>) =
        members.iter().copied().partition(|&lamp| middle(&lamps[lamp as usize])[axis] < half);
    if near.is_empty() || far.is_empty() {
        return None;
    }
    members[..near.len()].copy_from_slice(&near);
    members[near.len()..].copy_from_slice(&far);
    Some(range.start + near.len())
}

impl LampGroups {
    /// Groups of lamps of these powers, at most [`LAMP_GROUPS_MAX`], mostly in O(lamps × log(groups)).
    pub(super) fn new(lamps: &[Lamp], powers: &[f64]) -> Self {
        let mut members: Vec<u32> = (0..lamps.len() as u32).collect();
        let mut open = BinaryHeap::from([Part::new(0..members.len(), &members, lamps, powers)]);
        let mut ranges = Vec::new();
        while open.len() + ranges.len() < LAMP_GROUPS_MAX
            && let Some(part) = open.pop()
        {
            let range = part.range();
            match split(&range, &mut members, lamps) {
                Some(second) => {
                    open.push(Part::new(range.start..second, &members, lamps, powers));
                    open.push(Part::new(second..range.end, &members, lamps, powers));
                }
                None => ranges.push(range),
            }
        }
        ranges.extend(open.iter().map(Part::range));
        ranges.sort_unstable_by_key(|range| range.start);
        let shares = Vec::with_capacity(members.len());
        let mut all = Self { members, shares, of_lamp: vec![0; lamps.len()], groups: Vec::new() };
        let total: f64 = powers.iter().sum();
        for range in ranges {
            all.close(range, lamps, powers, total);
        }
        all
    }

    /// Makes a group of the next range of members.
    fn close(&mut self, range: Range<usize>, lamps: &[Lamp], powers: &[f64], total: f64) {
        let members = &self.members[range.clone()];
        let power: f64 = members.iter().map(|&lamp| powers[lamp as usize]).sum();
        let mut sum = 0.0;
        for &lamp in members {
            sum += powers[lamp as usize];
            self.shares.push((sum / power) as f32);
            self.of_lamp[lamp as usize] = self.groups.len() as u32;
        }
        let corners = members.iter().flat_map(|&lamp| {
            let Lamp { corner, edges: [ab, ac], .. } = lamps[lamp as usize];
            [corner, corner + ab, corner + ac]
        });
        let [low, high] = bounds(corners);
        self.groups.push(LampGroup {
            first: range.start as u32,
            end: range.end as u32,
            middle: 0.5 * (low + high),
            radius: (0.5 * (high - low).length()).max(1e-15),
            power: ((power / total) as f32).max(f32::MIN_POSITIVE),
        });
    }

    pub(super) fn all(&self) -> &[LampGroup] {
        &self.groups
    }

    #[inline]
    pub(super) fn of(&self, lamp: usize) -> u32 {
        self.of_lamp[lamp]
    }

    /// A triangle of a group, drawn by power with a number in [0, 1).
    #[inline]
    pub(super) fn draw(&self, group: u32, u: f32) -> usize {
        let LampGroup { first, end, .. } = self.groups[group as usize];
        let shares = &self.shares[first as usize..end as usize];
        let place = shares.partition_point(|share| *share <= u).min(shares.len() - 1);
        self.members[first as usize + place] as usize
    }
}

impl LampGroup {
    /// Its unshadowed light at a surface, for a power of 1 of all groups and as if it shone evenly.
    #[inline]
    pub(super) fn reach(&self, position: Vec3, normal: Vec3) -> f32 {
        let offset = self.middle - position;
        let square = offset.length_squared().max(self.radius * self.radius);
        let cosine = (normal.dot(offset) + self.radius) / square.sqrt();
        0.5 * self.power * cosine.clamp(0.0, 1.0) / square
    }

    /// The largest reach of a point of it that counts: places that all but touch a lamp stand for no others.
    pub(super) fn reach_max(&self) -> f32 {
        1.0 / (self.radius * self.radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lanterns a metre apart, each of ten triangles within some centimetres.
    fn lanterns(count: usize) -> (Vec<Lamp>, Vec<f64>) {
        let lamps = (0..count * 10).map(|number| {
            let (lantern, triangle) = (number / 10, number % 10);
            let foot = Vec3::new((lantern % 20) as f32, 2.0, (lantern / 20) as f32);
            let corner = foot + Vec3::new(0.01, 0.004, -0.007) * triangle as f32;
            let edges = [Vec3::X * 0.02, Vec3::Z * 0.03];
            Lamp { corner, edges, normal: Vec3::NEG_Y, emission: Vec3::ONE, density: 1.0 }
        });
        let powers = (0..count * 10).map(|number| 1.0 + (number * 7 % 5) as f64);
        (lamps.collect(), powers.collect())
    }

    #[test]
    fn a_group_lies_within_a_lantern_and_every_lamp_has_one() {
        let (lamps, powers) = lanterns(300);
        let groups = LampGroups::new(&lamps, &powers);
        assert!(groups.all().len() <= LAMP_GROUPS_MAX && groups.all().len() >= 300);
        let mut met = vec![0; lamps.len()];
        for (number, group) in groups.all().iter().enumerate() {
            assert!(group.radius < 0.2, "{group:?}");
            for &lamp in &groups.members[group.first as usize..group.end as usize] {
                met[lamp as usize] += 1;
                assert_eq!(groups.of(lamp as usize) as usize, number);
                assert_eq!(lamp / 10, groups.members[group.first as usize] / 10, "one lantern");
            }
        }
        assert!(met.iter().all(|count| *count == 1));
        let power: f32 = groups.all().iter().map(|group| group.power).sum();
        assert!((power - 1.0).abs() < 1e-4, "{power}");
    }

    #[test]
    fn lamps_of_a_group_are_drawn_by_power() {
        // All in one place: one group, whatever the limit.
        let (mut lamps, powers) = lanterns(1);
        let first = lamps[0];
        lamps.fill(first);
        let groups = LampGroups::new(&lamps, &powers);
        assert_eq!(groups.all().len(), 1);
        let (mut counts, draws) = ([0_u32; 10], 90_000);
        for draw in 0..draws {
            counts[groups.draw(0, draw as f32 / draws as f32)] += 1;
        }
        let total: f64 = powers.iter().sum();
        for (count, power) in counts.iter().zip(&powers) {
            let expected = f64::from(draws) * power / total;
            assert!((f64::from(*count) - expected).abs() < 20.0, "{counts:?}");
        }
    }
}
