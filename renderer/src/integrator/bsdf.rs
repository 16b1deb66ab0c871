//! How a surface scatters light: Lambert under a GGX layer, metals, mirrors, thin glass.
//!
//! One model covers the metallic-roughness materials of glTF. A share `F` (Schlick's Fresnel term) of the
//! light is reflected by a GGX microfacet layer, or by a perfect mirror where the surface is very smooth. Of
//! the rest, a share `transmission` passes straight through, as through a thin sheet, and what remains is
//! scattered diffusely if the surface is not a metal. Sources: Walter et al., Microfacet Models for
//! Refraction, EGSR 2007 (GGX); Heitz, Understanding the Masking-Shadowing Function, JCGT 2014; Dupuy and
//! Benyoub, Sampling Visible GGX Normals with Spherical Caps, HPG 2023; Ashikhmin and Shirley, An
//! Anisotropic Phong BRDF Model, 2000 (the diffuse part that leaves room for the layer above it).
//!
//! Directions are local: z is the shading normal, and both point away from the surface.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::sampling::{cosine_hemisphere, cosine_hemisphere_pdf, luminance};
use crate::scene::Material;

/// Below this roughness a surface counts as a perfect mirror.
const MIRROR_ROUGHNESS: f32 = 0.03;

/// A material made ready for shading.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    /// Albedo of the diffuse part.
    diffuse: Vec3,
    /// Reflectance of a microfacet at normal incidence and at grazing angles.
    f0: Vec3,
    f90: f32,
    /// Reflectance of the whole layer at grazing angles: a rough one reflects less than its microfacets,
    /// since they shadow each other there.
    layer_f90: Vec3,
    /// GGX width; `None` for a perfect mirror.
    alpha: Option<f32>,
    /// What light is multiplied by that passes through, before the Fresnel loss.
    through: Vec3,
}

/// What kind of event a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scatter {
    /// Drawn from a density; lights can be sampled instead.
    Rough,
    /// Perfect reflection.
    Mirror,
    /// Straight through, the direction unchanged.
    Through,
}

/// A scattered direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Where light comes from, local.
    pub direction: Vec3,
    /// Value times cosine over probability.
    pub weight: Vec3,
    /// Solid angle density of the direction over all rough lobes; 1 for the others, where it means nothing.
    pub pdf: f32,
    /// The kind of event.
    pub scatter: Scatter,
}

/// Probabilities of the three kinds of event, adding up to 1.
struct Shares {
    reflect: f32,
    diffuse: f32,
    through: f32,
}

impl Bsdf {
    /// From a material, whose fields are clamped to their ranges.
    pub fn new(material: &Material) -> Self {
        let base = material.base_color.clamp(Vec3::ZERO, Vec3::ONE);
        let metallic = material.metallic.clamp(0.0, 1.0);
        let roughness = material.roughness.clamp(0.0, 1.0);
        let transmission = material.transmission.clamp(0.0, 1.0) * (1.0 - metallic);
        let ior = material.ior.max(1.0);
        let dielectric = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let f0 = Vec3::splat(dielectric).lerp(base, metallic);
        // Nothing reflects at grazing angles where nothing reflects at all (index of refraction 1).
        let f90 = (50.0 * luminance(f0)).min(1.0).max(f0.max_element());
        let alpha = (roughness >= MIRROR_ROUGHNESS).then_some(roughness * roughness);
        Self {
            diffuse: base * (1.0 - metallic) * (1.0 - transmission),
            f0,
            f90,
            layer_f90: Vec3::splat(f90 * (1.0 - alpha.unwrap_or(0.0))).max(f0),
            alpha,
            through: base * transmission,
        }
    }

    /// Whether some light passes straight through.
    pub fn is_thin(&self) -> bool {
        self.through.max_element() > 0.0
    }

    /// Share of light that passes straight through at this cosine.
    pub fn transmittance(&self, cosine: f32) -> Vec3 {
        self.through * (Vec3::ONE - self.fresnel(cosine))
    }

    /// Reflectance of a microfacet.
    fn fresnel(&self, cosine: f32) -> Vec3 {
        self.f0.lerp(Vec3::splat(self.f90), schlick_weight(cosine))
    }

    /// Reflectance of the layer as a whole, which decides what is left for the parts below it.
    fn layer(&self, cosine: f32) -> Vec3 {
        self.f0 + (self.layer_f90 - self.f0) * schlick_weight(cosine)
    }

