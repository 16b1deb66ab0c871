//! Repair of values that break constraints, to the nearest ones that fulfil them.
//!
//! Near means a small sum of squares of the differences along each parameter's scale; texts without an order
//! are all equally far apart. Where the solutions of a group of parameters are listed, the nearest is found
//! among them. Elsewhere values near the wanted ones are tried, one parameter after the other. A constraint
//! ends a branch as soon as it cannot hold any more, and so does a distance beyond the best. The search
//! begins with the defaults, which fulfil every constraint.

use crate::limits::{ENUMERATED_MAX, REPAIR_PATIENCE, REPAIR_STEPS_MAX};
use crate::space::group::Group;
use crate::space::partial::Partial;
use crate::space::{Domain, Space};
use crate::value::Value;

/// Squared distance between two texts without an order, as between `false` and `true`.
const APART: f64 = 0.25;
/// Number of values at equal steps along the scale that are tried in a domain of more than
/// [`ENUMERATED_MAX`].
const GRID: usize = 32;
/// Number of whole numbers that are tried on each side of the wanted one.
const AROUND: i64 = 32;
/// Halvings of the way from a found value to the wanted one.
const HALVINGS: usize = 32;

impl Domain {
    /// The squared distance of two values; along the whole domain it is 1.
    pub(super) fn distance(&self, one: &Value, other: &Value) -> f64 {
        match (self.place(one), self.place(other)) {
            (Some(one), Some(other)) => (one - other) * (one - other),
            _ if one == other => 0.0,
            _ => APART,
        }
    }

    /// The place of a value along the domain, 0 to 1, if it has an order.
    fn place(&self, value: &Value) -> Option<f64> {
        let Domain::Categorical { values } = self else { return Some(self.encode(value)) };
        let number = value.as_number()?;
        let less = values.iter().filter(|other| other.as_number() < Some(number)).count();
        Some((less as f64 + 0.5) / values.len() as f64)
    }

    /// Values to try in place of the wanted one, the nearest first, and the wanted one before all.
    fn candidates(&self, wanted: &Value, default: &Value) -> Vec<(f64, Value)> {
        let mut values = self.values(ENUMERATED_MAX).unwrap_or_else(|| {
            let along = (0..=GRID).map(|step| self.decode(step as f64 / GRID as f64));
            let around = match wanted {
                Value::Integer(integer) => Some(integer - AROUND..=integer + AROUND),
                _ => None,
            };
            let around =
                around.into_iter().flatten().map(Value::Integer).filter(|value| self.contains(value));
            along.chain(around).chain([wanted.clone(), default.clone()]).collect()
        });
        values.sort();
        values.dedup();
        let mut near: Vec<(f64, Value)> =
            values.into_iter().map(|value| (self.distance(wanted, &value), value)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near
    }
}

/// A search for values of a group's members.
struct Hunt<'a> {
    group: &'a Group,
    partial: Partial<'a>,
    /// The values to try for each member, with their distances.
    candidates: Vec<Vec<(f64, Value)>>,
    /// The best values so far, with their distance.
    best: Option<(f64, Vec<Value>)>,
}

impl Space {
    /// Moves values of all parameters to the nearest that fulfil all constraints. `true` in the end.
    pub(super) fn move_to_nearest(&self, values: &mut [Value]) -> bool {
        self.fold(values, &self.active(values));
        for group in self.groups.iter() {
            if !group.is_broken(self, values, &self.active(values)) {
                continue;
            }
            if let Some(listing) = group.listing(self) {
                listing.nearest(self, values);
                continue;
            }
            let wanted = values.to_vec();
            let mut hunt = Hunt::new(self, group, values, |_| false);
            let defaults: Vec<Value> = self.defaults().cloned().collect();
            let of_member =
                |&member: &usize| self.parameters[member].domain.distance(&wanted[member], &defaults[member]);
            hunt.best = Some((group.members.iter().map(of_member).sum(), defaults));
            hunt.descend(0, 0.0);
            if let Some((_, found)) = hunt.best {
                group.members.iter().for_each(|&member| values[member].clone_from(&found[member]));
                self.approach(group, values, &wanted);
            }
        }
        true
    }

    /// Moves values that are not `fixed` so that all constraints hold. `false` where none were found.
    pub(super) fn move_around(&self, values: &mut [Value], fixed: impl Fn(usize) -> bool) -> bool {
        for group in self.groups.iter() {
            if !group.is_broken(self, values, &self.active(values)) {
                continue;
            }
            let mut hunt = Hunt::new(self, group, values, &fixed);
            hunt.descend(0, 0.0);
            let Some((_, found)) = hunt.best else { return false };
            group.members.iter().for_each(|&member| values[member].clone_from(&found[member]));
        }
        true
    }

    /// Brings the numbers that were moved closer to the wanted ones, one after the other, as far as the
    /// constraints allow.
    fn approach(&self, group: &Group, values: &mut [Value], wanted: &[Value]) {
        for &member in &group.members {
            let domain = &self.parameters[member].domain;
            if domain.bounds().is_none() || values[member] == wanted[member] {
                continue;
            }
            let (mut fulfilled, mut broken) =
                (domain.encode(&values[member]), domain.encode(&wanted[member]));
            for _ in 0..HALVINGS {
                let middle = 0.5 * (fulfilled + broken);
                let before = std::mem::replace(&mut values[member], domain.decode(middle));
                if group.is_broken(self, values, &self.active(values)) {
                    values[member] = before;
                    broken = middle;
                } else {
                    fulfilled = middle;
                }
            }
        }
    }
}

impl<'a> Hunt<'a> {
    fn new(space: &'a Space, group: &'a Group, wanted: &[Value], fixed: impl Fn(usize) -> bool) -> Self {
        let candidates = group.members.iter().map(|&member| {
            let parameter = &space.parameters[member];
            match fixed(member) {
                true => vec![(0.0, wanted[member].clone())],
                false => parameter.domain.candidates(&wanted[member], &parameter.default),
            }
        });
        let partial = Partial::new(space, REPAIR_STEPS_MAX);
        Hunt { group, partial, candidates: candidates.collect(), best: None }
    }

    fn descend(&mut self, depth: usize, sum: f64) {
        let Some(&member) = self.group.members.get(depth) else {
            self.best = Some((sum, self.partial.values.clone()));
            self.partial.steps = REPAIR_PATIENCE;
            return;
        };
        let is_active = self.partial.is_active(member);
        for index in 0..self.candidates[depth].len() {
            let (distance, value) = &self.candidates[depth][index];
            // The value of an inactive parameter does not matter.
            let distance = if is_active { *distance } else { 0.0 };
            let is_worse = self.best.as_ref().is_some_and(|(best, _)| sum + distance >= *best);
            if is_worse || self.partial.steps == 0 {
                break;
            }
            if self.partial.set(member, value, is_active) {
                self.descend(depth + 1, sum + distance);
            }
            if !is_active {
                break;
            }
        }
        self.partial.unset(member);
    }
}
