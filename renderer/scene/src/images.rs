//! Image files of textures and environments, decoded within limits that are checked beforehand.

use std::{io::Cursor, path::Path};

use base64::Engine as _;
use glam::Vec3;
use image::{DynamicImage, ImageReader, Limits};

use super::limits::{ENVIRONMENT_EDGE_MAX, IMAGE_BYTES_MAX, TEXTURE_EDGE_MAX};

/// Pixels of red, green, blue and alpha, row by row from the top.
pub(super) struct Pixels {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) pixels: Vec<[u8; 4]>,
}

/// Decodes an image file (PNG, JPEG, TGA, BMP) to eight bits a channel. Grey stands for all three colours.
pub(super) fn decode(bytes: &[u8], name: &Path) -> Result<Pixels, String> {
    let image = decoded(bytes, name, TEXTURE_EDGE_MAX)?.into_rgba8();
    let (width, height) = image.dimensions();
    Ok(Pixels { width, height, pixels: image.into_raw().as_chunks().0.to_vec() })
}

/// Decodes a picture of radiance (Radiance HDR, OpenEXR): its width, and its pixels row by row from the top.
pub(super) fn decode_radiance(bytes: &[u8], name: &Path) -> Result<(u32, Vec<Vec3>), String> {
    let image = decoded(bytes, name, ENVIRONMENT_EDGE_MAX)?.into_rgb32f();
    Ok((image.width(), image.pixels().map(|pixel| Vec3::from_array(pixel.0)).collect()))
}

/// The format follows from the first bytes, or from the name for those formats that have none of their own.
fn decoded(bytes: &[u8], name: &Path, edge_max: u32) -> Result<DynamicImage, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes));
    if let Ok(format) = image::ImageFormat::from_path(name) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(|error| error.to_string())?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(edge_max);
    limits.max_image_height = Some(edge_max);
    limits.max_alloc = Some(u64::from(edge_max) * u64::from(edge_max) * 16);
    reader.limits(limits);
    reader.decode().map_err(|error| error.to_string())
}

pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, String> {
    read_within(path, IMAGE_BYTES_MAX)
}

fn read_within(path: &Path, bytes_max: u64) -> Result<Vec<u8>, String> {
    let message = |error: std::io::Error| error.to_string();
    let metadata = std::fs::metadata(path).map_err(message)?;
    if !metadata.is_file() {
        return Err("it is no file".to_owned());
    }
    if metadata.len() > bytes_max {
        return Err(format!("it has {} bytes, more than the limit of {bytes_max}", metadata.len()));
    }
    std::fs::read(path).map_err(message)
}

/// The bytes behind an address: data in it, or a file, whose name may have backslashes or odd signs.
pub(super) fn fetch(address: &str, base: Option<&Path>, bytes_max: u64) -> Result<Vec<u8>, String> {
    if let Some(data) = address.strip_prefix("data:") {
        let (_, encoded) = data.split_once(";base64,").ok_or("its data is not in base64")?;
        let encoded: String = encoded.split_ascii_whitespace().collect();
        let decoded = base64::engine::general_purpose::STANDARD.decode(encoded);
        return decoded.map_err(|error| format!("its base64 data cannot be read: {error}"));
    }
    if address.contains("://") {
        return Err("it is not a file beside the scene".to_owned());
    }
    let base = base.unwrap_or(Path::new("."));
    let not_text = |_| "its name is not UTF-8 behind its percent signs".to_owned();
    let decoded = urlencoding::decode(address).map_err(not_text)?;
    let names = [decoded.to_string(), address.to_owned(), decoded.replace('\\', "/")];
    let name = names.iter().find(|name| base.join(name).is_file()).unwrap_or(&names[0]);
    read_within(&base.join(name), bytes_max)
}
