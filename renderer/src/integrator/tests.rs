//! The whole path tracer against scenes whose picture is known.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use proptest::prelude::*;
use treewright_accel::{BruteForce, Intersector, Ray, Triangles};

use super::*;
use crate::film::{Film, Picture};
use crate::render_options::RenderOptions;
use crate::scene::{Material, Mesh, Scene, Sky, Sun};

const NIGHT: Sky = Sky { zenith: Vec3::ZERO, horizon: Vec3::ZERO, sun: None };

/// A scene of meshes given as (corners, material).
pub(super) fn scene(parts: &[(Vec<[Vec3; 3]>, Material)], sky: Sky) -> Arc<Scene> {
    let (mut positions, mut indices, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (triangles, _)) in parts.iter().enumerate() {
        meshes.push(Mesh {
            name: format!("mesh {number}"),
            first_triangle: indices.len() as u32,
            triangle_count: triangles.len() as u32,
            material: number as u32,
        });
        for triangle in triangles {
            let first = positions.len() as u32;
            positions.extend(triangle.map(Vec3A::from));
            indices.push([first, first + 1, first + 2]);
        }
    }
    Arc::new(Scene {
        name: "test".into(),
        triangles: Arc::new(Triangles::new(positions, indices).expect("test triangles are sound")),
        instances: None,
        normals: Vec::new(),
        uvs: Vec::new(),
        textures: Vec::new(),
        environment: None,
        lights: Vec::new(),
        meshes,
        materials: parts.iter().map(|(_, material)| *material).collect(),
        sky,
        cameras: vec![camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO)],
        path_keys: Vec::new(),
        placement: Default::default(),
        animated: None,
        notes: Vec::new(),
    })
}

fn camera(position: Vec3, target: Vec3) -> Camera {
    Camera::upright(position, target, 30.0)
}

pub(super) fn quad(corner: Vec3, a: Vec3, b: Vec3) -> Vec<[Vec3; 3]> {
    vec![[corner, corner + a, corner + a + b], [corner, corner + a + b, corner + b]]
}

/// An octahedron, each face split into four a few times and pushed out to the sphere.
fn sphere(radius: f32, splits: u32) -> Vec<[Vec3; 3]> {
    let mut faces = Vec::new();
    for x in [-1.0, 1.0] {
        for y in [-1.0, 1.0] {
            for z in [-1.0, 1.0] {
                faces.push([Vec3::X * x, Vec3::Y * y, Vec3::Z * z]);
            }
        }
    }
    for _ in 0..splits {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [(a + b).normalize(), (b + c).normalize(), (c + a).normalize()];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    faces.into_iter().map(|face| face.map(|corner| corner * radius)).collect()
}

/// A picture by brute force, path by path, and what was counted.
pub(super) fn traced(scene: &Arc<Scene>, view: &View, size: [u32; 2], samples: u32) -> (Picture, Counts) {
    let prepared = Prepared::new(scene.clone());
    let (brute_force, options) = (BruteForce::new(&scene.triangles), RenderOptions::default());
    let (mut film, mut counts) = (Film::new(size), Counts::default());
    for _ in 0..samples {
        counts += render_sample(&prepared, &brute_force, view, &options, prepared.needs, &mut film, None).0;
    }
    (film.picture(), counts)
}

fn render(scene: &Arc<Scene>, camera: Camera, samples: u32) -> (Picture, Counts) {
    traced(scene, &View { camera, seed: 1, bounces: 3 }, [24, 18], samples)
}

fn lambert(albedo: f32) -> Material {
    Material { base_color: Vec3::splat(albedo), ior: 1.0, ..Material::default() }
}

fn glowing(radiance: f32) -> Material {
    Material { base_color: Vec3::ZERO, ior: 1.0, emission: Vec3::splat(radiance), ..Material::default() }
}

#[test]
fn a_white_body_vanishes_in_a_white_furnace() {
    let furnace = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, sun: None };
    let smooth_glass = Material { base_color: Vec3::ONE, roughness: 0.0, transmission: 1.0, ..lambert(1.0) };
    let mirror = Material { base_color: Vec3::ONE, roughness: 0.0, metallic: 1.0, ..lambert(1.0) };
    for material in [lambert(1.0), smooth_glass, mirror] {
        let (picture, counts) =
            render(&scene(&[(sphere(0.7, 2), material)], furnace), camera(Vec3::Z * 3.0, Vec3::ZERO), 4);
        assert!(counts.hits > 0);
        for pixel in &picture.pixels {
            assert!((*pixel - Vec3::ONE).length() < 1e-3, "{material:?} shows as {pixel}");
        }
    }
}

