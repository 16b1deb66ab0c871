//! The readers on small files with textures, written here.

use std::io::Cursor;

use glam::{Vec2, Vec3};
use image::{DynamicImage, ImageFormat, RgbaImage};
use serde_json::{Value, json};

use super::load_tests::{GltfFile, has_note, load_files, material, told};
use super::{Environment, Scene, Up, Volume, Wrap};

/// A PNG of two by two pixels: red, clear green, blue, white.
fn png() -> Vec<u8> {
    let pixels = vec![255, 0, 0, 255, 0, 255, 0, 0, 0, 0, 255, 255, 255, 255, 255, 255];
    let image = RgbaImage::from_raw(2, 2, pixels).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    DynamicImage::ImageRgba8(image).write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A triangle with texture coordinates and the picture above in its buffer; `change` has the last word.
fn textured(change: impl FnOnce(&mut Value)) -> Scene {
    let mut file = GltfFile::new();
    let places = file.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    assert_eq!((places, file.view(&png())), (2, 3));
    file.primitive()["attributes"]["TEXCOORD_0"] = json!(places);
    file.primitive()["material"] = json!(0);
    let document = &mut file.json;
    document["images"] = json!([{"bufferView": 3, "mimeType": "image/png"}]);
    document["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}]);
    document["textures"] = json!([{"source": 0, "sampler": 0}]);
    document["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}},
        "normalTexture": {"index": 0, "scale": 0.5},
        "emissiveTexture": {"index": 0}, "emissiveFactor": [1, 2, 3]}]);
    change(document);
    file.load()
}

