//! The scattering of light at a surface: Lambert under a GGX layer, metals, mirrors, thin glass.
//!
//! Of the light, a share `F` (Schlick's Fresnel term) is reflected by a GGX layer, or a perfect mirror where
//! the surface is very smooth; a share `transmission` of the rest passes straight through; what remains is
//! scattered diffusely unless the surface is a metal. A rough metal's further reflections:
//! [`multiple`](super::multiple). Sources: Walter et al., EGSR 2007 (GGX); Heitz, JCGT 2014 (masking); Dupuy
//! and Benyoub, HPG 2023 (visible normals); Ashikhmin and Shirley, 2000 (the diffuse part that leaves room
//! for the layer above it).
//!
//! Directions are local: z is the shading normal, and both point away from the surface.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::multiple::{Multiple, losses};
use super::sampling::{cosine_hemisphere, luminance, turn};
use crate::scene::Material;

/// Below this roughness a surface counts as a perfect mirror.
pub(super) const MIRROR_ROUGHNESS: f32 = 0.03;

/// A material made ready for shading.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    /// Albedo of the diffuse part; under a layer, of light that has come through it.
    diffuse: Vec3,
    /// One over what the layer leaves in the mean over all directions.
    outward: Vec3,
    /// Reflectance of a microfacet at normal incidence and at grazing angles.
    f0: Vec3,
    f90: f32,
    /// Reflectance of the layer at grazing angles: microfacets of a rough one shadow each other there.
    layer_f90: Vec3,
    /// GGX width; `None` for a perfect mirror.
    alpha: Option<f32>,
    /// Of a rough metal.
    multiple: Option<Multiple>,
    /// The factor on light that passes through, before the Fresnel loss.
    through: Vec3,
    /// Lambert and nothing else.
    matt: bool,
}

/// A surface seen from one direction. `THIN` is false where nothing in the scene lets light through.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a, const THIN: bool> {
    bsdf: &'a Bsdf,
    /// Where it is seen from, local.
    view: Vec3,
    /// The share of light that the layer leaves to the parts below it.
    below: Vec3,
    shares: Shares,
    /// The share of light from there that the layer of a rough metal loses.
    loss: f32,
    /// Smith's `sqrt(α² + (1 - α²) cos²)` of the view, and `0.5 / (cos + root)`: masking over four cosines.
    root: f32,
    masking: f32,
}

/// A rough layer over a diffuse part: the fields of a [`Bsdf`] that matter then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gloss {
    pub(super) diffuse: Vec3,
    pub(super) outward: Vec3,
    pub(super) f0: Vec3,
    pub(super) f90: f32,
    pub(super) layer_f90: Vec3,
    pub(super) alpha: f32,
    pub(super) multiple: Option<Multiple>,
}

impl From<Gloss> for Bsdf {
    #[inline(always)]
    fn from(Gloss { diffuse, outward, f0, f90, layer_f90, alpha, multiple }: Gloss) -> Self {
        let alpha = Some(alpha);
        Self { diffuse, outward, f0, f90, layer_f90, alpha, multiple, through: Vec3::ZERO, matt: false }
    }
}