#[test]
fn inside_a_glowing_ball_a_grey_patch_shows_its_albedo() {
    // Irradiance inside a surface of radiance 1 is π, so radiance is the albedo, however sampled.
    let patch = quad(Vec3::new(-0.2, -0.2, 0.0), Vec3::X * 0.4, Vec3::Y * 0.4);
    let ball = scene(&[(sphere(5.0, 2), glowing(1.0)), (patch, lambert(0.5))], NIGHT);
    let mut near = camera(Vec3::Z * 1.0, Vec3::ZERO);
    near.vertical_fov_deg = 10.0;
    let (picture, _) = render(&ball, near, 64);
    assert!((picture.mean_luminance() - 0.5).abs() < 0.01, "{}", picture.mean_luminance());
}

#[test]
fn without_a_bounce_surfaces_show_what_their_rough_lobes_scatter() {
    let draws = 160_000;
    let random = random::PathRandom::new(7, 0, 0);
    let layer = |roughness, metallic| Material { roughness, metallic, ..Material::default() };
    for material in [lambert(0.5), layer(0.5, 0.0), layer(0.5, 1.0), layer(0.0, 0.0)] {
        let patch = quad(Vec3::new(-0.2, -0.2, 0.0), Vec3::X * 0.4, Vec3::Y * 0.4);
        let ball = scene(&[(sphere(5.0, 2), glowing(1.0)), (patch, material)], NIGHT);
        let near = Camera::upright(Vec3::Z, Vec3::ZERO, 1.0);
        let (picture, _) = traced(&ball, &View { camera: near, seed: 1, bounces: 0 }, [24, 18], 128);
        let bsdf = Bsdf::new(&material);
        let seen = bsdf.seen_from::<false>(Vec3::Z).expect("from above");
        let scattered = |place| {
            let light = sampling::cosine_hemisphere(random.pair(place));
            f64::from(sampling::luminance(seen.rough(light).0) / light.z) * std::f64::consts::PI
        };
        let expected = (0..draws).map(scattered).sum::<f64>() / f64::from(draws);
        let found = picture.mean_luminance();
        assert!((found / expected - 1.0).abs() < 0.02, "{material:?}: {found} and {expected}");
    }
}

#[test]
fn inside_a_grey_ball_that_glows_every_bounce_adds_half_of_the_one_before() {
    let ball = scene(&[(sphere(5.0, 1), Material { emission: Vec3::ONE, ..lambert(0.5) })], NIGHT);
    for bounces in 0..3 {
        let view = View { camera: camera(Vec3::Z, Vec3::ZERO), seed: 1, bounces };
        let found = traced(&ball, &view, [24, 18], 64).0.mean_luminance();
        let expected = 2.0 - 0.5_f64.powi(bounces as i32 + 1);
        assert!((found - expected).abs() < 0.015, "{bounces} bounces: {found} and {expected}");
    }
}

