//! Stage by stage: all camera rays of a tile, all their shadow rays, all first bounces, and so on.
//!
//! Rays of one class lie side by side, to be traced in packets (compare Laine, Karras and Aila, Wavefront
//! Path Tracing on GPUs, HPG 2013). Pictures are those of the path-by-path way, bit for bit.

use std::ops::Range;

use glam::Vec3;
use treewright_accel::{Hit, Intersector, Packets, Ray, prefetch};

use super::chunk::{Chunk, HITS};
use super::vertex::{Path, Shadow, missed};
use super::{Counts, frame::Frame, random::PathRandom, shadows::through_sheets, surface::WorldFacet};
use crate::film::Tile;

/// Hits by which a facet is fetched ahead: enough to hide a miss behind the gathering of those before.
const AHEAD: usize = 16;

/// Memory of one thread: grows to the largest tile, then stays.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    /// The paths that go on, and the ray of each.
    paths: Vec<Path>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// Shadow rays, the light of each, and whose it is.
    shadow_rays: Vec<Ray>,
    shadow_light: Vec<(Vec3, u32)>,
    occluded: Vec<bool>,
    /// Light of each pixel's sample.
    radiance: Vec<Vec3>,
    chunk: Chunk,
}

const NO_RAY: Ray = Shadow::BLANK.ray;

impl Buffers {
    fn reserve(&mut self, pixels: usize) {
        if self.paths.len() < pixels {
            self.paths.resize(pixels, Path::new(0, PathRandom::default(), Vec3::ZERO));
            self.rays.resize(pixels, NO_RAY);
            self.hits.resize(pixels, None);
            self.shadow_rays.resize(pixels, NO_RAY);
            self.shadow_light.resize(pixels, (Vec3::ZERO, 0));
            self.occluded.resize(pixels, false);
            self.radiance.resize(pixels, Vec3::ZERO);
        }
    }
}

/// Adds a sample to each pixel of a tile. `bounces` groups the rays from the second bounce on.
pub(super) fn render<I: Intersector>(
    frame: &Frame,
    intersector: &I,
    bounces: Packets,
    buffers: &mut Buffers,
    tile: &mut Tile<'_>,
    counts: &mut Counts,
) {
    let pixels = tile.sums.len();
    buffers.reserve(pixels);
    let mut active = 0;
    for pixel in 0..pixels as u32 {
        if let Some((path, ray)) = frame.begin(tile, pixel) {
            buffers.paths[active] = path;
            buffers.rays[active] = ray;
            active += 1;
        }
    }
    buffers.radiance[..pixels].fill(Vec3::ZERO);
    for stage in 0.. {
        if active == 0 {
            break;
        }
        counts.rays += active as u64;
        let packets = packets_of(stage, bounces);
        if frame.is_blind(stage) {
            buffers.finish_blind(frame, intersector, packets, active, counts);
            break;
        }
        intersector.closest_each(packets, &buffers.rays[..active], &mut buffers.hits[..active]);
        let shadows;
        (active, shadows) = buffers.shade(frame, active, counts);
        buffers.light(frame, intersector, packets, shadows, counts);
    }
    for (pixel, sum) in tile.sums.iter_mut().enumerate() {
        counts.add_sample(sum, buffers.radiance[pixel]);
    }
}

/// How rays of a stage go: together those of the first; from the second on they wait for memory most.
fn packets_of(stage: u32, bounces: Packets) -> Packets {
    match stage {
        0 => Packets::SixteenCoherent,
        1 => Packets::Single,
        _ => bounces,
    }
}

impl Buffers {
    /// The rays after the last bounce where only the sky can be found.
    fn finish_blind<I: Intersector>(
        &mut self,
        frame: &Frame,
        intersector: &I,
        packets: Packets,
        active: usize,
        counts: &mut Counts,
    ) {
        intersector.occluded_each(packets, &self.rays[..active], &mut self.occluded[..active]);
        for index in 0..active {
            if self.occluded[index] {
                counts.hits += 1;
            } else {
                let path = &self.paths[index];
                let light = missed(frame.prepared, &frame.tracing, path, &self.rays[index]);
                self.radiance[path.pixel as usize] += light;
            }
        }
    }

    /// Shades all hits; returns how many paths go on and how many shadow rays there are.
    fn shade(&mut self, frame: &Frame, active: usize, counts: &mut Counts) -> (usize, usize) {
        let (mut kept, mut shadows) = (0, 0);
        for first in (0..active).step_by(HITS) {
            let range = first..active.min(first + HITS);
            let mut lanes = [None; HITS];
            self.gather(frame, range.clone(), active, &mut lanes);
            self.scatter(frame, range, &lanes, (&mut kept, &mut shadows), counts);
        }
        (kept, shadows)
    }

