//! The passes over a chunk: loops without a branch that leaves them, each over few columns.
//!
//! They compute the results of `vertex`, with its functions in its order of operations, so that pictures are
//! equal bit for bit.

use std::ops::Range;

use treewright_accel::Work;

use super::{Chunk, Columns, columns::LANES};
use crate::integrator::sampling::{Basis, cosine_hemisphere};
use crate::integrator::surface::{Surface, barycentric, facing, guarded, interpolated, offset, unit_normal};
use crate::integrator::vertex::{SHADOW_SHARE, density_of_finding, weight_over_density};
use crate::integrator::{LightSample, Needs};
use crate::{integrator::bsdf::Bsdf, integrator::lamp::Lamp, integrator::lights::Lights};
use glam::Vec3;

pub(super) struct Passes<'a> {
    pub(super) lights: &'a Lights,
    pub(super) needs: Needs,
    pub(super) chunk: &'a mut Chunk,
}

impl Work for Passes<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { lights, needs, chunk } = self;
        let (matt, glossy) = (0..chunk.matt.min(LANES), LANES - chunk.glossy.min(LANES)..LANES);
        let columns = &mut *chunk.columns;
        for lanes in [matt.clone(), glossy.clone()] {
            if needs.smooth {
                surfaces::<true>(columns, lanes.clone());
            } else {
                surfaces::<false>(columns, lanes.clone());
            }
            numbers(columns, needs, lanes.clone());
            light(columns, lights, needs, lanes);
        }
        scatter_matt(columns, matt);
        if needs.metals {
            scatter_glossy::<true>(columns, glossy);
        } else {
            scatter_glossy::<false>(columns, glossy);
        }
    }
}

#[inline(always)]
fn surfaces<const INTERPOLATE: bool>(columns: &mut Columns, lanes: Range<usize>) {
    let Columns { arrivals, facets, surfaces, odd, .. } = columns;
    for lane in lanes {
        let (origin, direction) = (arrivals.origin.get(lane), arrivals.direction.get(lane));
        let [a, ab, ac] = facets.corner_and_edges(lane);
        let otherwise = (arrivals.weights[0][lane], arrivals.weights[1][lane]);
        let (u, v) = barycentric(origin, direction, [a, ab, ac], otherwise);
        let unit = unit_normal(ab.cross(ac));
        odd[lane] = unit.is_none().into();
        let geometric_normal = facing(unit.unwrap_or(Vec3::ZERO), direction);
        let shading_normal = if INTERPOLATE {
            let normal = interpolated(facets.normals(lane), u, v);
            let guarded = guarded(normal, geometric_normal, direction);
            if facets.smooth[lane] != 0 { guarded } else { geometric_normal }
        } else {
            geometric_normal
        };
        let position = a + ab * u + ac * v;
        let offset = offset(position, facets.place[lane], facets.longest[lane]);
        surfaces.set(lane, &Surface { position, geometric_normal, shading_normal, offset });
    }
}

#[inline(always)]
fn numbers(columns: &mut Columns, needs: Needs, lanes: Range<usize>) {
    let Columns { arrivals, numbers, .. } = columns;
    if needs.lamps {
        for lane in lanes.clone() {
            let [first, second] = arrivals.random[lane].pair(arrivals.place[lane]);
            numbers.pick[0][lane] = first;
            numbers.pick[1][lane] = second;
        }
    }
    if needs.shadows() {
        for lane in lanes.clone() {
            let [first, second] = arrivals.random[lane].pair(arrivals.place[lane] + 1);
            numbers.light[0][lane] = first;
            numbers.light[1][lane] = second;
        }
    }
    if needs.layers {
        for lane in lanes.clone() {
            numbers.choice[lane] = arrivals.random[lane].single(arrivals.place[lane] + 2);
        }
    }
    for lane in lanes {
        let [first, second] = arrivals.random[lane].pair(arrivals.place[lane] + 3);
        numbers.turn[0][lane] = first;
        numbers.turn[1][lane] = second;
    }
}

