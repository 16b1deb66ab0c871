//! Lights without size from a glTF file to the picture: as much light as KHR_lights_punctual specifies.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use serde_json::{Value, json};
use treewright_accel::{BuildChoice, NativeOptions};
use treewright_renderer::film::{Film, Picture};
use treewright_renderer::{frame::Renderer, integrator::View, render_options::RenderOptions};
use treewright_scene::{Scene, load};

/// A file of grey triangles, a camera that looks along negative z as it is turned, and lights.
struct File {
    corners: Vec<Vec3>,
    triangles: Vec<[u16; 3]>,
    camera: Value,
    yfov: f64,
    lights: Vec<(Value, Value)>,
}

fn ground(camera: Value, yfov: f64, lights: Vec<(Value, Value)>) -> File {
    let corners = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)];
    File {
        corners: corners.map(|(x, z)| Vec3::new(x, 0.0, z)).to_vec(),
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        camera,
        yfov,
        lights,
    }
}

impl File {
    fn scene(&self, folder: &Path) -> Arc<Scene> {
        let numbers = self.corners.iter().flat_map(|corner| corner.to_array()).flat_map(f32::to_le_bytes);
        let mut data: Vec<u8> = numbers.collect();
        let places = data.len();
        data.extend(self.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()));
        std::fs::write(folder.join("a.bin"), &data).expect("room");
        let mut nodes = vec![json!({"mesh": 0}), self.camera.clone()];
        nodes[1]["camera"] = json!(0);
        for (number, (node, _)) in self.lights.iter().enumerate() {
            let mut node = node.clone();
            node["extensions"] = json!({"KHR_lights_punctual": {"light": number}});
            nodes.push(node);
        }
        let lights: Vec<&Value> = self.lights.iter().map(|(_, light)| light).collect();
        let all: Vec<usize> = (0..nodes.len()).collect();
        let document = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": all}], "nodes": nodes,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0}}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": self.yfov, "znear": 0.01}}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": self.corners.len(), "type": "VEC3"},
                {"bufferView": 1, "componentType": 5123, "count": 3 * self.triangles.len(), "type": "SCALAR"}],
            "bufferViews": [{"buffer": 0, "byteLength": places},
                {"buffer": 0, "byteOffset": places, "byteLength": data.len() - places}],
            "buffers": [{"uri": "a.bin", "byteLength": data.len()}],
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": lights}}
        });
        std::fs::write(folder.join("a.gltf"), document.to_string()).expect("room");
        Arc::new(load(folder.join("a.gltf")).expect("a scene"))
    }

    fn picture(&self, size: u32, samples: u32) -> Picture {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let scene = self.scene(folder.path());
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 1 };
        let mut renderer = Renderer::new(scene, 1).expect("it starts");
        renderer.rebuild(&BuildChoice::Native(NativeOptions::default())).expect("it is built");
        let mut film = Film::new([size, size]);
        for _ in 0..samples {
            renderer.render(&view, &RenderOptions::default(), &mut film);
        }
        film.picture()
    }
}

fn middle(picture: &Picture) -> Vec3 {
    picture.pixel(picture.width / 2, picture.height / 2)
}

/// From above, looking or shining down.
fn above(height: f64) -> Value {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    json!({"translation": [0, height, 0], "rotation": [-half, 0, 0, half]})
}

