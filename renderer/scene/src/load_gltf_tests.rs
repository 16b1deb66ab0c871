//! glTF as programs write it: what the format allows is read, omissions get notes, refusals a cause.

use glam::Vec3;
use serde_json::{Value, json};

use super::load_tests::{
    GltfFile, error_of, glb, has_note, load_bytes, load_files, material, told, triangle_document,
};
use super::{Cone, Punctual, Scene, Sky, Up, limits::PUNCTUAL_LIGHTS_MAX};

fn loaded(document: &Value) -> Scene {
    load_bytes("a.glb", &glb(document, &triangle_document().1)).unwrap()
}

/// The triangle's document with changes by path, in the order of paths; the parents of each have to be there.
fn changed(changes: &Value) -> Value {
    let (mut document, _) = triangle_document();
    for (path, value) in changes.as_object().unwrap() {
        let (parent, key) = path.rsplit_once('/').unwrap();
        document.pointer_mut(parent).unwrap()[key] = value.clone();
    }
    document
}

fn notes(changes: &Value) -> String {
    loaded(&changed(changes)).notes.join("\n")
}

#[test]
fn without_a_scene_the_roots_are_shown() {
    let nodes = json!([{"mesh": 0}, {"children": [0, 2], "translation": [5, 0, 0]}, {"mesh": 0}]);
    let (mut document, _) = triangle_document();
    document["nodes"] = nodes;
    for scenes in [Value::Null, json!([])] {
        document["scenes"] = scenes;
        for scene in [json!(0), Value::Null] {
            document["scene"] = scene;
            let mut without = document.clone();
            without.as_object_mut().unwrap().retain(|_, value| !value.is_null());
            let scene = loaded(&without);
            assert_eq!((scene.triangles.len(), scene.bounds().min.x), (2, 5.0));
            told(&scene, "has no scene; its 1 root nodes");
        }
    }
}

#[test]
fn scenes_may_be_empty_and_further_ones_are_told() {
    let with = |scenes: Value, scene: Value| {
        let mut document = changed(&json!({"/scenes": scenes}));
        document["scene"] = scene;
        document.as_object_mut().unwrap().retain(|_, value| !value.is_null());
        loaded(&document)
    };
    let scene = with(json!([{"nodes": [0]}, {"name": "Scene.001"}]), json!(0));
    assert!(!has_note(&scene, "Scene"), "{:?}", scene.notes);
    // Without a default, an empty first scene is passed over.
    assert_eq!(with(json!([{"name": "empty"}, {"nodes": [0]}]), Value::Null).triangles.len(), 1);
    let scene = with(json!([{"nodes": [0]}, {"nodes": [0]}]), json!(1));
    told(&scene, "Scene 1 is shown; 1 further ones");
}

#[test]
fn textures_without_a_picture_are_left_out_and_told() {
    for extension in ["EXT_texture_webp", "KHR_texture_basisu", "MSFT_texture_dds"] {
        let noted = notes(&json!({
            "/textures": [{"extensions": {extension: {"source": 0}}}, {"extensions": {extension: {"source": 0}}}],
            "/images": [{"uri": "a.webp"}],
            "/materials": [{
                "emissiveTexture": {"index": 0}, "normalTexture": {"index": 1},
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}, "metallicFactor": 0}}],
            "/meshes/0/primitives/0/material": 0,
            "/extensionsUsed": [extension],
            "/extensionsRequired": [extension]
        }));
        assert!(noted.contains(&format!("Left out 2 textures with {extension} alone.")), "{noted}");
    }
    let noted = notes(&json!({
        "/textures": [{}],
        "/materials": [{"occlusionTexture": {"index": 0}}]
    }));
    assert!(noted.contains("Left out 1 textures with no picture alone."), "{noted}");
}

#[test]
fn animations_skins_and_targets_are_told_and_never_refused() {
    let noted = notes(&json!({
        "/animations": [{
            "channels": [{"sampler": 0, "target": {"path": "translation"}}, {"sampler": 0, "target": {"path": "pointer"}}],
            "samplers": [{"input": 99, "output": 99}]}],
        "/skins": [{"joints": [0]}],
        "/nodes/0/skin": 0,
        "/meshes/0/weights": [1.0],
        "/meshes/0/primitives/0/targets": [{"POSITION": 0}]
    }));
    for expected in [
        "Left out 2 channels of animations",
        "Ignored 1 animations",
        "Took 1 primitives without their skins, morph targets and animations: not all its vertices have joints",
    ] {
        assert!(noted.contains(expected), "{noted}");
    }
}

