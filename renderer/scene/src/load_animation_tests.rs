//! Animations, skins and morph targets of glTF, on files of one triangle with values worked out by hand.

use std::{f32::consts::FRAC_1_SQRT_2, sync::Arc};

use glam::Vec3;
use serde_json::{Value, json};

use super::limits::{INSTANCING_SAVES_MIN, POSED_VERTICES_MAX};
use super::load_tests::{GltfFile, told, triangle_document};
use super::motion::{Motion, Mover};
use super::{Scene, Up, gltf_file::shared_meshes, gltf_instances::Copies};

/// A quarter turn about x, from y to z and from z to -y.
const QUARTER: [f32; 4] = [FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2];

impl GltfFile {
    /// Adds an animation of one channel. `path` says the interpolation after a blank, or none.
    fn animate(mut self, node: usize, path: &str, times: &[f32], values: &[f32]) -> Self {
        let (path, interpolation) = path.split_once(' ').unwrap_or((path, "LINEAR"));
        let kind = match path {
            "weights" => "SCALAR",
            "rotation" => "VEC4",
            _ => "VEC3",
        };
        let (input, output) = (self.floats("SCALAR", times), self.floats(kind, values));
        let animations = self.json.as_object_mut().unwrap().entry("animations").or_insert_with(|| json!([]));
        animations.as_array_mut().unwrap().push(json!({
            "samplers": [{"input": input, "output": output, "interpolation": interpolation}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]}));
        self
    }

    fn still(&self) -> Arc<Scene> {
        Arc::new(self.load())
    }

    /// The first triangle's corners at a share of the animation.
    fn at(&self, time: f32) -> [Vec3; 3] {
        corners(&Mover::new(self.still(), Motion::File).unwrap().at(time).unwrap(), 0)
    }
}

fn corners(scene: &Scene, triangle: usize) -> [Vec3; 3] {
    scene.triangles.corners(triangle).map(Vec3::from)
}

#[track_caller]
fn near(found: Vec3, expected: [f32; 3]) {
    assert!(found.distance(Vec3::from(expected)) < 1e-5, "{found} instead of {expected:?}");
}

