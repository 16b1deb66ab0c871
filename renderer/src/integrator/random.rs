//! Random numbers that depend only on (seed, pixel, sample, dimension).
//!
//! A path's numbers are a hash of a counter, so no generator is shared between threads and the image does
//! not depend on the order in which pixels are rendered. The mixing function is the finaliser of SplitMix64
//! (Steele, Lea, Flood: Fast Splittable Pseudorandom Number Generators, OOPSLA 2014).

/// The random numbers of one path.
#[derive(Clone, Debug)]
pub struct PathRandom {
    key: u64,
    counter: u64,
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The top 24 bits of each half as a number in [0, 1).
fn to_pair(bits: u64) -> [f32; 2] {
    const STEP: f32 = 1.0 / (1 << 24) as f32;
    [(bits >> 40) as f32 * STEP, ((bits >> 8) & 0xff_ffff) as f32 * STEP]
}

impl PathRandom {
    /// The numbers of sample `sample` of pixel `pixel` in a picture with this seed.
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let place = (u64::from(pixel) << 32) | u64::from(sample);
        Self { key: mix(seed.wrapping_add(GOLDEN)) ^ mix(place.wrapping_add(GOLDEN)), counter: 0 }
    }

    /// The next two numbers, each in [0, 1).
    pub fn pair(&mut self) -> [f32; 2] {
        self.counter = self.counter.wrapping_add(GOLDEN);
        to_pair(mix(self.key.wrapping_add(self.counter)))
    }

    /// The next number in [0, 1).
    pub fn single(&mut self) -> f32 {
        self.pair()[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_depend_on_every_part_of_the_key_and_repeat() {
        let first = |seed, pixel, sample| PathRandom::new(seed, pixel, sample).pair();
        assert_eq!(first(1, 2, 3), first(1, 2, 3));
        assert_ne!(first(1, 2, 3), first(2, 2, 3));
        assert_ne!(first(1, 2, 3), first(1, 3, 3));
        assert_ne!(first(1, 2, 3), first(1, 2, 4));
        assert_ne!(first(0, 1, 0), first(0, 0, 1), "pixel and sample must not be interchangeable");
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
        let mut path = PathRandom::new(7, 0, 0);
        assert!(chi_square((0..20_000).flat_map(|_| path.pair()).collect()) < 110.0);
        assert!(chi_square((0..20_000).map(|pixel| PathRandom::new(7, pixel, 0).single()).collect()) < 110.0);
        assert!(
            chi_square((0..20_000).map(|sample| PathRandom::new(7, 9, sample).single()).collect()) < 110.0
        );
    }
}
