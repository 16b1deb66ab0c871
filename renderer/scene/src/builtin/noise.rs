//! Repeatable noise: gradient noise after Perlin (2002) over a hashed lattice, and sums of its octaves.

use glam::Vec3;

/// Scrambles 64 bits (the finaliser of SplitMix64, Steele et al. 2014).
pub(super) fn scramble(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// A number from 0 up to 1 for whole coordinates.
pub(super) fn at_cell(seed: u64, x: i64, y: i64, z: i64) -> f32 {
    let mixed = [x, y, z].into_iter().fold(scramble(seed ^ 0x9e37_79b9_7f4a_7c15), |hash, coordinate| {
        scramble(hash.wrapping_add(coordinate as u64).wrapping_add(0x9e37_79b9_7f4a_7c15))
    });
    (mixed >> 40) as f32 / (1 << 24) as f32
}

/// Gradient noise, about -1 to 1, zero at whole coordinates, smooth in between.
pub(super) fn gradient(seed: u64, point: Vec3) -> f32 {
    let cell = point.floor();
    let inside = point - cell;
    let fade = inside * inside * inside * (inside * (inside * 6.0 - 15.0) + 10.0);
    let [x, y, z] = [cell.x as i64, cell.y as i64, cell.z as i64];
    let corner = |dx: i64, dy: i64, dz: i64| {
        let angle = at_cell(seed, x + dx, y + dy, z + dz) * 16.0;
        slope(angle as u32, inside - Vec3::new(dx as f32, dy as f32, dz as f32))
    };
    let mix = |a: f32, b: f32, weight: f32| a + (b - a) * weight;
    let front = mix(
        mix(corner(0, 0, 0), corner(1, 0, 0), fade.x),
        mix(corner(0, 1, 0), corner(1, 1, 0), fade.x),
        fade.y,
    );
    let back = mix(
        mix(corner(0, 0, 1), corner(1, 0, 1), fade.x),
        mix(corner(0, 1, 1), corner(1, 1, 1), fade.x),
        fade.y,
    );
    mix(front, back, fade.z)
}

/// One of the twelve edge directions of a cube (four of them twice) times an offset.
fn slope(direction: u32, offset: Vec3) -> f32 {
    let first = if direction < 8 { offset.x } else { offset.y };
    let second = match direction {
        0..4 => offset.y,
        12 | 14 => offset.x,
        _ => offset.z,
    };
    (if direction & 1 == 0 { first } else { -first }) + (if direction & 2 == 0 { second } else { -second })
}

/// Octaves of gradient noise, each twice as fine and half as strong; about -1 to 1.
pub(super) fn octaves(seed: u64, point: Vec3, count: u32) -> f32 {
    let (mut sum, mut scale, mut weight) = (0.0, 1.0, 0.5);
    for octave in 0..count {
        sum += weight * gradient(seed.wrapping_add(u64::from(octave)), point * scale);
        scale *= 2.03;
        weight *= 0.5;
    }
    sum
}

/// Octaves with sharp crests, 0 to about 1.
pub(super) fn ridges(seed: u64, point: Vec3, count: u32) -> f32 {
    let (mut sum, mut scale, mut weight) = (0.0, 1.0, 0.5);
    for octave in 0..count {
        let crest = 1.0 - gradient(seed.wrapping_add(u64::from(octave)), point * scale).abs();
        sum += weight * crest * crest;
        scale *= 2.03;
        weight *= 0.5;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_repeats_stays_in_range_and_varies() {
        let sample = |seed: u64| -> Vec<f32> {
            (0..2000)
                .map(|i| gradient(seed, Vec3::new(i as f32 * 0.37, i as f32 * -0.11, i as f32 * 0.05)))
                .collect()
        };
        let values = sample(7);
        assert_eq!(values, sample(7));
        assert_ne!(values, sample(8));
        assert!(values.iter().all(|value| value.abs() <= 1.2));
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let spread = values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / values.len() as f32;
        assert!(mean.abs() < 0.1 && spread > 0.03, "mean {mean}, variance {spread}");
        assert_eq!(gradient(3, Vec3::new(4.0, -2.0, 9.0)), 0.0);
    }
}
