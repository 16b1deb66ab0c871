//! Skies for scenes that have no light of their own.

use glam::Vec3;

use super::{Sky, Sun, up::Up};

/// Half of the sun's angular diameter. The real one is 0.0047; a slightly hazy sun gives softer shadows.
const SUN_HALF_ANGLE_RAD: f32 = 0.012;

impl Sky {
    /// No light from outside: closed rooms with lamps.
    pub const BLACK: Self = Self { zenith: Vec3::ZERO, horizon: Vec3::ZERO, sun: None };

    /// A clear day: blue above, pale at the horizon, a sun behind the viewer's right shoulder. A white wall
    /// in the open comes out at a radiance of about 1.
    pub fn daylight() -> Self {
        Self {
            zenith: Vec3::new(0.25, 0.42, 0.78),
            horizon: Vec3::new(0.72, 0.80, 0.90),
            sun: Some(Sun::towards(Vec3::new(0.45, 0.80, 0.40), Vec3::new(2.9, 2.6, 2.1))),
        }
    }

    /// The sky in a scene that is turned. The gradient always stands upright.
    pub(crate) fn turned(self, up: Up) -> Self {
        let turned = |sun: Sun| Sun { direction: up.turned(sun.direction), ..sun };
        Self { sun: self.sun.map(turned), ..self }
    }
}

impl Sun {
    /// A sun in a direction (any length but zero), with the irradiance it gives to a surface that faces it.
    pub fn towards(direction: Vec3, irradiance: Vec3) -> Self {
        Self { direction: direction.normalize_or(Vec3::Y), irradiance, half_angle_rad: SUN_HALF_ANGLE_RAD }
    }
}
