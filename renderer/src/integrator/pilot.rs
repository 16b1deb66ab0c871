//! A few small frames before the others, from which light sampling learns.

use std::{sync::Arc, time::Instant};

use glam::Vec3;
use rayon::prelude::*;
use treewright_accel::{Hit, Intersector, Ray};

use super::sky_guide::{Kind, Learnt, LightRecord, SkyGuide};
use super::surface::{Surface, WorldFacet};
use super::vertex::{Path, SHADOW_SHARE, Shadow, missed};
use super::{
    Counts, View, frame::Frame, lamp::LightSample, lamp_guide::LampGuide, prepared::Prepared,
    sampling::luminance, shadows::through_sheets,
};
use crate::film::{Film, Tile};
use crate::light_sampling::LearningTimes;

/// Most pixels of a pilot's frame along either side.
const EDGE_MAX: u32 = 160;
const SAMPLES: u32 = 16;
const TILE: u32 = 16;
/// Pixels of a block, a square along Morton's curve: its brightness is what light there is compared with.
const BLOCK: usize = 16;
const BLOCKS: usize = (TILE * TILE) as usize / BLOCK;
/// Share of the picture's brightness that is added to a block's.
const FLOOR: f64 = 0.05;
/// Of the bounces that find no sky one in this many is noted, for all of them.
const IN_VAIN: u32 = 8;
/// By the golden ratio of the numbers that there are, so that no length of paths keeps step with the noting.
const STEP: u32 = 0x9e37_79b9;

#[derive(Debug, Default)]
struct Notes {
    /// With the block of the path's pixel.
    records: Vec<(usize, LightRecord)>,
    /// Where paths met surfaces, if that is wanted.
    places: Vec<Surface>,
    places_wanted: bool,
    /// The block of the path that is followed.
    block: usize,
    /// Decides which bounces that found no sky are noted.
    in_vain: u32,
    of_block: [Brightness; BLOCKS],
}

/// The luminance of a block's samples.
#[derive(Clone, Copy, Debug, Default)]
struct Brightness {
    sum: f64,
    count: u32,
}

impl Brightness {
    fn mean(self) -> f64 {
        self.sum / f64::from(self.count.max(1))
    }

    fn and(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }
}

/// Renders pilot frames of a view. Runs on the rayon pool it is called in.
pub(crate) fn learn<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    [width, height]: [u32; 2],
) -> Learnt {
    let begin = Instant::now();
    let shrink = f64::from(width.max(height)) / f64::from(EDGE_MAX);
    let shrunk =
        |edge: u32| if shrink > 1.0 { (f64::from(edge) / shrink).round().max(1.0) as u32 } else { edge };
    let mut film = Film::new([width, height].map(shrunk));
    // Another picture than those that follow.
    let view = View { seed: view.seed ^ 0x9170_7a5c, ..*view };
    let lights = &prepared.lights;
    let (mut records, mut places) = (Vec::new(), Vec::new());
    let mut blocks: Vec<Brightness> = Vec::new();
    for sample in 0..SAMPLES {
        // One frame meets places enough.
        let places_wanted = sample == 0 && lights.has_many_lamps();
        let frame = Frame::new(prepared, &view, prepared.needs, &film);
        let tiles: Vec<Notes> = film
            .tiles(TILE)
            .into_par_iter()
            .map(|tile| notes_of(&frame, intersector, &tile, places_wanted))
            .collect();
        blocks.resize(tiles.len() * BLOCKS, Brightness::default());
        for (tile, notes) in tiles.into_iter().enumerate() {
            let own = &mut blocks[tile * BLOCKS..][..BLOCKS];
            own.iter_mut().zip(notes.of_block).for_each(|(block, more)| *block = block.and(more));
            records.extend(notes.records.into_iter().map(|(block, record)| (tile * BLOCKS + block, record)));
            places.extend(notes.places);
        }
        film.count_sample();
    }
    let brightness = blocks.iter().copied().fold(Brightness::default(), Brightness::and).mean();
    let relative = |(block, record): (usize, LightRecord)| {
        let around = blocks[block].mean().hypot(FLOOR * brightness);
        let scale = (1.0 / around.max(f64::MIN_POSITIVE)) as f32;
        LightRecord { light: record.light * scale, throughput: record.throughput * scale, ..record }
    };
    let is_sound = |record: &LightRecord| {
        let carried = record.bounces == 0 || record.throughput > 0.0;
        carried && record.light.is_finite() && record.throughput.is_finite()
    };
    let records: Vec<LightRecord> = records.into_iter().map(relative).filter(is_sound).collect();
    let brightness = brightness as f32;
    let guide = SkyGuide::new(&records, &lights.looks());
    let frames_ms = begin.elapsed().as_secs_f64() * 1e3;
    let begin = Instant::now();
    let lamps = learn_lamps(prepared, intersector, &view, &places);
    let times = LearningTimes { frames_ms, lamps_ms: begin.elapsed().as_secs_f64() * 1e3 };
    Learnt { sky: guide.map(Arc::new), lamps: lamps.map(Arc::new), brightness, times }
}

