//! The readers on small files written here.

use std::path::Path;

use glam::Vec3;
use serde_json::{Value, json};

use super::{Material, Punctual, Scene, SceneError, Sky, Up, load, load_upright};

/// Writes files into a folder of their own and loads the first.
pub(super) fn load_files(files: &[(&str, &[u8])], up: Up) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    load_upright(folder.path().join(files[0].0), up)
}

pub(super) fn load_bytes(name: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    load_files(&[(name, bytes)], Up::Y)
}

/// Why a file is refused, in words that name it.
pub(super) fn error_of(name: &str, bytes: &[u8]) -> String {
    let message = load_bytes(name, bytes).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains(name), "the message does not name the file: {message}");
    message
}

pub(super) fn has_note(scene: &Scene, part: &str) -> bool {
    scene.notes.iter().any(|note| note.contains(part))
}

/// Asserts that a note says this.
#[track_caller]
pub(super) fn told(scene: &Scene, part: &str) {
    assert!(has_note(scene, part), "{part}: {:?}", scene.notes);
}

/// The material of the first mesh.
pub(super) fn material(scene: &Scene) -> Material {
    scene.materials[scene.meshes[0].material as usize]
}

/// A binary glTF file of one JSON and one data chunk.
pub(super) fn glb(document: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut data = data.to_vec();
    data.resize(data.len().next_multiple_of(4), 0);
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend(((12 + 8 + text.len() + 8 + data.len()) as u32).to_le_bytes());
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(text);
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(data);
    file
}

/// One triangle in the xy plane with 16-bit indices: the document and its data.
pub(super) fn triangle_document() -> (Value, Vec<u8>) {
    let mut data: Vec<u8> = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect();
    data.extend([0_u16, 1, 2].iter().flat_map(|index| index.to_le_bytes()));
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"name": "wedge", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "buffers": [{"byteLength": data.len()}]
    });
    (document, data)
}

/// A glTF document that grows, and its data.
pub(super) struct GltfFile {
    pub(super) json: Value,
    pub(super) data: Vec<u8>,
}

impl GltfFile {
    /// A triangle at (0, 0, 0), (1, 0, 0), (0, 1, 0).
    pub(super) fn new() -> Self {
        let (json, data) = triangle_document();
        Self { json, data }
    }

    /// Adds bytes to the data and returns the number of their view.
    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        let number = views.len();
        views.push(json!({"buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len()}));
        self.data.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.data.len());
        number
    }

    pub(super) fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(json!({"bufferView": view, "componentType": component, "count": count, "type": kind}));
        accessors.len() - 1
    }

    pub(super) fn floats(&mut self, kind: &str, numbers: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.accessor(5126, kind, numbers.len() / width, &bytes)
    }

    pub(super) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        glb(&self.json, &self.data)
    }

    pub(super) fn load(&self) -> Scene {
        self.load_upright(Up::Y)
    }

    pub(super) fn load_upright(&self, up: Up) -> Scene {
        load_files(&[("a.glb", &self.bytes())], up).unwrap()
    }
}

#[test]
fn what_is_no_scene_file_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| load(path).map(|_| ()).unwrap_err().to_string();
    assert!(message(&folder.path().join("absent.glb")).contains("cannot read"));
    assert!(message(folder.path()).contains("is a folder"));
    assert!(error_of("model.stl", b"solid Empty\nendsolid Empty").contains("STL"));
    assert!(error_of("model.xyz", b"0 0 0").contains(".xyz"));
    assert!(error_of("model", b"0 0 0").contains("without an extension"));
    for name in ["a.glb", "a.gltf", "a.obj", "a.ply"] {
        assert!(error_of(name, b"").contains("is empty"));
    }
}

#[test]
fn gltf_nodes_share_meshes_and_carry_transforms() {
    let (mut document, data) = triangle_document();
    document["nodes"] = json!([
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0, std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2]}]);
    let scene = load_bytes("two.glb", &glb(&document, &data)).unwrap();
    assert_eq!((scene.name.as_str(), scene.triangles.len(), scene.meshes.len()), ("two", 2, 2));
    let corner = |triangle: usize, corner: usize| Vec3::from(scene.triangles.corners(triangle)[corner]);
    assert_eq!(corner(0, 1), Vec3::new(12.0, 0.0, 0.0));
    assert!((corner(1, 1) - Vec3::new(10.0, 1.0, 0.0)).length() < 1e-5);
    assert_eq!(scene.sky, Sky::daylight());
    assert_eq!(scene.cameras.len(), 1);
}

