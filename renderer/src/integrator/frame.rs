//! The data that all tiles of one sample of a picture share, and the first rays of paths.

use treewright_accel::Ray;

use super::View;
use super::lens::Lens;
use super::morton::decode_2;
use super::needs::Needs;
use super::prepared::Prepared;
use super::random::PathRandom;
use super::roulette::Roulette;
use super::vertex::{Kernel, Path, Tracing};
use crate::film::{Film, Tile};

/// The data that all tiles of a frame share.
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
    /// The next sample of a film.
    pub(super) fn new(prepared: &'a Prepared, view: &View, needs: Needs, film: &Film) -> Self {
        let lens = Lens::new(&view.camera, film.width(), film.height());
        Self {
            prepared,
            kernel: Kernel::of(needs),
            tracing: Tracing { bounces: view.bounces, pixel_angle: lens.pixel_angle() },
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
        let ray = self.lens.ray(x, y, random.pair(0));
        Some((Path::new(pixel, random, ray.origin), ray))
    }

    /// Whether for rays of a stage, counted from the camera's as 0, it is enough to know that they meet
    /// something.
    #[inline(always)]
    pub(super) fn is_blind(&self, stage: u32) -> bool {
        stage == self.tracing.bounces && !self.kernel.needs.last_hits()
    }
}
