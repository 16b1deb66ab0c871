//! Textures, masks, glass and environment maps in scenes whose picture is known.

use std::{f32::consts::PI, path::Path, sync::Arc};

use glam::{Vec2, Vec3};
use treewright_accel::{Card, Mask};

use super::tests::traced;
use super::*;
use crate::scene::assemble::{Assembler, Lighting};
use crate::scene::{Environment, Material, Scene, Sky, Texture, Volume, Wrap};
use crate::{film::Picture, scene::part::Part, scene::shapes::Shapes, scene::texture::Encoding};

const WHITE: Sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, sun: None };

/// One mesh of one material, and the textures it names by number.
fn scene(part: &Part, material: Material, textures: Vec<Texture>, sky: Sky) -> Scene {
    let mut assembler = Assembler::new("test", Path::new("test"));
    let number = assembler.material(material);
    assembler.mesh("mesh", number, part).expect("the mesh is sound");
    let mut scene = assembler.finish(Lighting::Given(sky), vec![]).expect("the scene is sound");
    if !part.uvs.is_empty() {
        // Its vertices are those of the part, in the order of the triangles that name them first.
        let mut order: Vec<u32> = Vec::new();
        for &vertex in part.indices.iter().flatten() {
            if !order.contains(&vertex) {
                order.push(vertex);
            }
        }
        scene.uvs = order.iter().map(|&vertex| part.uvs[vertex as usize]).collect();
    }
    scene.textures = textures.into_iter().map(Arc::new).collect();
    scene
}

fn render(scene: Scene, position: Vec3, fov_deg: f32, samples: u32) -> Picture {
    let camera = Camera::upright(position, Vec3::ZERO, fov_deg);
    traced(&Arc::new(scene), &View { camera, seed: 1, bounces: 3 }, [16; 2], samples).0
}

/// The view of something low, from before it.
fn from_before(position: Vec3, target: Vec3, bounces: u32) -> View {
    let camera = Camera { position, target, up: Vec3::Z, vertical_fov_deg: 14.0, framed_aspect: None };
    View { camera, seed: 1, bounces }
}

/// A square from -1 to 1 that faces the viewer, with the whole picture on it.
fn square() -> Part {
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    Part {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        uvs: vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO],
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..Part::default()
    }
}

fn texture(edge: u32, encoding: Encoding, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let pixels = (0..edge).flat_map(|y| (0..edge).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
    Texture::new(edge, edge, pixels, encoding, [Wrap::Clamp; 2]).expect("it has its pixels")
}

fn matt() -> Material {
    Material { base_color: Vec3::ONE, ior: 1.0, ..Material::default() }
}

fn glass() -> Material {
    Material {
        base_color: Vec3::ONE,
        roughness: 0.0,
        transmission: 1.0,
        volume: Some(Volume::new(Vec3::ONE, 0.0)),
        ..Material::default()
    }
}

fn ball() -> Part {
    let mut ball = Shapes::new();
    ball.sphere(Vec3::ZERO, 0.8, 48, 24);
    ball.part
}

#[test]
fn colours_stand_where_the_picture_has_them() {
    // Red above left, green above right, blue below left, white below right.
    let colours = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]];
    let quarters = texture(64, Encoding::Srgb, |x, y| colours[(x / 32 + 2 * (y / 32)) as usize]);
    let material = Material { base_color_texture: Some(0), ..matt() };
    let picture = render(scene(&square(), material, vec![quarters], WHITE), Vec3::Z * 4.0, 20.0, 4);
    for (x, y, colour) in [(3, 3, Vec3::X), (12, 3, Vec3::Y), (3, 12, Vec3::Z), (12, 12, Vec3::ONE)] {
        assert!((picture.pixel(x, y) - colour).length() < 0.02, "{}", picture.pixel(x, y));
    }
}

