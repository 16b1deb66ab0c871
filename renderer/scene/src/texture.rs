//! Textures: pictures on surfaces, with smaller copies of themselves for distant surfaces.
//!
//! A texture keeps eight bits a channel and a pyramid of halved copies (Williams, "Pyramidal Parametrics",
//! SIGGRAPH 1983), averaged as light, not as stored values. A look-up blends the four nearest pixels in the
//! two nearest levels.

use std::sync::LazyLock;

use glam::{IVec2, UVec2, Vec2, Vec4};
pub use treewright_accel::Wrap;

use super::limits::TEXTURE_EDGE_MAX;

/// The meaning of stored values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Colours with the transfer function of sRGB; alpha is linear.
    Srgb,
    /// Plain numbers: roughness, normals.
    Linear,
}

/// A picture by texture coordinates: (0, 0) is the upper left corner, (1, 1) the lower right one.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The whole picture first, then each half as wide and high, down to one pixel.
    levels: Vec<Level>,
    encoding: Encoding,
    wrap: [Wrap; 2],
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    size: UVec2,
    pixels: Vec<[u8; 4]>,
}

/// Each stored value of a colour as light.
static AS_LIGHT: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| srgb_to_linear(value as f32 / 255.0)));

impl Texture {
    /// A texture of pixels in red, green, blue and alpha, row by row from the top.
    ///
    /// # Errors
    /// One sentence if there are not `width` × `height` pixels, or an edge is 0 or beyond
    /// [`TEXTURE_EDGE_MAX`].
    pub fn new(
        width: u32,
        height: u32,
        pixels: Vec<[u8; 4]>,
        encoding: Encoding,
        wrap: [Wrap; 2],
    ) -> Result<Self, String> {
        let edges = 1..=TEXTURE_EDGE_MAX;
        if !edges.contains(&width) || !edges.contains(&height) {
            return Err(format!("it has {width}x{height} pixels, an edge is 1 to {TEXTURE_EDGE_MAX}"));
        }
        if pixels.len() != width as usize * height as usize {
            return Err(format!("it has {} pixels in place of {width}x{height}", pixels.len()));
        }
        let mut levels = vec![Level { size: UVec2::new(width, height), pixels }];
        while let Some(last) = levels.last()
            && last.size != UVec2::ONE
        {
            levels.push(last.halved(encoding));
        }
        Ok(Self { levels, encoding, wrap })
    }

    /// Pixels across and down.
    pub fn size(&self) -> UVec2 {
        self.levels[0].size
    }

    /// Its continuation beyond its edges.
    pub fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// The alpha of every pixel, row by row from the top.
    pub fn alpha(&self) -> Vec<u8> {
        self.levels[0].pixels.iter().map(|pixel| pixel[3]).collect()
    }

    /// The mean of all pixels; of colours as light, weighted by alpha.
    pub fn mean(&self) -> Vec4 {
        self.levels.last().map_or(Vec4::ONE, |level| self.value(level.pixels[0]))
    }

    /// The value at a place, of a footprint of two to the power of `level` pixels. Colours come out as light.
    #[inline]
    pub fn sample(&self, at: Vec2, level: f32) -> Vec4 {
        let last = (self.levels.len() - 1) as f32;
        // NaN counts as 0.
        let level = level.max(0.0).min(last);
        let (fine, share) = (level as usize, level.fract());
        let value = self.bilinear(&self.levels[fine], at);
        if share == 0.0 { value } else { value.lerp(self.bilinear(&self.levels[fine + 1], at), share) }
    }

    fn bilinear(&self, level: &Level, at: Vec2) -> Vec4 {
        let scaled = at * level.size.as_vec2() - 0.5;
        let low = scaled.floor();
        let share = scaled - low;
        let low = low.as_ivec2();
        let high = low.saturating_add(IVec2::ONE);
        let [wrap_x, wrap_y] = self.wrap;
        let columns = [low.x, high.x].map(|x| wrap_x.index(x, level.size.x) as usize);
        let row = |y: i32| {
            let first = wrap_y.index(y, level.size.y) as usize * level.size.x as usize;
            let [a, b] = columns.map(|column| self.value(level.pixels[first + column]));
            a.lerp(b, share.x)
        };
        // A place that is no number gives shares that are none.
        let value = row(low.y).lerp(row(high.y), share.y);
        if value.is_finite() { value } else { self.value(level.pixels[0]) }
    }

    #[inline]
    fn value(&self, pixel: [u8; 4]) -> Vec4 {
        decoded(pixel, self.encoding)
    }
}

impl Level {
    /// Half as wide and high, at least one pixel; the last row or column of an odd number counts twice.
    fn halved(&self, encoding: Encoding) -> Self {
        let size = (self.size / 2).max(UVec2::ONE);
        let at = |x: u32, y: u32| {
            let (x, y) = (x.min(self.size.x - 1), y.min(self.size.y - 1));
            decoded(self.pixels[y as usize * self.size.x as usize + x as usize], encoding)
        };
        // An odd edge's last pixels would be lost: the last mean takes three.
        let span = |place: u32, size: u32, full: u32| {
            let end = if place + 1 == size { full } else { 2 * place + 2 };
            (2 * place).min(full - 1)..end.max(2 * place + 1).min(full)
        };
        let pixels = (0..size.y)
            .flat_map(|y| (0..size.x).map(move |x| (x, y)))
            .map(|(x, y)| {
                let (mut colour, mut weight, mut alpha, mut count) = (Vec4::ZERO, 0.0, 0.0, 0.0);
                for row in span(y, size.y, self.size.y) {
                    for column in span(x, size.x, self.size.x) {
                        let value = at(column, row);
                        // Pixels that are cut away have no colour to lend.
                        let own = if encoding == Encoding::Srgb { value.w.max(1e-4) } else { 1.0 };
                        colour += value * own;
                        weight += own;
                        alpha += value.w;
                        count += 1.0;
                    }
                }
                encoded((colour / weight).truncate().extend(alpha / count), encoding)
            })
            .collect();
        Self { size, pixels }
    }
}

