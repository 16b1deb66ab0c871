//! The seventeen indicators that describe a scene and a camera to the tuner (paper Table 2).
//!
//! Where the paper leaves room, this is what we do and why:
//! - Surface values are divided by the squared diagonal of the scene's box, as the paper says. A triangle's
//!   size is its area so divided, and the variances are taken of those sizes, so that they do not depend on
//!   the unit of length either.
//! - Camera position and target have the range -10 to 10 in the paper, whose scenes are some ten units wide.
//!   We measure from the middle of the scene's box in tenths of its diagonal. The same room modelled in
//!   metres or centimetres then gives the same indicators, a camera inside lies within -5 to 5, and one
//!   that looks at the whole scene from outside seldom leaves -10 to 10. Values beyond are kept.
//! - Variances of triangle sizes are told in millionths of the squared diagonal (squared, and squared again), on a
//!   logarithmic scale. Over fourteen scenes they lie between 1e-12 and 4e-4 of the paper's unit, so that on its linear
//!   range of 0 to 0.01 all scenes but one would have the same two numbers.
//! - What an instance places counts as if it stood there itself: meshes, triangles and areas are those of the
//!   world, so that a scene has the same indicators with instances and flattened.
//! - Light sources are meshes that glow, plus one each for a sky that is not black and for a sun.
//! - The diffuse ratio weighs each surface's share of rough reflection by its area.
//!
//! Numbers of things and lengths span orders of magnitude, so the schema puts them on a logarithmic scale.
//! Sums run in double precision in the order of the triangles: the same scene gives the same bits.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use serde::Serialize;

use crate::{Camera, Material, Scene};

/// How an indicator's range is mapped to 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum IndicatorScale {
    /// In proportion.
    Linear,
    /// By the logarithm of 1 + value - minimum.
    Log,
}

/// An indicator's name and range (paper Table 2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IndicatorSpec {
    /// Its key in [`Indicators::values`].
    pub name: &'static str,
    /// Lower end of the range.
    pub min: f64,
    /// Upper end of the range; values beyond occur and are kept.
    pub max: f64,
    /// How the range is mapped.
    pub scale: IndicatorScale,
}

const fn spec(name: &'static str, min: f64, max: f64, scale: IndicatorScale) -> IndicatorSpec {
    IndicatorSpec { name, min, max, scale }
}

/// Squares of millionths in a square of the whole.
const SQUARED_MILLION: f64 = 1e12;

/// All indicators in the order of Table 2.
pub const SCHEMA: [IndicatorSpec; 17] = {
    use IndicatorScale::{Linear, Log};
    [
        spec("mesh_count", 0.0, 1e5, Log),
        spec("triangle_count", 0.0, 1e7, Log),
        spec("light_count", 0.0, 1e5, Log),
        spec("camera_x", -10.0, 10.0, Linear),
        spec("camera_y", -10.0, 10.0, Linear),
        spec("camera_z", -10.0, 10.0, Linear),
        spec("target_x", -10.0, 10.0, Linear),
        spec("target_y", -10.0, 10.0, Linear),
        spec("target_z", -10.0, 10.0, Linear),
        spec("vertical_fov_deg", 0.0, 180.0, Linear),
        spec("diffuse_ratio", 0.0, 1.0, Linear),
        spec("extent", 0.0, 1e5, Log),
        spec("total_area", 0.0, 10.0, Linear),
        spec("light_area", 0.0, 10.0, Linear),
        spec("area_per_mesh", 0.0, 10.0, Linear),
        spec("var_tri_size_mean", 0.0, 1e-2 * SQUARED_MILLION, Log),
        spec("var_tri_size_variance", 0.0, 1e-2 * SQUARED_MILLION * SQUARED_MILLION, Log),
    ]
};

/// The indicators of one frame, in the order of [`SCHEMA`]. All are finite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Indicators(pub [f64; SCHEMA.len()]);

impl Indicators {
    /// By name, as the tuner wants them.
    pub fn values(&self) -> BTreeMap<String, f64> {
        SCHEMA.iter().zip(self.0).map(|(spec, value)| (spec.name.to_owned(), value)).collect()
    }

    /// One value by name.
    pub fn get(&self, name: &str) -> Option<f64> {
        SCHEMA.iter().position(|spec| spec.name == name).map(|index| self.0[index])
    }
}

/// The part that depends on the scene alone: computed once, used for every frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneIndicators {
    mesh_count: f64,
    triangle_count: f64,
    light_count: f64,
    diffuse_ratio: f64,
    extent: f64,
    total_area: f64,
    light_area: f64,
    area_per_mesh: f64,
    var_tri_size_mean: f64,
    var_tri_size_variance: f64,
    center: DVec3,
}