#[test]
fn keys_are_interpolated_as_they_ask() {
    let file = GltfFile::new().animate(0, "translation", &[0.0, 2.0], &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    near(file.at(0.25)[0], [1.0, 0.0, 0.0]);
    near(file.at(-0.25)[1], [4.0, 0.0, 0.0]);
    let values = [0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 8.0, 0.0, 0.0];
    let file = GltfFile::new().animate(0, "translation STEP", &[0.0, 1.0, 2.0], &values);
    near(file.at(0.4)[0], [0.0; 3]);
    near(file.at(0.6)[0], [4.0, 0.0, 0.0]);
    // Before the first key its value holds.
    let file = GltfFile::new().animate(0, "scale", &[1.0, 2.0], &[3.0, 1.0, 1.0, 5.0, 1.0, 1.0]);
    near(file.at(0.25)[1], [3.0, 0.0, 0.0]);
    near(file.at(0.75)[1], [4.0, 0.0, 0.0]);
    let file = GltfFile::new().animate(0, "rotation", &[0.0, 1.0], &[[0.0, 0.0, 0.0, 2.0], QUARTER].concat());
    near(file.at(0.5)[2], [0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]);
    // Half-way: half of both values, and an eighth of both tangents times two seconds.
    let spline = [[9.0, 0.0, 0.0], [0.0; 3], [4.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0; 3]];
    let file = GltfFile::new().animate(0, "translation CUBICSPLINE", &[0.0, 2.0], &spline.concat());
    near(file.at(0.5)[0], [2.0, 0.0, 0.0]);
    near(file.at(0.0)[0], [0.0; 3]);
}

#[test]
fn children_go_along_and_rest_is_what_nodes_say() {
    let mut file = GltfFile::new().animate(0, "scale", &[0.0], &[2.0; 3]);
    file.json["nodes"] =
        json!([{"children": [1], "scale": [1, 1, 5]}, {"mesh": 0, "translation": [3, 0, 1]}]);
    let scene = file.still();
    near(corners(&scene, 0)[1], [4.0, 0.0, 5.0]);
    near(file.at(0.7)[1], [8.0, 0.0, 2.0]);
    let moved = Mover::new(scene, Motion::File).unwrap().at(0.0).unwrap();
    assert_eq!(moved.name, "a-file");
}

#[test]
fn a_skin_bends_what_hangs_on_it_and_its_node_stays_out() {
    let mut file = GltfFile::new().animate(2, "rotation", &[0.0], &QUARTER);
    let mut to_child = glam::Mat4::from_translation(Vec3::NEG_Y * 0.5).to_cols_array().to_vec();
    to_child.splice(0..0, glam::Mat4::IDENTITY.to_cols_array());
    let bind = file.floats("MAT4", &to_child);
    let joints = file.accessor(5121, "VEC4", 3, &[0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 77]);
    let weights = file.floats("VEC4", &[1.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    file.primitive()["attributes"] =
        json!({"POSITION": 0, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights});
    file.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": bind}]);
    file.json["scenes"] = json!([{"nodes": [0, 1]}]);
    file.json["nodes"] = json!([{"mesh": 0, "skin": 0, "translation": [50, 0, 0]}, {"children": [2]},
        {"translation": [0, 0.5, 0]}]);
    let rest = file.still();
    near(corners(&rest, 0)[1], [1.0, 0.0, 0.0]);
    let [first, second, third] = file.at(0.0);
    near(first, [0.0; 3]);
    near(second, [1.0, 0.25, -0.25]);
    near(third, [0.0, 0.5, 0.5]);
    let moved = Mover::new(rest, Motion::File).unwrap().at(0.0).unwrap();
    let turned = moved.triangles.indices()[0].map(|corner| moved.normals[corner as usize]);
    near(turned[0], [0.0, 0.0, 1.0]);
    near(turned[2], [0.0, -1.0, 0.0]);
    // Of a joint that there is not, nothing hangs.
    file.json["skins"][0]["joints"] = json!([1]);
    told(&file.load(), "a vertex hangs on joint 1 of 1");
}

#[test]
fn targets_morph_at_rest_and_in_motion() {
    let mut file = GltfFile::new().animate(0, "weights", &[0.0, 1.0], &[0.0, 1.0]);
    let up = file.floats("VEC3", &[0.0, 0.0, 2.0].repeat(3));
    let lean = file.floats("VEC3", &[2.0, 0.0, 0.0].repeat(3));
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    file.primitive()["targets"] = json!([{"POSITION": up, "NORMAL": lean}]);
    file.json["meshes"][0]["weights"] = json!([0.25]);
    near(corners(&file.still(), 0)[1], [1.0, 0.0, 0.5]);
    near(file.at(0.5)[1], [1.0, 0.0, 1.0]);
    let moved = Mover::new(file.still(), Motion::File).unwrap().at(0.5).unwrap();
    near(moved.normals[0], [FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2]);
    // A node's own weights stand for those of its mesh.
    file.json["nodes"][0]["weights"] = json!([1.5]);
    near(corners(&file.still(), 0)[1], [1.0, 0.0, 3.0]);
}

#[test]
fn flat_meshes_keep_their_own_normals() {
    let mut file = GltfFile::new().animate(0, "rotation", &[0.0], &QUARTER);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    file.json["meshes"][0]["primitives"] = json!([{"attributes": {"POSITION": 0}},
        {"attributes": {"POSITION": 0, "NORMAL": normals}}]);
    let moved = Mover::new(file.still(), Motion::File).unwrap().at(0.0).unwrap();
    for corner in moved.triangles.indices().iter().flatten() {
        near(moved.normals[*corner as usize], [0.0, -1.0, 0.0]);
    }
}

#[test]
fn a_flat_mesh_under_a_mirrored_armature_keeps_its_front() {
    let mut file = GltfFile::new();
    let joints = file.accessor(5121, "VEC4", 3, &[0; 12]);
    let weights = file.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(3));
    file.primitive()["attributes"] = json!({"POSITION": 0, "JOINTS_0": joints, "WEIGHTS_0": weights});
    file.json["skins"] = json!([{"joints": [1]}]);
    file.json["scenes"] = json!([{"nodes": [0, 1]}]);
    for (scale, x) in [(1.0, 1.0), (-1.0, -1.0)] {
        file.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {"scale": [scale, 1, 1]}]);
        let corners = corners(&file.load(), 0);
        assert!(corners.iter().any(|corner| corner.distance(Vec3::X * x) < 1e-5), "{corners:?}");
        near((corners[1] - corners[0]).cross(corners[2] - corners[0]), [0.0, 0.0, 1.0]);
    }
}

