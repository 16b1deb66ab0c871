//! A scene of instances as one without: every instance's triangles as its own.

use std::{path::PathBuf, sync::Arc};

use glam::{Vec3, Vec3A};
use treewright_accel::{Triangles, limits::TRIANGLES_MAX};

use super::limits::{MESHES_MAX, VERTICES_MAX};
use super::{Mesh, Scene, SceneError};

/// Marks a vertex that has no copy yet.
const NONE: u32 = u32::MAX;

impl Scene {
    /// This scene without instances. Needs memory for every placed triangle.
    ///
    /// # Errors
    /// [`SceneError::TooMany`] beyond the limits of scenes.
    pub fn flattened(&self) -> Result<Self, SceneError> {
        let Some(instances) = &self.instances else { return Ok(self.clone()) };
        let too_many = || SceneError::TooMany(PathBuf::from(&self.name));
        let count = usize::try_from(instances.placed_triangles()).map_err(|_| too_many())?;
        if count > TRIANGLES_MAX {
            return Err(too_many());
        }
        let (mut positions, mut normals) = (Vec::<Vec3A>::new(), Vec::<Vec3>::new());
        // The origins are vertices with their instances.
        let (mut uvs, mut cards, mut origins) = (Vec::new(), Vec::new(), Vec::new());
        let (mut indices, mut meshes) = (Vec::with_capacity(count), Vec::<Mesh>::new());
        let mut copies = vec![NONE; self.triangles.positions().len()];
        let mut copied: Vec<u32> = Vec::new();
        let mut current = None;
        for (mesh, number) in self.placed_meshes() {
            if current.replace(number) != Some(number) {
                copied.drain(..).for_each(|vertex| copies[vertex as usize] = NONE);
            }
            if meshes.len() >= MESHES_MAX {
                return Err(too_many());
            }
            let instance = &instances.placed()[number as usize];
            let mirrored = instance.to_world.matrix3.determinant() < 0.0;
            let upright = instance.to_object.matrix3.transpose();
            let first_triangle = indices.len() as u32;
            let range = mesh.first_triangle as usize..(mesh.first_triangle + mesh.triangle_count) as usize;
            for triangle in range {
                let mut corners = self.triangles.indices()[triangle].map(|vertex| {
                    let copy = &mut copies[vertex as usize];
                    if *copy == NONE {
                        *copy = positions.len() as u32;
                        copied.push(vertex);
                        let position = self.triangles.positions()[vertex as usize];
                        positions.push(instance.to_world.transform_point3a(position));
                        if let Some(normal) = self.normals.get(vertex as usize) {
                            normals.push((upright * *normal).normalize_or(Vec3::Y));
                        }
                        uvs.extend(self.uvs.get(vertex as usize));
                        origins.push((vertex, number));
                    }
                    *copy
                });
                let mut card = self.triangles.card(triangle);
                // Front sides stay front sides.
                if mirrored {
                    corners.swap(1, 2);
                    if let Some(card) = &mut card {
                        card.corners.swap(1, 2);
                    }
                }
                cards.extend(card.map(|card| (indices.len() as u32, card)));
                indices.push(corners);
            }
            if positions.len() > VERTICES_MAX {
                return Err(too_many());
            }
            meshes.push(Mesh { first_triangle, ..mesh.clone() });
        }
        let refuse = |source| SceneError::Geometry {
            path: PathBuf::from(&self.name),
            mesh: self.name.clone(),
            source,
        };
        let mut triangles = Triangles::new(positions, indices).map_err(refuse)?;
        if !cards.is_empty() {
            triangles = triangles.masked(self.triangles.masks().to_vec(), cards).map_err(refuse)?;
        }
        let animated = self.animated.as_ref().map(|animated| animated.copied(instances, &origins));
        let triangles = Arc::new(triangles);
        Ok(Self { triangles, instances: None, normals, uvs, meshes, animated, ..self.clone() })
    }
}
