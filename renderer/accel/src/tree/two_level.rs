//! Two levels: a tree for each object in its own space, and one over the instances in the world.
//!
//! Memory goes with what is unique. A ray walks the upper level; where it meets an instance's box it is taken
//! into the object's space and given to the object's own kernel. Its direction is not normalised there, so
//! that distances mean the same in both spaces and the nearest hit so far ends the walks of both levels. The
//! idea is as old as Kay and Kajiya's "Ray Tracing Complex Scenes" (1986); the arrangement is Wald, Benthin and
//! Slusallek's "Distributed Interactive Ray Tracing of Dynamic Scenes" (2003).

use std::sync::Arc;

use super::top::{Top, transformed};
use super::{Tree, TreeFault, TreeStatistics};
use crate::embree::Device;
use crate::error::BuildError;
use crate::geometry::{Hit, Intersector, Ray, Triangles};
use crate::instances::{Instance, Instances};
use crate::layout::Bounds;
use crate::parameters::{TreeParameters, Update};

/// Trees of our own under a tree over their instances.
#[derive(Debug)]
pub struct TwoLevel {
    /// By object.
    objects: Vec<Tree>,
    /// First triangle of each object.
    first: Vec<u32>,
    instances: Arc<Instances>,
    /// Triangles of all objects, placed or not.
    triangles: usize,
    top: Top,
}

impl TwoLevel {
    /// Builds the objects' trees, one after the other and each with all threads, then the upper level. Objects
    /// that nothing places are left empty.
    pub(crate) fn build(
        device: &Device,
        triangles: &Triangles,
        instances: &Arc<Instances>,
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        let objects = instances
            .parts(triangles)
            .map(|part| Tree::build(device, &Arc::new(part), parameters))
            .collect::<Result<Vec<_>, _>>()?;
        let first = instances.objects().iter().map(|range| range.start).collect();
        let top = upper_level(&objects, instances);
        Ok(Self { objects, first, instances: Arc::clone(instances), triangles: triangles.len(), top })
    }

    /// Updates the objects' trees and builds the upper level anew. Objects that nothing places stay empty.
    pub(crate) fn update(
        &mut self,
        device: &Device,
        triangles: &Triangles,
        update: Update,
    ) -> Result<(), BuildError> {
        BuildError::same_count(self.triangles, triangles.len())?;
        let instances = Arc::clone(&self.instances);
        let mut outcome = Ok(());
        for (tree, part) in self.objects.iter_mut().zip(instances.parts(triangles)) {
            // Whatever one says, all must be of the same moment.
            outcome = outcome.and(tree.update(device, &Arc::new(part), update));
        }
        self.top = upper_level(&self.objects, &instances);
        outcome
    }

    /// The objects' trees.
    pub fn objects(&self) -> &[Tree] {
        &self.objects
    }

    /// Sums over both levels. The cost is that of the whole: the upper level's nodes, and below each instance
    /// its object's tree with the probability that its box is hit.
    pub fn statistics(&self) -> TreeStatistics {
        let of_objects: Vec<TreeStatistics> = self.objects.iter().map(Tree::statistics).collect();
        let mut sum = TreeStatistics { bytes: self.top.bytes(), sah_cost: 1.0, ..TreeStatistics::default() };
        for object in &of_objects {
            sum.nodes += object.nodes;
            sum.leaves += object.leaves;
            sum.bytes += object.bytes;
            sum.triangle_references += object.triangle_references;
        }
        let root_area = self.top.bounds().half_area();
        self.top.walk(&mut |depth, bounds, leaf| {
            let share = if root_area > 0.0 { bounds.half_area() / root_area } else { 1.0 };
            match leaf {
                Some(number) => {
                    let object = &of_objects[self.instances.placed()[number as usize].object as usize];
                    sum.depth = sum.depth.max(depth + object.depth);
                    sum.sah_cost += share * object.sah_cost;
                }
                None => {
                    sum.nodes += 1;
                    sum.depth = sum.depth.max(depth);
                    sum.sah_cost += share;
                }
            }
        });
        sum
    }

    /// Checks every object's tree, and that the upper level holds every instance of something once, in a box
    /// that covers it.
    pub fn validate(&self) -> Result<(), TreeFault> {
        self.objects.iter().try_for_each(Tree::validate)?;
        let mut boxes = vec![Bounds::EMPTY; self.instances.placed().len()];
        let mut fault = None;
        self.top.walk(&mut |_, bounds, leaf| {
            if let Some(number) = leaf {
                let place = &mut boxes[number as usize];
                if *place != Bounds::EMPTY {
                    fault = Some(TreeFault::Instance { instance: number });
                }
                *place = bounds;
            }
        });
        for (number, (instance, bounds)) in self.instances.placed().iter().zip(&boxes).enumerate() {
            let object = self.objects[instance.object as usize].bounds();
            if object.lower[0] <= object.upper[0]
                && !bounds.contains(&transformed(&object, &instance.to_world))
            {
                fault = Some(TreeFault::Instance { instance: number as u32 });
            }
        }
        fault.map_or(Ok(()), Err)
    }
}

fn upper_level(objects: &[Tree], instances: &Instances) -> Top {
    Top::build(instances.placed().iter().enumerate().map(|(number, instance)| {
        let bounds = objects[instance.object as usize].bounds();
        let is_empty = bounds.lower[0] > bounds.upper[0];
        (number as u32, if is_empty { bounds } else { transformed(&bounds, &instance.to_world) })
    }))
}

/// The ray in the object's space; distances stay what they are.
#[inline]
fn into_object(ray: &Ray, instance: &Instance, t_max: f32) -> Ray {
    Ray {
        origin: instance.to_object.transform_point3(ray.origin),
        direction: instance.to_object.transform_vector3(ray.direction),
        t_min: ray.t_min,
        t_max,
    }
}

impl Intersector for TwoLevel {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let mut nearest = None;
        self.top.meet(ray, |number, t_max| {
            let instance = &self.instances.placed()[number as usize];
            match self.objects[instance.object as usize].closest(&into_object(ray, instance, t_max)) {
                Some(hit) => {
                    let triangle = self.first[instance.object as usize] + hit.triangle;
                    nearest = Some(Hit { triangle, instance: number, ..hit });
                    hit.t
                }
                None => t_max,
            }
        });
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        if !ray.is_valid() {
            return false;
        }
        let mut occluded = false;
        self.top.meet(ray, |number, t_max| {
            let instance = &self.instances.placed()[number as usize];
            occluded = self.objects[instance.object as usize].occluded(&into_object(ray, instance, t_max));
            if occluded { f32::NEG_INFINITY } else { t_max }
        });
        occluded
    }
}