fn notes_of<I: Intersector>(frame: &Frame, intersector: &I, tile: &Tile<'_>, places_wanted: bool) -> Notes {
    let mut notes = Notes { places_wanted, ..Notes::default() };
    for pixel in 0..tile.sums.len() as u32 {
        if let Some((path, ray)) = frame.begin(tile, pixel) {
            notes.block = pixel as usize / BLOCK;
            let radiance = follow(frame, intersector, path, ray, &mut notes);
            let sum = if radiance.is_finite() { f64::from(luminance(radiance)) } else { 0.0 };
            let own = &mut notes.of_block[notes.block];
            *own = own.and(Brightness { sum, count: 1 });
        }
    }
    notes
}

fn learn_lamps<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    places: &[Surface],
) -> Option<LampGuide> {
    let arrives = |place: &Surface, light: &LightSample| {
        let LightSample { direction, distance, .. } = *light;
        let origin = place.start(direction);
        let ray = Ray { origin, direction, t_min: 0.0, t_max: distance * SHADOW_SHARE };
        let through = || through_sheets(prepared, intersector, ray, &mut Counts::default()) != Vec3::ZERO;
        !intersector.occluded(&ray) || (prepared.needs.sheets && through())
    };
    prepared.lights.learn_lamps(places, view.camera.position, view.seed, arrives)
}

impl Notes {
    /// The light that a shadow ray brought.
    fn shadow(&mut self, Shadow { ray, light, .. }: &Shadow) {
        let light = luminance(*light);
        if light > 0.0 && light.is_finite() && ray.origin.is_finite() {
            let kind = if ray.t_max.is_finite() { Kind::Lamp } else { Kind::Sun };
            let (position, direction) = (ray.origin, ray.direction);
            let record = LightRecord { position, direction, light, throughput: 0.0, bounces: 0, kind };
            self.records.push((self.block, record));
        }
    }

    /// That a bounce looked for the sky, with the radiance that it found.
    fn bounce(&mut self, path: &Path, direction: Vec3, sky: Vec3) {
        let (light, throughput) = (luminance(path.throughput * sky), luminance(path.throughput));
        let mut bounces = 1;
        if light == 0.0 {
            self.in_vain = self.in_vain.wrapping_add(STEP);
            if self.in_vain >= u32::MAX / IN_VAIN {
                return;
            }
            bounces = IN_VAIN;
        }
        if light >= 0.0 && light.is_finite() && throughput > 0.0 && path.from.is_finite() {
            let (position, kind) = (path.from, Kind::Sky);
            let record = LightRecord { position, direction, light, throughput, bounces, kind };
            self.records.push((self.block, record));
        }
    }
}

fn place(prepared: &Prepared, ray: &Ray, hit: &Hit) -> Option<Surface> {
    let facet = &prepared.facets[hit.triangle as usize];
    let standing = WorldFacet::new::<false>(facet, prepared.scene.instance(hit.instance));
    Surface::new::<false>(&standing, ray, hit)
}

/// Follows a path and notes where it found light after a bounce, and what it met.
fn follow<I: Intersector>(
    frame: &Frame,
    intersector: &I,
    mut path: Path,
    mut ray: Ray,
    notes: &mut Notes,
) -> Vec3 {
    let (prepared, kernel) = (frame.prepared, &frame.kernel);
    let mut radiance = Vec3::ZERO;
    let mut shadow = Shadow::BLANK;
    loop {
        let last_ray = frame.tracing.is_last_ray(&path);
        let looks = path.pdf > 0.0 && !last_ray;
        let Some(hit) = intersector.closest(&ray) else {
            if looks {
                notes.bounce(&path, ray.direction, prepared.lights.environment_seen(ray.direction));
            }
            radiance += missed(prepared, &frame.tracing, &path, &ray);
            return radiance;
        };
        if notes.places_wanted && !last_ray {
            notes.places.extend(place(prepared, &ray, &hit));
        }
        let (before, direction) = (path, ray.direction);
        let next =
            (kernel.vertex)(prepared, &frame.tracing, &mut path, &mut ray, &hit, &mut radiance, &mut shadow);
        // Behind a sheet the bounce still looks for the sky.
        let passed = next.goes_on && path.sheets > 0;
        if looks && !passed {
            notes.bounce(&before, direction, Vec3::ZERO);
        }
        if next.shadow {
            if intersector.occluded(&shadow.ray) {
                let through = || through_sheets(prepared, intersector, shadow.ray, &mut Counts::default());
                shadow.light *= if kernel.needs.sheets { through() } else { Vec3::ZERO };
            }
            radiance += shadow.light;
            notes.shadow(&shadow);
        }
        if !next.goes_on {
            return radiance;
        }
    }
}