/// The kind of event of a sample.
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
#[derive(Clone, Copy, Debug)]
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
        // Transmission into a solid is not the affair of its surface.
        let thin = material.volume.is_none();
        let transmission = if thin { material.transmission.clamp(0.0, 1.0) * (1.0 - metallic) } else { 0.0 };
        let ior = material.ior.max(1.0);
        let dielectric = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let f0 = Vec3::splat(dielectric).lerp(base, metallic);
        // Nothing reflects at grazing angles where nothing reflects at all (index of refraction 1).
        let grazing = |f0: Vec3| (50.0 * luminance(f0)).min(1.0).max(f0.max_element());
        let f90 = grazing(f0);
        let alpha = (roughness >= MIRROR_ROUGHNESS).then_some(roughness * roughness);
        // Blending leaves the light behind it as it is; transmission tints it.
        let through = if material.blends { Vec3::splat(transmission) } else { base * transmission };
        let layer_f90 = f0.lerp(Vec3::splat(f90), rise_seen(alpha));
        // Nothing is left below a metal.
        let outward = 1.0 / (Vec3::ONE - mean_of_schlick(f0, layer_f90)).max(Vec3::splat(1e-3));
        let body = base * (1.0 - metallic) * (1.0 - transmission);
        let coat = Coat { f0: dielectric, f90: grazing(Vec3::splat(dielectric)), roughness, alpha };
        let metal = alpha.is_some() && metallic > 0.0;
        Self {
            diffuse: body * coat.kept(base) * outward,
            outward,
            f0,
            f90,
            layer_f90,
            alpha,
            multiple: metal.then(|| {
                let mean = mean_of_schlick(base, Vec3::splat(grazing(base)));
                Multiple::new(roughness, mean, metallic)
            }),
            through,
            matt: f90 == 0.0 && through == Vec3::ZERO,
        }
    }

    /// Whether some light passes straight through.
    pub fn is_thin(&self) -> bool {
        self.through.max_element() > 0.0
    }

    /// Whether it is a rough metal, whose microfacets reflect light to each other.
    pub(super) fn is_rough_metal(&self) -> bool {
        self.multiple.is_some()
    }

    /// Whether it is Lambert's and nothing else: no layer that reflects, nothing that passes through.
    #[inline(always)]
    pub fn is_matt(&self) -> bool {
        self.matt
    }

    /// Albedo of the diffuse part: a matt surface's value is this times the cosine of the light over π.
    #[inline(always)]
    pub fn diffuse(&self) -> Vec3 {
        self.diffuse
    }

    /// The parameters of a rough layer over a diffuse part; `None` for other surfaces.
    #[inline(always)]
    pub(super) fn gloss(&self) -> Option<Gloss> {
        let Self { diffuse, outward, f0, f90, layer_f90, multiple, .. } = *self;
        let rough = !self.matt && !self.is_thin();
        self.alpha.filter(|_| rough).map(|alpha| Gloss {
            diffuse,
            outward,
            f0,
            f90,
            layer_f90,
            alpha,
            multiple,
        })
    }

    /// Share of light that passes straight through at this cosine.
    #[inline]
    pub fn transmittance(&self, cosine: f32) -> Vec3 {
        self.through * (Vec3::ONE - self.fresnel(cosine))
    }

    /// Reflectance of a microfacet.
    #[inline(always)]
    fn fresnel(&self, cosine: f32) -> Vec3 {
        self.f0 + (Vec3::splat(self.f90) - self.f0) * schlick_weight(cosine)
    }

    /// Reflectance of the layer as a whole, which decides how much light is left for the parts below it.
    #[inline(always)]
    fn layer(&self, cosine: f32) -> Vec3 {
        self.f0 + (self.layer_f90 - self.f0) * schlick_weight(cosine)
    }

    /// The surface from one direction. Nothing is seen from below: `None`.
    #[inline(always)]
    pub fn seen_from<const THIN: bool>(&self, view: Vec3) -> Option<Seen<'_, THIN>> {
        (view.z > 0.0).then(|| self.see(view))
    }

    /// The surface from a direction above it.
    #[inline(always)]
    pub(super) fn see<const THIN: bool>(&self, view: Vec3) -> Seen<'_, THIN> {
        let layer = self.layer(view.z);
        let below = Vec3::ONE - layer;
        let mut reflect = luminance(layer);
        let mut diffuse = self.diffuse * below;
        let mut loss = 0.0;
        if let (Some(multiple), Some(alpha)) = (&self.multiple, self.alpha) {
            loss = multiple.losses.of_direction(view.z, alpha);
            diffuse += multiple.albedo * loss;
            reflect *= 1.0 - loss;
        }
        let diffuse = luminance(diffuse);
        let through = if THIN { luminance(self.transmittance(view.z)) } else { 0.0 };
        let total = reflect + diffuse + through;
        let shares = if total > 0.0 {
            let scale = 1.0 / total;
            Shares { reflect: reflect * scale, diffuse: diffuse * scale, through: through * scale }
        } else {
            Shares { reflect: 0.0, diffuse: 1.0, through: 0.0 }
        };
        let root = self.alpha.map_or(0.0, |alpha| smith_root(alpha, view.z));
        let masking = 0.5 / (view.z + root);
        Seen { bsdf: self, view, below, shares, loss, root, masking }
    }
}

