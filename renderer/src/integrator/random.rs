//! Random numbers that depend only on (seed, pixel, sample, place).
//!
//! A path's numbers are a hash of a counter, so no generator is shared between threads and the image does
//! not depend on the order in which pixels are rendered. Each number has its place: the vertex of the path
//! and what it is for. What is left unasked costs nothing and shifts no other number, so a scene without
//! lamps draws the same bounces whether or not code for lamps is there. The mixing function is the finaliser
//! of SplitMix64 (Steele, Lea, Flood: Fast Splittable Pseudorandom Number Generators, OOPSLA 2014).

/// The random numbers of one path.
#[derive(Clone, Copy, Debug, Default)]
pub struct PathRandom {
    key: u64,
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The top 24 bits of each half as a number in [0, 1).
#[inline(always)]
fn to_pair(bits: u64) -> [f32; 2] {
    const STEP: f32 = 1.0 / (1 << 24) as f32;
    // Signed, because that conversion is one instruction.
    [(bits >> 40) as i32 as f32 * STEP, ((bits >> 8) & 0xff_ffff) as i32 as f32 * STEP]
}

impl PathRandom {
    /// Of no path.
    pub(super) const NONE: Self = Self { key: 0 };

    /// The numbers of sample `sample` of pixel `pixel` in a picture with this seed.
    #[inline]
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let place = (u64::from(pixel) << 32) | u64::from(sample);
        Self { key: mix(seed.wrapping_add(GOLDEN)) ^ mix(place.wrapping_add(GOLDEN)) }
    }

    /// The two numbers at a place, each in [0, 1).
    #[inline(always)]
    pub fn pair(&self, place: u32) -> [f32; 2] {
        to_pair(mix(self.key.wrapping_add(GOLDEN.wrapping_mul(u64::from(place) + 1))))
    }

    /// The first number at a place, in [0, 1).
    #[inline(always)]
    pub fn single(&self, place: u32) -> f32 {
        self.pair(place)[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_depend_on_every_part_of_the_key_and_repeat() {
        let first = |seed, pixel, sample, place| PathRandom::new(seed, pixel, sample).pair(place);
        assert_eq!(first(1, 2, 3, 4), first(1, 2, 3, 4));
        assert_ne!(first(1, 2, 3, 4), first(2, 2, 3, 4));
        assert_ne!(first(1, 2, 3, 4), first(1, 3, 3, 4));
        assert_ne!(first(1, 2, 3, 4), first(1, 2, 4, 4));
        assert_ne!(first(1, 2, 3, 4), first(1, 2, 3, 5));
        assert_ne!(first(0, 1, 0, 0), first(0, 0, 1, 0), "pixel and sample must not be interchangeable");
    }

    #[test]
    fn numbers_are_uniform_within_and_across_pixels() {
        // A chi-square statistic over 64 cells has mean 63 and standard deviation 11.2; 110 is above four of them.
        let chi_square = |numbers: Vec<f32>| {
            let expected = numbers.len() as f64 / 64.0;
            let mut cells = [0_u32; 64];
            for number in numbers {
                assert!((0.0..1.0).contains(&number));
                cells[(number * 64.0) as usize] += 1;
            }
            cells.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum::<f64>()
        };
        let path = PathRandom::new(7, 0, 0);
        assert!(chi_square((0..20_000).flat_map(|place| path.pair(place)).collect()) < 110.0);
        assert!(
            chi_square((0..20_000).map(|pixel| PathRandom::new(7, pixel, 0).single(3)).collect()) < 110.0
        );
        assert!(
            chi_square((0..20_000).map(|sample| PathRandom::new(7, 9, sample).single(0)).collect()) < 110.0
        );
    }
}