#[test]
fn a_scene_that_is_turned_and_moved_is_so_in_motion() {
    for (up, place) in [(Up::Z, [1.0, 2.0, 3.0]), (Up::X, [1e7, 0.0, 4e6]), (Up::Y, [1e-9, 0.0, 0.0])] {
        let mut file = GltfFile::new().animate(0, "translation", &[0.0], &place);
        let size = if place[0] < 1.0 { 1e-9 } else { 1.0 };
        file.json["nodes"] = json!([{"mesh": 0, "translation": place, "scale": [size, size, size]}]);
        let rest = Arc::new(file.load_upright(up));
        let moved = Mover::new(rest.clone(), Motion::File).unwrap().at(0.0).unwrap();
        for (found, expected) in corners(&moved, 0).into_iter().zip(corners(&rest, 0)) {
            near(found, expected.to_array());
        }
    }
}

#[test]
fn animations_are_chosen_by_name_or_number() {
    let step = |by: f32| [by, 0.0, 0.0];
    let mut file = GltfFile::new()
        .animate(0, "translation", &[0.0], &step(1.0))
        .animate(0, "translation", &[0.0], &step(2.0))
        .animate(0, "translation", &[0.0], &step(3.0));
    file.json["animations"][2]["name"] = json!("1");
    file.json["animations"][1]["name"] = json!("run");
    let scene = file.still();
    told(&scene, "3 animations (0, 1 run, 2 1)");
    let at = |wanted: &str| Mover::of_file(scene.clone(), Some(wanted)).and_then(|mover| mover.at(0.0));
    for (wanted, expected) in [("0", 1.0), ("run", 2.0), ("1", 3.0), ("2", 3.0)] {
        near(corners(&at(wanted).unwrap(), 0)[0], step(expected));
    }
    assert_eq!(at("run").unwrap().name, "a-file1");
    let message = at("walk").map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("\"walk\"") && message.contains("1 run"), "{message}");
}

#[test]
fn animations_that_move_no_mesh_do_not_count() {
    let mut file = GltfFile::new()
        .animate(1, "translation", &[0.0, 4.0], &[0.0, 0.0, 0.0, 9.0, 0.0, 0.0])
        .animate(0, "translation", &[0.0], &[0.0, 3.0, 0.0]);
    file.json["nodes"] = json!([{"mesh": 0}, {}]);
    file.json["scenes"] = json!([{"nodes": [0, 1]}]);
    let scene = file.still();
    told(&scene, "Ignored 1 animations");
    told(&scene, "1 animations (1)");
    let moved = Mover::of_file(scene.clone(), None).unwrap().at(0.0).unwrap();
    near(corners(&moved, 0)[0], [0.0, 3.0, 0.0]);
    let message = Mover::of_file(scene, Some("0")).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("no animation \"0\"") && message.contains("it has: 1."), "{message}");
}