#[test]
fn gltf_textures_are_read_once_for_each_meaning() {
    let scene = textured(|_| {});
    assert_eq!(scene.uvs, [Vec2::Y, Vec2::ONE, Vec2::ZERO]);
    let material = material(&scene);
    // One picture as colours and as numbers.
    assert_eq!((scene.textures.len(), material.base_color_texture), (2, Some(0)));
    assert_eq!(material.base_color_texture, material.emission_texture);
    assert_eq!((material.metallic_roughness_texture, material.normal_texture), (Some(1), Some(1)));
    assert_eq!((material.normal_scale, material.cutoff, material.blends), (0.5, None, false));
    let colours = &scene.textures[0];
    assert_eq!(colours.wrap(), [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(colours.sample(Vec2::new(0.25, 0.75), 0.0), Vec3::Z.extend(1.0));
    assert!(!scene.triangles.has_masks() && !has_note(&scene, "texture"));
}

#[test]
fn a_picture_without_its_kind_is_read_and_one_without_any_place_left_out() {
    for kind in [json!({"bufferView": 3}), json!({"bufferView": 3, "mimeType": null, "uri": null})] {
        let scene = textured(|document| document["images"][0] = kind);
        assert_eq!(scene.textures[0].sample(Vec2::new(0.25, 0.75), 0.0), Vec3::Z.extend(1.0));
    }
    for nowhere in [json!({}), json!({"mimeType": "image/png"}), json!({"bufferView": null, "uri": null})] {
        let scene = textured(|document| document["images"][0] = nowhere);
        assert!(scene.textures.is_empty() && has_note(&scene, "image 0"));
    }
}

#[test]
fn gltf_alpha_cuts_out_and_blends() {
    let cut = textured(|document| {
        document["materials"][0]["alphaMode"] = json!("MASK");
        document["materials"][0]["alphaCutoff"] = json!(0.3);
        document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 1, 1, 0.5]);
    });
    assert_eq!(material(&cut).cutoff, Some(0.6));
    assert!(cut.triangles.is_card(0));
    let mask = &cut.triangles.masks()[0];
    assert!(!mask.is_solid(Vec2::new(0.75, 0.25)) && mask.is_solid(Vec2::new(0.25, 0.75)));
    assert_eq!(cut.triangles.card(0).unwrap().corners, [Vec2::Y, Vec2::ONE, Vec2::ZERO]);
    // A picture that is clear or solid everywhere is cut out, also where the file asks for blending.
    let crisp = textured(|document| document["materials"][0]["alphaMode"] = json!("BLEND"));
    assert!(crisp.triangles.is_card(0) && has_note(&crisp, "cut out"));
    let plain = textured(|document| {
        document["materials"][0] =
            json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}});
    });
    assert_eq!((material(&plain).transmission, material(&plain).ior), (0.75, 1.0));
    assert!(plain.textures.is_empty() && plain.uvs.is_empty());
    // Without a picture a mask is everything or nothing.
    for (alpha, is_there) in [(0.6, true), (0.4, false)] {
        let scene = textured(|document| {
            document["materials"][0] =
                json!({"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}});
        });
        assert_eq!(!scene.triangles.is_card(0), is_there);
        assert!(scene.triangles.masks().iter().all(|mask| !mask.is_solid(Vec2::ZERO)));
    }
}

#[test]
fn gltf_texture_transforms_and_other_coordinates() {
    let moved = textured(|document| {
        document["extensionsUsed"] = json!(["KHR_texture_transform"]);
        let texture = &mut document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
        texture["extensions"] = json!({"KHR_texture_transform": {
            "offset": [0.5, 0.25], "scale": [2, 3], "rotation": std::f32::consts::FRAC_PI_2}});
    });
    // (1, 1) is scaled to (2, 3), turned counter-clockwise where v runs down to (3, -2), and moved.
    assert!((moved.uvs[1] - Vec2::new(3.5, -1.75)).length() < 1e-5, "{}", moved.uvs[1]);
    assert_eq!(material(&moved).metallic_roughness_texture, None, "it takes other coordinates");
    told(&moved, "other coordinates");
}

#[test]
fn gltf_volumes_make_solids() {
    let glass = |extensions: Value| {
        let scene = textured(|document| {
            document["extensionsUsed"] = json!(["KHR_materials_transmission", "KHR_materials_volume"]);
            document["materials"][0] = json!({"extensions": extensions});
        });
        material(&scene).volume
    };
    let through = json!({"transmissionFactor": 1});
    assert_eq!(glass(json!({"KHR_materials_transmission": through})), None);
    assert_eq!(
        glass(json!({"KHR_materials_transmission": through, "KHR_materials_volume": {"thicknessFactor": 0}})),
        None
    );
    let clear =
        json!({"KHR_materials_transmission": through, "KHR_materials_volume": {"thicknessFactor": 1}});
    assert_eq!(glass(clear), Some(Volume { absorption: Vec3::ZERO }));
    let volume = json!({"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0.25]});
    let tinted =
        glass(json!({"KHR_materials_transmission": through, "KHR_materials_volume": volume})).unwrap();
    let expected = Vec3::new(0.0, 2.0_f32.ln() / 2.0, 4.0_f32.ln() / 2.0);
    assert!((tinted.absorption - expected).length() < 1e-6, "{tinted:?}");
}

#[test]
fn pictures_that_cannot_be_read_are_told() {
    for (image, cause) in [
        (json!({"uri": "absent.png"}), "No such file"),
        (json!({"uri": "bark%AA.png"}), "not UTF-8"),
        (json!({"uri": "data:image/png;base64,AAAA"}), "image"),
        (json!({"uri": "data:image/png,AAAA"}), "base64"),
        (json!({"uri": "https://example.org/a.png"}), "beside the scene"),
        (json!({"bufferView": 0, "mimeType": "image/png"}), "image"),
    ] {
        let scene = textured(|document| document["images"][0] = image.clone());
        assert_eq!(material(&scene).base_color_texture, None);
        let is_noted = scene.notes.iter().any(|note| note.contains("left out") && note.contains(cause));
        assert!(is_noted, "{image}: {:?}", scene.notes);
    }
}

/// An OBJ of one triangle with this material, beside the picture above.
fn obj(material: &str) -> Scene {
    let (picture, library) = (png(), format!("newmtl m\n{material}\n"));
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvt 1 0\nusemtl m\nf 1/1 2/2 3\n";
    let files = [("scene.obj", text.as_bytes()), ("m.mtl", library.as_bytes()), ("a leaf.png", &picture[..])];
    load_files(&files, Up::Y).unwrap()
}

#[test]
fn obj_maps_are_read() {
    let scene = obj("Kd 1 1 1\nmap_Kd a leaf.png");
    assert_eq!(scene.uvs, [Vec2::new(0.25, 0.25), Vec2::ONE, Vec2::Y]);
    assert!(scene.triangles.is_card(0), "the picture is cut out");
    let colours = &scene.textures[material(&scene).base_color_texture.unwrap() as usize];
    assert_eq!(colours.sample(scene.uvs[0], 0.0), Vec3::X.extend(1.0));
    let scene = obj("map_Pr -clamp on a leaf.png\nmap_Pm a leaf.png\nnorm a leaf.png\nmap_Ke a leaf.png");
    let material = material(&scene);
    assert_eq!((material.roughness, material.metallic, material.emission), (1.0, 1.0, Vec3::ONE));
    let rough = &scene.textures[material.metallic_roughness_texture.unwrap() as usize];
    // Red is 255 in the first and the last pixel, in both pictures.
    assert_eq!(rough.sample(Vec2::new(0.75, 0.25), 0.0).truncate(), Vec3::X);
    assert_eq!(rough.wrap(), [Wrap::Clamp; 2]);
    assert!(material.normal_texture.is_some() && !scene.triangles.has_masks());
    let scene = obj("map_d a leaf.png");
    let alpha = scene.textures[0].sample(Vec2::new(0.75, 0.25), 0.0);
    assert_eq!((alpha.w, scene.triangles.is_card(0)), (0.0, true));
    let scene = obj("map_Kd absent.tga");
    told(&scene, "absent.tga");
    assert!(obj("Kd 1 0 0").uvs.is_empty());
}

#[test]
fn environments_are_read_and_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = (0..8 * 4).flat_map(|pixel| [pixel as f32, 0.5, 100.0]).collect();
    let image = DynamicImage::ImageRgb32F(image::Rgb32FImage::from_raw(8, 4, pixels).unwrap());
    for name in ["sky.exr", "sky.hdr"] {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        let map = Environment::load(&path).unwrap();
        assert_eq!((map.width(), map.height()), (8, 4));
        assert!(
            (map.pixels()[9] - Vec3::new(9.0, 0.5, 100.0)).abs().max_element() < 0.6,
            "{}",
            map.pixels()[9]
        );
    }
    std::fs::write(folder.path().join("no.hdr"), b"#?RADIANCE\nnothing").unwrap();
    for name in ["absent.exr", "no.hdr"] {
        let message = Environment::load(folder.path().join(name)).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("equirectangular"), "{message}");
    }
}
