//! The lights: emissive triangles, the sun, and the sky.
//!
//! Of a few points drawn by power, or by what was learnt, one is taken by its unshadowed light (resampled
//! importance sampling: Talbot, Cline and Egbert, EGSR 2005). The power heuristic takes the density by power.
//! Emissive triangles shine to both sides, because winding cannot be relied on. The sky's gradient is left to
//! the surfaces' own sampling unless it was learnt. Lights without size are found in no other way.

use std::{f32::consts::PI, sync::Arc};

use glam::{Vec2, Vec3, Vec4Swizzles};

use super::lamp_guide::{LampDraw, LampGuide};
use super::sampling::{AliasTable, Basis, luminance, uniform_cone, uniform_triangle};
use super::sky_guide::{Looks, Shares, SkyGuide};
use super::{
    environment::SkyTable, lamp::Lamp, lamp::LightSample, punctual::PunctualLights, surface::Surface,
};
use crate::light_sampling::{LampChoice, LightSampling, SkyChoice};
use crate::scene::{Material, Scene, Sky, Texture};

/// The lights of a scene, ready to be sampled.
#[derive(Clone, Debug)]
pub struct Lights {
    /// The emissive triangles, parallel to `table`.
    lamps: Vec<Lamp>,
    powers: Vec<f64>,
    table: Option<AliasTable>,
    how: LightSampling,
    guide: Option<Arc<SkyGuide>>,
    lamp_guide: Option<Arc<LampGuide>>,
    /// Factor on the weight of a sampled lamp over that of its density by power.
    lamp_weight: f32,
    /// Parallel to `lamps`, or empty where none has a texture.
    skins: Vec<Option<Skin>>,
    textures: Vec<Arc<Texture>>,
    /// Density over area with which a point that emits luminance 1 is sampled.
    density: f32,
    sun: Option<SunDisc>,
    /// Probability that [`Lights::sample`] turns to the sun.
    sun_share: f32,
    sky: Sky,
    environment: Option<SkyTable>,
    /// Probability that [`Lights::sample`] turns to the environment map.
    environment_share: f32,
    punctual: Option<PunctualLights>,
    /// Probability that [`Lights::sample`] turns to a light without size, the environment map aside.
    punctual_share: f32,
}

#[derive(Clone, Copy, Debug)]
struct Skin {
    texture: u32,
    /// Texture coordinates of the corners.
    corners: [Vec2; 3],
    factor: Vec3,
}

/// The emission of a material in the mean over its texture.
pub(super) fn mean_emission(scene: &Scene, material: &Material) -> Vec3 {
    let texture = material.emission_texture.and_then(|number| scene.textures.get(number as usize));
    texture.map_or(material.emission, |texture| material.emission * texture.mean().xyz())
}

/// Number of triangles from which on candidates are drawn.
const FEW_LAMPS: usize = 3;
/// Steps from candidate to candidate on a triangle, which fill it evenly (Roberts, The Unreasonable
/// Effectiveness of Quasirandom Sequences, 2018).
const SHIFTS: [f32; 2] = [0.754_877_7, 0.569_840_3];

/// A number in [0, 1) moved on, and in again at the other end.
#[inline(always)]
fn shifted(number: f32, by: f32) -> f32 {
    let moved = number + by;
    if moved >= 1.0 { moved - 1.0 } else { moved }
}

/// The sun as a cone of constant radiance.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunDisc {
    frame: Basis,
    direction: Vec3,
    cos_half_angle: f32,
    radiance: Vec3,
    solid_angle: f32,
    /// Solid angle density with which it is sampled.
    pdf: f32,
}

impl SunDisc {
    #[inline(always)]
    pub(super) fn sample(&self, u: [f32; 2]) -> LightSample {
        LightSample {
            direction: self.frame.to_world(uniform_cone(u, self.cos_half_angle)),
            distance: f32::INFINITY,
            radiance: self.radiance,
            pdf: self.pdf,
        }
    }
}

/// The share of shadow rays of the sun or a sky beside other lights, where no shares were learnt.
const SHARE: f32 = 0.5;

