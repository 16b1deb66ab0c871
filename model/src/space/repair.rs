//! Repair of points of the cube that break constraints `lesser <= greater`, where there are no others.
//!
//! First the two values are swapped where both domains allow it. This folds the cube along the diagonal, so
//! uniform points stay uniform over the allowed triangle and the map stays continuous. Clamping would put
//! many samples onto the edge. Narrowing bounds removes the remaining violations.

use crate::space::{Domain, Space};
use crate::value::Value;

impl Space {
    /// Repairs `values` for this set of active parameters. `false` when no values fulfil the constraints
    /// among them.
    pub(super) fn repair(&self, values: &mut [Value], active: &[bool]) -> bool {
        self.fold(values, active)
            || self.violations(values, active).next().is_none()
            || self.narrow(values, active)
    }

    /// Swaps the values of broken orders. `true` when no order is broken any more.
    pub(super) fn fold(&self, values: &mut [Value], active: &[bool]) -> bool {
        // Bubble sort along the constraints: as many rounds as there are parameters sort any chain.
        for _ in 0..self.parameters.len() {
            let broken: Vec<usize> = self.violations(values, active).collect();
            if broken.is_empty() {
                return true;
            }
            for order in broken.into_iter().filter_map(|index| self.rules[index].order) {
                self.swap_if_possible(values, order);
            }
        }
        false
    }

    fn swap_if_possible(&self, values: &mut [Value], (lesser, greater): (usize, usize)) {
        let still_broken = values[lesser].as_number() > values[greater].as_number();
        let fits = self.parameters[lesser].domain.contains(&values[greater])
            && self.parameters[greater].domain.contains(&values[lesser]);
        if still_broken && fits {
            values.swap(lesser, greater);
        }
    }

    /// Bounds consistency: every parameter gets the range that the constraints leave it, is clamped into
    /// it in the order of listing, and narrows the ranges of the others. Because all constraints are
    /// `<=`, ranges that are consistent can always be filled in (each at its lower bound).
    fn narrow(&self, values: &mut [Value], active: &[bool]) -> bool {
        let mut ranges: Vec<(f64, f64)> =
            self.parameters.iter().map(|parameter| parameter.domain.bounds().unwrap_or((0.0, 0.0))).collect();
        if !self.propagate(&mut ranges, active) {
            return false;
        }
        for index in 0..values.len() {
            let (low, high) = ranges[index];
            let clamped = match &values[index] {
                Value::Integer(integer) if self.is_numeric(index) => {
                    Value::Integer((*integer).clamp(low as i64, high as i64))
                }
                Value::Float(float) if self.is_numeric(index) => Value::Float(float.clamp(low, high)),
                _ => continue,
            };
            if !active[index] {
                continue;
            }
            if let Some(number) = clamped.as_number() {
                ranges[index] = (number, number);
            }
            values[index] = clamped;
            if !self.propagate(&mut ranges, active) {
                return false;
            }
        }
        true
    }

    fn is_numeric(&self, index: usize) -> bool {
        self.parameters[index].domain.bounds().is_some()
    }

    /// Carries lower bounds up and upper bounds down along the constraints until no bound moves. `false` when
    /// a range became empty.
    fn propagate(&self, ranges: &mut [(f64, f64)], active: &[bool]) -> bool {
        let whole = |index: usize| matches!(self.parameters[index].domain, Domain::Integer { .. });
        loop {
            let mut moved = false;
            let orders = self.rules.iter().filter_map(|rule| rule.order);
            for (lesser, greater) in orders.filter(|(a, b)| active[*a] && active[*b]) {
                let low = ranges[lesser].0;
                let low = if whole(greater) { low.ceil() } else { low };
                if low > ranges[greater].0 {
                    ranges[greater].0 = low;
                    moved = true;
                }
                let high = ranges[greater].1;
                let high = if whole(lesser) { high.floor() } else { high };
                if high < ranges[lesser].1 {
                    ranges[lesser].1 = high;
                    moved = true;
                }
            }
            if ranges.iter().any(|(low, high)| low > high) {
                return false;
            }
            if !moved {
                return true;
            }
        }
    }
}