/// A mesh of 600 triangles and `nodes` nodes that show it, each a step to the right of the one before.
fn many_nodes(nodes: usize) -> Scene {
    let (mut document, mut data) = triangle_document();
    data.truncate(36);
    data.extend([0_u16, 1, 2].repeat(600).iter().flat_map(|index| index.to_le_bytes()));
    document["accessors"][1]["count"] = json!(1800);
    document["bufferViews"][1]["byteLength"] = json!(3600);
    document["buffers"][0]["byteLength"] = json!(data.len());
    let node = |number: usize| json!({"mesh": 0, "translation": [2 * number, 0, 0]});
    let mut all: Vec<Value> = (0..nodes).map(node).collect();
    // One that is flattened cannot be an instance.
    all.push(json!({"mesh": 0, "scale": [0, 1, 1]}));
    document["scenes"][0]["nodes"] = (0..all.len()).collect();
    document["nodes"] = Value::Array(all);
    load_bytes("many.glb", &glb(&document, &data)).unwrap()
}

#[test]
fn gltf_meshes_of_many_nodes_become_instances() {
    let nodes = 1 + super::limits::INSTANCING_SAVES_MIN as usize / 600;
    let scene = many_nodes(nodes);
    assert_eq!(scene.triangles.len(), 2 * 600, "the object and the flattened one");
    assert_eq!(scene.placed().count(), (nodes as u64 + 1) * 600);
    let flat = scene.flattened().unwrap();
    assert!(flat.instances.is_none());
    assert_eq!(flat.triangles.len() as u64, scene.placed().count());
    assert_eq!((flat.meshes.len(), flat.bounds()), (nodes + 1, scene.bounds()));
    let few = many_nodes(9);
    assert!(few.instances.is_none());
    assert_eq!(few.triangles.len(), 6000);
}

#[test]
fn gltf_materials_cameras_and_lights() {
    let (mut document, data) = triangle_document();
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 1], "metallicFactor": 0.25, "roughnessFactor": 0.5},
        "emissiveFactor": [1, 0.5, 0],
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 4},
            "KHR_materials_transmission": {"transmissionFactor": 0.75}, "KHR_materials_ior": {"ior": 1.4}}}]);
    document["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]);
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "directional", "color": [1, 1, 0.5], "intensity": 2}, {"type": "point", "intensity": 3}]}});
    document["nodes"] = json!([
        {"mesh": 0, "children": [1, 2, 3]},
        {"camera": 0, "translation": [0, 0, 5]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 1}}}]);
    document["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_emissive_strength"]);
    let scene = load_bytes("lit.glb", &glb(&document, &data)).unwrap();
    let material = material(&scene);
    assert_eq!(material.base_color, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(
        (material.metallic, material.roughness, material.transmission, material.ior),
        (0.25, 0.5, 0.75, 1.4)
    );
    assert_eq!(material.emission, Vec3::new(4.0, 2.0, 0.0));
    let camera = scene.cameras[0];
    assert_eq!((camera.position, camera.up), (Vec3::new(0.0, 0.0, 5.0), Vec3::Y));
    assert!((camera.vertical_fov_deg - 57.2958).abs() < 1e-3 && camera.target.z < 1.0);
    assert_eq!(scene.sky, Sky::BLACK);
    let lights = [
        Punctual::towards(Vec3::Z, Vec3::new(2.0, 2.0, 1.0)),
        Punctual::point(Vec3::Y * 2.0, Vec3::splat(3.0)),
    ];
    assert_eq!((scene.lights, scene.meshes.len()), (lights.to_vec(), 1));
}

#[test]
fn gltf_text_with_embedded_data_and_scene_extras() {
    use base64::Engine as _;
    let (mut document, data) = triangle_document();
    let encoded = base64::engine::general_purpose::STANDARD.encode(&data);
    document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{encoded}"));
    document["scenes"][0]["extras"] = json!({
        "cameras": [{"lookat": [1, 2, 3, 0, 0, 0, 0, 1, 0]},
                    {"world_to_camera": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], "params": {"fov": [30]}}],
        "lights": [{"type": "infinite"}]});
    let scene = load_bytes("extras.gltf", document.to_string().as_bytes()).unwrap();
    assert_eq!(scene.cameras.len(), 1);
    assert_eq!(scene.cameras[0].position, Vec3::new(1.0, 2.0, 3.0));
    assert!(scene.cameras[0].target.length() < 1e-5);
    assert_eq!(scene.sky, Sky::daylight());
}

