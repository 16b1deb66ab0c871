//! One configuration over one scene: built, updated, traced in every grouping of rays, and rendered.

use std::sync::Arc;

use glam::Vec3;
use treewright_accel::{BuildChoice, Hit, Intersector, Packets, Ray, Structure, Update};
use treewright_client::Configuration;
use treewright_renderer::film::{Film, Picture};
use treewright_renderer::integrator::{Lens, View};
use treewright_renderer::space::{Choice, TuningSpace};
use treewright_renderer::{frame::Renderer, integrator::random::PathRandom, render_options::RenderOptions};
use treewright_scene::Scene;

use crate::scenes::Kind;

/// Rays a scene: not a multiple of a packet's.
const RAYS: u32 = 203;
/// How structures follow what moves.
const UPDATE: Update = Update::Partial { rebuild_threshold: 1.1 };
/// Two distances agree up to this share of them.
const DISTANCE_TOLERANCE: f32 = 1e-3;
/// Most rays that may pass an edge on the other side.
const EDGE_RAYS_MAX: usize = 3;
/// A path that passes an edge on the other side changes a pixel of a small picture.
const PICTURE_DIFFERENCE_MAX: f64 = 0.03;

/// A scene with the answers of brute force.
pub(crate) struct Case {
    renderer: Renderer,
    scenes: Vec<Arc<Scene>>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    picture: Picture,
}

impl Case {
    pub(crate) fn new(kind: Kind) -> Self {
        let scenes = kind.scenes();
        let last = scenes.last().expect("there is a scene").clone();
        let rays = rays(&last);
        let renderer = Renderer::new(last, 2).expect("Embree is set up");
        let (oracle, _) = renderer.build(&BuildChoice::BruteForce).expect("there is nothing to build");
        let hits = rays.iter().map(|ray| oracle.closest(ray)).collect();
        let picture = picture(&renderer, &oracle, &RenderOptions::default());
        Self { renderer, scenes, rays, hits, picture }
    }

    /// Runs a configuration and returns its fault. One that cannot be built here has none.
    pub(crate) fn run(&mut self, space: &TuningSpace, configuration: &Configuration) -> Result<(), String> {
        let choice = space.choice(configuration).map_err(|error| error.to_string())?;
        let Some(structure) = self.build(&choice)? else { return Ok(()) };
        for packets in Packets::ALL {
            self.question(&structure, packets)?;
        }
        let difference =
            self.picture.mean_relative_difference(&picture(&self.renderer, &structure, &choice.render));
        if difference > PICTURE_DIFFERENCE_MAX {
            return Err(format!("the picture differs by {difference}"));
        }
        Ok(())
    }

    fn build(&mut self, choice: &Choice) -> Result<Option<Structure>, String> {
        let mut structure = None;
        for scene in &self.scenes {
            self.renderer.set_scene(scene.clone());
            let outcome = match &mut structure {
                Some(structure) => self.renderer.follow(structure, UPDATE).map(drop),
                None => self.renderer.build(&choice.build).map(|(built, _)| structure = Some(built)),
            };
            match outcome {
                Ok(()) => {}
                Err(error) if error.is_infeasible() => return Ok(None),
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(structure)
    }

    fn question(&self, structure: &Structure, packets: Packets) -> Result<(), String> {
        let mut hits = vec![None; self.rays.len()];
        let mut occluded = vec![false; self.rays.len()];
        structure.closest_each(packets, &self.rays, &mut hits);
        structure.occluded_each(packets, &self.rays, &mut occluded);
        let wrong = self.hits.iter().zip(&hits).filter(|(known, found)| !same(known, found)).count();
        let wrong_any =
            self.hits.iter().zip(&occluded).filter(|(known, any)| known.is_some() != **any).count();
        if wrong > EDGE_RAYS_MAX || wrong_any > EDGE_RAYS_MAX {
            return Err(format!(
                "{packets:?}: of {RAYS} rays {wrong} have another nearest hit and {wrong_any} another answer to any hit"
            ));
        }
        Ok(())
    }
}

fn same(known: &Option<Hit>, found: &Option<Hit>) -> bool {
    match (known, found) {
        (None, None) => true,
        (Some(known), Some(found)) => (known.t - found.t).abs() <= DISTANCE_TOLERANCE * known.t.max(found.t),
        _ => false,
    }
}

fn picture(renderer: &Renderer, structure: &Structure, options: &RenderOptions) -> Picture {
    let view = View { camera: renderer.scene().cameras[0], seed: 1, bounces: 2 };
    let mut film = Film::new([40, 30]);
    renderer.render_with(structure, &view, options, &mut film);
    film.picture()
}

/// From the camera, and between points of the scene's box, every other one of these with an end.
fn rays(scene: &Scene) -> Vec<Ray> {
    let bounds = scene.bounds();
    let lens = Lens::new(&scene.cameras[0], 20, 10);
    let ray = |number: u32| {
        let random = PathRandom::new(1, number, u32::MAX);
        if number < RAYS / 2 {
            return lens.ray(number % 20, number / 20, random.pair(0));
        }
        let point = |place| {
            let ([x, y], z) = (random.pair(place), random.single(place + 1));
            bounds.min + (bounds.max - bounds.min) * Vec3::new(x, y, z)
        };
        let (origin, target) = (point(1), point(3));
        let t_max = if number.is_multiple_of(2) { 1.0 } else { f32::INFINITY };
        Ray { origin, direction: target - origin, t_min: 0.0, t_max }
    };
    (0..RAYS).map(ray).collect()
}