/// A gap of 0.1 under a lamp of 2 by 2: sampled by area alone, up to 127 times too bright.
#[test]
fn a_lamp_close_to_the_last_vertex_leaves_no_bright_dots() {
    let (albedo, glow) = (0.8, 3.0);
    let level = |y: f32| quad(Vec3::new(-1.0, y, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let clear = Material { transmission: 1.0, roughness: 0.0, ..lambert(0.5) };
    let eye = Camera::upright(Vec3::new(0.0, 0.05, 0.45), Vec3::ZERO, 0.5);
    let view = |seed| View { camera: eye, seed, bounces: 0 };
    let mut parts = vec![(level(0.0), lambert(albedo)), (level(0.1), glowing(glow))];
    for share in [1.0, 0.5] {
        let gap = scene(&parts, NIGHT);
        // Of the light that comes back, a last ray brings its share and a sample of the lamp half of that.
        let bound = albedo * glow * 1.5 / vertex::LAST_RAY;
        for seed in 0..16 {
            let (picture, _) = traced(&gap, &view(seed), [24, 18], 1);
            let brightest = picture.pixels.iter().fold(0.0, |most: f32, pixel| most.max(pixel.x));
            assert!(brightest < bound, "{brightest}");
        }
        // The form factor of a square seen from above its middle.
        let side = (1.0_f64 / 0.1).hypot(1.0);
        let form = 4.0 / std::f64::consts::PI * (10.0 / side) * (10.0 / side).atan();
        let expected = f64::from(albedo * glow) * form * share;
        let found = traced(&gap, &view(1), [24, 18], 64).0.mean_luminance();
        assert!((found / expected - 1.0).abs() < 0.02, "{found} and {expected}");
        // Both techniques see the lamp through a sheet of half the light.
        parts.push((level(0.07), clear));
    }
}

#[test]
fn a_small_lamp_lights_a_floor_as_the_formula_says() {
    // Radiance of a Lambert floor under a small horizontal lamp: albedo/π · L · A · cos⁴/h².
    let lamp = quad(Vec3::new(-0.05, 2.0, -0.05), Vec3::X * 0.1, Vec3::Z * 0.1);
    let floor = quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let room = scene(&[(floor, lambert(0.8)), (lamp, glowing(100.0))], NIGHT);
    let mut eye = camera(Vec3::new(0.0, 1.5, 0.5), Vec3::ZERO);
    eye.vertical_fov_deg = 0.5;
    let (picture, _) = render(&room, eye, 32);
    let expected = 0.8 / std::f64::consts::PI * 100.0 * 0.01 / 4.0;
    assert!(
        (picture.mean_luminance() / expected - 1.0).abs() < 0.02,
        "{} vs {expected}",
        picture.mean_luminance()
    );
}

#[test]
fn the_sun_shines_through_a_clear_sheet() {
    let sun = Sun { direction: Vec3::Y, irradiance: Vec3::splat(3.0), half_angle_rad: 0.005 };
    let sky = Sky { sun: Some(sun), ..NIGHT };
    let floor = quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let sheet = quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    let clear = Material { transmission: 1.0, roughness: 0.0, ..lambert(0.5) };
    let mut eye = camera(Vec3::new(0.0, 0.5, 0.5), Vec3::ZERO);
    eye.vertical_fov_deg = 5.0;
    let open = render(&scene(&[(floor.clone(), lambert(0.8))], sky), eye, 4).0.mean_luminance();
    assert!((open - 0.8 * 3.0 / std::f64::consts::PI).abs() < 1e-2, "{open}");
    let tinted = render(&scene(&[(floor.clone(), lambert(0.8)), (sheet.clone(), clear)], sky), eye, 4).0;
    assert!((tinted.mean_luminance() - open * 0.5).abs() < 1e-2, "{}", tinted.mean_luminance());
    let closed = render(&scene(&[(floor, lambert(0.8)), (sheet, lambert(0.0))], sky), eye, 4).0;
    assert!(closed.mean_luminance() < 1e-6);
}

#[test]
fn no_bad_sample_in_a_scene_of_extremes() {
    let needle = vec![[Vec3::ZERO, Vec3::X * 1e-7, Vec3::Y * 1e4], [Vec3::ZERO, Vec3::X, Vec3::X * 2.0]];
    let mirror = Material { metallic: 1.0, roughness: 0.031, ..Material::default() };
    let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::splat(0.2), sun: None };
    let odd =
        scene(&[(needle, glowing(1e6)), (sphere(1.0, 1), mirror), (sphere(1e-4, 1), lambert(0.5))], sky);
    let (picture, counts) = render(&odd, camera(Vec3::Z * 3.0, Vec3::ZERO), 8);
    assert_eq!(counts.bad_samples, 0);
    assert!(picture.mean_luminance().is_finite());
}

fn test_room() -> Arc<Scene> {
    let floor = quad(Vec3::new(-2.0, -0.7, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0);
    let lamp = quad(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z);
    let gloss = Material { roughness: 0.3, metallic: 0.8, ..Material::default() };
    let sky = Sky { zenith: Vec3::splat(0.3), horizon: Vec3::splat(0.1), sun: None };
    scene(&[(sphere(0.7, 2), gloss), (floor, lambert(0.6)), (lamp, glowing(5.0))], sky)
}

#[test]
fn threads_do_not_change_the_picture() {
    let room = test_room();
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool can be made");
        pool.install(|| render(&room, room.cameras[0], 3))
    };
    let (one, counts) = with_threads(1);
    for threads in [2, 5] {
        let (picture, same) = with_threads(threads);
        assert_eq!(one, picture);
        assert_eq!(counts, same);
    }
}

#[test]
fn seeds_and_samples_change_the_noise_but_not_the_light() {
    let room = test_room();
    let mean = |seed| {
        let view = View { camera: room.cameras[0], seed, bounces: 3 };
        traced(&room, &view, [24, 18], 64).0
    };
    let (one, two) = (mean(1), mean(2));
    assert_ne!(one, two);
    assert!((one.mean_luminance() / two.mean_luminance() - 1.0).abs() < 0.03);
}

#[test]
fn rays_through_the_middle_go_where_the_camera_looks() {
    let eye = camera(Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 0.5, 1.0));
    let ray = Lens::new(&eye, 2, 2).ray(1, 1, [0.0, 0.0]);
    assert!((ray.direction - (eye.target - eye.position).normalize()).length() < 1e-6);
    let straight_up = Camera { target: eye.position + Vec3::Y, ..eye };
    assert!(Lens::new(&straight_up, 2, 2).ray(0, 0, [0.5, 0.5]).is_valid());
}

