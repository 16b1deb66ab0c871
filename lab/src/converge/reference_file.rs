//! References on disc: an OpenEXR file of two layers, so that any viewer shows them.
//!
//! The two halves are the layers `first half` and `second half`. The attribute `treewright` of both holds
//! their key as JSON.

use std::path::Path;

use exr::prelude::{
    AttributeValue, Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, ReadChannels,
    ReadLayers, SpecificChannels, Text, WritableImage, read,
};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::reference::Reference;
use super::reference_key::ReferenceKey;
use treewright_render_cli::error::CliError;
use treewright_renderer::film::Picture;
use treewright_renderer::limits::{SAMPLES_MAX, SIZE_MAX};

/// Name of the attribute.
const ATTRIBUTE: &str = "treewright";

/// The contents of the attribute.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    key: ReferenceKey,
    samples_each: u32,
}

/// Writes a reference. An old file is replaced only when the new one is whole.
pub fn write(reference: &Reference, path: &Path) -> Result<(), CliError> {
    let fault = |cause: String| {
        CliError::Failed(format!(
            "the reference {} cannot be written: {cause}; check the permissions and the free space",
            path.display()
        ))
    };
    let header = Header { key: reference.key.clone(), samples_each: reference.samples_each };
    let header = serde_json::to_string(&header).map_err(|error| fault(error.to_string()))?;
    let [width, height] = reference.key.size.map(|edge| edge as usize);
    let layer = |name: &str, picture: &Picture| {
        let pixels = picture.pixels.clone();
        let mut attributes = LayerAttributes::named(name);
        attributes.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(header.as_str())));
        Layer::new(
            (width, height),
            attributes,
            Encoding::SMALL_LOSSLESS,
            SpecificChannels::rgb(move |at: exr::math::Vec2<usize>| {
                let pixel = pixels[at.y() * width + at.x()];
                (pixel.x, pixel.y, pixel.z)
            }),
        )
    };
    let image = Image::empty(ImageAttributes::new(IntegerBounds::from_dimensions((width, height))))
        .with_layer(layer("first half", &reference.halves[0]))
        .with_layer(layer("second half", &reference.halves[1]));
    let mut unfinished = path.as_os_str().to_owned();
    unfinished.push(".part");
    image.write().to_file(&unfinished).map_err(|error| fault(error.to_string()))?;
    std::fs::rename(&unfinished, path).map_err(|error| fault(error.to_string()))
}

/// Reads a reference of what `key` says. `None` if there is no such file.
pub fn read_if_there(path: &Path, key: &ReferenceKey) -> Result<Option<Reference>, CliError> {
    if !path.exists() {
        return Ok(None);
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_file(path)
        .map_err(|error| {
            let path = path.display();
            CliError::Failed(format!(
                "the reference {path} cannot be read: {error}; remove it to have it rendered anew"
            ))
        })?;
    let foreign = |cause: &str| {
        let path = path.display();
        CliError::Failed(format!(
            "{path} is no reference of this program: {cause}; name another file, which will be written"
        ))
    };
    let header =
        image.layer_data.first().and_then(|layer| layer.attributes.other.get(&Text::from(ATTRIBUTE)));
    let Some(AttributeValue::Text(header)) = header else {
        return Err(foreign("it does not say what it shows"));
    };
    let header: Header = serde_json::from_str(&header.to_string())
        .map_err(|_| foreign("it says in no way we know what it shows"))?;
    if let Some(difference) = key.difference(&header.key) {
        return Err(CliError::Failed(format!(
            "the reference {} does not fit: {difference}; name another file, which will be written",
            path.display()
        )));
    }
    let [width, height] = header.key.size;
    if width > SIZE_MAX || height > SIZE_MAX || header.samples_each > SAMPLES_MAX {
        return Err(foreign("its size or number of samples is beyond the limits"));
    }
    let half = |name: &str| {
        let layer = image
            .layer_data
            .iter()
            .find(|layer| layer.attributes.layer_name.as_ref().is_some_and(|found| found == name))?;
        let channel = |name: &str| {
            let channels = &layer.channel_data.list;
            let channel = channels.iter().find(|channel| channel.name.to_string() == name)?;
            Some(channel.sample_data.values_as_f32().collect::<Vec<f32>>())
        };
        let (red, green, blue) = (channel("R")?, channel("G")?, channel("B")?);
        let pixels: Vec<Vec3> =
            red.iter().zip(&green).zip(&blue).map(|((&r, &g), &b)| Vec3::new(r, g, b)).collect();
        let whole = pixels.len() == width as usize * height as usize;
        (whole && pixels.iter().all(|pixel| pixel.is_finite())).then_some(Picture { width, height, pixels })
    };
    let broken = || foreign("one of its halves is missing or broken");
    let halves = [half("first half").ok_or_else(broken)?, half("second half").ok_or_else(broken)?];
    Ok(Some(Reference { key: header.key, samples_each: header.samples_each, halves }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converge::testing::key;

    fn reference() -> Reference {
        let half = |level: f32| Picture {
            width: 5,
            height: 3,
            pixels: (0..15).map(|index| Vec3::new(index as f32 * level, 1e4, 1.0 / 3.0)).collect(),
        };
        Reference { key: key([5, 3]), samples_each: 7, halves: [half(0.1), half(0.3)] }
    }

    #[test]
    fn files_come_back_bit_by_bit() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("reference.exr");
        assert!(read_if_there(&path, &key([5, 3])).is_ok_and(|read| read.is_none()));
        write(&reference(), &path).expect("it is written");
        write(&reference(), &path).expect("it is replaced");
        let read = read_if_there(&path, &key([5, 3])).expect("it is read");
        assert_eq!(read, Some(reference()));
        assert_eq!(
            std::fs::read_dir(folder.path()).map(Iterator::count).ok(),
            Some(1),
            "nothing is left over"
        );
    }

    #[test]
    fn what_does_not_fit_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("reference.exr");
        write(&reference(), &path).expect("it is written");
        let refusal = |key: &ReferenceKey| read_if_there(&path, key).expect_err("it is refused").to_string();
        let other_size = refusal(&ReferenceKey { size: [6, 3], ..key([5, 3]) });
        assert!(other_size.contains("reference.exr") && other_size.contains("it has 5x3 pixels"));
        assert!(
            refusal(&ReferenceKey { scene_hash: "11".to_owned(), ..key([5, 3]) }).contains("the scene box")
        );
        assert!(refusal(&ReferenceKey { bounces: 4, ..key([5, 3]) }).contains("up to 3 bounces"));

        std::fs::write(&path, "no picture").expect("it can be written");
        assert!(refusal(&key([5, 3])).contains("cannot be read"));
        let picture = Picture { width: 5, height: 3, pixels: vec![Vec3::ONE; 15] };
        treewright_renderer::image_file::write(
            &picture,
            treewright_renderer::image_file::Exposure::Auto,
            &path,
        )
        .expect("it is written");
        assert!(refusal(&key([5, 3])).contains("no reference of this program"));
        let nowhere = folder.path().join("nowhere/reference.exr");
        assert!(write(&reference(), &nowhere).is_err_and(|error| error.to_string().contains("nowhere")));
    }
}
