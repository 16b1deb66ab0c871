//! The data that all tiles of one sample of a picture share, and the first rays of paths.

use glam::Vec3;
use treewright_accel::{Hit, Ray};

use super::vertex::{Kernel, Path, Shadow, Tracing};
use super::{
    View, lens::Lens, morton::decode_2, needs::Needs, places, prepared::Prepared, random::PathRandom,
    roulette::Roulette,
};
use crate::film::{Film, Tile};
use crate::limits::{BOUNCES_MAX, FIRST_SHADOW_RAYS_MAX, SOLID_WAYS_MAX};

/// Vertices of further shadow rays of a first hit, beyond those of the longest path.
const FURTHER: u16 = 1 << 15;

const _: () =
    assert!((BOUNCES_MAX + 2) * (SOLID_WAYS_MAX + 2) < FURTHER as u32, "they share no random number");

pub(super) struct Frame<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) kernel: Kernel,
    pub(super) tracing: Tracing,
    roulette: Roulette,
    /// Shadow rays of a first hit: at least 1.
    pub(super) first_shadow_rays: u16,
    lens: Lens,
    seed: u64,
    width: u32,
    height: u32,
    sample: u32,
}

impl<'a> Frame<'a> {
    pub(super) fn new(prepared: &'a Prepared, view: &View, needs: Needs, film: &Film) -> Self {
        let lens = Lens::new(&view.camera, film.width(), film.height());
        let how = prepared.light_sampling();
        Self {
            prepared,
            kernel: Kernel::of(needs),
            tracing: Tracing {
                bounces: view.bounces,
                pixel_angle: lens.pixel_angle(),
                last_rays: prepared.lights.has_lamps(),
            },
            roulette: Roulette::new(how, prepared.learnt.brightness),
            first_shadow_rays: how.first_shadow_rays.clamp(1, FIRST_SHADOW_RAYS_MAX) as u16,
            lens,
            seed: view.seed,
            width: film.width(),
            height: film.height(),
            sample: film.samples(),
        }
    }

    /// The path of a pixel of a tile and its first ray. `None` outside the picture.
    #[inline(always)]
    pub(super) fn begin(&self, tile: &Tile<'_>, pixel: u32) -> Option<(Path, Ray)> {
        let (x, y) = decode_2(pixel);
        let (x, y) = (tile.left + x, tile.top + y);
        if x >= self.width || y >= self.height {
            return None;
        }
        let random = PathRandom::new(self.seed, y * self.width + x, self.sample);
        let ray = self.lens.ray(x, y, random.pair(places::CAMERA));
        Some((Path::new(pixel, random, ray.origin), ray))
    }

    /// A path and its ray before its first hit is shaded, if further shadow rays leave from there.
    #[inline(always)]
    pub(super) fn first_hit(&self, path: &Path, ray: &Ray) -> Option<(Path, Ray)> {
        (self.first_shadow_rays > 1 && path.vertex == 0).then_some((*path, *ray))
    }

    /// The further shadow rays of a first hit: its shading, repeated with other random numbers.
    #[inline(always)]
    pub(super) fn further_shadows(
        &self,
        first: Option<(Path, Ray)>,
        hit: &Hit,
    ) -> impl Iterator<Item = Shadow> {
        first.into_iter().flat_map(move |(path, ray)| {
            (1..self.first_shadow_rays).filter_map(move |number| self.further_shadow(path, ray, hit, number))
        })
    }

    #[inline(never)]
    fn further_shadow(&self, mut path: Path, mut ray: Ray, hit: &Hit, number: u16) -> Option<Shadow> {
        path.vertex = FURTHER + number;
        let (random, vertex) = (path.random, path.vertex);
        let (mut emitted, mut shadow) = (Vec3::ZERO, Shadow::BLANK);
        let shade = self.kernel.vertex;
        let next = shade(self.prepared, &self.tracing, &mut path, &mut ray, hit, &mut emitted, &mut shadow);
        (next.shadow && self.keeps_shadow(random, vertex, &mut shadow)).then_some(shadow)
    }

    /// Decides about a vertex's shadow ray, which brings more light if it stays by chance.
    #[inline(always)]
    pub(super) fn keeps_shadow(&self, random: PathRandom, vertex: u16, shadow: &mut Shadow) -> bool {
        if self.first_shadow_rays > 1 && (vertex == 0 || vertex >= FURTHER) {
            shadow.light *= 1.0 / f32::from(self.first_shadow_rays);
        }
        self.roulette.keeps_shadow(random, vertex, shadow)
    }

    /// Decides whether a path goes on after a vertex; about a last ray that was decided there.
    #[inline(always)]
    pub(super) fn keeps_path(&self, vertex: u16, path: &mut Path) -> bool {
        self.tracing.is_last_ray(path) || self.roulette.keeps_path(vertex, path)
    }

    /// Whether rays of a stage, the camera's as 0, need only know that they meet something.
    #[inline(always)]
    pub(super) fn is_blind(&self, stage: u32) -> bool {
        stage == self.tracing.bounces && !self.kernel.needs.last_hits()
    }
}
