//! A scene with the tables that shading needs.

use std::{collections::HashMap, sync::Arc};

use glam::Vec3;
use rayon::prelude::*;
use treewright_accel::wish_for_huge_pages;

use super::{
    bsdf::Bsdf, lights::Lights, lights::mean_emission, needs::Needs, sheets::Sheets, sky_guide::Learnt,
    surface::Facet,
};
use crate::light_sampling::LightSampling;
use crate::scene::{Material, Mesh, Scene};

/// A scene with the tables that shading needs. Independent of the acceleration structure and the camera.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The rendered scene.
    pub scene: Arc<Scene>,
    /// Its lights.
    pub lights: Lights,
    /// The features that its shading must have.
    pub needs: Needs,
    /// Those features as long as light is sampled by the constants.
    scene_needs: Needs,
    /// One a triangle.
    pub(super) facets: Vec<Facet>,
    /// The materials that triangles have, each once.
    pub(super) surfaces: Vec<Shading>,
    /// Where light can pass through something.
    pub(super) sheets: Sheets,
    /// Results of pilot frames for light sampling in this view.
    pub(super) learnt: Learnt,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Shading {
    pub(super) bsdf: Bsdf,
    pub(super) emission: Vec3,
    pub(super) density: f32,
    pub(super) glows: bool,
    /// Whether it has textures; then the rest is that of its factors alone.
    pub(super) textured: bool,
    /// Whether it is a transmitting solid. The BSDF is that of the share that transmits nothing.
    pub(super) solid: bool,
    pub(super) material: u32,
}

impl Prepared {
    /// Makes the tables: O(triangles).
    pub fn new(scene: Arc<Scene>) -> Self {
        let lights = Lights::new(&scene);
        let (surfaces, material_of_mesh) = surfaces(&scene, &lights);
        let facets = facets(&scene, &material_of_mesh);
        let needs = Needs {
            smooth: facets.par_iter().any(Facet::is_smooth),
            layers: surfaces.iter().any(|surface| !surface.bsdf.is_matt()),
            sheets: surfaces.iter().any(|surface| surface.bsdf.is_thin()),
            lamps: lights.has_lamps() || surfaces.iter().any(|surface| surface.glows),
            sun: lights.has_sun(),
            materials: surfaces.len() > 1,
            instances: scene.instances.is_some(),
            textures: surfaces.iter().any(|surface| surface.textured),
            solids: surfaces.iter().any(|surface| surface.solid),
            environment: lights.has_environment(),
            punctual: lights.has_punctual(),
            metals: surfaces.iter().any(|surface| surface.bsdf.is_rough_metal()),
        }
        .closed();
        let thin = |mesh: &Mesh| {
            let material = &scene.materials[mesh.material as usize];
            (material.blends && material.volume.is_none()) || Bsdf::new(material).is_thin()
        };
        let sheets = Sheets::new(&scene, thin);
        Self { lights, needs, scene_needs: needs, facets, surfaces, sheets, learnt: Learnt::default(), scene }
    }

    /// The options of light sampling.
    pub fn light_sampling(&self) -> LightSampling {
        self.lights.sampling()
    }

    /// Looks for light in another way from now on: O(lamps + materials).
    pub(crate) fn set_light_sampling(&mut self, how: LightSampling) {
        self.lights.set_sampling(how);
        self.follow_lights();
    }

    pub(crate) fn take_over(&mut self, learnt: Learnt) {
        self.lights.set_guides(learnt.sky.clone(), learnt.lamps.clone());
        self.learnt = learnt;
        self.follow_lights();
    }

    fn follow_lights(&mut self) {
        // From the scene's own needs: a sky that is no longer learnt leaves nothing behind.
        self.needs = Needs { environment: self.lights.has_environment(), ..self.scene_needs }.closed();
        for surface in &mut self.surfaces {
            let material = &self.scene.materials[surface.material as usize];
            surface.density = self.lights.lamp_density(mean_emission(&self.scene, material));
        }
    }

    /// The material of a hit triangle. `MANY` is false where all have one material.
    #[inline(always)]
    pub(super) fn surface<const MANY: bool>(&self, facet: &Facet) -> &Shading {
        &self.surfaces[if MANY { facet.material() } else { 0 }]
    }
}

/// The materials that meshes with triangles have, equal ones once, and which of them each mesh has.
fn surfaces(scene: &Scene, lights: &Lights) -> (Vec<Shading>, Vec<u32>) {
    let (mut surfaces, mut looks) = (Vec::new(), HashMap::new());
    let mut of_material = vec![None; scene.materials.len()];
    let material_of_mesh = scene
        .meshes
        .iter()
        .map(|mesh| {
            *of_material[mesh.material as usize].get_or_insert_with(|| {
                let material = &scene.materials[mesh.material as usize];
                // The debug output holds every field with all digits: equal for materials that look equal.
                *looks.entry(format!("{material:?}")).or_insert_with(|| {
                    surfaces.push(Shading {
                        bsdf: Bsdf::new(material),
                        emission: material.emission,
                        density: lights.lamp_density(mean_emission(scene, material)),
                        glows: material.emission != Vec3::ZERO,
                        textured: !scene.textures.is_empty() && material.is_textured(),
                        solid: is_solid(material),
                        material: mesh.material,
                    });
                    surfaces.len() as u32 - 1
                })
            })
        })
        .collect();
    (surfaces, material_of_mesh)
}

/// Whether a material bounds a transmitting solid.
fn is_solid(material: &Material) -> bool {
    material.volume.is_some() && material.transmission > 0.0 && material.metallic < 1.0
}

fn facets(scene: &Scene, material_of_mesh: &[u32]) -> Vec<Facet> {
    let covered: usize = scene.meshes.iter().map(|mesh| mesh.triangle_count as usize).sum();
    assert_eq!(covered, scene.triangles.len(), "the meshes of a scene cover its triangles");
    let indices = scene.triangles.indices();
    let mut facets = Vec::with_capacity(indices.len());
    wish_for_huge_pages(&facets);
    (0..indices.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|triangle| {
            let mesh = scene.meshes.partition_point(|mesh| mesh.first_triangle as usize <= triangle) - 1;
            let normals = (!scene.normals.is_empty())
                .then(|| indices[triangle].map(|vertex| scene.normals[vertex as usize]));
            Facet::new(scene.triangles.corners(triangle), material_of_mesh[mesh], normals)
        })
        .collect_into_vec(&mut facets);
    facets
}
