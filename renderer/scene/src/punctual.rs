//! Lights without size (KHR_lights_punctual): nothing ever meets one, and their shadows are sharp.

use std::f32::consts::FRAC_PI_2;

use glam::Vec3;

use super::up::Up;

/// A light without size. Linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Punctual {
    /// Parallel light from far away.
    Directional {
        /// Unit vector towards it.
        direction: Vec3,
        /// Irradiance on a surface that faces it.
        irradiance: Vec3,
    },
    /// Light from a point, in all directions or in a cone.
    Point {
        /// Where it is.
        position: Vec3,
        /// Radiant intensity, in the middle of the cone.
        intensity: Vec3,
        /// The cone of a spot.
        cone: Option<Cone>,
        /// Distance at which it ends; infinite for one that obeys nothing but the inverse square.
        range: f32,
    },
}

/// The cone of a spot: full up to the inner angle, none from the outer one, squared between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Unit vector in which it shines.
    axis: Vec3,
    /// One less the cosine of the outer angle.
    edge: f32,
    /// One over the difference of the cosines.
    steepness: f32,
}

/// Light that arrives from a light without size, if nothing is in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// Its distance; infinity for parallel light.
    pub distance: f32,
    /// Irradiance on a surface that faces it.
    pub irradiance: Vec3,
}

impl Cone {
    /// A cone of half its opening angles in radians, moved into range (0 to outer to a right angle).
    pub fn new(axis: Vec3, inner_rad: f32, outer_rad: f32) -> Self {
        let outer = outer_rad.clamp(0.0, FRAC_PI_2);
        let inner = inner_rad.clamp(0.0, outer);
        // Differences of cosines as products of sines: narrow cones keep their digits.
        let difference = 2.0 * (0.5 * (outer + inner)).sin() * (0.5 * (outer - inner)).sin();
        let edge = 2.0 * (0.5 * outer).sin().powi(2);
        Self {
            axis: axis.normalize_or(Vec3::NEG_Z),
            edge,
            steepness: 1.0 / difference.max(edge * 1e-6).max(f32::MIN_POSITIVE),
        }
    }

    /// Share of the intensity in a direction away from the light, a unit vector.
    fn share(&self, away: Vec3) -> f32 {
        // One less the cosine.
        let off = 0.5 * self.axis.distance_squared(away);
        let share = ((self.edge - off) * self.steepness).clamp(0.0, 1.0);
        share * share
    }
}

impl Punctual {
    /// Parallel light from a direction (any length but zero).
    pub fn towards(direction: Vec3, irradiance: Vec3) -> Self {
        Self::Directional { direction: direction.normalize_or(Vec3::Y), irradiance }
    }

    /// A point that shines to all sides.
    pub fn point(position: Vec3, intensity: Vec3) -> Self {
        Self::Point { position, intensity, cone: None, range: f32::INFINITY }
    }

    pub(crate) fn turned(self, up: Up) -> Self {
        match self {
            Self::Directional { direction, irradiance } => {
                Self::Directional { direction: up.turned(direction), irradiance }
            }
            Self::Point { position, intensity, cone, range } => {
                let cone = cone.map(|cone| Cone { axis: up.turned(cone.axis), ..cone });
                Self::Point { position: up.turned(position), intensity, cone, range }
            }
        }
    }

    /// Follows a scene whose lengths are multiplied by a factor: as much light arrives.
    pub(crate) fn scale(&mut self, factor: f32) {
        if let Self::Point { position, intensity, range, .. } = self {
            *position *= factor;
            *intensity = *intensity * factor * factor;
            *range *= factor;
        }
    }

    pub(crate) fn move_by(&mut self, by: Vec3) {
        if let Self::Point { position, .. } = self {
            *position += by;
        }
    }

    /// The light that arrives at a position; no irradiance at the light itself.
    pub fn arrival(&self, at: Vec3) -> Arrival {
        match *self {
            Self::Directional { direction, irradiance } => {
                Arrival { direction, distance: f32::INFINITY, irradiance }
            }
            Self::Point { position, intensity, cone, range } => {
                let offset = position - at;
                let distance = offset.length();
                let direction = offset / distance;
                if !(direction.is_finite() && distance > 0.0) {
                    return Arrival { direction: Vec3::Y, distance: 0.0, irradiance: Vec3::ZERO };
                }
                let share = cone.map_or(1.0, |cone| cone.share(-direction));
                let window = (1.0 - (distance / range).powi(4)).clamp(0.0, 1.0);
                // One after the other, so that no square leaves the range of single precision.
                let irradiance = intensity * (share * window) / distance / distance;
                Arrival { direction, distance, irradiance }
            }
        }
    }

