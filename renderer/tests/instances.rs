//! A scene of instances equals its flattened copy in pictures, indicators and light.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use treewright_accel::{BuildChoice, NativeOptions, TreeParameters};
use treewright_renderer::film::{Film, Picture};
use treewright_renderer::integrator::{Lights, View};
use treewright_renderer::{frame::Renderer, render_options::RenderOptions};
use treewright_scene::assemble::{Assembler, Lighting};
use treewright_scene::indicators::{SCHEMA, SceneIndicators};
use treewright_scene::{Material, Scene, Sky, builtin, shapes::Shapes};

#[allow(dead_code, reason = "this test uses some of it")]
#[path = "full_space/scenes.rs"]
mod scenes;

/// A room of lamps and smooth balls, turned, squeezed and mirrored.
fn lamps() -> Scene {
    let mut assembler = Assembler::new("lamps", Path::new("lamps"));
    let wall = assembler.material(Material::default());
    let shiny = assembler.material(Material { metallic: 1.0, roughness: 0.3, ..Material::default() });
    let light = assembler.material(Material { emission: Vec3::new(6.0, 5.0, 3.0), ..Material::default() });
    assembler.mesh("room", wall, &scenes::walls()).unwrap();
    let (mut ball, mut bulb) = (Shapes::new(), Shapes::new());
    ball.sphere(Vec3::new(0.0, 0.6, 0.0), 0.6, 20, 12);
    bulb.cuboid(Vec3::new(-0.2, 1.3, -0.3), Vec3::new(0.3, 1.4, 0.3));
    assembler.begin_object();
    assembler.mesh("ball", shiny, &ball.part).unwrap();
    assembler.mesh("bulb", light, &bulb.part).unwrap();
    let lamp = assembler.end_object();
    scenes::place_around(&mut assembler, lamp, 6);
    assembler.finish(Lighting::Given(Sky::BLACK), vec![scenes::view()]).unwrap()
}

fn choices() -> [BuildChoice; 3] {
    let wide = TreeParameters { branching_factor: 8, max_depth: 64, ..TreeParameters::default() };
    [
        BuildChoice::Native(NativeOptions::default()),
        BuildChoice::Tree(wide),
        BuildChoice::Tree(TreeParameters { robust: true, ..wide }),
    ]
}

fn picture(scene: Scene, choice: &BuildChoice, samples: u32) -> Picture {
    let scene = Arc::new(scene);
    let view = View { camera: scene.cameras[0], seed: 1, bounces: 3 };
    let mut renderer = Renderer::new(scene, 0).expect("Embree is set up");
    renderer.rebuild(choice).expect("it builds");
    let mut film = Film::new([96, 72]);
    for _ in 0..samples {
        renderer.render(&view, &RenderOptions::default(), &mut film).expect("it was built");
    }
    film.picture()
}

/// The means of squares of `square` by `square` pixels.
fn coarse(picture: &Picture, square: u32) -> Picture {
    let (width, height) = (picture.width / square, picture.height / square);
    let mean = |x: u32, y: u32| {
        let pixels = (0..square * square).map(|inside| {
            let (x, y) = (x * square + inside % square, y * square + inside / square);
            picture.pixel(x, y)
        });
        pixels.sum::<Vec3>() / (square * square) as f32
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
    Picture { width, height, pixels }
}

#[test]
fn pictures_are_those_of_the_flattened_scene() {
    let forest = || {
        let options = builtin::Options { detail: 0.01, ..builtin::Options::default() };
        builtin::build("forest", &options).expect("it is built in")
    };
    // Rounded areas turn the table of lamps round, so the means of many samples are compared.
    for (scene, samples, square, tolerance) in [(lamps(), 48, 12, 2e-2), (forest(), 4, 1, 2e-2)] {
        assert!(scene.instances.is_some());
        let flat = scene.flattened().expect("it is small");
        let expected = coarse(&picture(flat, &choices()[0], samples), square);
        assert!(expected.mean_luminance() > 0.01);
        for choice in choices() {
            // Instances round a little differently, and where leaves overlap a path may turn elsewhere.
            let found = coarse(&picture(scene.clone(), &choice, samples), square);
            let difference = expected.mean_relative_difference(&found);
            assert!(difference < tolerance, "{}: {choice:?} differs by {difference}", scene.name);
        }
    }
}

#[test]
fn indicators_and_lights_are_those_of_the_flattened_scene() {
    let scene = lamps();
    let flat = scene.flattened().expect("it is small");
    assert_eq!(Lights::new(&scene).triangle_count(), 6 * 12);
    assert_eq!(Lights::new(&flat).triangle_count(), 6 * 12);
    let camera = &scene.cameras[0];
    let (a, b) =
        (SceneIndicators::of(&scene).with_camera(camera), SceneIndicators::of(&flat).with_camera(camera));
    for (spec, (a, b)) in SCHEMA.iter().zip(a.0.into_iter().zip(b.0)) {
        assert!((a - b).abs() <= 1e-5 * (1.0 + b.abs()), "{} is {a} and flattened {b}", spec.name);
    }
}
