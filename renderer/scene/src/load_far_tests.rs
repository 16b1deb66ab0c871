//! Scenes far from their origin, too large or too small for single precision, look like usual copies.

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::json;

use super::load_tests::{GltfFile, has_note, load_bytes, load_files, told};
use super::{Placement, Scene, Up};

/// Three corners in double precision, with a shape that single precision would lose at the offset.
const CORNERS: [DVec3; 3] =
    [DVec3::new(-0.5, 0.0, 0.125), DVec3::new(0.7123, 0.0, 0.0), DVec3::new(0.1, 0.9001, -0.2)];

fn obj(offset: DVec3) -> Scene {
    let vertex =
        |at: &DVec3| format!("v {:.6} {:.6} {:.6}\n", at.x + offset.x, at.y + offset.y, at.z + offset.z);
    let text: String = CORNERS.iter().map(vertex).collect();
    load_bytes("far.obj", (text + "f 1 2 3\n").as_bytes()).expect("a scene")
}

fn ply(offset: DVec3) -> Scene {
    let properties = "property double x\nproperty double y\nproperty double z\n";
    let head = format!("ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\n");
    let vertex = |at: &DVec3| format!("{} {} {}\n", at.x + offset.x, at.y + offset.y, at.z + offset.z);
    let text: String = CORNERS.iter().map(vertex).collect();
    let faces = "property list uchar int vertex_indices\nend_header\n";
    load_bytes("far.ply", (head + faces + &text + "3 0 1 2\n").as_bytes()).expect("a scene")
}

/// The edges from the first corner, which no movement changes.
fn edges(scene: &Scene) -> [Vec3; 2] {
    let [a, b, c] = scene.triangles.corners(0).map(Vec3::from);
    [b - a, c - a]
}

#[test]
fn text_in_double_precision_keeps_its_digits_far_away() {
    let far = DVec3::new(448_000.0, 5_411_000.0, 120.0);
    for load in [obj, ply] {
        let (near, far_scene) = (load(DVec3::ZERO), load(far));
        assert_eq!(near.placement, Placement::default());
        assert!(!has_note(&near, "moved"));
        for (near, far) in edges(&near).into_iter().zip(edges(&far_scene)) {
            assert!((near - far).abs().max_element() < 1e-6, "{near} {far}");
        }
        told(&far_scene, "lies far from its origin");
        // A place of the file is found again, for cameras that people give.
        let corner = Vec3::from(far_scene.triangles.corners(0)[0]);
        assert!((far_scene.placement.in_scene(far + CORNERS[0]) - corner).length() < 1e-6);
        assert!(far_scene.bounds().center().length() < 1.0);
    }
}

#[test]
fn what_stands_upright_otherwise_is_moved_along_the_turned_axes() {
    let text = b"v 4e6 2e5 10\nv 4000001 2e5 10\nv 4e6 2e5 11\nf 1 2 3\n";
    let scene = load_files(&[("far.obj", text)], Up::Z).expect("a scene");
    let [a, _, c] = scene.triangles.corners(0).map(Vec3::from);
    assert_eq!(c - a, Vec3::Y, "the file's z is up");
    // Turned, the file's x, y, z are x, -z, y.
    assert_eq!(scene.placement.in_scene(DVec3::new(4e6, 10.0, -2e5)), a);
}

#[test]
fn nodes_far_away_keep_the_digits_of_their_meshes_and_lights_and_cameras_go_along() {
    let mut file = GltfFile::new();
    let document = &mut file.json;
    let far = [1e6, -2e6, 3e6];
    document["nodes"] = json!([
        {"translation": far, "children": [1, 2, 3]},
        {"mesh": 0, "translation": [0.1, 0.2, 0.3]},
        {"camera": 0, "translation": [0, 0, 5]},
        {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]);
    document["scenes"] = json!([{"nodes": [0]}]);
    document["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]);
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
    let scene = file.load();
    file.json["nodes"][0]["translation"] = json!([0, 0, 0]);
    let near = file.load();
    assert_eq!(edges(&scene), edges(&near));
    let corner = |scene: &Scene| Vec3::from(scene.triangles.corners(0)[0]);
    let eye = |scene: &Scene| scene.cameras[0].position - corner(scene);
    let light = |scene: &Scene| scene.lights[0].arrival(corner(scene));
    assert!((eye(&scene) - eye(&near)).length() < 1e-5);
    assert!((light(&scene).distance - light(&near).distance).abs() < 1e-5);
    assert_ne!(scene.placement, Placement::default());
}

#[test]
fn a_far_corner_is_too_far_and_not_called_infinite() {
    let refused = |far: &str| {
        let text = format!("v 0 0 0\nv 1 0 0\nv 0 {far} 0\nf 1 2 3\n");
        load_bytes("a.obj", text.as_bytes()).map(|_| ()).expect_err("nothing is left").to_string()
    };
    assert!(refused("1e30").contains("too far out, beyond ±1e12"), "{}", refused("1e30"));
    assert!(refused("nan").contains("not finite"), "{}", refused("nan"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_scene_of_any_size_and_place_is_the_same_triangle(
        size in -11.0_f64..11.0, distance in -2.0_f64..6.0, seed in 0_u32..8,
    ) {
        let size = 10_f64.powf(size);
        let sign = |bit: u32| if seed >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let far = 10_f64.powf(distance) * size;
        prop_assume!(far < 5e11);
        let offset = DVec3::new(far * sign(0), far * sign(1), far * sign(2));
        let vertex = |at: &DVec3| {
            let at = *at * size + offset;
            format!("v {:e} {:e} {:e}\n", at.x, at.y, at.z)
        };
        let text: String = CORNERS.iter().map(vertex).collect();
        let scene = load_bytes("a.obj", (text + "f 1 2 3\n").as_bytes()).expect("a scene");
        let scale = (size * scene.placement.factor) as f32;
        for (edge, expected) in edges(&scene).into_iter().zip([CORNERS[1], CORNERS[2]]) {
            let expected = (expected - CORNERS[0]).as_vec3();
            prop_assert!((edge / scale - expected).length() < 3e-5, "{} {}", edge / scale, expected);
        }
        for corner in CORNERS {
            let at = scene.placement.in_scene(corner * size + offset) / scale;
            let is_there = scene.triangles.corners(0).iter()
                .any(|there| (Vec3::from(*there) / scale - at).length() < 3e-5);
            prop_assert!(is_there, "{at}");
        }
    }
}
