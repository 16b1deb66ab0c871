//! The vertex of a path: the one definition of its shading, for every order of work.
//!
//! A light is sampled directly, and the surface's own sampling finds lights and sky; the two are weighed by
//! the power heuristic (Veach 1997). Passing thin sheets is no bounce: the path keeps its density.
//!
//! From a vertex without a bounce left a last ray goes by chance, which looks for lamps alone: else nothing
//! would weigh a sample of a lamp near by.
//!
//! [`Kernel`]s are compiled for sets of [`Needs`]; a frame picks one and calls it for each hit, independently
//! of the acceleration structures.

use glam::Vec3;
use treewright_accel::{Hit, Ray};

use super::sampling::{Basis, power_heuristic};
use super::surface::{Surface, WorldFacet};
use super::{
    bsdf::Scatter, lamp::solid_angle_pdf, needs::Needs, places, prepared::Prepared, random::PathRandom,
};
use crate::limits::SHEETS_PER_SEGMENT_MAX;

/// A shadow ray ends this share before the light, so that it does not meet the light itself.
pub(super) const SHADOW_SHARE: f32 = 1.0 - 1e-4;

#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// The factor on light that arrives along the ray.
    pub(super) throughput: Vec3,
    /// The largest of that after the first vertex; 0 before.
    pub(super) first: f32,
    /// The density by which a light it meets is weighed: of a lobe at `from`, [`DIRECT`] or [`CAUSTIC`].
    pub(super) pdf: f32,
    /// Where it was scattered last; behind mirrors and glass, where that or the eye seems to be.
    pub(super) from: Vec3,
    /// Whose path it is; the meaning is the caller's.
    pub(super) pixel: u32,
    pub(super) random: PathRandom,
    pub(super) vertex: u16,
    pub(super) bounce: u8,
    pub(super) sheets: u8,
}

/// From the camera, or only perfect mirrors since: no other technique finds these lights.
pub(super) const DIRECT: f32 = -1.0;
/// A perfect mirror after a rough surface: [`DIRECT`] without the sun's disc, which leaves bright dots.
const CAUSTIC: f32 = -2.0;

