//! The converged picture that errors are measured against, and its own error.
//!
//! It is rendered as two independent halves. Their mean is the reference; a quarter of their mean squared
//! difference is the reference's own variance, which every measured error contains. Below about twice that
//! floor a curve shows more of the reference than of the contender.

use treewright_accel::Structure;

use treewright_renderer::film::{Film, Picture};
use treewright_renderer::frame::Renderer;
use treewright_renderer::integrator::View;
use treewright_renderer::render_options::RenderOptions;

use super::metrics::Yardstick;
use super::reference_key::ReferenceKey;

/// Errors below the floor times this are not trusted.
pub const TRUSTED_FROM: f64 = 2.0;

/// A converged picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Its scene, view and settings.
    pub key: ReferenceKey,
    /// Samples a pixel of each of the halves.
    pub samples_each: u32,
    /// Two independent pictures.
    pub halves: [Picture; 2],
}

impl Reference {
    /// A reference without samples.
    pub fn empty(key: ReferenceKey) -> Self {
        let [width, height] = key.size;
        let black = Film::new(width, height).picture();
        Self { key, samples_each: 0, halves: [black.clone(), black] }
    }

    /// Samples a pixel of the reference.
    pub fn samples(&self) -> u32 {
        self.samples_each * 2
    }

    /// Adds samples until there are at least `samples` a pixel, or `go_on` says no, which is asked before
    /// each pair of frames. No contender has the picture's seeds.
    pub fn extend(
        &mut self,
        renderer: &Renderer,
        structure: &Structure,
        view: &View,
        options: &RenderOptions,
        samples: u32,
        mut go_on: impl FnMut() -> bool,
    ) {
        let missing = samples.div_ceil(2).saturating_sub(self.samples_each);
        let [width, height] = self.key.size;
        let mut films = [Film::new(width, height), Film::new(width, height)];
        while films[0].samples() < missing && go_on() {
            for (half, film) in films.iter_mut().enumerate() {
                let view = View { seed: reference_seed(half as u64, self.samples_each), ..*view };
                renderer.render_with(structure, &view, options, film);
            }
        }
        let added = films[0].samples();
        if added == 0 {
            return;
        }
        let share = added as f32 / (self.samples_each + added) as f32;
        for (half, film) in self.halves.iter_mut().zip(films) {
            for (old, new) in half.pixels.iter_mut().zip(film.picture().pixels) {
                *old += (new - *old) * share;
            }
        }
        self.samples_each += added;
    }

    /// The best picture there is: the mean of both halves.
    pub fn picture(&self) -> Picture {
        let [first, second] = &self.halves;
        let pixels = first.pixels.iter().zip(&second.pixels).map(|(&a, &b)| (a + b) * 0.5).collect();
        Picture { pixels, ..*first }
    }

    /// The reference's own relative mean squared error, estimated from its halves.
    ///
    /// # Panics
    /// If the yardstick is of another size.
    pub fn floor(&self, yardstick: &Yardstick) -> f64 {
        let [first, second] = &self.halves;
        yardstick.mean_weighted(|pixel, channel| {
            0.5 * (f64::from(first.pixels[pixel][channel]) - f64::from(second.pixels[pixel][channel]))
        })
    }
}

/// Seeds of references: far from the small numbers that people give to contenders, and another one for each
/// half and each time that samples are added.
fn reference_seed(half: u64, from_sample: u32) -> u64 {
    0x7265_6665_0000_0000 ^ (half << 56) ^ u64::from(from_sample)
}

#[cfg(test)]
mod tests {
    use treewright_accel::{BuildChoice, NativeOptions};

    use super::*;
    use crate::converge::testing::matt_scene;

    fn view_of_a_scene() -> (Renderer, Structure, View) {
        let (renderer, view) = matt_scene();
        let structure =
            renderer.build(&BuildChoice::Native(NativeOptions::default())).expect("it can be built").0;
        (renderer, structure, view)
    }

    #[test]
    fn the_floor_is_the_error_that_is_left() {
        let (renderer, structure, view) = view_of_a_scene();
        let key = ReferenceKey::new(renderer.scene(), &view, 32, 24);
        let rendered = |samples: u32| {
            let mut reference = Reference::empty(key.clone());
            reference.extend(&renderer, &structure, &view, &RenderOptions::default(), samples, || true);
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

    #[test]
    fn samples_can_be_added_later() {
        let (renderer, structure, view) = view_of_a_scene();
        let key = ReferenceKey::new(renderer.scene(), &view, 16, 12);
        let mut reference = Reference::empty(key);
        reference.extend(&renderer, &structure, &view, &RenderOptions::default(), 8, || true);
        let before = reference.clone();
        reference.extend(&renderer, &structure, &view, &RenderOptions::default(), 8, || true);
        assert_eq!(reference, before, "it has what is asked for");
        let mut left = 3;
        reference.extend(&renderer, &structure, &view, &RenderOptions::default(), 100, || {
            left -= 1;
            left >= 0
        });
        assert_eq!(reference.samples(), 8 + 6, "it stops when told");
        assert_ne!(reference.halves[0], reference.halves[1]);
        let mut pairs = before.halves[0].pixels.iter().zip(&reference.halves[0].pixels);
        assert!(pairs.any(|(a, b)| a != b), "the later samples are others");
    }
}