/// Samples a light for each hit, as [`Lights::sample`] does.
#[inline(always)]
fn light(columns: &mut Columns, lights: &Lights, needs: Needs, lanes: Range<usize>) {
    if (needs.environment && lights.has_environment()) || (needs.punctual && lights.has_punctual()) {
        return light_one_by_one(columns, lights, lanes);
    }
    let has_lamps = needs.lamps && lights.has_lamps();
    let (sun, sun_share) = lights.sun_disc();
    if has_lamps {
        pick_lamps(columns, lights, if needs.sun { sun_share } else { 0.0 }, lanes.clone());
    }
    match sun.filter(|_| needs.sun) {
        None if !has_lamps => columns.lit[lanes].fill(0),
        None => sample(columns, lanes, |lamp, position, _, u| {
            let light = lamp.sample(position, u);
            (light, light.is_sound())
        }),
        Some(sun) if !has_lamps => sample(columns, lanes, |_, _, _, u| (sun.sample(u), true)),
        Some(sun) => sample(columns, lanes, |lamp, position, choice, u| {
            let from_lamp = lamp.sample(position, u);
            let to_sun = choice < sun_share;
            (select(to_sun, sun.sample(u), from_lamp), to_sun | from_lamp.is_sound())
        }),
    }
}

/// Picks a lamp for each hit that does not turn to the sun, from all over the table.
#[inline(always)]
fn pick_lamps(columns: &mut Columns, lights: &Lights, sun_share: f32, lanes: Range<usize>) {
    let Columns { numbers, surfaces, lamps, .. } = columns;
    for lane in lanes {
        let pick = [numbers.pick[0][lane], numbers.pick[1][lane]];
        if pick[0] < sun_share {
            continue;
        }
        let u = [numbers.light[0][lane], numbers.light[1][lane]];
        let (position, normal) = (surfaces.position.get(lane), surfaces.geometric_normal.get(lane));
        match lights.lamp(pick, u, position, normal) {
            Some((lamp, [first, second])) => {
                lamps.set(lane, &lamp);
                numbers.light[0][lane] = first;
                numbers.light[1][lane] = second;
            }
            None => lamps.set(lane, &Lamp::NONE),
        }
    }
}

/// Samples lights where a table of the whole sky or lights without size are asked.
#[inline(always)]
fn light_one_by_one(columns: &mut Columns, lights: &Lights, lanes: Range<usize>) {
    let Columns { arrivals, numbers, surfaces, sampled, lit, .. } = columns;
    for lane in lanes {
        let pick = [numbers.pick[0][lane], numbers.pick[1][lane]];
        let u = [numbers.light[0][lane], numbers.light[1][lane]];
        let normal = surfaces.geometric_normal.get(lane);
        let last = arrivals.last[lane] != 0;
        let light = lights.sample_all(surfaces.position.get(lane), normal, pick, u, last);
        let light = light.filter(|light| light.direction.dot(normal) > 0.0);
        lit[lane] = light.is_some().into();
        if let Some(light) = light {
            sampled.set(lane, &light);
        }
    }
}

/// `light` gives a light and its soundness from lamp, position, the choice of light, and two numbers.
#[inline(always)]
fn sample(
    columns: &mut Columns,
    lanes: Range<usize>,
    light: impl Fn(Lamp, Vec3, f32, [f32; 2]) -> (LightSample, bool),
) {
    let Columns { numbers, lamps, surfaces, sampled, lit, .. } = columns;
    for lane in lanes {
        let u = [numbers.light[0][lane], numbers.light[1][lane]];
        let position = surfaces.position.get(lane);
        let (light, sound) = light(lamps.get(lane), position, numbers.pick[0][lane], u);
        let above = light.direction.dot(surfaces.geometric_normal.get(lane)) > 0.0;
        lit[lane] = (sound & above).into();
        sampled.set(lane, &light);
    }
}

