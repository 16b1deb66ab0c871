//! The order of work changes no picture: stages against paths, every kernel against the least one.

use std::sync::Arc;

use glam::Vec3;
use treewright_accel::{
    BuildChoice, Device, Hit, Intersector, NativeOptions, Packets, Ray, Structure, TreeParameters, Visitor,
    build,
};

use super::{Counts, Needs, Prepared, View, render_sample};
use crate::film::{Film, Picture};
use crate::render_options::RenderOptions;
use crate::scene::builtin::{self, Options};
use crate::scene::{Cone, Environment, Material, Punctual, Scene, Sky, Sun, Volume};

/// Two samples of a picture.
struct Render<'a> {
    prepared: &'a Prepared,
    options: RenderOptions,
    needs: Needs,
    bounces: u32,
}

impl Visitor for Render<'_> {
    type Output = (Picture, Counts);

    fn visit<I: Intersector>(self, intersector: &I) -> Self::Output {
        // No multiple of any tile.
        let mut film = Film::new([53, 37]);
        let view = View { camera: self.prepared.scene.cameras[0], seed: 3, bounces: self.bounces };
        let mut counts = Counts::default();
        for _ in 0..2 {
            let (options, needs) = (&self.options, self.needs);
            counts += render_sample(self.prepared, intersector, &view, options, needs, &mut film, None).0;
        }
        (film.picture(), counts)
    }
}

fn native(device: &Device, scene: &Scene) -> Structure {
    build(device, &scene.triangles, &BuildChoice::Native(NativeOptions::default())).expect("it is built")
}

/// Small scenes that between them use all there is.
fn scenes() -> Vec<Arc<Scene>> {
    let options = Options { detail: 0.02, ..Options::default() };
    let mut scenes: Vec<Scene> = ["quick", "hall", "gallery", "statue", "grove"]
        .iter()
        .map(|name| builtin::build(name, &options).expect("it is a scene"))
        .collect();
    // Under a plain sky, all matt and of one kind.
    let mut plain = scenes[0].clone();
    plain.name = "plain".into();
    plain.sky = Sky { zenith: Vec3::splat(0.8), horizon: Vec3::splat(0.5), sun: None };
    plain.normals = Vec::new();
    plain.materials.fill(Material { ior: 1.0, ..Material::default() });
    scenes.push(plain);
    // Everything of glass, lamps among it.
    let mut glass = scenes[0].clone();
    glass.name = "glass".into();
    for (number, material) in glass.materials.iter_mut().enumerate() {
        material.transmission = 0.7;
        material.roughness = [0.0, 0.4][number % 2];
        material.emission = Vec3::splat([0.0, 0.0, 2.0][number % 3]);
    }
    glass.sky.sun = Some(Sun::towards(Vec3::new(0.3, 1.0, 0.2), Vec3::splat(2.0)));
    let mut solid = glass.clone();
    scenes.push(glass);
    // Solids of glass under a picture of a sky.
    solid.name = "solid".into();
    for material in &mut solid.materials {
        material.volume = Some(Volume::new(Vec3::new(0.9, 0.5, 0.7), 0.3));
    }
    let pixels = (0..32).map(|pixel| Vec3::splat(if pixel == 11 { 30.0 } else { 0.4 }));
    solid.environment = Some(Arc::new(Environment::new(8, pixels.collect()).expect("it is sound")));
    scenes.push(solid);
    // Lights without size beside a sun and lamps.
    let mut points = scenes[1].clone();
    points.name = "points".into();
    points.sky.sun = Some(Sun::towards(Vec3::new(0.3, 1.0, 0.2), Vec3::splat(2.0)));
    let place = points.cameras[0].position;
    points.lights = vec![Punctual::point(place, Vec3::splat(5.0)), Punctual::towards(Vec3::Y, Vec3::ONE)];
    let cone = Some(Cone::new(points.cameras[0].target - place, 0.2, 0.4));
    points.lights.push(Punctual::Point { position: place, intensity: Vec3::X, cone, range: 9.0 });
    scenes.push(points);
    scenes.into_iter().map(Arc::new).collect()
}