#[test]
fn damaged_gltf_files() {
    let (document, data) = triangle_document();
    let whole = glb(&document, &data);
    assert!(error_of("cut.glb", &whole[..whole.len() - 9]).contains("cut off"));
    for length in 1..whole.len() {
        assert!(load_bytes("cut.glb", &whole[..length]).is_err(), "{length} bytes are no whole file");
    }
    let changed = |pointer: &str, value: Value| {
        let mut document = document.clone();
        *document.pointer_mut(pointer).unwrap() = value;
        glb(&document, &data)
    };
    let strange = json!([{"byteLength": data.len(), "uri": "wedge%AA.bin"}]);
    let strange = error_of("strange.glb", &changed("/buffers", strange));
    assert!(strange.contains("not UTF-8") && strange.contains("wedge%AA.bin"), "{strange}");
    let far = error_of("far.glb", &changed("/accessors/0/count", json!(3_000_000)));
    assert!(far.contains("wedge") && far.contains("outside its buffer"), "{far}");
    assert!(error_of("huge.glb", &changed("/accessors/0/count", json!(u64::MAX))).contains("limit"));
    assert!(error_of("none.glb", &changed("/accessors/1/count", json!(0))).contains("no triangle"));
    assert!(error_of("view.glb", &changed("/bufferViews/0/byteLength", json!(u64::MAX))).contains("outside"));
    assert!(
        error_of("loop.glb", &changed("/nodes/0", json!({"mesh": 0, "children": [0]}))).contains("ancestor")
    );
    assert!(error_of("mesh.glb", &changed("/nodes/0/mesh", json!(9))).contains("Index out of bounds"));
    let points = changed("/meshes/0/primitives/0", json!({"attributes": {"POSITION": 0}, "mode": 0}));
    assert!(error_of("points.glb", &points).contains("Ignored 1 primitives"));
    let astray = changed("/meshes/0/primitives/0/attributes/POSITION", json!(7));
    assert!(error_of("astray.glb", &astray).contains("names accessor 7"));
    let typed = changed("/accessors/1/componentType", json!(5126));
    assert!(error_of("typed.glb", &typed).contains("accessor 1 holds"));
    let no_mesh = glb(&json!({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}), &[]);
    assert!(error_of("bare.glb", &no_mesh).contains("no meshes"));
    assert!(error_of("text.gltf", b"{\"asset\": ").contains("glTF"));
    let mut wild = data.clone();
    wild[36] = 77;
    let message = error_of("wild.glb", &glb(&document, &wild));
    assert!(message.contains("wedge") && message.contains("names vertex 77"), "{message}");
    let mut compressed = document.clone();
    compressed["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(error_of("draco.glb", &glb(&compressed, &data)).contains("without mesh compression"));
}

#[test]
fn obj_with_materials_quads_and_relative_numbers() {
    let mtl = "newmtl lamp\nKd 0 0 0\nKe 2 3 4\nnewmtl chrome\nKd 0 0 0\nKs 0.9 0.8 0.7\nNs 998\nnewmtl bad\nKd 1 0\nmap_Kd a.png\n";
    let obj = "mtllib square.mtl\nmtllib gone.mtl\no square\nv 0 0 0 1 1 1\nv 1 0 0 nan nan nan\nv 1 1 0\nv 0 1 0\n\
               vn 0 0 1\nusemtl lamp\nf -4//-1 -3//-1 -2//-1 -1//-1\nusemtl chrome\nf 1//1 2//1 3//1\nusemtl bad\nf 1//1 2//1 3//1\nl 1 2 3\n";
    let files = [("square.obj", obj.as_bytes()), ("square.mtl", mtl.as_bytes())];
    let scene = load_files(&files, Up::Y).unwrap();
    assert_eq!(scene.triangles.len(), 4);
    let material = |mesh: usize| scene.materials[scene.meshes[mesh].material as usize];
    assert_eq!(material(0).emission, Vec3::new(2.0, 3.0, 4.0));
    assert_eq!((material(1).metallic, material(1).base_color), (1.0, Vec3::new(0.9, 0.8, 0.7)));
    assert!(material(1).roughness < 0.25);
    assert!(scene.normals.iter().all(|normal| *normal == Vec3::Z));
    assert_eq!(scene.sky, Sky::BLACK, "a lamp shines");
    for expected in ["gone.mtl", "a.png", "Ignored 1 points"] {
        told(&scene, expected);
    }
}

#[test]
fn bad_obj_files() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let message = error_of("far.obj", format!("{corners}f 1 2 3\nf 1 2 9\n").as_bytes());
    assert!(message.contains("line 5") && message.contains("vertex 9"), "{message}");
    assert!(error_of("back.obj", format!("{corners}f -1 -2 -4\n").as_bytes()).contains("vertex -4"));
    let scene =
        load_bytes("nan.obj", format!("{corners}v nan 0 inf\nf 1 2 3\nf 1 2 4\n").as_bytes()).unwrap();
    assert_eq!(scene.triangles.len(), 1);
    assert!(scene.notes.iter().any(|note| note.starts_with("Dropped 1 ")));
    let message = error_of("lines.obj", format!("{corners}l 1 2\np 3\n").as_bytes());
    assert!(message.contains("Ignored 2") && message.contains("no faces"), "{message}");
    assert!(error_of("comment.obj", b"# nothing\n").contains("no faces"));
    assert!(load_bytes("latin.obj", format!("# caf\u{e9}\n{corners}f 1 2 3\n").as_bytes()).is_ok());
    assert!(error_of("noise.obj", &[0xff, 0xfe, 0x00, 0x01]).contains("no faces"));
}