#[test]
fn far_textures_are_their_mean() {
    let checks =
        texture(
            256,
            Encoding::Srgb,
            |x, y| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] },
        );
    let material = Material { base_color_texture: Some(0), ..matt() };
    let picture = render(scene(&square(), material, vec![checks], WHITE), Vec3::Z * 4.0, 20.0, 1);
    // A pixel covers more than a hundred of the texture's: even one sample a pixel shows grey.
    for pixel in &picture.pixels {
        assert!((*pixel - 0.5).abs().max_element() < 0.03, "{pixel}");
    }
}

#[test]
fn flat_normal_maps_change_nothing_and_leaning_ones_turn_away() {
    let sky = Sky { zenith: Vec3::splat(2.0), horizon: Vec3::ZERO, sun: None };
    let light = |normal: Option<[u8; 4]>| {
        let textures = normal.map(|pixel| texture(1, Encoding::Linear, |_, _| pixel));
        let material = Material { normal_texture: normal.map(|_| 0), ..matt() };
        let part = square();
        let scene = scene(&part, material, textures.into_iter().collect(), sky);
        render(scene, Vec3::Z * 4.0, 20.0, 64).mean_luminance()
    };
    let plain = light(None);
    assert!((light(Some([128, 128, 255, 255])) / plain - 1.0).abs() < 0.05);
    // Leaning up it sees more of a sky that is bright above.
    assert!(light(Some([128, 218, 218, 255])) > 1.3 * plain);
    assert!(light(Some([128, 38, 218, 255])) < 0.7 * plain);
}

#[test]
fn rays_pass_where_a_mask_is_clear() {
    let mut open = scene(&square(), Material { base_color: Vec3::ZERO, ior: 1.0, ..matt() }, vec![], WHITE);
    let alpha: Vec<u8> = (0..64).map(|pixel| if pixel % 8 < 4 { 255 } else { 0 }).collect();
    let mask = Mask::new(8, 8, alpha.into(), 0.5, [Wrap::Clamp; 2]).expect("it has its pixels");
    let uvs = &open.uvs;
    let uv = |vertex: u32| if uvs.is_empty() { square().uvs[vertex as usize] } else { uvs[vertex as usize] };
    let cards: Vec<(u32, Card)> = open
        .triangles
        .indices()
        .iter()
        .zip(0..)
        .map(|(corners, triangle)| (triangle, Card { mask: 0, corners: corners.map(uv) }))
        .collect();
    open.triangles = Arc::new((*open.triangles).clone().masked(vec![mask], cards).expect("it exists"));
    let picture = render(open, Vec3::Z * 4.0, 20.0, 2);
    assert_eq!((picture.pixel(3, 8), picture.pixel(12, 8)), (Vec3::ZERO, Vec3::ONE));
}

#[test]
fn blended_textures_let_their_share_through() {
    let half = texture(4, Encoding::Srgb, |x, _| [0, 0, 0, if x < 2 { 64 } else { 255 }]);
    let material = Material { base_color_texture: Some(0), blends: true, ..matt() };
    let picture = render(scene(&square(), material, vec![half], WHITE), Vec3::Z * 4.0, 20.0, 400);
    // Black itself, it shows three quarters of the white behind it, untinted.
    assert!((picture.pixel(2, 8) - 0.75).abs().max_element() < 0.08, "{}", picture.pixel(2, 8));
    assert!(picture.pixel(13, 8).max_element() < 0.01);
}