/// Where a map is learnt, the part of its rays that the guide draws. The map's brightness draws the others: a
/// small sun fills a thousandth of a direction of the guide.
const BY_GUIDE: f32 = 0.5;

/// Density of a direction that the guide or the map's brightness draws.
fn by_either(by_guide: f32, by_map: f32) -> f32 {
    BY_GUIDE * by_guide + (1.0 - BY_GUIDE) * by_map
}

impl Lights {
    /// Collects the lights of a scene: O(triangles of emissive meshes, those of every instance counted).
    pub fn new(scene: &Scene) -> Self {
        let (mut lamps, mut weights, mut skins) = (Vec::new(), Vec::new(), Vec::new());
        let placed = scene.placed();
        for (mesh, instance) in scene.placed_meshes() {
            let material = &scene.materials[mesh.material as usize];
            let emission = mean_emission(scene, material);
            let texture = material.emission_texture.filter(|_| !scene.uvs.is_empty());
            let strength = f64::from(luminance(emission));
            if strength <= 0.0 {
                continue;
            }
            for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                let [a, b, c] = placed.corners(triangle, instance).map(Vec3::from);
                let across = (b - a).cross(c - a);
                let area = f64::from(0.5 * across.length());
                if area > 0.0 && area.is_finite() {
                    let normal = across.normalize_or_zero();
                    lamps.push(Lamp { corner: a, edges: [b - a, c - a], normal, emission, density: 0.0 });
                    weights.push(area * strength);
                    let corners = || {
                        scene.triangles.indices()[triangle as usize].map(|vertex| scene.uvs[vertex as usize])
                    };
                    let factor = material.emission;
                    skins.push(texture.map(|texture| Skin { texture, corners: corners(), factor }));
                }
            }
        }
        let table = AliasTable::new(&weights);
        let sun = scene.sky.sun.filter(|sun| luminance(sun.irradiance) > 0.0).map(|sun| {
            // A point-like sun would have infinite radiance; a tenth of the real half angle is sharp enough.
            let half_angle = sun.half_angle_rad.clamp(5e-4, 1.0);
            let direction = sun.direction.normalize_or(Vec3::Y);
            // 1 - cos, without cancellation.
            let solid_angle = 4.0 * PI * (half_angle * 0.5).sin().powi(2);
            SunDisc {
                frame: Basis::new(direction),
                direction,
                cos_half_angle: half_angle.cos(),
                radiance: sun.irradiance / (PI * half_angle.sin().powi(2)),
                solid_angle,
                pdf: 0.0,
            }
        });
        if skins.iter().all(Option::is_none) {
            skins = Vec::new();
        }
        let textures = if skins.is_empty() { Vec::new() } else { scene.textures.clone() };
        let mut lights = Self {
            lamps,
            powers: weights,
            table,
            how: LightSampling::default(),
            guide: None,
            lamp_guide: None,
            lamp_weight: 1.0,
            skins,
            textures,
            density: 0.0,
            sun,
            sun_share: 0.0,
            sky: scene.sky,
            environment: scene.environment.as_ref().map(SkyTable::new),
            environment_share: 0.0,
            punctual: PunctualLights::of(scene),
            punctual_share: 0.0,
        };
        lights.share_out();
        lights
    }

    pub(super) fn sampling(&self) -> LightSampling {
        self.how
    }

    /// Looks for light in another way from now on: O(lamps).
    pub(super) fn set_sampling(&mut self, how: LightSampling) {
        self.how = how;
        self.share_out();
    }

    /// Takes over the learnt directions of the sky, and the learnt lamps of places.
    pub(super) fn set_guides(&mut self, sky: Option<Arc<SkyGuide>>, lamps: Option<Arc<LampGuide>>) {
        (self.guide, self.lamp_guide) = (sky, lamps);
        self.share_out();
    }

    /// Whether there are lamps among which a choice can be learnt.
    pub(super) fn has_many_lamps(&self) -> bool {
        self.table.is_some() && self.lamps.len() >= FEW_LAMPS
    }

    /// Learns which lamps light places. See [`LampGuide::new`].
    pub(super) fn learn_lamps(
        &self,
        places: &[Surface],
        eye: Vec3,
        seed: u64,
        arrives: impl Fn(&Surface, &LightSample) -> bool + Sync,
    ) -> Option<LampGuide> {
        LampGuide::new(&self.lamps, &self.powers, places, eye, seed, arrives)
    }

    /// The learnt directions of the sky, where they are sampled.
    #[inline(always)]
    fn guide(&self) -> Option<&SkyGuide> {
        if self.how.sky == SkyChoice::Learnt { self.guide.as_deref() } else { None }
    }

    /// The learnt lamps of places, where they are used.
    #[inline(always)]
    fn lamp_guide(&self) -> Option<&LampGuide> {
        if self.how.lamps == LampChoice::Learnt { self.lamp_guide.as_deref() } else { None }
    }

    /// Deals out the shares of the kinds of light, and the densities that follow.
    fn share_out(&mut self) {
        let share = |is_there: bool, others: bool, share: f32| match (is_there, others) {
            (false, _) => 0.0,
            (true, false) => 1.0,
            (true, true) => share,
        };
        let how = self.how;
        self.sun_share = share(self.sun.is_some(), self.table.is_some(), SHARE);
        let has_surfaces = self.sun.is_some() || self.table.is_some();
        self.punctual_share = share(self.punctual.is_some(), has_surfaces, SHARE);
        let others = self.punctual.is_some() || has_surfaces;
        self.environment_share = share(self.has_environment(), others, SHARE);
        let others = (1.0 - self.environment_share) * (1.0 - self.punctual_share);
        let power: f64 = self.powers.iter().sum();
        self.lamp_weight = how.lamp_weight * self.lamp_guide().map_or(1.0, LampGuide::gain);
        let share = f64::from(others * (1.0 - self.sun_share) * self.lamp_weight);
        self.density = if self.table.is_some() { (share / power) as f32 } else { 0.0 };
        for lamp in &mut self.lamps {
            lamp.density = self.density * luminance(lamp.emission);
        }
        let sun_share = self.sun_share;
        if let Some(sun) = &mut self.sun {
            sun.pdf = others * sun_share / sun.solid_angle;
        }
    }

    /// Number of emissive triangles, those of every instance counted.
    pub fn triangle_count(&self) -> usize {
        self.lamps.len()
    }

    /// Whether emissive triangles are sampled.
    pub fn has_lamps(&self) -> bool {
        self.table.is_some()
    }

    /// Whether a sun is sampled.
    pub fn has_sun(&self) -> bool {
        self.sun.is_some()
    }

    /// Whether there are lights without size.
    pub fn has_punctual(&self) -> bool {
        self.punctual.is_some()
    }

    /// Whether the sky is sampled: by an environment map, unless it is black, or by learnt directions.
    pub fn has_environment(&self) -> bool {
        self.environment.is_some() || self.guide().is_some()
    }

    /// Draws a direction towards any light: as [`Lights::sample`], a bright place of the environment, or a
    /// light without size. After the `last` bounce the environment, like the gradient, brings no light.
    pub(super) fn sample_all(
        &self,
        position: Vec3,
        normal: Vec3,
        [mut choice, pick]: [f32; 2],
        u: [f32; 2],
        last: bool,
    ) -> Option<LightSample> {
        if let Some(shares) = self.learnt_shares(position) {
            return self.sample_learnt(position, normal, [choice, pick], u, last, shares);
        }
        let sky_share = self.environment_share;
        if sky_share > 0.0 && last {
            // Draws of the others need not leave room for the sky, nor for light that a bounce would find.
            let light = self.sample_others(position, normal, [choice, pick], u)?;
            let pdf = light.pdf / (1.0 - sky_share);
            return (sky_share < 1.0).then_some(LightSample { pdf, ..light });
        }
        if sky_share > 0.0 {
            if choice < sky_share {
                let light = self.sample_sky(position, pick, u)?;
                let light = LightSample { pdf: light.pdf * sky_share, ..light };
                return light.is_sound().then_some(light);
            }
            choice = (choice - sky_share) / (1.0 - sky_share);
        }
        self.sample_others(position, normal, [choice, pick], u)
    }

    /// Draws a direction towards a kind of light by learnt shares. After the `last` bounce the sky has none.
    fn sample_learnt(
        &self,
        position: Vec3,
        normal: Vec3,
        [choice, pick]: [f32; 2],
        u: [f32; 2],
        last: bool,
        [sky, sun, lamps]: Shares,
    ) -> Option<LightSample> {
        let whole = if last { sun + lamps } else { 1.0 };
        let mut choice = choice * whole;
        if !last {
            if choice < sky {
                let light = self.sample_sky(position, pick, u)?;
                let light = LightSample { pdf: light.pdf * sky, ..light };
                return light.is_sound().then_some(light);
            }
            choice -= sky;
        }
        if choice < sun {
            let light = self.sun.as_ref()?.sample(u);
            return Some(LightSample { pdf: light.pdf * self.sun_factor(sun) / whole, ..light });
        }
        let rest = ((choice - sun) / lamps.max(f32::MIN_POSITIVE)).min(1.0 - f32::EPSILON);
        let choice = self.sun_share + rest * (1.0 - self.sun_share);
        let (lamp, u) = self.lamp([choice, pick], u, position, normal)?;
        let light = lamp.sample(position, u);
        let light = LightSample { pdf: light.pdf * self.lamp_factor_of(lamps) / whole, ..light };
        light.is_sound().then_some(light)
    }

    /// What shadow rays look for, by constant shares.
    pub(super) fn looks(&self) -> Looks {
        let others = 1.0 - self.environment_share;
        Looks {
            shares: [self.environment_share, others * self.sun_share, others * (1.0 - self.sun_share)],
            there: [true, self.has_sun(), self.has_lamps()],
            map: self.environment.is_some(),
            used: self.punctual.is_none(),
        }
    }

    /// The learnt shares at a position; `None` where they are fixed. A sky alone is looked for where that was
    /// found to be worth a ray.
    #[inline(always)]
    fn learnt_shares(&self, position: Vec3) -> Option<Shares> {
        self.guide().filter(|_| self.punctual.is_none()).map(|guide| guide.shares(position))
    }

    /// The factor from the sun's fixed density to that of this share.
    #[inline(always)]
    fn sun_factor(&self, share: f32) -> f32 {
        let fixed = (1.0 - self.environment_share) * self.sun_share;
        if fixed > 0.0 { share / fixed } else { 0.0 }
    }

    /// The factor from the lamps' fixed density to that of this share.
    #[inline(always)]
    fn lamp_factor_of(&self, share: f32) -> f32 {
        let fixed = (1.0 - self.environment_share) * (1.0 - self.sun_share);
        if fixed > 0.0 { share / fixed } else { 0.0 }
    }

    /// The density of lamp samples from a position over [`Lights::lamp_density`]; no sky after `last`.
    #[inline(always)]
    pub(super) fn lamp_factor(&self, position: Vec3, last: bool) -> f32 {
        match self.learnt_shares(position) {
            Some([_, sun, lamps]) => self.lamp_factor_of(lamps) / if last { sun + lamps } else { 1.0 },
            None => 1.0 / if last { 1.0 - self.environment_share } else { 1.0 },
        }
    }

    /// Draws a direction towards any light but the sky.
    fn sample_others(
        &self,
        position: Vec3,
        normal: Vec3,
        [mut choice, pick]: [f32; 2],
        u: [f32; 2],
    ) -> Option<LightSample> {
        if let Some(punctual) = &self.punctual {
            if choice < self.punctual_share {
                let share = (1.0 - self.environment_share) * self.punctual_share;
                return punctual.sample(position, normal, [choice / self.punctual_share, pick], share);
            }
            choice = (choice - self.punctual_share) / (1.0 - self.punctual_share);
        }
        self.sample::<true, true>(position, normal, [choice, pick], u)
    }

    fn sample_sky(&self, position: Vec3, pick: f32, u: [f32; 2]) -> Option<LightSample> {
        let (direction, radiance, pdf) = match (self.guide(), &self.environment) {
            (None, map) => return Some(map.as_ref()?.sample(pick, u)),
            (Some(guide), None) => {
                let (direction, pdf) = guide.sample(position, pick, u);
                (direction, self.sky(direction), pdf)
            }
            (Some(guide), Some(map)) => {
                let direction = match pick < BY_GUIDE {
                    true => guide.sample(position, pick / BY_GUIDE, u).0,
                    false => map.sample((pick - BY_GUIDE) / (1.0 - BY_GUIDE), u).direction,
                };
                let (radiance, by_map) = map.look_up(direction);
                (direction, radiance, by_either(guide.density(position, direction), by_map))
            }
        };
        Some(LightSample { direction, distance: f32::INFINITY, radiance, pdf })
    }

    /// Draws a direction towards the sun or a point on an emissive triangle, if any and not edge on. `LAMPS`
    /// and `SUN` are false where the scene has none.
    #[inline(always)]
    pub fn sample<const LAMPS: bool, const SUN: bool>(
        &self,
        position: Vec3,
        normal: Vec3,
        [choice, pick]: [f32; 2],
        u: [f32; 2],
    ) -> Option<LightSample> {
        if SUN
            && let Some(sun) = &self.sun
            && (!LAMPS || choice < self.sun_share)
        {
            return Some(sun.sample(u));
        }
        if !LAMPS {
            return None;
        }
        let (lamp, u) = self.lamp([choice, pick], u, position, normal)?;
        let light = lamp.sample(position, u);
        light.is_sound().then_some(light)
    }

    /// One of a few emissive triangles that belong to `pick`, by the part of `choice` that does not mean the
    /// sun, and two numbers for [`Lamp::sample`]. `None` if nothing of them reaches the surface.
    #[inline(always)]
    pub(super) fn lamp(
        &self,
        numbers: [f32; 2],
        u: [f32; 2],
        position: Vec3,
        normal: Vec3,
    ) -> Option<(Lamp, [f32; 2])> {
        match self.lamp_guide() {
            None => self.lamp_by_power(numbers, u, position, normal),
            Some(guide) => self.learnt_lamp(guide, numbers, u, position, normal),
        }
    }

    #[inline(always)]
    fn lamp_by_power(
        &self,
        numbers: [f32; 2],
        u: [f32; 2],
        position: Vec3,
        normal: Vec3,
    ) -> Option<(Lamp, [f32; 2])> {
        let table = self.table.as_ref()?;
        let draw = |pick| LampDraw { lamp: table.sample(pick), ratio: 1.0, worth: 1.0 };
        self.resampled(numbers, u, position, normal, draw)
    }

    /// One by the place, where that was learnt; apart, so that the others need no room for it.
    #[inline(never)]
    fn learnt_lamp(
        &self,
        guide: &LampGuide,
        numbers: [f32; 2],
        u: [f32; 2],
        position: Vec3,
        normal: Vec3,
    ) -> Option<(Lamp, [f32; 2])> {
        let Some(of_place) = guide.table(position, normal) else {
            return self.lamp_by_power(numbers, u, position, normal);
        };
        let table = self.table.as_ref()?;
        let draw = |pick| guide.draw(of_place, pick, |pick| table.sample(pick));
        self.resampled(numbers, u, position, normal, draw)
    }

    /// One of a few lamps, each of which `draw` gives for a number in [0, 1).
    #[inline(always)]
    fn resampled(
        &self,
        [choice, pick]: [f32; 2],
        u: [f32; 2],
        position: Vec3,
        normal: Vec3,
        draw: impl Fn(f32) -> LampDraw,
    ) -> Option<(Lamp, [f32; 2])> {
        // Few triangles are one lamp, all of which is about as near.
        let candidates = if self.lamps.len() < FEW_LAMPS { 1 } else { self.how.candidates };
        if candidates == 1 {
            let LampDraw { lamp, ratio, .. } = draw(pick);
            return Some(self.weighed(lamp, u, ratio));
        }
        let step = 1.0 / candidates as f32;
        let mut rest = (choice - self.sun_share) / (1.0 - self.sun_share);
        let (mut sum, mut taken) = (0.0, None);
        for candidate in 0..candidates {
            let shift = candidate as f32;
            // Each draws like the first, and together they lie evenly.
            let LampDraw { lamp, ratio, worth } = draw(shifted(pick, shift * step));
            let at = [shifted(u[0], (shift * SHIFTS[0]).fract()), shifted(u[1], (shift * SHIFTS[1]).fract())];
            let light = self.lamps[lamp].reach(position, normal, at) * worth;
            let weight = light * ratio;
            sum += weight;
            let share = if sum > 0.0 { weight / sum } else { 0.0 };
            if rest < share {
                taken = Some((lamp, at, light));
                rest /= share;
            } else {
                rest = (rest - share) / (1.0 - share);
            }
        }
        let (lamp, at, light) = taken?;
        Some(self.weighed(lamp, at, sum / (light * candidates as f32)))
    }

    /// A lamp and where on it, with the emission of the point times the weight of the choice.
    #[inline(always)]
    fn weighed(&self, number: usize, at: [f32; 2], weight: f32) -> (Lamp, [f32; 2]) {
        let lamp = self.lamps[number];
        let lamp = if self.skins.is_empty() { lamp } else { self.looked_up(number, lamp, at) };
        (Lamp { emission: lamp.emission * (weight * self.lamp_weight), ..lamp }, at)
    }

    #[cold]
    fn looked_up(&self, number: usize, lamp: Lamp, u: [f32; 2]) -> Lamp {
        let Some(Skin { texture, corners: [a, b, c], factor }) = self.skins[number] else { return lamp };
        let [v, w] = uniform_triangle(u);
        let value = self.textures[texture as usize].sample(a + (b - a) * v + (c - a) * w, 0.0);
        Lamp { emission: factor * value.xyz(), ..lamp }
    }

    /// Radiance of the sky in a direction and its sampling density; `None` where it is not sampled.
    #[inline(always)]
    pub fn environment(&self, position: Vec3, direction: Vec3) -> Option<(Vec3, f32)> {
        if self.environment_share == 0.0 {
            return None;
        }
        let looked_up = self.environment.as_ref().map(|environment| environment.look_up(direction));
        let (radiance, pdf) = match (self.guide(), looked_up) {
            (None, looked_up) => looked_up?,
            (Some(guide), None) => (self.sky(direction), guide.density(position, direction)),
            (Some(guide), Some((radiance, by_map))) => {
                (radiance, by_either(guide.density(position, direction), by_map))
            }
        };
        let share = self.learnt_shares(position).map_or(self.environment_share, |[sky, ..]| sky);
        Some((radiance, pdf * share))
    }

    /// The sun, and the probability that [`Lights::sample`] turns to it.
    #[inline(always)]
    pub(super) fn sun_disc(&self) -> (Option<&SunDisc>, f32) {
        (self.sun.as_ref(), self.sun_share)
    }

    /// Density over area with which [`Lights::sample`] draws a point of this emission.
    pub fn lamp_density(&self, emission: Vec3) -> f32 {
        self.density * luminance(emission)
    }

    /// Radiance of the sky in a direction as it is seen, directly or in a mirror.
    #[inline(always)]
    pub fn environment_seen(&self, direction: Vec3) -> Vec3 {
        let environment = self.environment.as_ref();
        environment.map_or_else(|| self.sky(direction), |environment| environment.seen(direction))
    }

    /// Radiance of the sun's disc in a direction and the density with which it is sampled from a position.
    #[inline(always)]
    pub fn sun(&self, position: Vec3, direction: Vec3) -> Option<(Vec3, f32)> {
        let sun = self.sun.as_ref()?;
        if direction.dot(sun.direction) < sun.cos_half_angle {
            return None;
        }
        let factor = self.learnt_shares(position).map_or(1.0, |[_, share, _]| self.sun_factor(share));
        Some((sun.radiance, sun.pdf * factor))
    }

    /// Radiance of the sky's gradient in a direction.
    #[inline(always)]
    pub fn sky(&self, direction: Vec3) -> Vec3 {
        self.sky.horizon + (self.sky.zenith - self.sky.horizon) * direction.y.clamp(0.0, 1.0)
    }
}