#[test]
fn moving_meshes_stay_instances_where_they_have_no_room() {
    let is_shared = |vertices: u64, is_flattened: bool| {
        let (mut document, _) = triangle_document();
        document["accessors"][0]["count"] = json!(vertices);
        document["accessors"][1]["count"] = json!(vertices);
        document["nodes"] = json!([{"mesh": 0}, {"mesh": 0}]);
        let json = gltf::json::deserialize::from_str(&document.to_string()).unwrap();
        let document = gltf::Document::from_json(json).unwrap();
        shared_meshes(&document, &Copies::new(), &[false, is_flattened])[0].is_some()
    };
    let few = 3 * INSTANCING_SAVES_MIN;
    let many = POSED_VERTICES_MAX as u64;
    assert!(!is_shared(few, false), "it saves too little");
    assert!(is_shared(few + 3, false) && !is_shared(few + 3, true));
    assert!(!is_shared(many / 2, true) && is_shared(many / 2 + 1, true));
    assert!(is_shared(u64::MAX, true), "however many a file says it has");
}

#[test]
fn faults_are_told_and_move_nothing() {
    let still = |file: &GltfFile, note: &str| {
        let scene = file.still();
        told(&scene, note);
        let message = Mover::new(scene, Motion::File).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains("no animation"), "{message}");
    };
    let two = [0.0; 6];
    for times in [[0.0, f32::NAN], [1.0, 0.5], [1.0, 1.0], [-1.0, 1.0], [0.0, f32::INFINITY]] {
        still(&GltfFile::new().animate(0, "translation", &times, &two), "do not rise");
    }
    still(&GltfFile::new().animate(0, "translation", &[0.0], &two), "has 2 elements for 1 keys");
    still(
        &GltfFile::new().animate(0, "translation CUBICSPLINE", &[0.0, 1.0], &two),
        "has 2 elements for 2 keys",
    );
    still(&GltfFile::new().animate(0, "weights", &[0.0, 1.0], &two), "has 6 elements for 2 keys");
    still(&GltfFile::new().animate(0, "translation", &[0.0], &[f32::NAN; 3]), "not finite");
    let good = || GltfFile::new().animate(0, "translation", &[0.0, 1.0], &two);
    let changed = |path: &str, value: Value| {
        let mut file = good();
        *file.json.pointer_mut(path).unwrap() = value;
        file
    };
    let lost = "Left out 1 channels of animations that lead nowhere";
    still(&changed("/animations/0/channels/0/sampler", json!(7)), lost);
    still(&changed("/animations/0/channels/0/target/node", json!(7)), lost);
    still(&changed("/animations/0/channels/0/target/path", json!("pointer")), lost);
    still(&changed("/animations/0/samplers/0/input", json!(99)), lost);
    still(&changed("/animations/0/samplers/0/interpolation", json!("BEZIER")), lost);
    still(&changed("/animations/0/samplers", json!([])), lost);
    still(&changed("/accessors/2/type", json!("VEC2")), "holds Vec2 of F32");
    still(&changed("/accessors/2/count", json!(1_000_000)), "outside its buffer");
    still(&changed("/accessors/3/count", json!(u64::MAX)), "more than");
    still(&changed("/accessors/3/count", json!(0)), "has 0 elements for 2 keys");
    still(&changed("/accessors/2/count", json!(0)), "has no elements");
    // Beside what is read, anything may stand.
    for (path, value) in [
        ("/animations/0/samplers/0/interpolation", json!(null)),
        ("/animations/0/samplers/0/extensions", json!(5)),
        ("/animations/0/channels/0/target", json!({"node": 0, "path": "translation", "extensions": 5})),
        ("/nodes/0", json!({"mesh": 0, "weights": ["a"]})),
        ("/meshes/0/weights", json!({})),
    ] {
        let mut file = good();
        let (above, key) = path.rsplit_once('/').unwrap();
        match file.json.pointer_mut(above).unwrap() {
            Value::Array(all) => all[0] = value,
            other => other[key] = value,
        }
        assert!(Mover::new(file.still(), Motion::File).is_ok(), "{path}");
    }
    let mut file = good();
    file.json["accessors"][3].as_object_mut().unwrap().remove("bufferView");
    still(&file, "outside its buffer");
    // Sparse keys are read: the second is at two seconds.
    let mut file = good();
    let (at, to) = (file.accessor(5121, "SCALAR", 1, &[1]), file.floats("SCALAR", &[2.0]));
    file.json["accessors"][2]["sparse"] = json!({"count": 1, "indices": {"bufferView": at, "componentType": 5121},
        "values": {"bufferView": to}});
    assert!(Mover::new(file.still(), Motion::File).is_ok());
    for part in ["indices", "values"] {
        let whole = file.json["accessors"][2]["sparse"].clone();
        file.json["accessors"][2]["sparse"][part]["byteOffset"] = json!(u64::MAX);
        still(&file, "outside its buffer");
        file.json["accessors"][2]["sparse"] = whole;
    }
    // Keys that lead too far end the motion, not the program.
    let file = GltfFile::new().animate(0, "translation", &[0.0, 1.0], &[0.0, 0.0, 0.0, f32::MAX, 0.0, 0.0]);
    let error = Mover::new(file.still(), Motion::File).unwrap().at(0.9).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("too far"), "{error}");
}

