//! Image errors on pictures whose error is known: equal ones, constant offsets, noise of known variance.

use glam::Vec3;
use proptest::prelude::*;

use super::*;
use treewright_renderer::integrator::random::PathRandom;

const WIDTH: u32 = 24;
const HEIGHT: u32 = 18;

fn picture(value: impl Fn(u32) -> f32) -> Picture {
    let pixels = (0..WIDTH * HEIGHT).map(|index| Vec3::splat(value(index))).collect();
    Picture { width: WIDTH, height: HEIGHT, pixels }
}

fn gradient() -> Picture {
    picture(|index| 0.2 + index as f32 / (WIDTH * HEIGHT) as f32)
}

fn noisy(clean: &Picture, strength: f32, seed: u64) -> Picture {
    let mut noisy = clean.clone();
    for (index, pixel) in noisy.pixels.iter_mut().enumerate() {
        let [u, v] = PathRandom::new(seed, index as u32, 0).pair(0);
        *pixel += Vec3::new(u - 0.5, v - 0.5, u * v - 0.25) * strength;
    }
    noisy
}

#[test]
fn the_same_picture_has_no_error() {
    for clean in [gradient(), picture(|_| 0.0)] {
        let yardstick = Yardstick::new(clean.clone());
        assert_eq!(yardstick.relative_mse(&clean), 0.0);
    }
}

#[test]
fn a_constant_offset_follows_the_formula() {
    // Grey of level 2, all pixels off by 0.2: 0.04 over 4 and a hundredth of 4.
    let yardstick = Yardstick::new(picture(|_| 2.0));
    let error = yardstick.relative_mse(&picture(|_| 2.2));
    assert!((error - 0.04 / 4.04).abs() < 1e-6, "{error}");
    // Relative: another unit of radiance changes nothing.
    let scaled = Yardstick::new(picture(|_| 2e6)).relative_mse(&picture(|_| 2.2e6));
    assert!((error - scaled).abs() < 1e-6);
}

#[test]
#[should_panic(expected = "a reference of their size")]
fn other_sizes_are_refused() {
    let small = Picture { width: 1, height: 1, pixels: vec![Vec3::ONE] };
    Yardstick::new(gradient()).relative_mse(&small);
}

proptest! {
    #[test]
    fn errors_are_finite_and_grow_with_the_noise(seed in any::<u64>(), strength in 0.01_f32..0.2) {
        let clean = gradient();
        let yardstick = Yardstick::new(clean.clone());
        let (less, more) = (noisy(&clean, strength, seed), noisy(&clean, strength * 2.0, seed));
        let ratio = yardstick.relative_mse(&more) / yardstick.relative_mse(&less);
        prop_assert!((ratio - 4.0).abs() < 1e-2, "the error is quadratic: {}", ratio);
    }
}
