//! The indicators of a [`Scene`]: its meshes and lights, handed to `treewright-indicators`, which defines the
//! indicators.
//!
//! - The contents of an instance count as if they stood there themselves, so that a scene has equal
//!   indicators with instances and flattened.
//! - Light sources are meshes that glow, plus one each for a sky that is not black and for a sun.

use glam::Vec3;
use treewright_indicators::{Accumulator, Surface, View};

pub use treewright_indicators::{IndicatorScale, IndicatorSpec, Indicators, SCHEMA};

use crate::{Camera, Material, Scene};

/// The part that depends on the scene alone: computed once, used for every frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneIndicators(treewright_indicators::SceneIndicators);

impl SceneIndicators {
    /// Goes once through all triangles, those of every instance counted.
    pub fn of(scene: &Scene) -> Self {
        let bounds = scene.bounds();
        let placed = scene.placed();
        let mut all = Accumulator::new(bounds.min.as_dvec3(), bounds.max.as_dvec3());
        for (mesh, instance) in scene.placed_meshes() {
            let material = &scene.materials[mesh.material as usize];
            let surface = Surface {
                diffuse_share: diffuse_share(material),
                emits: material.emission.max_element() > 0.0,
            };
            let triangles = mesh.first_triangle..mesh.first_triangle + mesh.triangle_count;
            let corners =
                |triangle| placed.corners(triangle, instance).map(|corner| Vec3::from(corner).as_dvec3());
            all.mesh(surface, triangles.map(corners));
        }
        let sky = &scene.sky;
        let has_gradient = sky.zenith.max_element() > 0.0 || sky.horizon.max_element() > 0.0;
        let lights = u32::from(has_gradient) + u32::from(sky.sun.is_some()) + scene.lights.len() as u32;
        Self(all.finish(lights))
    }

    /// Adds a camera. Numbers of the camera that are not finite count as 0.
    pub fn with_camera(&self, camera: &Camera) -> Indicators {
        self.0.with_camera(&View {
            position: camera.position.as_dvec3(),
            target: camera.target.as_dvec3(),
            vertical_fov_deg: f64::from(camera.vertical_fov_deg),
        })
    }
}