#[test]
fn accessors_without_a_view_hold_zeros() {
    let (mut document, _) = triangle_document();
    let zeros = |kind: &str| json!({"componentType": 5126, "count": 3, "type": kind});
    document["accessors"].as_array_mut().unwrap().extend([zeros("VEC3"), zeros("VEC2")]);
    document["meshes"][0]["primitives"] = json!([
        {"attributes": {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3}, "indices": 1},
        {"attributes": {"POSITION": 2}}, {"attributes": {"POSITION": 0}, "indices": 2}, {"attributes": {"NORMAL": 0}}]);
    let scene = loaded(&document);
    assert_eq!(scene.triangles.len(), 1);
    told(&scene, "Left out 3 primitives without data");
    // Nor do they have to say their box.
    let (mut document, _) = triangle_document();
    document["accessors"][0].as_object_mut().unwrap().retain(|key, _| key != "min" && key != "max");
    assert_eq!(loaded(&document).triangles.len(), 1);
}

#[test]
fn what_is_not_honoured_is_told_once_with_its_count() {
    let unlit = json!({"extensions": {"KHR_materials_unlit": {}}});
    let noted = notes(&json!({
        "/materials": [unlit, unlit, {"extensions": {"KHR_materials_clearcoat": {}, "KHR_materials_ior": {}}}],
        "/meshes/0/primitives/0/attributes/COLOR_0": 0,
        "/samplers": [{"magFilter": 9728}, {"magFilter": 9729}],
        "/nodes/0/extensions": {"EXT_new": {}},
        "/extensionsRequired": ["EXT_new"],
        "/nodes/0/extras": {"extensions": {"EXT_own": {}}},
        "/cameras": [{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0.1}}],
        "/nodes/0/camera": 0
    }));
    for expected in [
        "Ignored 2 uses of the extension KHR_materials_unlit.",
        "Ignored 1 uses of the extension KHR_materials_clearcoat.",
        "Ignored the vertex colours (COLOR_0) of 1 primitives.",
        "1 samplers ask for the nearest pixel",
        "Ignored 1 uses of the extension EXT_new.",
        "The file requires the extension EXT_new, which is not read.",
        "Ignored 1 orthographic cameras.",
    ] {
        assert!(noted.contains(expected), "{expected}: {noted}");
    }
    assert!(!noted.contains("EXT_own") && !noted.contains("KHR_materials_ior"), "{noted}");
}

#[test]
fn materials_of_specular_and_gloss_are_dielectrics() {
    let other = json!({"diffuseFactor": [0.1, 0.2, 0.3, 1], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.75});
    let gloss = json!([{"extensions": {"KHR_materials_pbrSpecularGlossiness": other}}]);
    let scene = loaded(&changed(&json!({
        "/materials": gloss,
        "/meshes/0/primitives/0/material": 0
    })));
    let found = material(&scene);
    assert_eq!((found.base_color, found.metallic, found.roughness), (Vec3::new(0.1, 0.2, 0.3), 0.0, 0.25));
    told(&scene, "Took 1 materials of specular and gloss");
}