impl<const THIN: bool> Seen<'_, THIN> {
    /// For a direction `light`: value of the rough lobes times the cosine, and the density of
    /// [`Seen::sample`]. Both zero below the surface.
    ///
    /// The lobe is GGX with height-correlated shadowing, drawn by visible normals, written with roots so that
    /// grazing angles divide by nothing small (Lagarde and de Rousiers, Moving Frostbite to PBR, 2014,
    /// section 3.1.2). For unit vectors `|view + light|` is twice the cosine with the half vector.
    #[inline(always)]
    pub fn rough(&self, light: Vec3) -> (Vec3, f32) {
        let (bsdf, view) = (self.bsdf, self.view);
        if light.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let cosine = light.z * FRAC_1_PI;
        let mut diffuse =
            bsdf.diffuse * self.below * bsdf.outward * (Vec3::ONE - bsdf.layer(light.z)) * cosine;
        let diffuse_pdf = self.shares.diffuse * cosine;
        let Some(alpha) = bsdf.alpha else { return (diffuse, diffuse_pdf) };
        if let Some(multiple) = &bsdf.multiple {
            diffuse += multiple.value(self.loss, light.z, alpha);
        }
        let half = view + light;
        let length_squared = half.length_squared();
        let square = alpha * alpha;
        // Written with the sine so that a narrow lobe's peak keeps its digits.
        let spread = square * half.z * half.z + half.x * half.x + half.y * half.y;
        let density = square * length_squared * length_squared / (PI * spread * spread);
        let shadowing = 0.5 * light.z / (light.z * self.root + view.z * smith_root(alpha, light.z));
        let fresnel = bsdf.fresnel(0.5 * length_squared.sqrt());
        (
            diffuse + fresnel * (density * shadowing),
            diffuse_pdf + self.shares.reflect * density * self.masking,
        )
    }

    /// Whether a choice in [0, 1) means that light passes straight through; with what weight.
    #[inline(always)]
    pub fn through(&self, choice: f32) -> Option<Vec3> {
        (THIN && choice < self.shares.through)
            .then(|| self.bsdf.transmittance(self.view.z) / self.shares.through)
    }

    /// Draws a direction from three numbers in [0, 1). `None` when the light is absorbed.
    #[inline(always)]
    pub fn sample(&self, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let (bsdf, view, shares) = (self.bsdf, self.view, &self.shares);
        if let Some(weight) = self.through(choice) {
            return Some(BsdfSample { direction: -view, weight, pdf: 1.0, scatter: Scatter::Through });
        }
        if choice < shares.through + shares.reflect && bsdf.alpha.is_none() {
            let direction = Vec3::new(-view.x, -view.y, view.z);
            let weight = bsdf.fresnel(view.z) / shares.reflect;
            return Some(BsdfSample { direction, weight, pdf: 1.0, scatter: Scatter::Mirror });
        }
        let (direction, weight, pdf, sound) = self.sample_rough(choice, u);
        sound.then_some(BsdfSample { direction, weight, pdf, scatter: Scatter::Rough })
    }

    /// Draws a direction from the rough lobes: direction, weight, density, and whether it is of any use.
    #[inline(always)]
    pub(super) fn sample_rough(&self, choice: f32, u: [f32; 2]) -> (Vec3, Vec3, f32, bool) {
        let direction = match self.bsdf.alpha {
            Some(alpha) if choice < self.shares.through + self.shares.reflect => {
                reflect_at_visible_normal(alpha, self.view, u)
            }
            _ => cosine_hemisphere(u),
        };
        let (value, pdf) = self.rough(direction);
        let weight = value / pdf;
        let sound = pdf > 0.0 && pdf.is_finite() && weight.max_element() > 0.0;
        (direction, weight, pdf, sound)
    }
}