impl Path {
    /// A path that begins at the camera's eye.
    #[inline(always)]
    pub(super) fn new(pixel: u32, random: PathRandom, eye: Vec3) -> Self {
        Self {
            throughput: Vec3::ONE,
            first: 0.0,
            pdf: DIRECT,
            from: eye,
            pixel,
            random,
            vertex: 0,
            bounce: 0,
            sheets: 0,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Tracing {
    pub(super) bounces: u32,
    /// The angle that a pixel covers, in radians.
    pub(super) pixel_angle: f32,
    /// Whether there are lamps, for which last rays look beyond the last bounce.
    pub(super) last_rays: bool,
}

/// Probability that a last ray leaves a vertex without a bounce left. A power of two, which costs no digits.
pub(super) const LAST_RAY: f32 = 0.25;

impl Tracing {
    /// Whether a path is on its last ray, beyond the last bounce.
    #[inline(always)]
    pub(super) fn is_last_ray(&self, path: &Path) -> bool {
        u32::from(path.bounce) > self.bounces
    }

    /// The factor on the light of a rough lobe's ray: 1 while bounces are left, then the last's; 0 for none.
    #[inline(always)]
    pub(super) fn follow(&self, path: &Path, place: u32) -> f32 {
        if u32::from(path.bounce) < self.bounces {
            return 1.0;
        }
        let may_follow = self.last_rays && !self.is_last_ray(path);
        let follows = may_follow && path.random.single(places::of_last_ray(place)) < LAST_RAY;
        if follows { 1.0 / LAST_RAY } else { 0.0 }
    }
}

/// Assumed width, in radians, of light that comes over a perfect mirror after a rough surface.
const CAUSTIC_ANGLE: f32 = 0.1;
/// The angle after a rough surface: this share of one over the density's root; also the greatest.
const ROUGH_ANGLE: f32 = 0.25;

impl Path {
    /// Width of a ray at a position, as a cone from the last scattering (Akenine-Möller et al., Texture Level
    /// of Detail Strategies for Real-Time Ray Tracing, 2019).
    #[inline]
    pub(super) fn width(&self, tracing: &Tracing, position: Vec3) -> f32 {
        let angle = if self.pdf == DIRECT {
            tracing.pixel_angle
        } else if self.pdf == CAUSTIC {
            CAUSTIC_ANGLE
        } else {
            ROUGH_ANGLE * (1.0 / self.pdf).sqrt().min(1.0)
        };
        angle * position.distance(self.from)
    }

    /// Its density after a perfect reflection or refraction.
    #[inline(always)]
    pub(super) fn mirrored_pdf(&self) -> f32 {
        if self.pdf == DIRECT { DIRECT } else { CAUSTIC }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Next {
    pub(super) shadow: bool,
    pub(super) goes_on: bool,
}

pub(super) const END: Next = Next { shadow: false, goes_on: false };

/// A shadow ray and the light that arrives if nothing is in its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shadow {
    pub(super) ray: Ray,
    pub(super) light: Vec3,
}

impl Shadow {
    pub(super) const BLANK: Self = Self {
        ray: Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 0.0 },
        light: Vec3::ZERO,
    };
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Kernel {
    pub(super) needs: Needs,
    /// Adds a hit's emission to the radiance, prepares the shadow ray, and turns path and ray.
    pub(super) vertex: Vertex,
}

type Vertex = fn(&Prepared, &Tracing, &mut Path, &mut Ray, &Hit, &mut Vec3, &mut Shadow) -> Next;

macro_rules! kernels {
    ($($number:literal)*) => {
        [$(vertex::<{ Needs::of_kernel($number).bits() }>),*]
    };
}

static VERTICES: [Vertex; Needs::SETS] = kernels!(
    0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31
    32 33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63
    64 65 66 67 68 69 70 71 72 73 74 75 76 77 78 79 80 81 82 83 84 85 86 87 88 89 90 91 92 93 94
);

impl Kernel {
    pub(super) fn of(needs: Needs) -> Self {
        let needs = needs.closed();
        Self { needs, vertex: VERTICES[needs.kernel()] }
    }
}

fn vertex<const NEEDS: usize>(
    prepared: &Prepared,
    tracing: &Tracing,
    path: &mut Path,
    ray: &mut Ray,
    hit: &Hit,
    radiance: &mut Vec3,
    shadow: &mut Shadow,
) -> Next {
    let needs = const { Needs::from_bits(NEEDS) };
    let facet = &prepared.facets[hit.triangle as usize];
    let material =
        if needs.materials { prepared.surface::<true>(facet) } else { prepared.surface::<false>(facet) };
    let instance = if needs.instances { prepared.scene.instance(hit.instance) } else { None };
    let mut standing = if needs.smooth {
        WorldFacet::new::<true>(facet, instance)
    } else {
        WorldFacet::new::<false>(facet, instance)
    };
    let looked_up;
    let material = if needs.textures && material.textured {
        looked_up = prepared.look_up(tracing, path, ray, hit, material, &mut standing);
        &looked_up
    } else {
        material
    };
    let surface = if needs.smooth {
        Surface::new::<true>(&standing, ray, hit)
    } else {
        Surface::new::<false>(&standing, ray, hit)
    };
    let Some(surface) = surface else { return END };
    let last_ray = needs.lamps && tracing.is_last_ray(path);
    if needs.lamps && material.glows {
        let weight = if path.pdf < 0.0 {
            1.0
        } else {
            let cosine = surface.geometric_normal.dot(ray.direction);
            let distance_squared = surface.position.distance_squared(path.from);
            let lights = &prepared.lights;
            let factor = if needs.environment { lights.lamp_factor(path.from, last_ray) } else { 1.0 };
            let density = material.density * factor;
            power_heuristic(path.pdf, solid_angle_pdf(density, cosine, distance_squared))
        };
        *radiance += path.throughput * material.emission * weight;
    }
    // A last ray looks for lamps alone, also behind sheets, as shadow rays do.
    if last_ray && !(needs.sheets && material.bsdf.is_thin()) {
        return END;
    }
    let place = places::of_vertex(path.vertex);
    path.vertex += 1;
    let last = u32::from(path.bounce) >= tracing.bounces;
    let follow = tracing.follow(path, place);
    let context = Context { prepared, surface: &surface, last, last_ray, follow, place };
    if needs.solids && material.solid {
        return context.solid::<NEEDS>(material, &standing, path, ray, shadow);
    }
    if !needs.layers || material.bsdf.is_matt() {
        context.matt::<NEEDS>(material.bsdf.diffuse(), path, ray, shadow)
    } else if needs.sheets {
        context.layered::<NEEDS, true>(&material.bsdf, path, ray, shadow)
    } else {
        context.layered::<NEEDS, false>(&material.bsdf, path, ray, shadow)
    }
}

/// The power heuristic's weight of a sample of density `pdf` beside `other`, over the density.
#[inline(always)]
pub(super) fn weight_over_density(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    1.0 / (pdf * (1.0 + ratio * ratio))
}

/// The density with which a surface's own sampling, of `pdf`, finds a light; none without size.
#[inline(always)]
pub(super) fn density_of_finding(pdf: f32, last: bool, distance: f32) -> f32 {
    let by_last_ray = if distance.is_finite() { pdf * LAST_RAY } else { 0.0 };
    if last { by_last_ray } else { pdf }
}

pub(super) struct Context<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) surface: &'a Surface,
    pub(super) last: bool,
    /// The path has come by a last ray: no light is sampled.
    last_ray: bool,
    follow: f32,
    /// Where the vertex's random numbers begin.
    pub(super) place: u32,
}

impl Context<'_> {
    /// Samples a light and prepares its ray: `value` gives value times cosine, and its own density.
    #[inline(always)]
    fn light<const NEEDS: usize>(
        &self,
        path: &Path,
        shadow: &mut Shadow,
        value: impl FnOnce(Vec3) -> (Vec3, f32),
    ) -> bool {
        let needs = const { Needs::from_bits(NEEDS) };
        if !needs.shadows() || self.last_ray {
            return false;
        }
        let lights = &self.prepared.lights;
        let (position, normal) = (self.surface.position, self.surface.geometric_normal);
        let u = path.random.pair(self.place + 1);
        let pick = || path.random.pair(self.place);
        let light = match (needs.environment || needs.punctual, needs.lamps, needs.sun) {
            (true, ..) => lights.sample_all(position, normal, pick(), u, self.last),
            (false, false, false) => None,
            (false, false, true) => lights.sample::<false, true>(position, normal, [0.0; 2], u),
            (false, true, false) => lights.sample::<true, false>(position, normal, pick(), u),
            (false, true, true) => lights.sample::<true, true>(position, normal, pick(), u),
        };
        let Some(light) = light.filter(|light| light.direction.dot(self.surface.geometric_normal) > 0.0)
        else {
            return false;
        };
        let (value, pdf) = value(light.direction);
        if value == Vec3::ZERO {
            return false;
        }
        let weight = weight_over_density(light.pdf, density_of_finding(pdf, self.last, light.distance));
        *shadow = Shadow {
            ray: Ray {
                origin: self.surface.start(light.direction),
                direction: light.direction,
                t_min: 0.0,
                t_max: light.distance * SHADOW_SHARE,
            },
            light: path.throughput * value * light.radiance * weight,
        };
        true
    }

    /// Turns path and ray to a new direction. False if the path ends here.
    #[inline(always)]
    pub(super) fn turn(
        &self,
        path: &mut Path,
        ray: &mut Ray,
        direction: Vec3,
        weight: Vec3,
        pdf: f32,
    ) -> bool {
        path.throughput *= weight;
        // A direction above the shading horizon but below the triangle's would start inside the solid.
        let outside = direction.dot(self.surface.geometric_normal) > 0.0;
        if !outside || path.throughput == Vec3::ZERO {
            return false;
        }
        path.bounce += 1;
        path.sheets = 0;
        self.redirect(path, ray, direction, pdf);
        true
    }

    /// Lets a path go on elsewhere. Behind a perfect mirror it seems to come from as far away.
    #[inline(always)]
    pub(super) fn redirect(&self, path: &mut Path, ray: &mut Ray, direction: Vec3, pdf: f32) {
        let position = self.surface.position;
        let behind = if pdf < 0.0 { position.distance(path.from) } else { 0.0 };
        path.from = position - direction * behind;
        path.pdf = pdf;
        self.leave(ray, direction);
    }

    #[inline(always)]
    fn leave(&self, ray: &mut Ray, direction: Vec3) {
        *ray = Ray { origin: self.surface.start(direction), direction, t_min: 0.0, t_max: f32::INFINITY };
    }

    /// A surface of Lambert's, which needs no local frame but for sampling.
    #[inline(always)]
    fn matt<const NEEDS: usize>(
        &self,
        diffuse: Vec3,
        path: &mut Path,
        ray: &mut Ray,
        shadow: &mut Shadow,
    ) -> Next {
        let normal = self.surface.shading_normal;
        let shadow = self.light::<NEEDS>(path, shadow, |light| {
            let pdf = normal.dot(light).max(0.0) * std::f32::consts::FRAC_1_PI;
            (diffuse * pdf, pdf)
        });
        if self.follow == 0.0 {
            return Next { shadow, goes_on: false };
        }
        let local = super::sampling::cosine_hemisphere(path.random.pair(self.place + 3));
        let direction = Basis::new(normal).to_world(local);
        // Value over density is the albedo.
        let pdf = local.z * std::f32::consts::FRAC_1_PI;
        let (weight, found) = (diffuse * self.follow, pdf / self.follow);
        Next { shadow, goes_on: pdf > 0.0 && self.turn(path, ray, direction, weight, found) }
    }

    /// A surface with a reflecting layer, and with transmission if it is `THIN`.
    #[inline(always)]
    pub(super) fn layered<const NEEDS: usize, const THIN: bool>(
        &self,
        bsdf: &super::Bsdf,
        path: &mut Path,
        ray: &mut Ray,
        shadow: &mut Shadow,
    ) -> Next {
        let frame = Basis::new(self.surface.shading_normal);
        let Some(seen) = bsdf.seen_from::<THIN>(frame.to_local(-ray.direction)) else { return END };
        let shadow = self.light::<NEEDS>(path, shadow, |light| seen.rough(frame.to_local(light)));
        if self.follow == 0.0 && !THIN {
            return Next { shadow, goes_on: false };
        }
        let choice = path.random.single(self.place + 2);
        if THIN && let Some(weight) = seen.through(choice) {
            path.throughput *= weight;
            path.sheets += 1;
            let ends = u32::from(path.sheets) > SHEETS_PER_SEGMENT_MAX || path.throughput == Vec3::ZERO;
            let direction = ray.direction;
            self.leave(ray, direction);
            return Next { shadow, goes_on: !ends };
        }
        if self.follow == 0.0 {
            return Next { shadow, goes_on: false };
        }
        let Some(sample) = seen.sample(choice, path.random.pair(self.place + 3)) else {
            return Next { shadow, goes_on: false };
        };
        let pdf = match sample.scatter {
            // Light samples know nothing of mirrors, so there is nothing to weigh.
            Scatter::Mirror if self.last => return Next { shadow, goes_on: false },
            Scatter::Mirror => path.mirrored_pdf(),
            Scatter::Rough | Scatter::Through => sample.pdf / self.follow,
        };
        let direction = frame.to_world(sample.direction);
        Next { shadow, goes_on: self.turn(path, ray, direction, sample.weight * self.follow, pdf) }
    }
}

/// Light of sky and sun that a ray which meets nothing brings to its path: a last ray none.
#[inline]
pub(super) fn missed(prepared: &Prepared, tracing: &Tracing, path: &Path, ray: &Ray) -> Vec3 {
    if tracing.is_last_ray(path) {
        return Vec3::ZERO;
    }
    let sky = match prepared.lights.environment(path.from, ray.direction) {
        None => prepared.lights.sky(ray.direction),
        Some(_) if path.pdf < 0.0 => prepared.lights.environment_seen(ray.direction),
        Some((radiance, pdf)) => radiance * power_heuristic(path.pdf, pdf),
    };
    let light = match prepared.lights.sun(path.from, ray.direction) {
        Some(_) if path.pdf == CAUSTIC => sky,
        Some((radiance, _)) if path.pdf < 0.0 => sky + radiance,
        Some((radiance, sun_pdf)) => sky + radiance * power_heuristic(path.pdf, sun_pdf),
        None => sky,
    };
    path.throughput * light
}