#[inline]
fn decoded(pixel: [u8; 4], encoding: Encoding) -> Vec4 {
    let [r, g, b, a] = pixel;
    let plain = |value: u8| f32::from(value) * (1.0 / 255.0);
    match encoding {
        Encoding::Srgb => {
            let light = &*AS_LIGHT;
            Vec4::new(light[r as usize], light[g as usize], light[b as usize], plain(a))
        }
        Encoding::Linear => Vec4::new(plain(r), plain(g), plain(b), plain(a)),
    }
}

fn encoded(value: Vec4, encoding: Encoding) -> [u8; 4] {
    let byte = |value: f32| (value * 255.0).round() as u8;
    let colour = |value: f32| byte(if encoding == Encoding::Srgb { linear_to_srgb(value) } else { value });
    [colour(value.x), colour(value.y), colour(value.z), byte(value.w)]
}

/// The inverse of the sRGB transfer function (IEC 61966-2-1).
fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn texture(width: u32, height: u32, encoding: Encoding, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
        let pixels =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
        Texture::new(width, height, pixels, encoding, [Wrap::Repeat; 2]).expect("it has its pixels")
    }

    #[test]
    fn pixels_are_found_where_they_stand() {
        let plain = texture(4, 2, Encoding::Linear, |x, y| [(x * 60) as u8, (y * 100) as u8, 7, 255]);
        let at = |x: f32, y: f32| plain.sample(Vec2::new(x, y), 0.0) * 255.0;
        assert!((at(0.125, 0.25) - Vec4::new(0.0, 0.0, 7.0, 255.0)).length() < 1e-3);
        assert!((at(0.625, 0.75) - Vec4::new(120.0, 100.0, 7.0, 255.0)).length() < 1e-3);
        assert!((at(0.5, 0.5) - Vec4::new(90.0, 50.0, 7.0, 255.0)).length() < 1e-3, "between four pixels");
        assert!((at(0.0, 0.25).x - 90.0).abs() < 1e-3, "between the last and the first");
        assert!((at(-7.375, 5.75) - at(0.625, 0.75)).length() < 1e-3, "it repeats");
    }

    #[test]
    fn smaller_levels_keep_the_light() {
        // Black and white by turns: half the light, which is stored as 188.
        let checks =
            texture(
                8,
                8,
                Encoding::Srgb,
                |x, y| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] },
            );
        for level in [1.0, 1.5, 2.0, 3.0, 9.0] {
            let value = checks.sample(Vec2::new(0.3, 0.6), level);
            assert!((value.x - 0.5).abs() < 0.005, "level {level}: {value}");
        }
        assert!((checks.mean().x - 0.5).abs() < 0.005);
        let half = checks.sample(Vec2::new(0.0625, 0.0625), 0.5);
        assert!((half.x - 0.75).abs() < 0.01, "halfway to the first level: {half}");
    }

    #[test]
    fn what_is_cut_away_lends_no_colour() {
        let leaf =
            texture(2, 2, Encoding::Srgb, |x, _| if x == 0 { [40, 200, 40, 255] } else { [255, 0, 255, 0] });
        let mean = leaf.mean();
        assert!(mean.x < 0.03 && mean.y > 0.55 && (mean.w - 0.5).abs() < 0.01, "{mean}");
    }

    #[test]
    fn sizes_are_checked() {
        let make = |width, height, count| {
            Texture::new(width, height, vec![[0; 4]; count], Encoding::Srgb, [Wrap::Clamp; 2])
        };
        assert!(make(3, 5, 15).is_ok_and(|texture| texture.levels.len() == 3));
        assert!(
            make(0, 5, 0).is_err() && make(3, 5, 14).is_err() && make(TEXTURE_EDGE_MAX + 1, 1, 1).is_err()
        );
    }

    proptest! {
        #[test]
        fn every_place_and_level_has_a_value(
            width in 1_u32..9, height in 1_u32..9, x in any::<f32>(), y in any::<f32>(), level in any::<f32>(),
        ) {
            let some = texture(width, height, Encoding::Srgb, |x, y| [(x * 30) as u8, (y * 30) as u8, 90, 200]);
            let value = some.sample(Vec2::new(x, y), level);
            prop_assert!(value.is_finite() && value.min_element() >= 0.0 && value.max_element() <= 1.0);
        }

        #[test]
        fn no_level_is_brighter_or_darker(width in 1_u32..40, height in 1_u32..40) {
            let even = texture(width, height, Encoding::Srgb, |_, _| [100, 150, 200, 255]);
            for level in 0..even.levels.len() {
                let value = even.sample(Vec2::new(0.3, 0.8), level as f32);
                prop_assert!((value - even.sample(Vec2::ZERO, 0.0)).length() < 1e-5);
            }
        }
    }
}
