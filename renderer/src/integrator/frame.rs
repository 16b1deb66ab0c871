//! The data that all tiles of one sample of a picture share, and the first rays of paths.

use treewright_accel::Ray;

use super::vertex::{Kernel, Path, Tracing};
use super::{
    View, lens::Lens, morton::decode_2, needs::Needs, places, prepared::Prepared, random::PathRandom,
    roulette::Roulette,
};
use crate::film::{Film, Tile};

pub(super) struct Frame<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) kernel: Kernel,
    pub(super) tracing: Tracing,
    pub(super) roulette: Roulette,
    lens: Lens,
    seed: u64,
    width: u32,
    height: u32,
    sample: u32,
}

impl<'a> Frame<'a> {
    pub(super) fn new(prepared: &'a Prepared, view: &View, needs: Needs, film: &Film) -> Self {
        let lens = Lens::new(&view.camera, film.width(), film.height());
        Self {
            prepared,
            kernel: Kernel::of(needs),
            tracing: Tracing {
                bounces: view.bounces,
                pixel_angle: lens.pixel_angle(),
                last_rays: prepared.lights.has_lamps(),
            },
            roulette: Roulette::new(prepared.light_sampling(), prepared.learnt.brightness),
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
