//! Configurations and the unit cube in which searches work: one coordinate per parameter.

use crate::configuration::Configuration;
use crate::space::Space;
use crate::value::Value;

impl Space {
    /// The point of a configuration of this space: `dimension()` coordinates in 0..1. Inactive parameters sit
    /// at their default's coordinate, so that they do not separate equal configurations.
    pub fn encode(&self, configuration: &Configuration) -> Vec<f64> {
        let coordinates = self.parameters.iter().zip(&self.default_point);
        coordinates
            .map(|(parameter, &default)| match configuration.get(&parameter.name) {
                Some(value) => parameter.domain.encode(value),
                None => default,
            })
            .collect()
    }

    /// The configuration at a point: coordinates are clamped and rounded, parameters whose condition does
    /// not hold are left out, and broken constraints are repaired. Always valid and deterministic.
    ///
    /// `decode(encode(c))` gives back `c`: exactly for discrete domains of up to 2^40 values, to twelve
    /// significant digits for floats.
    ///
    /// # Panics
    /// When `point` does not have `dimension()` coordinates.
    pub fn decode(&self, point: &[f64]) -> Configuration {
        let (values, active) = self.settle(point);
        self.collect(&values, &active)
    }

    /// Moves a point to the encoding of its configuration, as `encode(decode(point))` does, and returns the
    /// active parameters.
    ///
    /// # Panics
    /// When `point` does not have `dimension()` coordinates.
    pub fn canonical(&self, point: &mut [f64]) -> Vec<bool> {
        let (values, active) = self.settle(point);
        for (index, x) in point.iter_mut().enumerate() {
            let is_active = active[index];
            *x = if is_active {
                self.parameters[index].domain.encode(&values[index])
            } else {
                self.default_point[index]
            };
        }
        active
    }

    /// The values at a point, repaired, and which are active.
    fn settle(&self, point: &[f64]) -> (Vec<Value>, Vec<bool>) {
        assert_eq!(point.len(), self.dimension(), "a point has one coordinate per parameter");
        let mut values: Vec<Value> =
            self.parameters.iter().zip(point).map(|(parameter, &x)| parameter.domain.decode(x)).collect();
        // A repair can switch other parameters on or off, but only a limited number of times.
        for _ in 0..=self.parameters.len() {
            let active = self.active(&values);
            if self.violations(&values, &active).next().is_none() {
                return (values, active);
            }
            let is_repaired = match self.has_expressions() {
                true => self.move_to_nearest(&mut values),
                false => self.repair(&mut values, &active),
            };
            if !is_repaired {
                break;
            }
        }
        let values: Vec<Value> = self.defaults().cloned().collect();
        let active = self.active(&values);
        (values, active)
    }

    /// Whether a constraint is more than the order of two parameters.
    pub fn has_expressions(&self) -> bool {
        !self.groups.is_empty()
    }

    /// The default value of each parameter, active or not.
    pub(super) fn defaults(&self) -> impl Iterator<Item = &Value> {
        self.parameters.iter().map(|parameter| &parameter.default)
    }
}
