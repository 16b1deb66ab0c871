//! Environment maps: the light of the whole sky as one picture.
//!
//! The picture is equirectangular: its middle is the direction of the negative z axis, its left and right
//! edges meet at the positive one, its top is straight up. Pixels hold linear radiance.

use std::f32::consts::{PI, TAU};
use std::path::Path;

use glam::Vec3;

use super::{SceneError, Sky, error::one_line, images, limits::ENVIRONMENT_EDGE_MAX};

/// Pixels across of [`Environment::of_sky`], each about as wide as the sun of [`Sky::daylight`].
const SKY_WIDTH: u32 = 256;

/// Radiance from every direction.
#[derive(Clone, Debug)]
pub struct Environment {
    width: u32,
    height: u32,
    pixels: Vec<Vec3>,
}

impl Environment {
    /// Reads a Radiance HDR or OpenEXR picture. Values that are not finite or negative count as black.
    ///
    /// # Errors
    /// [`SceneError`], naming the file, the cause and the remedy.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let remedy = "give an equirectangular picture as .hdr or .exr, twice as wide as high";
        let refused = SceneError::malformed(path, "an environment map", remedy);
        let malformed = |cause: String| refused(one_line(&cause));
        let bytes = images::read_file(path).map_err(malformed)?;
        let (width, pixels) = images::decode_radiance(&bytes, path).map_err(malformed)?;
        Self::new(width, pixels).map_err(malformed)
    }

    /// A map of rows of `width` pixels from the top. Values that are not finite or negative count as black.
    ///
    /// # Errors
    /// One sentence if the pixels make no whole rows or an edge is 0 or beyond [`ENVIRONMENT_EDGE_MAX`].
    pub fn new(width: u32, mut pixels: Vec<Vec3>) -> Result<Self, String> {
        let height = pixels.len() as u64 / u64::from(width.max(1));
        let edges = 1..=u64::from(ENVIRONMENT_EDGE_MAX);
        if !edges.contains(&u64::from(width)) || !edges.contains(&height) {
            return Err(format!("it has {width}x{height} pixels, an edge is 1 to {ENVIRONMENT_EDGE_MAX}"));
        }
        if height * u64::from(width) != pixels.len() as u64 {
            return Err(format!("{} pixels make no rows of {width}", pixels.len()));
        }
        for pixel in &mut pixels {
            *pixel = pixel.map(|channel| if channel.is_finite() { channel.max(0.0) } else { 0.0 });
        }
        Ok(Self { width, height: height as u32, pixels })
    }

    /// A small map of a sky. One pixel has all light of the sun.
    pub(crate) fn of_sky(sky: &Sky) -> Self {
        let (width, height) = (SKY_WIDTH, SKY_WIDTH / 2);
        let up = |row: f32| (row / height as f32 * PI).cos();
        let row = |row: u32| {
            let radiance = sky.horizon.lerp(sky.zenith, up(row as f32 + 0.5).max(0.0));
            vec![radiance; width as usize]
        };
        let mut map = Self { width, height, pixels: (0..height).flat_map(row).collect() };
        if let Some(sun) = sky.sun {
            let pixel = map.pixel(sun.direction);
            let row = (pixel / width as usize) as f32;
            let solid_angle = (up(row) - up(row + 1.0)) * TAU / width as f32;
            map.pixels[pixel] += sun.irradiance / solid_angle;
        }
        map
    }

    /// This sky brighter by a factor, and turned to the right by an angle, rounded to pixels.
    pub fn changed(mut self, factor: f32, turn_deg: f32) -> Self {
        self.pixels.iter_mut().for_each(|pixel| *pixel = (*pixel * factor).min(Vec3::splat(f32::MAX)));
        let columns = (turn_deg / 360.0).rem_euclid(1.0) * self.width as f32;
        let columns = columns.round() as usize % self.width as usize;
        self.pixels.chunks_exact_mut(self.width as usize).for_each(|row| row.rotate_right(columns));
        self
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[Vec3] {
        &self.pixels
    }

    /// The unit vector at a share of the way round (0 is the left edge) and a height from -1 to 1.
    #[inline]
    pub fn direction(round: f32, up: f32) -> Vec3 {
        let (sin, cos) = ((round - 0.5) * TAU).sin_cos();
        let out = (1.0 - up * up).max(0.0).sqrt();
        Vec3::new(sin * out, up, -cos * out)
    }

    /// Column and row of a direction, between pixels.
    #[inline]
    fn place(&self, direction: Vec3) -> (f32, f32) {
        let round = 0.5 + direction.x.atan2(-direction.z) / TAU;
        let down = direction.y.clamp(-1.0, 1.0).acos() / PI;
        (round * self.width as f32, down * self.height as f32)
    }

    /// The pixel of a direction, which need not have unit length but for its height.
    #[inline]
    pub fn pixel(&self, direction: Vec3) -> usize {
        let (x, y) = self.place(direction);
        let (column, row) = ((x as u32).min(self.width - 1), (y as u32).min(self.height - 1));
        row as usize * self.width as usize + column as usize
    }

    /// Radiance from a direction, between the four nearest pixels.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let (x, y) = self.place(direction);
        let (x, y) = (x - 0.5, y - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let columns =
            [column, column + 1.0].map(|column| (column as i64).rem_euclid(i64::from(self.width)) as usize);
        let line = |row: f32| {
            let first = (row.max(0.0) as usize).min(self.height as usize - 1) * self.width as usize;
            self.pixels[first + columns[0]].lerp(self.pixels[first + columns[1]], x - column)
        };
        line(row).lerp(line(row + 1.0), y - row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_and_pixels_agree() {
        let map = Environment::new(8, (0..32).map(|pixel| Vec3::splat(pixel as f32)).collect()).unwrap();
        assert_eq!((map.width(), map.height()), (8, 4));
        // The middle is ahead, a quarter to the right of it is the right.
        assert_eq!(map.pixel(Environment::direction(0.5625, 0.3)), 8 + 4);
        assert!((Environment::direction(0.75, 0.0) - Vec3::X).length() < 1e-6);
        assert!((Environment::direction(0.5, 0.0) - Vec3::NEG_Z).length() < 1e-6);
        assert!(map.pixel(Vec3::Y) < 8 && map.pixel(Vec3::NEG_Y) >= 24);
        for column in 0..8 {
            for row in 0..4 {
                let up = ((row as f32 + 0.5) / 4.0 * PI).cos();
                let direction = Environment::direction((column as f32 + 0.5) / 8.0, up);
                let pixel = row * 8 + column;
                assert_eq!(map.pixel(direction), pixel);
                assert!((map.radiance(direction).x - pixel as f32).abs() < 1e-2);
            }
        }
        assert!(map.radiance(Vec3::NAN).is_nan() || map.radiance(Vec3::NAN).is_finite());
    }

    #[test]
    fn a_map_of_a_sky_has_its_gradient_and_its_sun() {
        let day = Sky::daylight();
        let [map, dark] = [day, Sky { sun: None, ..day }].map(|sky| Environment::of_sky(&sky));
        let at = |direction: Vec3| dark.pixels()[dark.pixel(direction)];
        assert!(
            (at(Vec3::Y) - day.zenith).length() < 1e-3 && (at(Vec3::NEG_Y) - day.horizon).length() < 1e-6
        );
        let sun = day.sun.expect("it is day");
        let brighter = (0..map.pixels().len()).filter(|pixel| map.pixels()[*pixel] != dark.pixels()[*pixel]);
        assert_eq!(brighter.collect::<Vec<_>>(), [map.pixel(sun.direction)]);
        // Pixels are as high as they are wide at the horizon.
        let edge = TAU / 256.0;
        let solid_angle = edge * edge * (1.0 - sun.direction.y.powi(2)).sqrt();
        let pixel = map.pixel(sun.direction);
        let light = (map.pixels()[pixel] - dark.pixels()[pixel]) * solid_angle;
        assert!((light / sun.irradiance - Vec3::ONE).abs().max_element() < 0.03, "{light}");
    }

    #[test]
    fn a_turned_sky_shines_from_the_side_and_a_brighter_one_more() {
        let mut pixels = vec![Vec3::ZERO; 32];
        // Ahead, a little to the right.
        pixels[8 + 4] = Vec3::ONE;
        let map = Environment::new(8, pixels).unwrap();
        let ahead = Environment::direction(0.5625, 0.3);
        let right = Environment::direction(0.8125, 0.3);
        assert_eq!((map.pixels()[map.pixel(ahead)], map.pixels()[map.pixel(right)]), (Vec3::ONE, Vec3::ZERO));
        for (turn, place) in [(90.0, right), (-270.0, right), (360.0, ahead), (0.0, ahead)] {
            let turned = map.clone().changed(2.5, turn);
            assert_eq!(turned.pixels()[turned.pixel(place)], Vec3::splat(2.5), "{turn}");
        }
    }

    #[test]
    fn odd_pixels_are_black_and_odd_sizes_refused() {
        let odd = vec![Vec3::new(f32::NAN, -1.0, f32::INFINITY), Vec3::ONE];
        assert_eq!(Environment::new(2, odd).unwrap().pixels(), [Vec3::ZERO, Vec3::ONE]);
        assert!(Environment::new(0, vec![]).is_err() && Environment::new(2, vec![Vec3::ONE; 3]).is_err());
        assert!(Environment::new(ENVIRONMENT_EDGE_MAX + 1, vec![Vec3::ONE; 1 << 15]).is_err());
    }
}