    /// Shades the hits of a range that can be shaded together, and notes their lanes.
    fn gather(&mut self, frame: &Frame, range: Range<usize>, active: usize, lanes: &mut [Option<u8>; HITS]) {
        let (prepared, needs) = (frame.prepared, frame.kernel.needs);
        let Self { paths, rays, hits, chunk, .. } = self;
        let (paths, rays, hits) = (&paths[..active], &rays[..active], &hits[..active]);
        let fetch = |index: usize| {
            if let Some(Some(hit)) = hits.get(index) {
                prefetch(&prepared.facets, hit.triangle as usize);
            }
        };
        chunk.clear();
        if range.start == 0 {
            (0..AHEAD).for_each(fetch);
        }
        for (lane, index) in lanes.iter_mut().zip(range) {
            fetch(index + AHEAD);
            let Some(hit) = &hits[index] else { continue };
            let facet = &prepared.facets[hit.triangle as usize];
            let shading = if needs.materials {
                prepared.surface::<true>(facet)
            } else {
                prepared.surface::<false>(facet)
            };
            let instance = if needs.instances { prepared.scene.instance(hit.instance) } else { None };
            let (path, ray) = (&paths[index], &rays[index]);
            let mut standing = if needs.smooth {
                WorldFacet::new::<true>(facet, instance)
            } else {
                WorldFacet::new::<false>(facet, instance)
            };
            let looked_up;
            let shading = if needs.textures && shading.textured {
                looked_up = prepared.look_up(&frame.tracing, path, ray, hit, shading, &mut standing);
                &looked_up
            } else {
                shading
            };
            let tracing = &frame.tracing;
            *lane =
                chunk.gather(needs, tracing, (path, ray, hit), (&standing, shading)).map(|lane| lane as u8);
        }
        chunk.shade(prepared, needs);
    }

    /// Deals out what came of some hits, in their order; those without a lane are shaded one by one.
    fn scatter(
        &mut self,
        frame: &Frame,
        range: Range<usize>,
        lanes: &[Option<u8>; HITS],
        (kept, shadows): (&mut usize, &mut usize),
        counts: &mut Counts,
    ) {
        let prepared = frame.prepared;
        let Self { paths, rays, hits, chunk, shadow_rays, shadow_light, radiance, .. } = self;
        let mut shadow = Shadow::BLANK;
        for (lane, index) in lanes.iter().zip(range) {
            let (path, ray) = (&mut paths[index], &mut rays[index]);
            let (pixel, random, vertex) = (path.pixel, path.random, path.vertex);
            let radiance = &mut radiance[pixel as usize];
            let Some(hit) = &hits[index] else {
                *radiance += missed(prepared, &frame.tracing, path, ray);
                continue;
            };
            counts.hits += 1;
            let together = lane.and_then(|lane| chunk.scatter(lane.into(), path, ray, &mut shadow));
            let next = together.unwrap_or_else(|| {
                (frame.kernel.vertex)(prepared, &frame.tracing, path, ray, hit, radiance, &mut shadow)
            });
            if next.shadow && frame.roulette.keeps_shadow(random, vertex, &mut shadow) {
                shadow_rays[*shadows] = shadow.ray;
                shadow_light[*shadows] = (shadow.light, pixel);
                *shadows += 1;
            }
            if next.goes_on && frame.keeps_path(vertex, path) {
                if *kept < index {
                    paths[*kept] = paths[index];
                    rays[*kept] = rays[index];
                }
                *kept += 1;
            }
        }
    }

    /// Traces the shadow rays and adds the light of those that reach it.
    fn light<I: Intersector>(
        &mut self,
        frame: &Frame,
        intersector: &I,
        packets: Packets,
        shadows: usize,
        counts: &mut Counts,
    ) {
        counts.shadow_rays += shadows as u64;
        let (rays, occluded) = (&self.shadow_rays[..shadows], &mut self.occluded[..shadows]);
        intersector.occluded_each(packets, rays, occluded);
        for index in 0..shadows {
            let (light, pixel) = self.shadow_light[index];
            if !self.occluded[index] {
                self.radiance[pixel as usize] += light;
            } else if frame.kernel.needs.sheets {
                let ray = self.shadow_rays[index];
                self.radiance[pixel as usize] +=
                    light * through_sheets(frame.prepared, intersector, ray, counts);
            }
        }
    }
}
