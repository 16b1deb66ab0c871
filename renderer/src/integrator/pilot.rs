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

#[derive(Debug, Default)]
struct Notes {
    records: Vec<LightRecord>,
    /// Where paths met surfaces, if that is wanted.
    places: Vec<Surface>,
    places_wanted: bool,
    /// Sum of the luminance of all samples.
    light: f64,
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
    let pixels = film.width() as usize * film.height() as usize;
    // Another picture than those that follow.
    let view = View { seed: view.seed ^ 0x9170_7a5c, ..*view };
    let lights = &prepared.lights;
    let mut all = Notes::default();
    for sample in 0..SAMPLES {
        // One frame meets places enough.
        let places_wanted = sample == 0 && lights.has_many_lamps();
        let frame = Frame::new(prepared, &view, prepared.needs, &film);
        let tiles: Vec<Notes> = film
            .tiles(TILE)
            .into_par_iter()
            .map(|tile| notes_of(&frame, intersector, &tile, places_wanted))
            .collect();
        for notes in tiles {
            all.records.extend(notes.records);
            all.places.extend(notes.places);
            all.light += notes.light;
        }
        film.count_sample();
    }
    let brightness = (all.light / (pixels as f64 * f64::from(SAMPLES))) as f32;
    let guide = SkyGuide::new(&all.records);
    let guide = guide.map(|guide| guide.keep_kinds([true, lights.has_sun(), lights.has_lamps()]));
    let frames_ms = begin.elapsed().as_secs_f64() * 1e3;
    let begin = Instant::now();
    let lamps = learn_lamps(prepared, intersector, &view, &all.places);
    let times = LearningTimes { frames_ms, lamps_ms: begin.elapsed().as_secs_f64() * 1e3 };
    Learnt { sky: guide.map(Arc::new), lamps: lamps.map(Arc::new), brightness, times }
}

fn notes_of<I: Intersector>(frame: &Frame, intersector: &I, tile: &Tile<'_>, places_wanted: bool) -> Notes {
    let mut notes = Notes { places_wanted, ..Notes::default() };
    for pixel in 0..tile.sums.len() as u32 {
        if let Some((path, ray)) = frame.begin(tile, pixel) {
            let radiance = follow(frame, intersector, path, ray, &mut notes);
            notes.light += if radiance.is_finite() { f64::from(luminance(radiance)) } else { 0.0 };
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

fn note(records: &mut Vec<LightRecord>, position: Vec3, ray: &Ray, light: Vec3, kind: Kind) {
    let light = luminance(light);
    if light > 0.0 && light.is_finite() && position.is_finite() {
        records.push(LightRecord { position, direction: ray.direction, light, kind });
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
        let Some(hit) = intersector.closest(&ray) else {
            radiance += missed(prepared, &frame.tracing, &path, &ray);
            if path.pdf > 0.0 && !last_ray {
                let sky = prepared.lights.environment_seen(ray.direction);
                note(&mut notes.records, path.from, &ray, path.throughput * sky, Kind::Sky);
            }
            return radiance;
        };
        if notes.places_wanted && !last_ray {
            notes.places.extend(place(prepared, &ray, &hit));
        }
        let next =
            (kernel.vertex)(prepared, &frame.tracing, &mut path, &mut ray, &hit, &mut radiance, &mut shadow);
        if next.shadow && !intersector.occluded(&shadow.ray) {
            radiance += shadow.light;
            let kind = if shadow.ray.t_max.is_finite() { Kind::Lamp } else { Kind::Sun };
            note(&mut notes.records, shadow.ray.origin, &shadow.ray, shadow.light, kind);
        }
        if !next.goes_on {
            return radiance;
        }
    }
}
