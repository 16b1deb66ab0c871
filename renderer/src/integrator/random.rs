//! Random numbers that depend only on (seed, pixel, sample, place).
//!
//! No generator is shared between threads, and pictures do not depend on the order of pixels. A place is the
//! vertex of the path and a purpose: a number that is not drawn shifts no other.
//!
//! The pairs of one place of a pixel are points of Sobol's first two dimensions with Owen's scrambling, other
//! ones for each place (Burley, JCGT 2020; Kollig and Keller, Eurographics 2002). The second dimension is a
//! product with Pascal's matrix, in five steps (Ahmed, EGSR 2024). Seeds are mixed by the finaliser of
//! SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).

/// The random numbers of one path.
#[derive(Clone, Copy, Debug, Default)]
pub struct PathRandom {
    /// Of seed and pixel.
    key: u32,
    /// The sample's number, its bits the other way round.
    reversed: u32,
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Owen's scrambling of reversed bits by a seed (Laine and Karras 2011, Vegdahl's constants of 2021).
#[inline(always)]
fn scrambled(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The bits times Pascal's matrix of binomial coefficients, modulo 2.
#[inline(always)]
fn times_pascal(mut x: u32) -> u32 {
    x ^= (x & 0xaaaa_aaaa) >> 1;
    x ^= (x & 0xcccc_cccc) >> 2;
    x ^= (x & 0xf0f0_f0f0) >> 4;
    x ^= (x & 0xff00_ff00) >> 8;
    x ^ (x & 0xffff_0000) >> 16
}

/// The top 24 bits as a number in [0, 1).
#[inline(always)]
fn to_unit(bits: u32) -> f32 {
    const STEP: f32 = 1.0 / (1 << 24) as f32;
    // Signed, because that conversion is one instruction.
    (bits >> 8) as i32 as f32 * STEP
}

impl PathRandom {
    pub(super) const NONE: Self = Self { key: 0, reversed: 0 };

    /// The numbers of sample `sample` of pixel `pixel` in a picture with this seed.
    #[inline]
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let key = mix(mix(seed.wrapping_add(GOLDEN)) ^ mix(u64::from(pixel).wrapping_add(GOLDEN)));
        Self { key: (key >> 32) as u32, reversed: sample.reverse_bits() }
    }

    /// The two numbers at a place, each in [0, 1).
    #[inline(always)]
    pub fn pair(&self, place: u32) -> [f32; 2] {
        let mixed = mix(((u64::from(self.key) << 32) | u64::from(place)).wrapping_mul(GOLDEN));
        let (first, second) = (mixed as u32, (mixed >> 32) as u32);
        let index = scrambled(self.reversed, first.rotate_left(16) ^ second).reverse_bits();
        let (x, y) = (scrambled(index, first), scrambled(times_pascal(index), second));
        [to_unit(x.reverse_bits()), to_unit(y.reverse_bits())]
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
        // A chi-square statistic over 64 cells has mean 63 and standard deviation 11.2.
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

    #[test]
    fn samples_fill_the_square_evenly() {
        for (pixel, place) in [(0, 1), (7, 4), (123_456, 9)] {
            // A run of 4^n samples has one point in each cell of every grid of 4^n cells.
            for (first, count) in [(0, 16), (0, 64), (64, 64), (256, 256)] {
                for across in (0..).map(|power| 1 << power).take_while(|across| *across <= count) {
                    let mut cells = vec![0; count];
                    for sample in first..first + count as u32 {
                        let [x, y] = PathRandom::new(5, pixel, sample).pair(place);
                        let (column, row) = (x * across as f32, y * (count / across) as f32);
                        cells[row as usize * across + column as usize] += 1;
                    }
                    assert!(
                        cells.iter().all(|cell| *cell == 1),
                        "{count} samples, {across} columns: {cells:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn places_and_pixels_have_nothing_to_do_with_each_other() {
        // The correlation of 4096 independent pairs has a standard deviation of 1/64.
        let count = 4096;
        let correlation = |pairs: Vec<(f32, f32)>| {
            let sum: f64 = pairs.iter().map(|(a, b)| f64::from((a - 0.5) * (b - 0.5))).sum();
            (sum / f64::from(count) * 12.0).abs()
        };
        let number =
            |pixel, sample, place, which: usize| PathRandom::new(1, pixel, sample).pair(place)[which];
        for (a, b) in
            [((3, 1, 0), (3, 2, 0)), ((3, 1, 0), (3, 1, 1)), ((3, 1, 1), (4, 1, 1)), ((8, 5, 0), (9, 6, 1))]
        {
            let pairs = (0..count as u32)
                .map(|sample| (number(a.0, sample, a.1, a.2), number(b.0, sample, b.1, b.2)));
            let found = correlation(pairs.collect());
            assert!(found < 0.07, "{a:?} {b:?}: {found}");
        }
    }
}
