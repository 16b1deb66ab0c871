//! Pictures on disc: PNG for people, EXR for measuring.
//!
//! PNG files are exposed and go through the [tone curve](crate::tone). EXR files hold the linear radiance as
//! it is. Source of the automatic exposure: Reinhard et al., Photographic Tone Reproduction for Digital
//! Images, SIGGRAPH 2002.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb, RgbImage};

use crate::film::Picture;
use crate::tone::{displayed, encoded_plainly};

/// Why a picture was not written.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// The extension is neither of the two.
    #[error("{}: pictures are written as .png or .exr; choose one of these extensions", path.display())]
    UnknownFormat {
        /// The file asked for.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{} cannot be written: {source}; check the permissions and the free space", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// The error of the encoder or the system.
        source: image::ImageError,
    },
}

/// The brightness of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The picture's log-average luminance becomes middle grey.
    #[default]
    Auto,
    /// Radiance is multiplied by two to this power.
    Stops(f32),
}

/// The way from exposed radiance to colours of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// By the [tone curve](crate::tone), in which nothing burns out.
    #[default]
    Film,
    /// As it is, in sRGB; values above white are cut off.
    Plain,
}

/// Exposure and tone of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Its brightness.
    pub exposure: Exposure,
    /// The way from radiance to colours.
    pub tone: Tone,
}

impl From<Exposure> for Look {
    fn from(exposure: Exposure) -> Self {
        Self { exposure, tone: Tone::Film }
    }
}

/// Middle grey: the reflectance that looks half as bright as white.
const MIDDLE_GREY: f32 = 0.18;

/// Checks a file's extension before minutes go into its picture.
pub fn check_path(path: &Path) -> Result<(), ImageFileError> {
    format_of(path).map(drop)
}

/// Writes a picture; the extension says how.
pub fn write(picture: &Picture, look: impl Into<Look>, path: &Path) -> Result<(), ImageFileError> {
    let format = format_of(path)?;
    let image = match format {
        ImageFormat::OpenExr => DynamicImage::ImageRgb32F(linear(picture)),
        _ => DynamicImage::ImageRgb8(developed(picture, look.into())),
    };
    image.save_with_format(path, format).map_err(|source| ImageFileError::Write { path: path.into(), source })
}

/// The bytes of a PNG file, for pictures inside other files.
pub fn png_bytes(picture: &Picture, exposure: Exposure) -> Result<Vec<u8>, ImageFileError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    DynamicImage::ImageRgb8(developed(picture, exposure.into()))
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|source| ImageFileError::Write { path: "a PNG in memory".into(), source })?;
    Ok(bytes.into_inner())
}

/// The factor on radiance that an exposure means for a picture.
fn exposure_factor(picture: &Picture, exposure: Exposure) -> f32 {
    match exposure {
        Exposure::Stops(stops) => stops.exp2(),
        Exposure::Auto => {
            // Means of blocks, about 16 along the longer edge: single noisy pixels say little.
            let means = picture.block_luminances(picture.width.max(picture.height).div_ceil(16).max(1));
            // Blocks that are nearly black say nothing about how bright the rest should be.
            let floor = picture.mean_luminance() * 1e-4;
            let lit: Vec<f64> = means.into_iter().filter(|&mean| mean > floor).map(f64::ln).collect();
            if lit.is_empty() {
                1.0
            } else {
                MIDDLE_GREY / (lit.iter().sum::<f64>() / lit.len() as f64).exp() as f32
            }
        }
    }
}

fn format_of(path: &Path) -> Result<ImageFormat, ImageFileError> {
    match path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).as_deref() {
        Some("png") => Ok(ImageFormat::Png),
        Some("exr") => Ok(ImageFormat::OpenExr),
        _ => Err(ImageFileError::UnknownFormat { path: path.into() }),
    }
}

fn linear(picture: &Picture) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
    ImageBuffer::from_fn(picture.width, picture.height, |x, y| Rgb(picture.pixel(x, y).to_array()))
}