#[test]
fn faults_of_skins_and_targets_leave_the_mesh_as_it_stands() {
    let stands = |targets: Value, skins: Value, note: &str| {
        let mut file = GltfFile::new();
        let _ = file.floats("VEC3", &[1.0; 6]);
        let _ = file.floats("VEC3", &[f32::NAN; 9]);
        let _ = file.floats("MAT4", &[f32::NAN; 16]);
        file.primitive()["targets"] = targets;
        file.json["meshes"][0]["weights"] = json!([1.0]);
        file.json["skins"] = skins;
        file.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {}]);
        let scene = file.load();
        near(corners(&scene, 0)[1], [1.0, 0.0, 0.0]);
        told(&scene, note);
    };
    stands(json!([{"POSITION": 2}]), json!([]), "a morph target has 2 of 3 vertices");
    stands(json!([{"POSITION": 1}]), json!([]), "accessor 1 holds Scalar of U16");
    stands(json!([{"POSITION": 3}]), json!([]), "accessor 3 holds numbers that are not finite");
    stands(json!({"POSITION": 0}), json!([]), "without morph targets that there are not");
    stands(json!([{"POSITION": 9}]), json!([]), "without morph targets that there are not");
    stands(json!([]), json!([]), "without skins that there are not");
    stands(json!([]), json!([{"joints": [9]}]), "Left out skin 0: it has no joints");
    stands(json!([]), json!([{"joints": [1]}]), "node 1, is not in the scene");
    stands(json!([]), json!([{"joints": [0], "inverseBindMatrices": 0}]), "holds Vec3 of F32");
    let bound = json!([{"joints": [0], "inverseBindMatrices": 4}]);
    stands(json!([]), bound, "Left out skin 0: accessor 4 holds numbers that are not finite");
    stands(json!([]), json!([{"joints": [0]}]), "not all its vertices have joints and weights");
}

/// Gives the file a mesh of 600 triangles, and behind its first node as many as make instances of it.
fn add_instances(file: &mut GltfFile) -> usize {
    let count = 2 + INSTANCING_SAVES_MIN as usize / 600;
    let many = [0_u8, 0, 1, 0, 2, 0].repeat(600);
    let indices = file.accessor(5123, "SCALAR", 1800, &many);
    file.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 0}}]},
        {"primitives": [{"attributes": {"POSITION": 0}, "indices": indices}]}]);
    let mut nodes = vec![json!({"mesh": 0})];
    nodes.extend((0..count).map(|number| json!({"mesh": 1, "translation": [number, 0, 0]})));
    file.json["scenes"] = json!([{"nodes": (0..nodes.len()).collect::<Vec<_>>()}]);
    file.json["nodes"] = json!(nodes);
    count
}