const STAGED: RenderOptions = RenderOptions { staged: true, bounce_flight: Packets::Single };

/// Traces the rays of every packet one by one.
struct OneByOne<'a, I>(&'a I);

impl<I: Intersector> Intersector for OneByOne<'_, I> {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(ray)
    }
}

/// A rendering with every ray on its own.
struct RenderOneByOne<'a>(Render<'a>);

impl Visitor for RenderOneByOne<'_> {
    type Output = (Picture, Counts);

    fn visit<I: Intersector>(self, intersector: &I) -> Self::Output {
        self.0.visit(&OneByOne(intersector))
    }
}

#[test]
fn stages_do_not_change_the_picture_and_packets_find_what_single_rays_find() {
    let device = Device::open(0).expect("Embree is set up");
    for (scene, bounces) in scenes().into_iter().flat_map(|scene| [(scene.clone(), 0), (scene, 3)]) {
        let structure = native(&device, &scene);
        let prepared = Prepared::new(scene.clone());
        let render = |options| Render { prepared: &prepared, options, needs: prepared.needs, bounces };
        let (reference, counts) = structure.visit(render(RenderOptions::default()));
        let (picture, same) = structure.visit(RenderOneByOne(render(STAGED)));
        assert_eq!(counts, same, "{}", scene.name);
        assert!(picture == reference, "{}", scene.name);
        if bounces == 0 {
            continue;
        }
        assert!(reference.mean_luminance() > 0.0 && counts.bad_samples == 0, "{}", scene.name);
        let (picture, others) = structure.visit(render(STAGED));
        // A packet may find the other one of two triangles at a common edge or upon each other.
        let pairs = picture.pixels.iter().zip(&reference.pixels);
        let differing = pairs.filter(|(one, other)| one != other).count();
        assert!(differing * 50 <= reference.pixels.len(), "{}: {differing}", scene.name);
        assert!(others.shadow_rays.abs_diff(counts.shadow_rays) * 500 <= counts.shadow_rays);
    }
}

#[test]
fn rays_in_flight_do_not_change_the_picture() {
    let device = Device::open(0).expect("Embree is set up");
    for scene in scenes() {
        let wide = TreeParameters { branching_factor: 8, max_depth: 64, ..TreeParameters::default() };
        let structure = build(&device, &scene.triangles, &BuildChoice::Tree(wide)).expect("it is built");
        let prepared = Prepared::new(scene.clone());
        let render = |bounce_flight| {
            let options = RenderOptions { bounce_flight, ..STAGED };
            structure.visit(Render { prepared: &prepared, options, needs: prepared.needs, bounces: 3 })
        };
        let alone = render(Packets::Single);
        for bounce_flight in [Packets::Four, Packets::Eight] {
            assert!(render(bounce_flight) == alone, "{}: {bounce_flight:?}", scene.name);
        }
    }
}

#[test]
fn no_omission_changes_the_picture() {
    let device = Device::open(0).expect("Embree is set up");
    let mut omitted = 0;
    for scene in scenes() {
        let structure = native(&device, &scene);
        let prepared = Prepared::new(scene.clone());
        for staged in [false, true] {
            for bounces in [0, 1, 3] {
                let render = |needs| {
                    let options = RenderOptions { staged, ..STAGED };
                    structure.visit(Render { prepared: &prepared, options, needs, bounces }).0
                };
                let least = render(prepared.needs);
                for needs in prepared.needs.one_more().chain([Needs::ALL]) {
                    assert!(render(needs) == least, "{}: {needs:?}, {bounces} bounces", scene.name);
                    omitted += 1;
                }
            }
        }
    }
    assert!(omitted > 60, "the scenes need too much: {omitted}");
}