fn developed(picture: &Picture, look: Look) -> RgbImage {
    let factor = exposure_factor(picture, look.exposure);
    let toned = match look.tone {
        Tone::Film => displayed,
        Tone::Plain => encoded_plainly,
    };
    ImageBuffer::from_fn(picture.width, picture.height, |x, y| {
        Rgb(toned(picture.pixel(x, y) * factor).to_array().map(|channel| (channel * 255.0).round() as u8))
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn grey(level: f32) -> Picture {
        Picture { width: 4, height: 3, pixels: vec![Vec3::splat(level); 12] }
    }

    #[test]
    fn automatic_exposure_makes_equal_pictures_of_equal_scenes() {
        for level in [1e-3, 1.0, 500.0] {
            assert!((exposure_factor(&grey(level), Exposure::Auto) * level - MIDDLE_GREY).abs() < 1e-3);
        }
        let mut noisy = grey(0.5);
        for (index, pixel) in noisy.pixels.iter_mut().enumerate() {
            *pixel *= if index % 2 == 0 { 2.0 } else { 0.0 };
        }
        let (clean, large) =
            (grey(0.5), Picture { width: 32, height: 32, pixels: noisy.pixels.repeat(86)[..1024].to_vec() });
        let ratio = exposure_factor(&large, Exposure::Auto) / exposure_factor(&clean, Exposure::Auto);
        assert!((ratio - 1.0).abs() < 0.05, "noise does not brighten a picture: {ratio}");
        assert_eq!(exposure_factor(&grey(0.0), Exposure::Auto), 1.0);
        assert_eq!(exposure_factor(&grey(7.0), Exposure::Stops(-2.0)), 0.25);
    }

    #[test]
    fn files_are_read_back_as_they_were_written() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let mut picture = grey(0.25);
        picture.pixels[5] = Vec3::new(3.5, 0.0, 1e4);
        let (png, exr) = (folder.path().join("a.png"), folder.path().join("b.EXR"));
        write(&picture, Exposure::Auto, &png).expect("the PNG is written");
        write(&picture, Exposure::Auto, &exr).expect("the EXR is written");
        let developed = image::open(&png).expect("the PNG is read").to_rgb8();
        assert_eq!(developed.dimensions(), (4, 3));
        let [r, g, _] = developed.get_pixel(0, 0).0;
        assert!(r.abs_diff(g) <= 1);
        assert!(developed.get_pixel(1, 1).0[2] > developed.get_pixel(0, 0).0[2]);
        let linear = image::load_from_memory_with_format(
            &std::fs::read(&exr).expect("it exists"),
            ImageFormat::OpenExr,
        );
        let linear = linear.expect("the EXR is read").to_rgb32f();
        assert_eq!(linear.get_pixel(1, 1).0, [3.5, 0.0, 1e4]);
        assert_eq!(linear.get_pixel(0, 0).0, [0.25; 3]);
        let bytes = png_bytes(&picture, Exposure::Auto).expect("a PNG in memory");
        assert_eq!(bytes, std::fs::read(&png).expect("it exists"));
    }

    #[test]
    fn a_plain_picture_is_its_radiance_in_srgb() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("plain.png");
        let mut picture = grey(0.5);
        picture.pixels[0] = Vec3::new(7.0, 0.0, f32::NAN);
        let look = Look { exposure: Exposure::Stops(0.0), tone: Tone::Plain };
        write(&picture, look, &path).expect("it is written");
        let read = image::open(&path).expect("it is read").to_rgb8();
        // IEC 61966-2-1: a half is 188.
        assert_eq!((read.get_pixel(1, 0).0, read.get_pixel(0, 0).0), ([188; 3], [255, 0, 0]));
    }

    #[test]
    fn wrong_names_are_told_before_rendering() {
        let refusal = check_path(Path::new("a.gif")).expect_err("it is refused").to_string();
        assert!(refusal.contains(".png or .exr"), "{refusal}");
        assert!(check_path(Path::new("a.png")).is_ok());
    }
}