struct Coat {
    f0: f32,
    f90: f32,
    roughness: f32,
    alpha: Option<f32>,
}

impl Coat {
    /// The factor on the albedo of a body under it, so that no light is lost: what the coat reflects back
    /// into the body, half as much again as from outside, is scattered there again.
    fn kept(&self, base: Vec3) -> Vec3 {
        let outside = mean_of_schlick(Vec3::splat(self.f0), Vec3::splat(self.f90)).x;
        let within = (1.5 * outside).min(0.95);
        (1.0 - self.reflected()) * (1.0 - within) / (Vec3::ONE - base * within)
    }

    /// Share of light that its lobe reflects, in the mean over all directions.
    fn reflected(&self) -> f32 {
        let lost = self.alpha.map_or(0.0, |_| losses(self.roughness).1);
        (self.f0 + (self.f90 - self.f0) / 21.0 * rise_seen(self.alpha)) * (1.0 - lost)
    }
}

/// Share of Fresnel's rise towards grazing angles that a rough layer shows, within 0.05.
fn rise_seen(alpha: Option<f32>) -> f32 {
    alpha.map_or(1.0, |alpha| 1.0 / (1.0 + alpha * (4.0 + 2.0 * alpha)))
}

/// Schlick's reflectance in the mean over all directions by their cosine.
fn mean_of_schlick(f0: Vec3, f90: Vec3) -> Vec3 {
    f0 + (f90 - f0) / 21.0
}

/// Schlick's weight of the grazing reflectance.
#[inline(always)]
fn schlick_weight(cosine: f32) -> f32 {
    let x = 1.0 - cosine.clamp(0.0, 1.0);
    let square = x * x;
    square * square * x
}

/// The root in Smith's shadowing of GGX: `sqrt(α² + (1 - α²) cos²)`.
#[inline(always)]
fn smith_root(alpha: f32, cosine: f32) -> f32 {
    let square = alpha * alpha;
    (square + (1.0 - square) * cosine * cosine).sqrt()
}

/// Share of microfacets that others leave in sight at a cosine (Smith).
pub(super) fn masking(alpha: f32, cosine: f32) -> f32 {
    2.0 * cosine / (cosine + smith_root(alpha, cosine))
}

/// A microfacet normal, of any length, that is visible: a point on a sphere's cap, stretched back.
#[inline(always)]
pub(super) fn visible_normal(alpha: f32, view: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(view.x * alpha, view.y * alpha, view.z).normalize();
    let z = (1.0 - v) * (1.0 + stretched.z) - stretched.z;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = turn(u);
    let half = Vec3::new(sine * cos, sine * sin, z) + stretched;
    Vec3::new(half.x * alpha, half.y * alpha, half.z.max(0.0))
}

/// The view reflected at a microfacet that is visible from it.
#[inline(always)]
fn reflect_at_visible_normal(alpha: f32, view: Vec3, u: [f32; 2]) -> Vec3 {
    let half = visible_normal(alpha, view, u);
    let length_squared = half.length_squared();
    if length_squared > 0.0 {
        half * (2.0 * view.dot(half) / length_squared) - view
    } else {
        Vec3::new(-view.x, -view.y, view.z)
    }
}

#[cfg(test)]
#[path = "bsdf_tests.rs"]
mod tests;