#[test]
fn what_moves_beside_instances_moves_whether_they_are_flattened_or_not() {
    let mut file = GltfFile::new().animate(0, "translation", &[0.0], &[0.0, 7.0, 0.0]);
    let count = add_instances(&mut file);
    let scene = file.still();
    assert!(scene.instances.is_some());
    let moved = Mover::new(scene.clone(), Motion::File).unwrap().at(0.0).unwrap();
    assert!(moved.instances.as_ref().unwrap().same_objects(scene.instances.as_ref().unwrap()));
    assert_eq!(corners(&moved, 0)[0].y - corners(&scene, 0)[0].y, 7.0);
    assert_eq!(corners(&moved, 1), corners(&scene, 1));
    let flat = Arc::new(scene.flattened().unwrap());
    let moved = Mover::new(flat.clone(), Motion::File).unwrap().at(0.0).unwrap();
    let rises: Vec<f32> = (0..flat.triangles.len())
        .map(|triangle| corners(&moved, triangle)[0].y - corners(&flat, triangle)[0].y)
        .collect();
    assert_eq!(rises.iter().filter(|rise| **rise == 7.0).count(), 1);
    assert_eq!(rises.iter().filter(|rise| **rise == 0.0).count(), 600 * count);
}

#[test]
fn nodes_carry_instances_that_they_move_without_flattening_them() {
    let up_and_away = [1.0, 0.0, 0.0, 1.0, 8.0, 0.0];
    for (up, size) in [(Up::Y, 1.0_f32), (Up::Z, 1e-12)] {
        let mut file = GltfFile::new().animate(2, "translation", &[0.0, 2.0], &up_and_away);
        let count = add_instances(&mut file);
        // A node hangs on the one that moves, and all on one that makes them smaller.
        file.json["nodes"][2]["children"] = json!([3]);
        let below: Vec<usize> = (0..=count).filter(|node| *node != 3).collect();
        let root = json!({"children": below, "scale": [size, size, size]});
        file.json["nodes"].as_array_mut().unwrap().push(root);
        file.json["scenes"] = json!([{"nodes": [count + 1]}]);
        let rest = Arc::new(file.load_upright(up));
        let now = Mover::new(rest.clone(), Motion::File).unwrap().at(0.5).unwrap();
        assert!(Arc::ptr_eq(&now.triangles, &rest.triangles), "no vertex moves");
        let rise = up.turned(Vec3::Y) * (4.0 * size * rest.placement.factor as f32);
        let placed = |scene: &Scene| scene.instances.as_ref().unwrap().placed().to_vec();
        let ways: Vec<Vec3> = (placed(&now).iter().zip(&placed(&rest)))
            .map(|(now, rest)| Vec3::from(now.to_world.translation - rest.to_world.translation))
            .collect();
        assert_eq!(ways.iter().filter(|way| way.distance(rise) < 1e-3 * rise.length()).count(), 2, "{up:?}");
        assert_eq!(ways.iter().filter(|way| **way == Vec3::ZERO).count(), count - 1, "{up:?}");
        let expected = now.flattened().unwrap();
        let flat = Arc::new(rest.flattened().unwrap());
        let moved = Mover::new(flat, Motion::File).unwrap().at(0.5).unwrap();
        let reach = expected.bounds().diagonal();
        for triangle in (0..expected.triangles.len()).step_by(300) {
            for (found, expected) in corners(&moved, triangle).into_iter().zip(corners(&expected, triangle)) {
                assert!(found.distance(expected) < 1e-5 * reach, "{triangle}: {found}, not {expected}");
            }
        }
    }
    for (least, is_instanced) in [(0.5, true), (0.0, false), (-1.0, false)] {
        let mut file = GltfFile::new().animate(2, "scale", &[0.0, 1.0], &[1.0, 1.0, 1.0, 1.0, least, 1.0]);
        add_instances(&mut file);
        assert_eq!(file.load().instances.is_some(), is_instanced, "{least}");
    }
}