    fn shares(&self, view: Vec3) -> Shares {
        let layer = self.layer(view.z);
        let reflect = luminance(layer);
        let diffuse = luminance(self.diffuse * (Vec3::ONE - layer));
        let through = luminance(self.transmittance(view.z));
        let total = reflect + diffuse + through;
        if total > 0.0 {
            Shares { reflect: reflect / total, diffuse: diffuse / total, through: through / total }
        } else {
            Shares { reflect: 0.0, diffuse: 1.0, through: 0.0 }
        }
    }

    /// Value of the rough lobes times the cosine of `light`. Zero below the surface.
    pub fn evaluate(&self, view: Vec3, light: Vec3) -> Vec3 {
        if view.z <= 0.0 || light.z <= 0.0 {
            return Vec3::ZERO;
        }
        let room = (Vec3::ONE - self.layer(view.z)) * (Vec3::ONE - self.layer(light.z));
        let diffuse = self.diffuse * room * (light.z / PI);
        let Some(alpha) = self.alpha else {
            return diffuse;
        };
        let half = (view + light).normalize_or_zero();
        let shadowing = 1.0 / (1.0 + smith_lambda(alpha, view.z) + smith_lambda(alpha, light.z));
        diffuse + self.fresnel(view.dot(half)) * (ggx_density(alpha, half.z) * shadowing / (4.0 * view.z))
    }

    /// Solid angle density with which [`Bsdf::sample`] draws `light` from a rough lobe.
    pub fn pdf(&self, view: Vec3, light: Vec3) -> f32 {
        if view.z <= 0.0 || light.z <= 0.0 {
            return 0.0;
        }
        let shares = self.shares(view);
        let diffuse = shares.diffuse * cosine_hemisphere_pdf(light.z);
        let Some(alpha) = self.alpha else {
            return diffuse;
        };
        let half = (view + light).normalize_or_zero();
        let masking = 1.0 / (1.0 + smith_lambda(alpha, view.z));
        diffuse + shares.reflect * ggx_density(alpha, half.z) * masking / (4.0 * view.z)
    }

    /// Draws a direction from three numbers in [0, 1). `None` when the light is absorbed.
    pub fn sample(&self, view: Vec3, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if view.z <= 0.0 {
            return None;
        }
        let shares = self.shares(view);
        if choice < shares.through {
            let weight = self.transmittance(view.z) / shares.through;
            return Some(BsdfSample { direction: -view, weight, pdf: 1.0, scatter: Scatter::Through });
        }
        let direction = if choice < shares.through + shares.reflect {
            let Some(alpha) = self.alpha else {
                let direction = Vec3::new(-view.x, -view.y, view.z);
                let weight = self.fresnel(view.z) / shares.reflect;
                return Some(BsdfSample { direction, weight, pdf: 1.0, scatter: Scatter::Mirror });
            };
            let half = sample_visible_normal(alpha, view, u);
            2.0 * view.dot(half) * half - view
        } else {
            cosine_hemisphere(u)
        };
        let pdf = self.pdf(view, direction);
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let weight = self.evaluate(view, direction) / pdf;
        (weight.max_element() > 0.0).then_some(BsdfSample { direction, weight, pdf, scatter: Scatter::Rough })
    }
}

/// Schlick's weight of the grazing reflectance.
fn schlick_weight(cosine: f32) -> f32 {
    (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

/// The GGX distribution of normals.
fn ggx_density(alpha: f32, cosine: f32) -> f32 {
    let square = alpha * alpha;
    // Written with the sine so that a narrow lobe's peak keeps its digits.
    let spread = square * cosine * cosine + (1.0 - cosine * cosine).max(0.0);
    square / (PI * spread * spread)
}

/// Smith's auxiliary function of GGX.
fn smith_lambda(alpha: f32, cosine: f32) -> f32 {
    let square = cosine * cosine;
    let tangent = (1.0 - square).max(0.0) / square;
    ((1.0 + alpha * alpha * tangent).sqrt() - 1.0) * 0.5
}

/// A microfacet normal that is visible from `view`: a uniform point on the spherical cap that a perfect
/// sphere would show, stretched back.
fn sample_visible_normal(alpha: f32, view: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(view.x * alpha, view.y * alpha, view.z).normalize();
    let z = (1.0 - v) * (1.0 + stretched.z) - stretched.z;
    let sine = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let (sin, cos) = (TAU * u).sin_cos();
    let half = Vec3::new(sine * cos, sine * sin, z) + stretched;
    Vec3::new(half.x * alpha, half.y * alpha, half.z.max(0.0)).normalize_or(Vec3::Z)
}

#[cfg(test)]
#[path = "bsdf_tests.rs"]
mod tests;