proptest! {
    /// Rays that leave a triangle, however large, small or far away, do not meet it again.
    #[test]
    fn new_rays_do_not_meet_the_surface_they_leave(
        scale_log in -3.0_f32..4.0,
        shift in prop::array::uniform3(-1.0_f32..1.0),
        far in 0.0_f32..1e3,
        corners in prop::array::uniform3(prop::array::uniform3(-1.0_f32..1.0)),
        weights in (0.05_f32..0.45, 0.05_f32..0.45),
        target in prop::array::uniform3(-1.0_f32..1.0),
    ) {
        let scale = 10.0_f32.powf(scale_log);
        let shift = Vec3::from_array(shift) * far * scale;
        let corners = corners.map(|corner| Vec3::from_array(corner) * scale + shift);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let sliver = (b - a).cross(c - a).length() / (b - a).length_squared().max((c - a).length_squared());
        prop_assume!(sliver > 0.05);
        let inside = a + (b - a) * weights.0 + (c - a) * weights.1;
        let scene = scene(&[(vec![corners], lambert(0.5))], NIGHT);
        let brute_force = BruteForce::new(&scene.triangles);
        let origin = inside + normal * scale * 2.0;
        let ray = Ray { origin, direction: (inside - origin).normalize(), t_min: 0.0, t_max: f32::INFINITY };
        let Some(hit) = brute_force.closest(&ray) else { return Ok(()) };
        let facet = surface::Facet::new(scene.triangles.corners(0), 0, None);
        let standing = surface::WorldFacet::new::<false>(&facet, None);
        let surface = surface::Surface::new::<false>(&standing, &ray, &hit).expect("the triangle has area");
        let direction = Vec3::from_array(target).normalize_or(Vec3::X);
        let next = Ray { origin: surface.start(direction), direction, t_min: 0.0, t_max: f32::INFINITY };
        prop_assert!(!brute_force.occluded(&next));
    }
}