#[test]
fn lamps_shine_as_their_texture_does() {
    // A lamp above a floor: the side below its bright half is brighter, and all of it as the mean says.
    let light = |texture: Option<Texture>, factor: f32| {
        let mut assembler = Assembler::new("test", Path::new("test"));
        let floor = assembler.material(matt());
        let emission_texture = texture.as_ref().map(|_| 0);
        let emission = Vec3::splat(factor);
        let lamp =
            assembler.material(Material { base_color: Vec3::ZERO, emission, emission_texture, ..matt() });
        let mut ground = square();
        ground.uvs.clear();
        let mut above = square();
        above.positions.iter_mut().for_each(|at| at.z = 1.0);
        assembler.mesh("floor", floor, &ground).expect("sound");
        assembler.mesh("lamp", lamp, &above).expect("sound");
        let mut scene = assembler.finish(Lighting::Given(Sky::BLACK), vec![]).expect("sound");
        if let Some(texture) = texture {
            scene.uvs = [vec![Vec2::ZERO; 4], square().uvs].concat();
            scene.textures = vec![Arc::new(texture)];
        }
        let view = from_before(Vec3::new(0.0, -3.0, 0.45), Vec3::ZERO, 1);
        let picture = traced(&Arc::new(scene), &view, [16; 2], 200).0;
        let half = |range: std::ops::Range<u32>| {
            range
                .flat_map(|x| (7..16).map(move |y| (x, y)))
                .map(|(x, y)| f64::from(picture.pixel(x, y).y))
                .sum::<f64>()
        };
        (half(0..8), half(8..16))
    };
    let bright_left = texture(2, Encoding::Srgb, |x, _| if x == 0 { [255; 4] } else { [0, 0, 0, 255] });
    let (left, right) = light(Some(bright_left), 2.0);
    let (plain_left, plain_right) = light(None, 1.0);
    assert!(left > 1.05 * right, "{left} {right}");
    assert!(((left + right) / (plain_left + plain_right) - 1.0).abs() < 0.06, "{left} {right} {plain_left}");
}

#[test]
fn a_solid_of_clear_glass_vanishes_in_a_white_furnace() {
    for roughness in [0.0, 0.3] {
        let material = Material { roughness, ..glass() };
        let picture = render(scene(&ball(), material, vec![], WHITE), Vec3::Z * 4.0, 26.0, 32);
        let mean = picture.mean_luminance();
        // Rough facets shadow each other; a smooth surface loses but what its mesh is not round.
        let least = if roughness == 0.0 { 0.97 } else { 0.85 };
        assert!((least..=1.0 + 1e-3).contains(&mean), "roughness {roughness}: {mean}");
    }
}

#[test]
fn a_slab_absorbs_as_beer_says_and_reflects_as_fresnel_says() {
    let mut slab = Shapes::new();
    slab.cuboid(Vec3::new(-50.0, -50.0, -0.5), Vec3::new(50.0, 50.0, 0.5));
    let material = Material { volume: Some(Volume::new(Vec3::splat(0.5), 1.0)), ..glass() };
    let picture = render(scene(&slab.part, material, vec![], WHITE), Vec3::Z * 30.0, 1.0, 600);
    // Half is left after one way; in series all ways there and back (Stokes).
    let (left, reflected) = (0.5_f64, 0.04_f64);
    let through = (1.0 - reflected).powi(2) * left / (1.0 - (reflected * left).powi(2));
    let back =
        reflected + (1.0 - reflected).powi(2) * reflected * left * left / (1.0 - (reflected * left).powi(2));
    let mean = picture.mean_luminance();
    assert!((mean - (through + back)).abs() < 0.004, "{mean} is not {}", through + back);
}

#[test]
fn a_ball_of_glass_shows_the_world_upside_down_and_a_thin_one_does_not() {
    let sky = Sky { zenith: Vec3::splat(4.0), horizon: Vec3::ZERO, sun: None };
    let halves = |material: Material| {
        let picture = render(scene(&ball(), material, vec![], sky), Vec3::Z * 3.0, 22.0, 32);
        let row = |rows: std::ops::Range<u32>| rows.map(|y| picture.pixel(8, y).y).sum::<f32>();
        (row(2..6), row(10..14))
    };
    let (above, below) = halves(glass());
    assert!(below > 2.0 * above, "{above} {below}");
    let (above, below) = halves(Material { volume: None, ior: 1.0, ..glass() });
    assert!(above > 2.0 * below, "{above} {below}");
}