/// Share of a surface's reflection that scatters widely: 1 if matt, 0 for mirrors, else as it is rough.
fn diffuse_share(material: &Material) -> f64 {
    let [metallic, roughness, transmission, ior] =
        [material.metallic, material.roughness, material.transmission, material.ior].map(f64::from);
    let facing = ((ior - 1.0) / (ior + 1.0)).powi(2);
    let body = (1.0 - metallic) * (1.0 - transmission);
    // The coat of a dielectric reflects a few per cent, mirror-like where it is smooth.
    body * (1.0 - facing * (1.0 - roughness)) + (1.0 - body) * roughness
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::{Assembler, Lighting};
    use crate::{builtin, framing::CameraPose, shapes::Shapes};
    use std::path::Path;

    fn view(position: Vec3) -> CameraPose {
        CameraPose::from(&Camera::upright(position, Vec3::ZERO, 50.0))
    }

    /// A unit cube around the origin, optionally with one corner triangle of a lamp in its plane.
    fn cube(scale: f32) -> Assembler {
        let mut assembler = Assembler::new("cube", Path::new("cube"));
        let matt = assembler.material(Material::default());
        let mut shapes = Shapes::new();
        shapes.cuboid(Vec3::splat(-0.5 * scale), Vec3::splat(0.5 * scale));
        assembler.mesh("cube", matt, &shapes.part).unwrap();
        assembler
    }

    #[test]
    fn a_unit_cube_by_hand() {
        let scene = cube(1.0).finish(Lighting::Automatic, vec![view(Vec3::new(0.0, 0.0, 3.0))]).unwrap();
        let indicators = SceneIndicators::of(&scene).with_camera(&scene.cameras[0]);
        let root3 = 3.0_f64.sqrt();
        let expected = [
            1.0,
            12.0,
            // The added sky and its sun.
            2.0,
            0.0,
            0.0,
            30.0 / root3,
            0.0,
            0.0,
            0.0,
            50.0,
            1.0,
            root3,
            // Six faces over a diagonal squared of three.
            2.0,
            0.0,
            2.0,
            // All twelve triangles have one size.
            0.0,
            0.0,
        ];
        for ((spec, value), expected) in SCHEMA.iter().zip(indicators.0).zip(expected) {
            assert!((value - expected).abs() < 1e-6, "{} is {value}, not {expected}", spec.name);
        }
    }

    #[test]
    fn lamps_and_uneven_triangles_by_hand() {
        let mut assembler = cube(2.0);
        let lamp = Material { emission: Vec3::ONE, metallic: 1.0, roughness: 0.25, ..Material::default() };
        let lamp = assembler.material(lamp);
        // Inside the box, so the diagonal squared stays 12; areas 1/2 and 2.
        let mut shapes = Shapes::new();
        shapes.triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        shapes.triangle(-Vec3::ONE, Vec3::new(1.0, -1.0, -1.0), Vec3::new(-1.0, 1.0, -1.0));
        assembler.mesh("lamp", lamp, &shapes.part).unwrap();
        let scene = assembler.finish(Lighting::Automatic, vec![view(Vec3::X)]).unwrap();
        let indicators = SceneIndicators::of(&scene).with_camera(&scene.cameras[0]);
        let check = |name: &str, expected: f64| {
            let value = indicators.get(name).unwrap();
            assert!((value - expected).abs() < 1e-9 * expected.max(1.0), "{name} is {value}, not {expected}");
        };
        check("light_count", 1.0);
        check("light_area", 2.5 / 12.0);
        check("total_area", 26.5 / 12.0);
        check("area_per_mesh", 26.5 / 24.0);
        check("diffuse_ratio", (24.0 + 0.25 * 2.5) / 26.5);
        // The lamp's sizes are 1/24 and 4/24: mean 2.5/24, variance (1.5/24)². The cube's variance is 0.
        let lamp_variance = (1.5_f64 / 24.0).powi(2);
        check("var_tri_size_mean", lamp_variance / 2.0 * 1e12);
        check("var_tri_size_variance", (lamp_variance / 2.0).powi(2) * 1e24);
    }

    #[test]
    fn the_unit_of_length_matters_for_the_extent_only() {
        let of = |scale: f32| {
            let scene = cube(scale).finish(Lighting::Automatic, vec![view(Vec3::X * 2.0 * scale)]).unwrap();
            SceneIndicators::of(&scene).with_camera(&scene.cameras[0])
        };
        let (metres, centimetres) = (of(1.0), of(100.0));
        for (spec, (a, b)) in SCHEMA.iter().zip(metres.0.into_iter().zip(centimetres.0)) {
            let expected = if spec.name == "extent" { a * 100.0 } else { a };
            assert!((b - expected).abs() <= 1e-4 * expected.abs(), "{}: {a} and {b}", spec.name);
        }
    }

    #[test]
    fn surfaces_from_mirror_to_matt() {
        let of = |metallic, roughness, transmission| {
            diffuse_share(&Material { metallic, roughness, transmission, ..Material::default() })
        };
        assert_eq!(of(0.0, 1.0, 0.0), 1.0);
        assert_eq!(of(1.0, 0.0, 0.0), 0.0);
        assert_eq!(of(0.0, 0.0, 1.0), 0.0);
        assert!((of(0.0, 0.0, 0.0) - 0.96).abs() < 1e-9);
        assert!((of(1.0, 0.25, 0.0) - 0.25).abs() < 1e-9);
    }

    #[test]
    fn every_scene_gives_finite_numbers_with_stable_bits() {
        for name in builtin::names() {
            let build = || {
                builtin::build(name, &builtin::Options { detail: 0.01, ..builtin::Options::default() })
                    .unwrap()
            };
            let scene = build();
            let indicators = SceneIndicators::of(&scene).with_camera(&scene.cameras[0]);
            assert!(indicators.0.iter().all(|value| value.is_finite()), "{name}: {indicators:?}");
            assert_eq!(indicators, SceneIndicators::of(&build()).with_camera(&scene.cameras[0]));
            for (spec, value) in SCHEMA.iter().zip(indicators.0) {
                assert!((spec.min..=spec.max).contains(&value), "{name}: {} is {value}", spec.name);
            }
        }
        let scene = cube(1e12).finish(Lighting::Automatic, vec![]).unwrap();
        let wild = Camera { position: Vec3::NAN, vertical_fov_deg: f32::INFINITY, ..scene.cameras[0] };
        assert!(SceneIndicators::of(&scene).with_camera(&wild).0.iter().all(|value| value.is_finite()));
        let flat = cube(0.0).finish(Lighting::Automatic, vec![]).unwrap();
        let indicators = SceneIndicators::of(&flat).with_camera(&flat.cameras[0]);
        assert!(indicators.0.iter().all(|value| value.is_finite()), "{indicators:?}");
    }

    #[test]
    fn names_are_unique_and_ranges_make_sense() {
        let values = SceneIndicators::of(&cube(1.0).finish(Lighting::Automatic, vec![]).unwrap());
        let camera = Camera::upright(Vec3::ZERO, Vec3::X, 40.0);
        let map = values.with_camera(&camera).values();
        assert_eq!(map.len(), SCHEMA.len());
        assert!(SCHEMA.iter().all(|spec| spec.min < spec.max && map.contains_key(spec.name)));
    }
}
