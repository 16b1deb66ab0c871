//! The number of configurations of a space, where they are few.

use crate::configuration::Configuration;
use crate::limits::ENUMERATED_MAX;
use crate::space::{Domain, Space};
use crate::value::Value;

impl Domain {
    /// Every value in order, where there are at most [`ENUMERATED_MAX`].
    fn values(&self) -> Option<Vec<Value>> {
        match self {
            Domain::Boolean => Some([false, true].map(Value::Boolean).to_vec()),
            Domain::Categorical { values } => Some(values.clone()),
            Domain::Integer { min, max, .. } if max.abs_diff(*min) < ENUMERATED_MAX as u64 => {
                Some((*min..=*max).map(Value::Integer).collect())
            }
            Domain::Float { min, max, .. } if min == max => Some(vec![Value::Float(*min)]),
            Domain::Integer { .. } | Domain::Float { .. } => None,
        }
    }
}

/// The part that is put together so far: a value and whether it is active, for each of the first parameters.
#[derive(Default)]
struct Partial {
    ordered: Vec<Value>,
    active: Vec<bool>,
    found: Vec<Configuration>,
    /// Combinations that were looked at, those that break a constraint among them.
    looked_at: usize,
}

impl Space {
    /// Every configuration, where there are at most [`ENUMERATED_MAX`] combinations of values; `None` where
    /// there are more, or where they cannot be counted.
    pub fn enumerate(&self) -> Option<Vec<Configuration>> {
        let values: Vec<Vec<Value>> =
            self.parameters.iter().map(|parameter| parameter.domain.values()).collect::<Option<_>>()?;
        let mut partial = Partial::default();
        self.extend(&mut partial, &values).then_some(partial.found)
    }

    /// Goes through all combinations of the parameters that are left; `false` where there are too many.
    fn extend(&self, partial: &mut Partial, values: &[Vec<Value>]) -> bool {
        let index = partial.ordered.len();
        let Some(parameter) = self.parameters.get(index) else {
            partial.looked_at += 1;
            if self.violations(&partial.ordered, &partial.active).next().is_none() {
                partial.found.push(self.collect(&partial.ordered, &partial.active));
            }
            return partial.looked_at <= ENUMERATED_MAX;
        };
        let is_active = self.is_active(index, &partial.ordered, &partial.active);
        let default = std::slice::from_ref(&parameter.default);
        partial.active.push(is_active);
        let all = if is_active { &values[index] } else { default };
        let are_few = all.iter().all(|value| {
            partial.ordered.push(value.clone());
            let are_few = self.extend(partial, values);
            partial.ordered.pop();
            are_few
        });
        partial.active.pop();
        are_few
    }
}
