//! Rays that bring little, traced with a lower probability for more (Arvo and Kirk, SIGGRAPH 1990).

use super::vertex::{Path, Shadow};
use super::{places, random::PathRandom, sampling::luminance};
use crate::light_sampling::LightSampling;

#[derive(Clone, Copy, Debug)]
pub(super) struct Roulette {
    /// Luminance at a pixel below which a shadow ray may be left out; 0 for none.
    shadow: f32,
    /// Throughput, relative to that after the first vertex, below which a path may end; 0 for none.
    path: f32,
}

impl Roulette {
    /// For pictures of a mean luminance; 0 where it is not known, and then no shadow ray is left out.
    pub(super) fn new(how: LightSampling, brightness: f32) -> Self {
        Self { shadow: how.shadow_roulette * brightness, path: how.path_roulette }
    }

    /// Decides about the shadow ray of a vertex, and lets it bring more if it stays.
    #[inline(always)]
    pub(super) fn keeps_shadow(&self, random: PathRandom, vertex: u16, shadow: &mut Shadow) -> bool {
        if self.shadow <= 0.0 {
            return true;
        }
        let light = luminance(shadow.light);
        if light >= self.shadow {
            return true;
        }
        let probability = light / self.shadow;
        let stays = random.pair(places::of_roulette(vertex))[0] < probability;
        if stays {
            shadow.light *= 1.0 / probability;
        }
        stays
    }

    /// Decides whether a path goes on after a vertex, and lets it bring more if it does. It does after the
    /// first one: what is dark all over shows what arrives there.
    #[inline(always)]
    pub(super) fn keeps_path(&self, vertex: u16, path: &mut Path) -> bool {
        if self.path <= 0.0 {
            return true;
        }
        let most = path.throughput.max_element();
        if path.first == 0.0 {
            path.first = most;
        }
        let least = self.path * path.first;
        if most >= least {
            return true;
        }
        let probability = most / least;
        let stays = path.random.pair(places::of_roulette(vertex))[1] < probability;
        if stays {
            path.throughput *= 1.0 / probability;
        }
        stays
    }
}