#[test]
fn copies_of_a_mesh_stand_where_they_are_put() {
    let mut file = GltfFile::new();
    file.floats("VEC3", &[0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 7.0]);
    file.floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let placed = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2, "ROTATION": 3}}});
    file.json["nodes"] = json!([{"mesh": 0, "scale": [2, 2, 2], "extensions": placed}]);
    let scene = file.load();
    assert_eq!(scene.triangles.len(), 3);
    let first = |triangle: usize| scene.triangles.corners(triangle).map(Vec3::from);
    assert_eq!(first(0)[1], Vec3::new(2.0, 0.0, 0.0));
    // Half a turn about the upright axis of z, at ten by the node's scale.
    assert!((first(1)[1] - Vec3::new(18.0, 0.0, 0.0)).length() < 1e-5, "{:?}", first(1));
    assert_eq!(first(2)[0], Vec3::new(0.0, 0.0, 14.0));
    // Turns in 16 bits: the identity, half a turn about z, and none at all.
    let mut quantised = GltfFile { json: file.json.clone(), data: file.data.clone() };
    quantised.data.truncate(80);
    for turn in [[0i16, 0, 0, i16::MAX], [0, 0, i16::MAX, 0], [0; 4]] {
        quantised.data.extend(turn.into_iter().flat_map(i16::to_le_bytes));
    }
    quantised.json["buffers"][0]["byteLength"] = json!(quantised.data.len());
    quantised.json["bufferViews"][3]["byteLength"] = json!(24);
    quantised.json["accessors"][3]["componentType"] = json!(5122);
    quantised.json["accessors"][3]["normalized"] = json!(true);
    let same = quantised.load();
    for triangle in 0..3 {
        assert_eq!(same.triangles.corners(triangle), scene.triangles.corners(triangle));
    }
    // Without being normalised they stand for nothing.
    quantised.json["accessors"][3]["normalized"] = json!(false);
    let unread = quantised.load();
    assert_eq!(unread.triangles.len(), 1);
    told(&unread, "1 nodes have copies");
    file.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(0);
    file.json["accessors"][0]["count"] = json!(2);
    let odd = load_bytes("odd.glb", &file.bytes());
    assert!(odd.is_err() || has_note(&odd.unwrap(), "1 nodes have copies"));
}

#[test]
fn punctual_lights_are_what_they_are_in_the_file() {
    let scene = loaded(&changed(&json!({
        "/extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": 2, "color": [1, 0, 0]}, {"type": "directional", "color": [0, 1, 0]},
            {"type": "point", "intensity": 40, "range": 9},
            {"type": "spot", "intensity": 100, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.3}},
            {"type": "spot"}, {"type": "point", "intensity": 0}]}},
        "/nodes": [{"mesh": 0, "children": [1, 2, 3, 4, 5, 6], "scale": [3, 3, 3]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"translation": [0, 1, 0], "extensions": {"KHR_lights_punctual": {"light": 2}}},
            {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 3}}},
            {"extensions": {"KHR_lights_punctual": {"light": 4}}},
            {"extensions": {"KHR_lights_punctual": {"light": 5}}}]
    })));
    let position = Vec3::Y * 6.0;
    let cone = Some(Cone::new(Vec3::NEG_Z, 0.2, 0.3));
    let range = f32::INFINITY;
    assert_eq!(
        scene.lights[..4],
        [
            Punctual::towards(Vec3::Z, Vec3::X * 2.0),
            Punctual::towards(Vec3::Z, Vec3::Y),
            Punctual::Point { position: Vec3::Y * 3.0, intensity: Vec3::splat(40.0), cone: None, range: 9.0 },
            Punctual::Point { position, intensity: Vec3::splat(100.0), cone, range },
        ]
    );
    assert_eq!((scene.lights.len(), scene.triangles.len(), scene.sky), (5, 1, Sky::BLACK));
    told(&scene, "Left out 1 lights");
}

