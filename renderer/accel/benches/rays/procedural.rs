//! Scenes and rays for a benchmark without recordings: a camera's rays, two diffuse bounces, and sun rays.

use glam::Vec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use treewright_accel::recording::{RayClass, RaySet, Recording};
use treewright_accel::{
    BuildChoice, BuildError, Device, Intersector, NativeOptions, Ray, Structure, Triangles, build,
};

use crate::scenes;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
/// Camera rays come in blocks of this edge, as a renderer would pack them.
const BLOCK: u32 = 4;

/// A scene and where it is seen from.
#[derive(Clone, Copy)]
pub(crate) struct Procedural {
    pub(crate) name: &'static str,
    triangles: fn() -> std::sync::Arc<Triangles>,
    eye: Vec3,
    target: Vec3,
}

/// All of them.
pub(crate) const SCENES: [Procedural; 3] = [
    Procedural {
        name: "hills",
        triangles: || scenes::hills(500),
        eye: Vec3::new(0.9, 0.45, 0.9),
        target: Vec3::ZERO,
    },
    Procedural {
        name: "city",
        triangles: || scenes::city(200, 1),
        eye: Vec3::new(0.5, 0.25, 0.6),
        target: Vec3::new(-0.3, 0.0, -0.3),
    },
    Procedural {
        name: "soup",
        triangles: || scenes::soup(300_000, 0.03, 2),
        eye: Vec3::new(1.5, 1.0, 1.8),
        target: Vec3::ZERO,
    },
];

impl Procedural {
    /// Makes the triangles and follows the rays through them.
    pub(crate) fn record(&self, device: &Device) -> Result<Recording, BuildError> {
        let triangles = (self.triangles)();
        let structure = build(device, &triangles, &BuildChoice::Native(NativeOptions::default()))?;
        let mut random = scenes::random(7);
        let primary = self.camera();
        let first = bounce(&structure, &triangles, &primary, &mut random);
        let second = bounce(&structure, &triangles, &first, &mut random);
        let (sun, later_sun) = (to_the_sun(&first, &mut random), to_the_sun(&second, &mut random));
        let sets = [
            (RayClass::Primary, primary),
            (RayClass::FirstShadow, sun),
            (RayClass::FirstBounce, first),
            (RayClass::SecondBounce, second),
            (RayClass::Shadow, later_sun),
        ];
        Ok(Recording { triangles, sets: sets.map(|(class, rays)| RaySet { class, rays }).into() })
    }

    fn camera(&self) -> Vec<Ray> {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let up = right.cross(forward);
        let blocks =
            (0..HEIGHT / BLOCK).flat_map(|y| (0..WIDTH / BLOCK).map(move |x| (x * BLOCK, y * BLOCK)));
        let pixels = blocks
            .flat_map(|(x, y)| (0..BLOCK).flat_map(move |dy| (0..BLOCK).map(move |dx| (x + dx, y + dy))));
        pixels
            .map(|(x, y)| {
                let across = (x as f32 + 0.5) / WIDTH as f32 - 0.5;
                let down = ((y as f32 + 0.5) / HEIGHT as f32 - 0.5) * HEIGHT as f32 / WIDTH as f32;
                open(self.eye, forward + right * across - up * down)
            })
            .collect()
    }
}

fn open(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 1e-4, t_max: f32::INFINITY }
}

/// A cosine-distributed ray from wherever a ray hits.
fn bounce(structure: &Structure, triangles: &Triangles, rays: &[Ray], random: &mut ChaCha8Rng) -> Vec<Ray> {
    let from = |ray: &Ray| {
        let hit = structure.closest(ray)?;
        let [a, b, c] = triangles.corners(hit.triangle as usize);
        let normal = Vec3::from((b - a).cross(c - a)).normalize_or_zero();
        let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        Some(open(ray.origin + ray.direction * hit.t, normal + scenes::on_sphere(random) * 0.999))
    };
    rays.iter().filter_map(from).collect()
}

/// Rays from the same points to a sun of some width.
fn to_the_sun(rays: &[Ray], random: &mut ChaCha8Rng) -> Vec<Ray> {
    let mut aside = || random.random_range(-0.05..0.05f32);
    rays.iter().map(|ray| open(ray.origin, Vec3::new(0.4 + aside(), 0.8, 0.3 + aside()))).collect()
}
