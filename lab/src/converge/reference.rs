//! The converged picture that errors are measured against, and its own error.
//!
//! It is rendered as two independent halves. Their mean is the reference; a quarter of their mean squared
//! difference is the reference's own variance, which every measured error contains. Below about twice that
//! floor a curve shows more of the reference than of the contender.

use treewright_accel::Structure;

use treewright_renderer::film::{Film, Picture};
use treewright_renderer::{frame::Renderer, integrator::View, render_options::RenderOptions};

use super::metrics::Yardstick;

/// Errors below the floor times this are not trusted.
pub(crate) const TRUSTED_FROM: f64 = 2.0;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reference {
    /// Samples a pixel of each of the halves.
    samples_each: u32,
    halves: [Picture; 2],
}

impl Reference {
    /// Renders at least `samples` a pixel unless `go_on` says no. No contender has the picture's seeds.
    pub(crate) fn rendered(
        renderer: &Renderer,
        structure: &Structure,
        view: &View,
        options: &RenderOptions,
        size: [u32; 2],
        samples: u32,
        mut go_on: impl FnMut() -> bool,
    ) -> Self {
        let mut films = [Film::new(size), Film::new(size)];
        while films[0].samples() < samples.div_ceil(2) && go_on() {
            for (half, film) in films.iter_mut().enumerate() {
                // Far from the small numbers that people give to contenders.
                let seed = 0x7265_6665_0000_0000 ^ ((half as u64) << 56);
                renderer.render_with(structure, &View { seed, ..*view }, options, film);
            }
        }
        Self { samples_each: films[0].samples(), halves: films.map(|film| film.picture()) }
    }

    pub(crate) fn samples(&self) -> u32 {
        self.samples_each * 2
    }

    /// The best picture there is: the mean of both halves.
    pub(crate) fn picture(&self) -> Picture {
        let [first, second] = &self.halves;
        let pixels = first.pixels.iter().zip(&second.pixels).map(|(&a, &b)| (a + b) * 0.5).collect();
        Picture { pixels, ..*first }
    }

    /// The reference's own relative mean squared error, estimated from its halves.
    pub(crate) fn floor(&self, yardstick: &Yardstick) -> f64 {
        let [first, second] = &self.halves;
        yardstick.mean_weighted(|pixel, channel| {
            0.5 * (f64::from(first.pixels[pixel][channel]) - f64::from(second.pixels[pixel][channel]))
        })
    }
}

#[cfg(test)]
mod tests {
    use treewright_accel::{BuildChoice, NativeOptions};

    use super::*;
    use crate::converge::testing::matt_scene;

    #[test]
    fn the_floor_is_the_error_that_is_left() {
        let (renderer, view) = matt_scene();
        let native = BuildChoice::Native(NativeOptions::default());
        let structure = renderer.build(&native).expect("it can be built").0;
        let rendered = |samples: u32| {
            let options = RenderOptions::default();
            let reference =
                Reference::rendered(&renderer, &structure, &view, &options, [32, 24], samples, || true);
            assert_eq!(reference.samples(), samples);
            let yardstick = Yardstick::new(reference.picture());
            (reference.floor(&yardstick), yardstick, reference)
        };
        let (coarse_floor, _, coarse) = rendered(32);
        let (fine_floor, fine, _) = rendered(2048);
        let ratio = coarse_floor / fine_floor;
        assert!((40.0..100.0).contains(&ratio), "64 times the samples, {ratio} of the variance");
        let true_error = fine.relative_mse(&coarse.picture());
        assert!(
            (0.75..1.33).contains(&(coarse.floor(&fine) / true_error)),
            "estimated {}, found {true_error}",
            coarse.floor(&fine)
        );
    }
}
