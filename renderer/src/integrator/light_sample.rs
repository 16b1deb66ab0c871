//! The sample of a light.

use glam::Vec3;

/// A direction in which light may arrive.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// Its distance; infinity for the sun and other parallel light.
    pub distance: f32,
    /// Radiance that arrives if nothing is in between.
    pub radiance: Vec3,
    /// Solid angle density. That of a light without size stands for one without bound.
    pub pdf: f32,
}

impl LightSample {
    /// Whether it can be used: not on a triangle that is seen edge on.
    #[inline(always)]
    pub(super) fn is_sound(&self) -> bool {
        self.pdf > 0.0 && self.pdf.is_finite()
    }
}