#[test]
fn angles_of_view_are_kept_or_told() {
    let camera = |yfov: f64| {
        loaded(&changed(&json!({
            "/cameras": [{"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.1}}],
            "/nodes": [{"mesh": 0, "children": [1]}, {"camera": 0}]
        })))
    };
    for degrees in [0.02_f64, 0.5, 1.0, 169.0] {
        let scene = camera(degrees.to_radians());
        assert!((f64::from(scene.cameras[0].vertical_fov_deg) / degrees - 1.0).abs() < 1e-5);
        assert!(!has_note(&scene, "angle"), "{:?}", scene.notes);
    }
    for (radians, kept) in [(1e-6, 0.01), (3.1, 170.0)] {
        let scene = camera(radians);
        assert_eq!(scene.cameras[0].vertical_fov_deg, kept);
        told(&scene, "the angle of view of 1 cameras");
    }
}

/// A triangle of such a size, once or many times, with a camera, a light and a volume.
fn of_size(size: f32, copies: usize) -> Scene {
    let (mut document, _) = triangle_document();
    let mut data: Vec<u8> =
        [0.0_f32, 0.0, 0.0, size, 0.0, 0.0, 0.0, size, 0.0].map(f32::to_le_bytes).concat();
    data.extend([0_u16, 1, 2].iter().flat_map(|index| index.to_le_bytes()));
    document["accessors"][0]["max"] = json!([size, size, 0.0]);
    let at = |shares: [f32; 3]| json!(shares.map(|share| share * size));
    let mut nodes = vec![
        json!({"camera": 0, "translation": at([0.0, 0.0, 2.0])}),
        json!({"translation": at([0.0, 4.0, 0.0]), "extensions": {"KHR_lights_punctual": {"light": 0}}}),
    ];
    nodes.extend((0..copies).map(|copy| json!({"mesh": 0, "translation": at([copy as f32, 0.0, 0.0])})));
    document["scenes"] = json!([{"nodes": (0..nodes.len()).collect::<Vec<_>>()}]);
    document["nodes"] = json!(nodes);
    document["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}]);
    document["materials"] = json!([{"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": size, "attenuationColor": [0.5, 0.5, 0.5]}}}]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    let light = json!({"type": "point", "intensity": 32.0 * size * size, "range": 8.0 * size});
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
    load_bytes("a.glb", &glb(&document, &data)).unwrap()
}

#[test]
fn scenes_out_of_the_range_of_single_precision_are_drawn_within_it() {
    let usual = of_size(1.0, 3);
    let is_noted = |scene: &Scene| has_note(scene, "all lengths are multiplied by");
    assert!(!is_noted(&usual) && !is_noted(&of_size(1e-6, 3)) && !is_noted(&of_size(1e6, 3)));
    for size in [1e-10, 1e-15, 1e9, 3e11_f32] {
        let scene = of_size(size, 3);
        assert!(is_noted(&scene), "{size}: {:?}", scene.notes);
        let unit = scene.bounds().size().y;
        assert!((0.1..=1e7).contains(&unit), "{size}: {unit}");
        let close = |found: f32, expected: f32| (found / expected - 1.0).abs() < 1e-4;
        assert!(close(scene.bounds().size().x / unit, usual.bounds().size().x));
        let (camera, expected) = (scene.cameras[0], usual.cameras[0]);
        assert!(close(camera.position.z / unit, expected.position.z));
        let light = scene.lights[0].arrival(Vec3::ZERO);
        assert!(close(light.distance / unit, 4.0) && close(light.irradiance.x, 2.0 * (1.0 - 0.0625)));
        let absorption = scene.materials[0].volume.unwrap().absorption.x;
        assert!(close(absorption * unit, usual.materials[0].volume.unwrap().absorption.x));
    }
}

#[test]
fn lights_beyond_the_limit_are_told() {
    let light = json!({"extensions": {"KHR_lights_punctual": {"light": 0}}});
    let mut nodes = vec![light; PUNCTUAL_LIGHTS_MAX + 3];
    nodes.push(json!({"mesh": 0, "children": (0..nodes.len()).collect::<Vec<_>>()}));
    let scene = loaded(&changed(&json!({
        "/extensions": {"KHR_lights_punctual": {"lights": [{"type": "point"}]}},
        "/scenes": [{"nodes": [nodes.len() - 1]}],
        "/nodes": nodes
    })));
    assert_eq!(scene.lights.len(), PUNCTUAL_LIGHTS_MAX);
    told(&scene, "Took the first 65536 of 65539 lights.");
}

#[test]
fn a_file_on_another_axis_is_turned_as_a_whole() {
    let document = |nodes: Value| {
        changed(&json!({
            "/extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot"}, {"type": "directional"}]}},
            "/cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
            "/nodes": nodes
        }))
    };
    let nodes = json!([{"mesh": 0, "children": [1, 2, 3]}, {"camera": 0, "translation": [1, 2, 3]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [4, 5, 6]},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}}]);
    let bytes = glb(&document(nodes), &triangle_document().1);
    let scene = load_files(&[("a.glb", &bytes)], Up::Z).unwrap();
    // The file's up, z, points up in the scene; the former up points away from the viewer.
    assert_eq!((scene.bounds().min, scene.bounds().max), (Vec3::new(0.0, 0.0, -1.0), Vec3::X));
    let camera = scene.cameras[0];
    assert_eq!((camera.position, camera.up), (Vec3::new(1.0, 3.0, -2.0), Vec3::NEG_Z));
    assert!((camera.target - camera.position).normalize().y < -0.999);
    let spot = scene.lights[0].arrival(Vec3::new(4.0, 5.0, -5.0));
    assert_eq!((spot.direction, spot.irradiance), (Vec3::Y, Vec3::ONE));
    assert_eq!(scene.lights[1], Punctual::towards(Vec3::Y, Vec3::ONE));
}

