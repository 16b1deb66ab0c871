//! Configurations and the unit cube in which searches work: one coordinate per parameter.

use crate::configuration::Configuration;
use crate::space::Space;
use crate::value::Value;

impl Space {
    /// The point of a configuration of this space: `dimension()` coordinates in 0..1. Inactive parameters
    /// sit at their default's coordinate, so that they do not separate what behaves alike.
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
        assert_eq!(point.len(), self.dimension(), "a point has one coordinate per parameter");
        let mut values: Vec<Value> =
            self.parameters.iter().zip(point).map(|(parameter, &x)| parameter.domain.decode(x)).collect();
        // A repair can switch other parameters on or off, but only so often.
        for _ in 0..=self.parameters.len() {
            let active = self.active(&values);
            if self.violations(&values, &active).next().is_none() {
                return self.collect(&values, &active);
            }
            if !self.repair(&mut values, &active) {
                break;
            }
        }
        self.default.clone()
    }
}