impl SceneIndicators {
    /// Goes once through all triangles, those of every instance counted.
    pub fn of(scene: &Scene) -> Self {
        let bounds = scene.bounds();
        let extent = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length();
        // A scene that is a point has no area either; dividing by 1 keeps its zeros zero.
        let unit_area = if extent > 0.0 { extent * extent } else { 1.0 };
        let placed = scene.placed();
        let (mut total, mut lit, mut diffuse, mut glowing, mut meshes) = (0.0, 0.0, 0.0, 0, 0u64);
        let mut variances = Moments::default();
        for (mesh, instance) in scene.placed_meshes() {
            meshes += 1;
            let material = &scene.materials[mesh.material as usize];
            let mut sizes = Moments::default();
            for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                let [a, b, c] =
                    placed.corners(triangle, instance).map(|corner| Vec3::from(corner).as_dvec3());
                sizes.add((b - a).cross(c - a).length() * 0.5 / unit_area);
            }
            let area = sizes.mean * sizes.count;
            total += area;
            diffuse += area * diffuse_share(material);
            if material.emission.max_element() > 0.0 && mesh.triangle_count > 0 {
                glowing += 1;
                lit += area;
            }
            variances.add(sizes.variance());
        }
        let sky = &scene.sky;
        let has_gradient = sky.zenith.max_element() > 0.0 || sky.horizon.max_element() > 0.0;
        Self {
            mesh_count: meshes as f64,
            triangle_count: placed.count() as f64,
            light_count: f64::from(glowing)
                + f64::from(u8::from(has_gradient))
                + f64::from(u8::from(sky.sun.is_some())),
            diffuse_ratio: if total > 0.0 { diffuse / total } else { 1.0 },
            extent,
            total_area: total,
            light_area: lit,
            area_per_mesh: total / meshes.max(1) as f64,
            var_tri_size_mean: variances.mean * SQUARED_MILLION,
            var_tri_size_variance: variances.variance() * SQUARED_MILLION * SQUARED_MILLION,
            center: (bounds.min.as_dvec3() + bounds.max.as_dvec3()) * 0.5,
        }
    }

    /// Adds a camera. Numbers of the camera that are not finite count as 0.
    pub fn with_camera(&self, camera: &Camera) -> Indicators {
        let tenth = if self.extent > 0.0 { self.extent / 10.0 } else { 1.0 };
        let relative = |point: Vec3| {
            let point = if point.is_finite() { point.as_dvec3() } else { self.center };
            (point - self.center) / tenth
        };
        let (position, target) = (relative(camera.position), relative(camera.target));
        let fov_deg = f64::from(camera.vertical_fov_deg);
        Indicators([
            self.mesh_count,
            self.triangle_count,
            self.light_count,
            position.x,
            position.y,
            position.z,
            target.x,
            target.y,
            target.z,
            if fov_deg.is_finite() { fov_deg } else { 0.0 },
            self.diffuse_ratio,
            self.extent,
            self.total_area,
            self.light_area,
            self.area_per_mesh,
            self.var_tri_size_mean,
            self.var_tri_size_variance,
        ])
    }
}

/// Share of a surface's reflection that scatters widely: all of a matt surface, none of a mirror or of clear
/// glass, and as much of a metal or of frosted glass as it is rough.
fn diffuse_share(material: &Material) -> f64 {
    let [metallic, roughness, transmission, ior] =
        [material.metallic, material.roughness, material.transmission, material.ior].map(f64::from);
    let facing = ((ior - 1.0) / (ior + 1.0)).powi(2);
    let body = (1.0 - metallic) * (1.0 - transmission);
    // The coat of a dielectric reflects a few per cent, mirror-like where it is smooth.
    body * (1.0 - facing * (1.0 - roughness)) + (1.0 - body) * roughness
}

/// Running mean and variance (Welford 1962): no list, no cancellation.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let from_mean = value - self.mean;
        self.mean += from_mean / self.count;
        self.squares += from_mean * (value - self.mean);
    }

    /// Of the population: the triangles at hand are all there are.
    fn variance(&self) -> f64 {
        if self.count > 0.0 { self.squares / self.count } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::{Assembler, Lighting};
    use crate::builtin;
    use crate::framing::CameraPose;
    use crate::shapes::Shapes;
    use std::path::Path;

    fn view(position: Vec3) -> CameraPose {
        CameraPose {
            position,
            forward: -position,
            up: Vec3::Y,
            vertical_fov_deg: 50.0,
            framed_aspect: None,
            distance: Some(position.length()),
        }
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
            // All twelve triangles are the same size.
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
        let lamp = assembler.material(Material { emission: Vec3::ONE, ..Material::default() });
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
        let camera = Camera {
            position: Vec3::ZERO,
            target: Vec3::X,
            up: Vec3::Y,
            vertical_fov_deg: 40.0,
            framed_aspect: None,
        };
        let map = values.with_camera(&camera).values();
        assert_eq!(map.len(), SCHEMA.len());
        assert!(SCHEMA.iter().all(|spec| spec.min < spec.max && map.contains_key(spec.name)));
    }
}