/// A box without a lid, in which light is reflected more often than paths bounce.
#[test]
fn a_sky_is_as_bright_as_a_picture_of_it() {
    let sky = Sky { zenith: Vec3::new(0.2, 0.4, 0.9), horizon: Vec3::new(0.9, 0.8, 0.6), sun: None };
    let (width, height) = (256, 128);
    let pixels = (0..width * height).map(|pixel| {
        let up = ((pixel / width) as f32 + 0.5) / height as f32 * PI;
        sky.horizon + (sky.zenith - sky.horizon) * up.cos().clamp(0.0, 1.0)
    });
    let map = Environment::new(width, pixels.collect()).expect("it is sound");
    let mut walls = Shapes::new();
    walls.cuboid(Vec3::NEG_ONE, Vec3::ONE);
    let mut open = walls.part;
    // Inside out, and without what lies on top.
    open.indices.retain(|triangle| triangle.iter().any(|corner| open.positions[*corner as usize].y < 0.0));
    open.indices.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    open.normals.iter_mut().for_each(|normal| *normal = -*normal);
    open.uvs.clear();
    let white = Material { base_color: Vec3::splat(0.8), ..matt() };
    let light = |environment: Option<Environment>| {
        let sky = if environment.is_some() { Sky::BLACK } else { sky };
        let mut scene = scene(&open, white, vec![], sky);
        scene.environment = environment.map(Arc::new);
        render(scene, Vec3::new(0.0, 3.0, 1.0), 30.0, 64).mean_luminance()
    };
    let (gradient, picture) = (light(None), light(Some(map)));
    assert!((picture / gradient - 1.0).abs() < 0.01, "{picture} and {gradient}");
}

#[test]
fn a_bright_spot_in_the_sky_is_found_at_once() {
    // One pixel of 64 × 32 straight ahead of the square.
    let (width, height) = (64, 32);
    let mut pixels = vec![Vec3::ZERO; width * height];
    let towards = Vec3::new(0.3, 0.4, 1.0).normalize();
    let blank = Environment::new(width as u32, pixels.clone()).expect("it is sound");
    let spot = blank.pixel(towards);
    pixels[spot] = Vec3::splat(500.0);
    let mut lit = scene(&square(), matt(), vec![], Sky::BLACK);
    let map = Environment::new(width as u32, pixels).expect("it is sound");
    let solid_angle = {
        let row = (spot / width) as f32;
        let cosine = |row: f32| (row / height as f32 * PI).cos();
        (cosine(row) - cosine(row + 1.0)) * 2.0 * PI / width as f32
    };
    lit.environment = Some(Arc::new(map));
    let picture = render(lit, Vec3::Z * 4.0, 20.0, 64);
    let expected = 500.0 * solid_angle * towards.z / PI;
    for pixel in &picture.pixels {
        assert!((pixel.y / expected - 1.0).abs() < 0.1, "{pixel} is not {expected}");
    }
}

#[test]
fn many_lamps_together_give_the_light_of_each() {
    let mut ground = square();
    ground.uvs.clear();
    // Small and near, larger and far, too small to stand in each other's light.
    let places: Vec<(Vec3, f32)> = (0..8)
        .map(|lamp| {
            (Vec3::new((lamp as f32 - 3.5) * 0.4, 0.3, 0.02 + 0.15 * lamp as f32), 0.02 + 0.005 * lamp as f32)
        })
        .collect();
    let light = |lamps: &[(Vec3, f32)], samples| {
        let mut assembler = Assembler::new("test", Path::new("test"));
        let floor = assembler.material(matt());
        let glow = Material { base_color: Vec3::ZERO, emission: Vec3::splat(5.0), ..matt() };
        let lamp = assembler.material(glow);
        assembler.mesh("floor", floor, &ground).expect("sound");
        for &(place, size) in lamps {
            let mut bulb = Shapes::new();
            bulb.cuboid(place - size, place + size);
            assembler.mesh("lamp", lamp, &bulb.part).expect("sound");
        }
        let scene = assembler.finish(Lighting::Given(Sky::BLACK), vec![]).expect("sound");
        let view = from_before(Vec3::new(0.0, -2.0, 0.6), Vec3::new(0.0, -0.6, 0.0), 0);
        traced(&Arc::new(scene), &view, [16; 2], samples).0.mean_luminance()
    };
    let apart: f64 = places.iter().map(|place| light(&[*place], 200)).sum();
    let together = light(&places, 400);
    assert!((together / apart - 1.0).abs() < 0.03, "{together} {apart}");
}
