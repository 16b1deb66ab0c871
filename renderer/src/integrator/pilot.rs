//! A few small frames before the others, from which light sampling learns.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use treewright_accel::{Intersector, Ray};

use super::View;
use super::frame::Frame;
use super::prepared::Prepared;
use super::sampling::luminance;
use super::sky_guide::{Kind, Learnt, LightRecord, SkyGuide};
use super::vertex::{Path, Shadow, missed};
use crate::film::Film;

/// Most pixels of a pilot's frame along either side.
const EDGE_MAX: u32 = 160;

/// Samples of each of its pixels.
const SAMPLES: u32 = 16;

const TILE: u32 = 16;

/// Renders pilot frames of a view. Runs on the rayon pool it is called in.
pub(crate) fn learn<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    [width, height]: [u32; 2],
) -> Learnt {
    let shrink = f64::from(width.max(height)) / f64::from(EDGE_MAX);
    let shrunk =
        |edge: u32| if shrink > 1.0 { (f64::from(edge) / shrink).round().max(1.0) as u32 } else { edge };
    let mut film = Film::new(shrunk(width), shrunk(height));
    let pixels = film.width() as usize * film.height() as usize;
    // Another picture than those that follow.
    let view = View { seed: view.seed ^ 0x9170_7a5c, ..*view };
    let (mut records, mut light) = (Vec::new(), 0.0);
    for _ in 0..SAMPLES {
        let frame = Frame::new(prepared, &view, prepared.needs, &film);
        let tiles: Vec<(Vec<LightRecord>, f64)> = film
            .tiles(TILE)
            .into_par_iter()
            .map(|tile| {
                let (mut records, mut sum) = (Vec::new(), 0.0);
                for pixel in 0..tile.sums.len() as u32 {
                    if let Some((path, ray)) = frame.begin(&tile, pixel) {
                        let radiance = follow(&frame, intersector, path, ray, &mut records);
                        sum += if radiance.is_finite() { f64::from(luminance(radiance)) } else { 0.0 };
                    }
                }
                (records, sum)
            })
            .collect();
        for (tile_records, sum) in tiles {
            records.extend(tile_records);
            light += sum;
        }
        film.count_sample();
    }
    let brightness = (light / (pixels as f64 * f64::from(SAMPLES))) as f32;
    let lights = &prepared.lights;
    let guide = SkyGuide::new(&records);
    let guide = guide.map(|guide| guide.keep_kinds([true, lights.has_sun(), lights.has_lamps()]));
    Learnt { sky: guide.map(Arc::new), brightness }
}

fn note(records: &mut Vec<LightRecord>, position: Vec3, ray: &Ray, light: Vec3, kind: Kind) {
    let light = luminance(light);
    if light > 0.0 && light.is_finite() && position.is_finite() {
        records.push(LightRecord { position, direction: ray.direction, light, kind });
    }
}

/// Follows a path and notes where it found the sky after a bounce.
fn follow<I: Intersector>(
    frame: &Frame,
    intersector: &I,
    mut path: Path,
    mut ray: Ray,
    records: &mut Vec<LightRecord>,
) -> Vec3 {
    let (prepared, kernel) = (frame.prepared, &frame.kernel);
    let mut radiance = Vec3::ZERO;
    let mut shadow = Shadow::BLANK;
    loop {
        let Some(hit) = intersector.closest(&ray) else {
            radiance += missed(prepared, &path, &ray);
            if path.pdf > 0.0 {
                let sky = prepared.lights.environment_seen(ray.direction);
                note(records, path.from, &ray, path.throughput * sky, Kind::Sky);
            }
            return radiance;
        };
        let next =
            (kernel.vertex)(prepared, &frame.tracing, &mut path, &mut ray, &hit, &mut radiance, &mut shadow);
        if next.shadow && !intersector.occluded(&shadow.ray) {
            radiance += shadow.light;
            let kind = if shadow.ray.t_max.is_finite() { Kind::Lamp } else { Kind::Sun };
            note(records, shadow.ray.origin, &shadow.ray, shadow.light, kind);
        }
        if !next.goes_on {
            return radiance;
        }
    }
}