#[test]
fn elements_that_overlap_are_error_of() {
    let message = error_of("close.glb", &glb(&changed(&json!({"/bufferViews/0/byteStride": 11})), &[0; 64]));
    assert!(message.contains("accessor 0 has elements that lie closer together"), "{message}");
    let mut document = changed(&json!({
        "/accessors/0/sparse": {"count": 1, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}},
        "/buffers/0/byteLength": 64
    }));
    document["bufferViews"].as_array_mut().unwrap().extend([
        json!({"buffer": 0, "byteOffset": 42, "byteLength": 2}),
        json!({"buffer": 0, "byteOffset": 44, "byteLength": 12, "byteStride": 4}),
    ]);
    let message = error_of("close.glb", &glb(&document, &[0; 64]));
    assert!(message.contains("sparse elements that lie closer together"), "{message}");
}

#[test]
fn a_corner_that_there_is_not_is_refused_beside_normals_without_length() {
    let mut file = GltfFile::new();
    // A second triangle, one of whose corners there is not; all normals are zero.
    file.data.truncate(42);
    file.data.extend([0_u16, 1, 700].iter().flat_map(|index| index.to_le_bytes()));
    file.json["bufferViews"][1]["byteLength"] = json!(12);
    file.json["accessors"][1]["count"] = json!(6);
    let normals = file.floats("VEC3", &[0.0; 9]);
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    let message = error_of("wild.glb", &file.bytes());
    assert!(message.contains("700"), "{message}");
}

#[test]
fn refusals_name_what_is_missing() {
    for extension in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let document = changed(&json!({
            "/extensionsRequired": [extension],
            "/accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}]
        }));
        let message = error_of("packed.glb", &glb(&document, &[]));
        assert!(message.contains(extension) && message.contains("without mesh compression"), "{message}");
    }
    let document = changed(&json!({
        "/accessors/0/componentType": 5120,
        "/accessors/0/normalized": true
    }));
    let message = error_of("quantised.glb", &glb(&document, &[0; 64]));
    assert!(message.contains("KHR_mesh_quantization is not read"), "{message}");
    let with = |uri: &str| {
        let document = changed(&json!({"/buffers": [{"byteLength": 42, "uri": uri}]}));
        error_of("a.gltf", document.to_string().as_bytes())
    };
    let message = with("gone.bin");
    assert!(message.contains("buffer 0, gone.bin: No such file"), "{message}");
    assert!(with("data:application/octet-stream;base64,AAMA==").contains("base64"));
    assert!(with("data:application/octet-stream,AAAA").contains("base64"));
    assert!(
        with("data:application/octet-stream;base64,AAAA").contains("buffer 0 should have 42 bytes, it has 3")
    );
    assert!(with("https://a.example/b.bin").contains("not a file beside the scene"));
    let old = r#"{"asset": {"version": "1.0"}, "meshes": {}, "scenes": {"s": {"nodes": []}}, "scene": "s"}"#;
    assert!(error_of("old.gltf", old.as_bytes()).contains("version 1.0 of glTF"));
    let mut binary = glb(&triangle_document().0, &triangle_document().1);
    binary[4] = 1;
    assert!(error_of("old.glb", &binary).contains("version 1 of glTF"));
    let newer = changed(&json!({"/asset": {"version": "2.1", "minVersion": "2.1"}}));
    assert!(error_of("new.glb", &glb(&newer, &[])).contains("version 2.1 of glTF"));
    assert!(error_of("none.gltf", b"{\"asset\": {}}").contains("does not say its version"));
    assert!(error_of("list.gltf", b"[1]").contains("is no object"));
}

#[test]
fn names_with_backslashes_spaces_and_marks_are_found() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    let (_, data) = triangle_document();
    for name in ["data/a b.bin", "100%.bin"] {
        std::fs::write(folder.path().join(name), &data).unwrap();
    }
    for uri in ["data\\a b.bin", "data/a%20b.bin", "data/a b.bin", "100%.bin"] {
        let document = changed(&json!({"/buffers": [{"byteLength": 42, "uri": uri}]}));
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, format!("\u{feff}{document}")).unwrap();
        assert_eq!(super::load(&path).map(|scene| scene.triangles.len()).ok(), Some(1), "{uri}");
    }
}
