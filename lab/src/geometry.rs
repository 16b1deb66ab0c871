//! The hash of a scene's geometry, so that another scene under its name is noticed.

use glam::Vec3;
use sha2::{Digest, Sha256};

use treewright_scene::Scene;

fn numbers(hash: &mut Sha256, vector: Vec3) {
    for number in vector.to_array() {
        hash.update(number.to_le_bytes());
    }
}

/// SHA-256 of vertices, triangles and instances, in hexadecimal digits.
pub(crate) fn geometry_hash(scene: &Scene) -> String {
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
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use treewright_scene::builtin;

    use super::*;

    #[test]
    fn geometry_counts_and_nothing_else() {
        let scene = |detail| {
            let options = builtin::Options { detail, ..builtin::Options::default() };
            builtin::build("quick", &options).expect("it is built in")
        };
        let hash = geometry_hash(&scene(0.05));
        let mut painted = scene(0.05);
        painted.materials[0].roughness *= 0.5;
        assert_eq!((geometry_hash(&painted), hash.len()), (hash.clone(), 64));
        assert_ne!(geometry_hash(&scene(0.1)), hash);
    }
}