#[inline(always)]
fn select(first: bool, a: LightSample, b: LightSample) -> LightSample {
    let vector = |a: Vec3, b: Vec3| if first { a } else { b };
    let number = |a: f32, b: f32| if first { a } else { b };
    LightSample {
        direction: vector(a.direction, b.direction),
        distance: number(a.distance, b.distance),
        radiance: vector(a.radiance, b.radiance),
        pdf: number(a.pdf, b.pdf),
    }
}

/// The shadow ray and its light: `value` is value times cosine, `pdf` the surface's own density.
#[inline(always)]
fn shadow(columns: &mut Columns, lane: usize, surface: &Surface, light: &LightSample, value: Vec3, pdf: f32) {
    let Columns { arrivals, departures, lit, .. } = columns;
    let other = density_of_finding(pdf, arrivals.last[lane] != 0, light.distance);
    let weight = weight_over_density(light.pdf, other);
    departures.shadow[lane] = lit[lane] & u32::from(value != Vec3::ZERO);
    departures.shadow_origin.set(lane, surface.start(light.direction));
    departures.shadow_direction.set(lane, light.direction);
    departures.shadow_t_max[lane] = light.distance * SHADOW_SHARE;
    departures.light.set(lane, arrivals.throughput.get(lane) * value * light.radiance * weight);
}

#[inline(always)]
fn turn(
    columns: &mut Columns,
    lane: usize,
    surface: &Surface,
    direction: Vec3,
    weight: Vec3,
    pdf: f32,
    sound: bool,
) {
    let Columns { arrivals, departures, .. } = columns;
    let follow = arrivals.follow[lane];
    let throughput = arrivals.throughput.get(lane) * (weight * follow);
    let outside = direction.dot(surface.geometric_normal) > 0.0;
    let goes_on = sound & outside & (throughput != Vec3::ZERO) & (follow != 0.0);
    departures.goes_on[lane] = goes_on.into();
    departures.origin.set(lane, surface.start(direction));
    departures.direction.set(lane, direction);
    departures.throughput.set(lane, throughput);
    departures.pdf[lane] = pdf / follow;
}

#[inline(always)]
fn scatter_matt(columns: &mut Columns, lanes: Range<usize>) {
    for lane in lanes {
        let surface = columns.surfaces.get(lane);
        let diffuse = columns.materials.diffuse.get(lane);
        let normal = surface.shading_normal;
        let light = columns.sampled.get(lane);
        let light_pdf = normal.dot(light.direction).max(0.0) * std::f32::consts::FRAC_1_PI;
        shadow(columns, lane, &surface, &light, diffuse * light_pdf, light_pdf);
        let u = [columns.numbers.turn[0][lane], columns.numbers.turn[1][lane]];
        let local = cosine_hemisphere(u);
        let direction = Basis::new(normal).to_world(local);
        let pdf = local.z * std::f32::consts::FRAC_1_PI;
        turn(columns, lane, &surface, direction, diffuse, pdf, pdf > 0.0);
    }
}

/// `METALS` is false where no material is a rough metal.
#[inline(always)]
fn scatter_glossy<const METALS: bool>(columns: &mut Columns, lanes: Range<usize>) {
    for lane in lanes {
        let surface = columns.surfaces.get(lane);
        let bsdf = Bsdf::from(columns.materials.get::<METALS>(lane));
        let frame = Basis::new(surface.shading_normal);
        let view = frame.to_local(-columns.arrivals.direction.get(lane));
        let seen = bsdf.see::<false>(view);
        let above = view.z > 0.0;
        let light = columns.sampled.get(lane);
        let (value, light_pdf) = seen.rough(frame.to_local(light.direction));
        shadow(columns, lane, &surface, &light, value, light_pdf);
        columns.departures.shadow[lane] &= u32::from(above);
        let u = [columns.numbers.turn[0][lane], columns.numbers.turn[1][lane]];
        let (direction, weight, pdf, sound) = seen.sample_rough(columns.numbers.choice[lane], u);
        let direction = frame.to_world(direction);
        turn(columns, lane, &surface, direction, weight, pdf, sound & above);
    }
}