#[test]
fn ply_in_text_and_in_both_byte_orders() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment hand-made\nelement vertex 4\nproperty double x\nproperty float y\n\
             property float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let corners = [(0.0_f64, 0.0_f32), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let mut text = header("ascii");
    corners.iter().for_each(|(x, y)| text.push_str(&format!("{x} {y} 2 255\n")));
    text.push_str("4 0 1 2 3\n");
    let (mut little, mut big) =
        (header("binary_little_endian").into_bytes(), header("binary_big_endian").into_bytes());
    for (x, y) in corners {
        little.extend([&x.to_le_bytes()[..], &y.to_le_bytes(), &2.0_f32.to_le_bytes(), &[255]].concat());
        big.extend([&x.to_be_bytes()[..], &y.to_be_bytes(), &2.0_f32.to_be_bytes(), &[255]].concat());
    }
    little.push(4);
    big.push(4);
    for index in 0..4_i32 {
        little.extend(index.to_le_bytes());
        big.extend(index.to_be_bytes());
    }
    for bytes in [text.as_bytes(), &little, &big] {
        let scene = load_bytes("square.ply", bytes).unwrap();
        assert_eq!(scene.triangles.indices(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(Vec3::from(scene.triangles.corners(1)[1]), Vec3::new(1.0, 1.0, 2.0));
        assert!(scene.normals.is_empty());
    }
    assert!(load_bytes("cut.ply", &little[..little.len() - 1]).is_err());
}

#[test]
fn bad_ply_files() {
    let file = |vertices: u64, faces: &str, rest: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {faces}\nproperty list uchar int vertex_index\nend_header\n{rest}"
        )
    };
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    let message = error_of("points.ply", file(3, "0", points).as_bytes());
    assert!(message.contains("3 vertices and 0 faces"), "{message}");
    assert!(
        error_of("far.ply", file(3, "1", &format!("{points}3 0 1 5\n")).as_bytes()).contains("[0, 1, 5]")
    );
    assert!(
        error_of("minus.ply", file(3, "1", &format!("{points}3 0 1 -1\n")).as_bytes()).contains("negative")
    );
    assert!(
        error_of("cut.ply", file(3, "2", &format!("{points}3 0 1 2\n")).as_bytes()).contains("end of file")
    );
    assert!(error_of("huge.ply", file(u64::MAX, "1", points).as_bytes()).contains("cannot be read as PLY"));
    assert!(error_of("many.ply", file(4_000_000_000, "1", points).as_bytes()).contains("more than the file"));
    assert!(error_of("bare.ply", b"ply\nformat ascii 1.0\nend_header\n").contains("0 vertices"));
    assert!(error_of("not.ply", b"solid of something else").contains("ply"));
    let two_corners = file(3, "2", &format!("{points}2 0 1\n3 0 1 2\n"));
    assert_eq!(load_bytes("two.ply", two_corners.as_bytes()).unwrap().triangles.len(), 1);
}