/// Every kind of light that gives an irradiance of 10 in the middle of the ground is as bright there.
#[test]
fn a_point_of_forty_candela_at_two_metres_is_a_sun_of_ten() {
    let kinds = [
        (above(2.0), json!({"type": "point", "intensity": 40})),
        (above(2.0), json!({"type": "directional", "intensity": 10})),
        (
            above(2.0),
            json!({"type": "spot", "intensity": 40, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.3}}),
        ),
        (above(200.0), json!({"type": "point", "intensity": 400_000})),
        (above(0.002), json!({"type": "point", "intensity": 4e-5})),
    ];
    for (node, light) in kinds {
        let description = light.to_string();
        let near = node["translation"][1].as_f64().expect("a height") * 0.5;
        let file = ground(above(near.min(1.0)), 0.05, vec![(node, light)]);
        let middle = middle(&file.picture(8, 16));
        assert!((middle.x - 1.5).abs() < 0.03, "{description}: {middle}");
    }
    // Fifty lights of a fiftieth each, of which only a few are looked at at once.
    let lights = (0..50).map(|_| (above(2.0), json!({"type": "point", "intensity": 0.8}))).collect();
    let middle = middle(&ground(above(1.0), 0.05, lights).picture(8, 64));
    assert!((middle.x - 1.5).abs() < 0.03, "{middle}");
}

/// One file in two units of length, lit by a surface and a point, gives one picture.
#[test]
fn a_picture_does_not_depend_on_the_unit_of_length() {
    let of = |unit: f64| {
        let lights = vec![(
            json!({"translation": [unit, 2.0 * unit, 0]}),
            json!({"type": "point", "intensity": 40.0 * unit * unit}),
        )];
        let mut file = ground(above(6.0 * unit), 1.2, lights);
        let first = file.corners.len() as u16;
        file.corners.extend(
            [(-2.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (-2.0, 1.0)].map(|(x, z)| Vec3::new(x, 1.0, z)),
        );
        file.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        file.corners.iter_mut().for_each(|corner| *corner *= unit as f32);
        file.picture(16, 16)
    };
    let usual = of(1.0);
    for unit in [1e-10, 1e-3, 1e6, 1e9] {
        let picture = of(unit);
        let pixels = usual.pixels.iter().zip(&picture.pixels);
        // Rays at edges may fall to the other side.
        let others = pixels.filter(|(a, b)| (**a - **b).length() > 0.02 * a.length()).count();
        assert!(others <= 4, "unit {unit}: {others} pixels of 256 differ");
    }
}

/// A long lens on a small patch sees what a short one sees there.
#[test]
fn a_twentieth_of_a_degree_is_seen_right() {
    let lights = || vec![(above(2.0), json!({"type": "point", "intensity": 40}))];
    let middle = middle(&ground(above(500.0), 0.05_f64.to_radians(), lights()).picture(32, 16));
    assert!((middle.x - 1.5).abs() < 0.03, "{middle}");
    // From 500 it covers 0.44: neighbours differ, and the light falls off to either side as it should.
    let row = ground(above(500.0), 0.5_f64.to_radians(), lights()).picture(64, 32);
    for x in 0..64 {
        let off = ((x as f32 + 0.5) / 32.0 - 1.0) * 500.0 * (0.25_f32).to_radians().tan();
        let cosine = 2.0 / off.hypot(2.0);
        let (light, expected) = (row.pixel(x, 32).x, 1.5 * cosine.powi(3));
        assert!((light / expected - 1.0).abs() < 0.1, "{x}: {light} and {expected}");
    }
}

#[test]
fn what_stands_in_the_way_throws_a_sharp_shadow() {
    let light = || vec![(json!({"translation": [0, 4, 0]}), json!({"type": "point", "intensity": 40}))];
    let mut file =
        ground(json!({"translation": [1.5, 1.0, 0], "rotation": above(1.0)["rotation"]}), 0.05, light());
    let open = middle(&file.picture(8, 16)).x;
    // A card half-way up, whose shadow ends at two.
    let first = file.corners.len() as u16;
    file.corners
        .extend([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| Vec3::new(x, 2.0, z)));
    file.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    let shaded = middle(&file.picture(8, 16)).x;
    assert!(open > 0.2 && shaded < 0.05 * open, "{open} {shaded}");
    file.camera["translation"] = json!([2.5, 1.0, 0]);
    assert!(middle(&file.picture(8, 16)).x > 0.2);
}
