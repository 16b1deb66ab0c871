//! All solutions of some constraints, where they are few, and the nearest of them to a point.
//!
//! They form a tree with one level for each parameter, so that solutions with equal first values share them.
//! A walk over it takes the nearest values first and skips branches that are already further away than the
//! best.

use crate::configuration::Configuration;
use crate::limits::{ENUMERATED_MAX, LISTED_MAX, LISTING_STEPS_MAX, REPAIR_STEPS_MAX};
use crate::space::partial::Partial;
use crate::space::{Domain, Space};
use crate::value::Value;

/// The solutions of the constraints among some parameters.
#[derive(Debug)]
pub(super) struct Listing {
    members: Vec<usize>,
    /// The values of each parameter.
    values: Vec<Vec<Value>>,
    /// For each parameter the branches of its level; branches of one parent are next to each other.
    levels: Vec<Vec<Branch>>,
}

#[derive(Clone, Copy, Debug)]
struct Branch {
    /// The index of the value; [`INACTIVE`] where the parameter is inactive.
    value: u32,
    /// The index of its first continuation in the next level. Its continuations end at the first one of the
    /// next branch.
    first: u32,
}

const INACTIVE: u32 = u32::MAX;

impl Domain {
    /// Every value in order, where there are at most `most`.
    pub(super) fn values(&self, most: usize) -> Option<Vec<Value>> {
        match self {
            Domain::Boolean => Some([false, true].map(Value::Boolean).to_vec()),
            Domain::Categorical { values } => Some(values.clone()),
            Domain::Integer { min, max, .. } if max.abs_diff(*min) < most as u64 => {
                Some((*min..=*max).map(Value::Integer).collect())
            }
            Domain::Float { min, max, .. } if min == max => Some(vec![Value::Float(*min)]),
            Domain::Integer { .. } | Domain::Float { .. } => None,
        }
    }
}

impl Space {
    /// Every configuration, where there are at most [`ENUMERATED_MAX`]; `None` where there are more, or where
    /// it takes too long to count them.
    pub fn enumerate(&self) -> Option<Vec<Configuration>> {
        let all: Vec<usize> = (0..self.dimension()).collect();
        let listing = Listing::of(self, &all, ENUMERATED_MAX, LISTING_STEPS_MAX)?;
        let mut found = Vec::new();
        let mut values: Vec<Value> = self.defaults().cloned().collect();
        listing.each(0, 0..listing.levels[0].len(), &mut values, &mut |values| {
            found.push(self.collect(values, &self.active(values)));
        });
        Some(found)
    }
}

impl Listing {
    /// Lists the solutions of all constraints among `members`, which include every parameter that decides
    /// whether a member is active. `None` where there are more than `most`, or where it takes more than
    /// `steps` steps.
    pub(super) fn of(space: &Space, members: &[usize], most: usize, steps: usize) -> Option<Self> {
        let values_max = if space.rules.is_empty() { most } else { LISTED_MAX };
        let domains = members.iter().map(|&member| &space.parameters[member].domain);
        let mut listing = Listing {
            members: members.to_vec(),
            values: domains.map(|domain| domain.values(values_max)).collect::<Option<_>>()?,
            levels: vec![Vec::new(); members.len()],
        };
        listing.extend(0, most, &mut Partial::new(space, steps)).then_some(listing)
    }

    /// Adds all continuations of the values that are set; `false` where there are too many.
    fn extend(&mut self, depth: usize, most: usize, partial: &mut Partial<'_>) -> bool {
        let Some(&member) = self.members.get(depth) else { return true };
        let is_last = depth + 1 == self.members.len();
        let is_active = partial.is_active(member);
        let values = if is_active { self.values[depth].len() } else { 1 };
        for index in 0..values {
            let default = &partial.space.parameters[member].default;
            let value = if is_active { &self.values[depth][index] } else { default };
            if partial.set(member, value, is_active) {
                let first = self.levels.get(depth + 1).map_or(0, Vec::len);
                if !self.extend(depth + 1, most, partial) {
                    return false;
                }
                let grows = is_last || self.levels[depth + 1].len() > first;
                if grows {
                    let value = if is_active { index as u32 } else { INACTIVE };
                    self.levels[depth].push(Branch { value, first: first as u32 });
                }
            }
            partial.unset(member);
            if partial.steps == 0 || is_last && self.levels[depth].len() > most {
                return false;
            }
        }
        true
    }

    /// The branches that follow one.
    fn following(&self, depth: usize, branch: usize) -> std::ops::Range<usize> {
        let Some(next) = self.levels.get(depth + 1) else { return 0..0 };
        let level = &self.levels[depth];
        let end = level.get(branch + 1).map_or(next.len(), |after| after.first as usize);
        level[branch].first as usize..end
    }

    /// Calls `take` with all values, once for each solution.
    fn each(
        &self,
        depth: usize,
        branches: std::ops::Range<usize>,
        values: &mut [Value],
        take: &mut impl FnMut(&[Value]),
    ) {
        for branch in branches {
            let index = self.levels[depth][branch].value;
            if index != INACTIVE {
                values[self.members[depth]].clone_from(&self.values[depth][index as usize]);
            }
            match depth + 1 == self.members.len() {
                true => take(values),
                false => self.each(depth + 1, self.following(depth, branch), values, take),
            }
        }
    }

    /// The values of the members that are nearest to those wanted, the first of equals: exactly, unless more
    /// than [`REPAIR_STEPS_MAX`] values are tried in vain. Inactive ones are left as they are.
    pub(super) fn nearest(&self, space: &Space, wanted: &mut [Value]) -> bool {
        let distances = self.members.iter().zip(&self.values);
        let distances = distances.map(|(&member, values)| {
            let domain = &space.parameters[member].domain;
            values.iter().map(|value| domain.distance(&wanted[member], value)).collect()
        });
        let (distances, path) = (distances.collect(), Vec::new());
        let mut walk = Walk { listing: self, distances, path, best: None, steps: REPAIR_STEPS_MAX };
        walk.descend(0, 0..self.levels[0].len(), 0.0);
        let Some((_, path)) = walk.best else { return false };
        for (depth, index) in path.into_iter().enumerate().filter(|(_, index)| *index != INACTIVE) {
            wanted[self.members[depth]].clone_from(&self.values[depth][index as usize]);
        }
        true
    }
}

struct Walk<'a> {
    listing: &'a Listing,
    /// The distance of each value of each parameter to the wanted one, squared.
    distances: Vec<Vec<f64>>,
    path: Vec<u32>,
    best: Option<(f64, Vec<u32>)>,
    steps: usize,
}

impl Walk<'_> {
    fn descend(&mut self, depth: usize, branches: std::ops::Range<usize>, sum: f64) {
        let listing = self.listing;
        if depth == listing.members.len() {
            self.best = Some((sum, self.path.clone()));
            self.steps = REPAIR_STEPS_MAX;
            return;
        }
        let distance = |branch: usize| match listing.levels[depth][branch].value {
            INACTIVE => 0.0,
            value => self.distances[depth][value as usize],
        };
        let mut nearest: Vec<(f64, usize)> = branches.map(|branch| (distance(branch), branch)).collect();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (distance, branch) in nearest {
            let is_worse = self.best.as_ref().is_some_and(|(best, _)| sum + distance >= *best);
            if is_worse || self.steps == 0 {
                return;
            }
            self.steps -= usize::from(self.best.is_some());
            self.path.push(listing.levels[depth][branch].value);
            self.descend(depth + 1, listing.following(depth, branch), sum + distance);
            self.path.pop();
        }
    }
}
