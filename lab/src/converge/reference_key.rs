//! The scene, view and settings of a reference, so that a stored one is not taken for another picture's.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use treewright_renderer::integrator::View;
use treewright_scene::{Camera, Scene};

/// Goes up when the path tracer's pictures change in the mean, which makes old references useless.
const REVISION: u32 = 2;

/// Everything that a picture's expected value depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceKey {
    /// Revision of the path tracer.
    pub revision: u32,
    /// Name of the scene, for people.
    pub scene: String,
    /// SHA-256 of its geometry, materials and lights, in hexadecimal digits.
    pub scene_hash: String,
    /// Position, target, up vector and vertical angle of view in degrees.
    pub camera: [f32; 10],
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Most bounces of a path.
    pub bounces: u32,
}

impl ReferenceKey {
    /// The key of a view of a scene. Reads the whole scene.
    pub fn new(scene: &Scene, view: &View, width: u32, height: u32) -> Self {
        Self {
            revision: REVISION,
            scene: scene.name.clone(),
            scene_hash: scene_hash(scene),
            camera: camera_numbers(&view.camera, width as f32 / height as f32),
            size: [width, height],
            bounces: view.bounces,
        }
    }

    /// The first difference of `stored` from this key, in words; `None` if they agree.
    pub fn difference(&self, stored: &Self) -> Option<String> {
        let size = |[width, height]: [u32; 2]| format!("{width}x{height} pixels");
        if self.size != stored.size {
            return Some(format!("it has {}, {} are asked for", size(stored.size), size(self.size)));
        }
        if self.scene_hash != stored.scene_hash {
            let same = if self.scene == stored.scene { ", whose contents were others," } else { "" };
            return Some(format!("it shows the scene {}{same} and not this {}", stored.scene, self.scene));
        }
        if self.camera != stored.camera {
            return Some("it was seen by another camera".to_owned());
        }
        if self.bounces != stored.bounces {
            return Some(format!(
                "its paths have up to {} bounces, {} are asked for",
                stored.bounces, self.bounces
            ));
        }
        (self.revision != stored.revision)
            .then(|| "it was rendered by another version of the path tracer".to_owned())
    }
}

fn camera_numbers(camera: &Camera, aspect: f32) -> [f32; 10] {
    let [a, b, c] = camera.position.to_array();
    let [d, e, f] = camera.target.to_array();
    let [g, h, i] = camera.up.to_array();
    [a, b, c, d, e, f, g, h, i, 2.0 * camera.half_height(aspect).atan().to_degrees()]
}

fn numbers(hash: &mut Sha256, vector: Vec3) {
    for number in vector.to_array() {
        hash.update(number.to_le_bytes());
    }
}

/// Vertices, triangles and instances.
fn geometry(scene: &Scene) -> Sha256 {
    let mut hash = Sha256::new();
    for &position in scene.triangles.positions() {
        numbers(&mut hash, position.into());
    }
    for triangle in scene.triangles.indices() {
        for index in triangle {
            hash.update(index.to_le_bytes());
        }
    }
    if let Some(instances) = &scene.instances {
        hash.update(format!("{:?}", instances.objects()));
        for instance in instances.placed() {
            hash.update(format!("{instance:?}"));
        }
    }
    hash
}

fn hexadecimal(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of the geometry alone, in hexadecimal digits: vertices, triangles, instances.
pub(crate) fn geometry_hash(scene: &Scene) -> String {
    hexadecimal(geometry(scene))
}

fn scene_hash(scene: &Scene) -> String {
    let mut hash = geometry(scene);
    for &normal in &scene.normals {
        numbers(&mut hash, normal);
    }
    for mesh in &scene.meshes {
        for number in [mesh.first_triangle, mesh.triangle_count, mesh.material] {
            hash.update(number.to_le_bytes());
        }
    }
    // The debug output holds every field with all digits, also fields that are added later.
    hash.update(format!("{:?} {:?}", scene.materials, scene.sky));
    for uv in &scene.uvs {
        numbers(&mut hash, uv.extend(0.0));
    }
    for texture in &scene.textures {
        hash.update(format!("{texture:?}"));
    }
    for &pixel in scene.environment.iter().flat_map(|environment| environment.pixels()) {
        numbers(&mut hash, pixel);
    }
    hexadecimal(hash)
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_scene::builtin;

    fn scene() -> Scene {
        builtin::build("quick", &builtin::Options { detail: 0.05, ..builtin::Options::default() })
            .expect("it is built in")
    }

    #[test]
    fn every_part_counts_and_is_named() {
        let scene = scene();
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 3 };
        let key = ReferenceKey::new(&scene, &view, 32, 24);
        assert_eq!(key.difference(&ReferenceKey::new(&scene, &View { seed: 9, ..view }, 32, 24)), None);
        let difference = |scene: &Scene, view: View, width: u32| {
            key.difference(&ReferenceKey::new(scene, &view, width, 24)).expect("they differ")
        };
        assert!(difference(&scene, view, 33).contains("33x24 pixels, 32x24 pixels are asked for"));
        assert!(difference(&scene, View { bounces: 4, ..view }, 32).contains("up to 4 bounces"));
        let camera = Camera { vertical_fov_deg: 10.0, ..view.camera };
        assert!(difference(&scene, View { camera, ..view }, 32).contains("another camera"));
        let mut other = scene.clone();
        other.materials[0].roughness *= 0.5;
        assert!(difference(&other, view, 32).contains("whose contents were others"));
        let mut other = scene.clone();
        other.sky.zenith.x += 1.0;
        assert!(difference(&other, view, 32).contains("the scene"));
        let old = ReferenceKey { revision: 0, ..key.clone() };
        assert!(key.difference(&old).is_some_and(|message| message.contains("another version")));
    }
}