    /// Radiant intensity, or irradiance of parallel light.
    pub fn strength(&self) -> Vec3 {
        match *self {
            Self::Directional { irradiance, .. } => irradiance,
            Self::Point { intensity, .. } => intensity,
        }
    }

    /// Whether it gives light, and its numbers are finite and not negative.
    pub(crate) fn is_sound(&self) -> bool {
        let place = match *self {
            Self::Directional { direction, .. } => direction,
            Self::Point { position, range, .. } if range > 0.0 => position,
            Self::Point { .. } => Vec3::NAN,
        };
        let strength = self.strength();
        place.is_finite()
            && strength.is_finite()
            && strength.min_element() >= 0.0
            && strength.max_element() > 0.0
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_4;

    use super::*;

    #[test]
    fn light_falls_off_by_the_square() {
        for scale in [1e-10, 1.0, 1e9] {
            let light = Punctual::point(Vec3::Y * 2.0 * scale, Vec3::splat(40.0));
            let Arrival { direction, distance, irradiance } = light.arrival(Vec3::ZERO);
            assert_eq!((direction, distance), (Vec3::Y, 2.0 * scale));
            assert!((irradiance.x * scale * scale - 10.0).abs() < 1e-4, "{irradiance}");
            assert_eq!(light.arrival(Vec3::Y * 2.0 * scale).irradiance, Vec3::ZERO);
        }
    }

    #[test]
    fn cones_end_where_they_should() {
        // The last ones are narrower than the 0.001 that the extension divides by at least.
        for (inner, outer) in [(0.2, 0.3), (0.0, FRAC_PI_4), (0.5, FRAC_PI_2), (0.0, 0.03), (0.002, 0.004)] {
            let cone = Some(Cone::new(Vec3::NEG_Y * 7.0, inner, outer));
            let spot =
                Punctual::Point { position: Vec3::Y, intensity: Vec3::ONE, cone, range: f32::INFINITY };
            let at =
                |angle: f32| spot.arrival(Vec3::Y + Vec3::new(angle.sin(), -angle.cos(), 0.0)).irradiance.x;
            assert!((at(0.0) - 1.0).abs() < 1e-5 && (at(inner * 0.99) - 1.0).abs() < 2e-3, "{inner} {outer}");
            // Between the angles the square of how far the cosine is on its way.
            let middle = f64::from(0.5 * (inner + outer));
            let cosine = |angle: f32| f64::from(angle).cos();
            let share = (middle.cos() - cosine(outer)) / (cosine(inner) - cosine(outer));
            assert!((f64::from(at(middle as f32)) - share * share).abs() < 2e-3, "{inner} {outer}: {share}");
            assert_eq!((at(outer * 1.01), at(3.0)), (0.0, 0.0), "{inner} {outer}");
        }
    }

    #[test]
    fn angles_without_sense_are_moved_into_their_range() {
        let share = |inner, outer, at: f32| {
            Cone::new(Vec3::Y, inner, outer).share(Vec3::new(at.sin(), at.cos(), 0.0))
        };
        // A sharp edge, whichever is the larger.
        assert_eq!((share(0.4, 0.4, 0.39), share(0.4, 0.4, 0.41)), (1.0, 0.0));
        assert_eq!((share(0.9, 0.4, 0.39), share(0.9, 0.4, 0.41)), (1.0, 0.0));
        assert_eq!((share(-1.0, 9.0, 0.0), share(-1.0, 9.0, 1.58)), (1.0, 0.0));
        assert_eq!((share(0.0, 0.0, 0.0), share(0.0, 0.0, 0.1)), (0.0, 0.0));
    }

    #[test]
    fn a_range_ends_the_light() {
        let light = |range| Punctual::Point { position: Vec3::ZERO, intensity: Vec3::ONE, cone: None, range };
        let at = |range| light(range).arrival(Vec3::X).irradiance.x;
        assert_eq!((at(1.0), at(f32::INFINITY)), (0.0, 1.0));
        assert!((at(2.0) - (1.0 - 0.0625)).abs() < 1e-6);
        assert!(light(2.0).is_sound() && !light(0.0).is_sound() && !light(f32::NAN).is_sound());
        assert!(
            !Punctual::point(Vec3::NAN, Vec3::ONE).is_sound()
                && !Punctual::point(Vec3::X, Vec3::ZERO).is_sound()
        );
    }
}
