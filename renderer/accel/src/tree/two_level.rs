//! Two levels: a tree for each object in its own space, and one over the instances in the world.
//!
//! Memory goes with the unique triangles. A ray walks the upper level; where it meets an instance's box it is
//! taken into the object's space and given to the object's own kernel (`traverse::placed`). The idea is as
//! old as Kay and Kajiya's "Ray Tracing Complex Scenes" (1986); the arrangement is Wald, Benthin and
//! Slusallek's "Distributed Interactive Ray Tracing of Dynamic Scenes" (2003).

use std::sync::Arc;

use super::level::{Below, Level, Place};
use super::{Tree, TreeFault, TreeStatistics};
use crate::geometry::{Hit, Intersector, Packets, Ray, Triangles};
use crate::layout::{Bounds, Root};
use crate::parameters::{TreeParameters, Update};
use crate::{embree::Device, error::BuildError, instances::Instances};

/// Trees of our own under a tree over their instances.
#[derive(Debug)]
pub struct TwoLevel {
    /// By object; empty ones for objects that nothing places.
    objects: Vec<Tree>,
    instances: Arc<Instances>,
    /// Triangles of all objects, placed or not.
    triangles: usize,
    parameters: TreeParameters,
    device: Device,
    /// Refers to the trees above.
    level: Box<Level>,
}

impl TwoLevel {
    /// Builds the trees of objects that are placed, each with all threads, then the upper level.
    pub(crate) fn build(
        device: &Device,
        triangles: &Triangles,
        instances: &Arc<Instances>,
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        parameters.check()?;
        let objects = instances
            .parts(triangles)
            .map(|part| Tree::build(device, &Arc::new(part), parameters))
            .collect::<Result<Vec<_>, _>>()?;
        let mut two_level = Self {
            objects,
            instances: Arc::clone(instances),
            triangles: triangles.len(),
            parameters: *parameters,
            device: device.clone(),
            level: Box::new(Level::empty(parameters)),
        };
        two_level.join()?;
        Ok(two_level)
    }

    /// Builds the upper level over the trees as they are. After an error there is none, and rays miss.
    fn join(&mut self) -> Result<(), BuildError> {
        *self.level = Level::empty(&self.parameters);
        let ranges = self.instances.objects();
        let below = self.objects.iter().zip(ranges);
        let below: Vec<Below<'_>> = below.map(|(tree, range)| Below { tree, first: range.start }).collect();
        *self.level = Level::build(&self.device, &below, &self.places(), &self.parameters)?;
        Ok(())
    }

    fn places(&self) -> Vec<Place> {
        let is_there = |bounds: Bounds| bounds.lower[0] <= bounds.upper[0];
        (0..)
            .zip(self.instances.placed())
            .filter(|(_, instance)| is_there(self.objects[instance.object as usize].bounds()))
            .map(|(number, instance)| (number, *instance))
            .collect()
    }

    /// Updates objects that move, then the upper level; see [`Structure::update`](crate::Structure::update).
    pub(crate) fn update(
        &mut self,
        device: &Device,
        triangles: &Triangles,
        instances: Option<&Arc<Instances>>,
        update: Update,
    ) -> Result<(), BuildError> {
        BuildError::same_count(self.triangles, triangles.len())?;
        update.check()?;
        let instances = self.instances.followed_by(instances)?;
        let (mut outcome, mut rest) = (Ok(()), true);
        for (tree, now) in self.objects.iter_mut().zip(instances.parts(triangles)) {
            if !tree.rests(&now, update) {
                rest = false;
                // All trees must be of one moment, also after an error of one of them.
                outcome = outcome.and(tree.update(device, &Arc::new(now), update));
            }
        }
        self.instances = instances;
        let most = match update {
            Update::Rebuild => None,
            Update::Refit => Some(f64::INFINITY),
            Update::Partial { rebuild_threshold } => Some(f64::from(rebuild_threshold)),
        };
        let places = self.places();
        let is_fitted = rest && most.is_some_and(|most| self.level.fit(&places, most));
        if is_fitted { outcome } else { self.join().and(outcome) }
    }

    /// Sums over both levels; each instance's tree counts with the probability that its box is hit.
    pub fn statistics(&self) -> TreeStatistics {
        let mut sum = TreeStatistics { bytes: self.level.bytes(), ..TreeStatistics::default() };
        let of_trees: Vec<TreeStatistics> = self.objects.iter().map(Tree::statistics).collect();
        for of_tree in &of_trees {
            sum.nodes += of_tree.nodes;
            sum.leaves += of_tree.leaves;
            sum.bytes += of_tree.bytes;
            sum.triangle_references += of_tree.triangle_references;
            sum.depth = sum.depth.max(of_tree.depth);
        }
        let (depth_below, mut depth) = (sum.depth, 0);
        let root_area = self.level.root.bounds.half_area();
        self.level.walk(&mut |at, bounds, part| {
            let share = if root_area > 0.0 { bounds.half_area() / root_area } else { 1.0 };
            depth = depth.max(at);
            match part {
                Some(part) => sum.sah_cost += share * of_trees[part.object as usize].sah_cost,
                None => {
                    sum.nodes += 1;
                    sum.sah_cost += share;
                }
            }
        });
        sum.depth = depth_below + depth;
        sum
    }

    /// Checks every object's tree, and that the upper level holds and covers every instance once.
    pub fn validate(&self) -> Result<(), TreeFault> {
        self.objects.iter().try_for_each(Tree::validate)?;
        let placed = self.instances.placed();
        let mut times = vec![0; placed.len()];
        let mut fault = None;
        self.level.walk(&mut |_, bounds, part| {
            let Some(part) = part else { return };
            let instance = &placed[part.instance as usize];
            let Root { node, triangles, .. } = &self.objects[instance.object as usize].root;
            times[part.instance as usize] += 1;
            let corners = (0..triangles.len()).flat_map(|triangle| triangles.corners(triangle));
            let is_covered = corners
                .map(|corner| instance.to_world.transform_point3a(corner).to_array())
                .all(|at| bounds.contains(&Bounds { lower: at, upper: at }));
            let is_its_own = part.object == instance.object && part.node.into_raw() == node.into_raw();
            if !is_its_own || !is_covered {
                fault = Some(TreeFault::Instance(part.instance));
            }
        });
        for ((number, instance), times) in (0..).zip(placed).zip(times) {
            let triangles = &self.objects[instance.object as usize].root.triangles;
            if times != usize::from(!triangles.is_empty()) {
                fault = Some(TreeFault::Instance(number));
            }
        }
        fault.map_or(Ok(()), Err)
    }
}

impl Intersector for TwoLevel {
    #[inline]
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let Level { root, lower, kernels, .. } = &*self.level;
        // SAFETY: the level was built over these trees, and its kernels and theirs selected for them.
        unsafe { kernels.closest(root, lower, ray) }
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        let Level { root, lower, kernels, .. } = &*self.level;
        // SAFETY: as above.
        unsafe { kernels.occluded(root, lower, ray) }
    }

    fn closest_each(&self, packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        let Level { root, lower, kernels, .. } = &*self.level;
        // SAFETY: as above.
        unsafe { kernels.closest_each(root, lower, packets, rays, hits) };
    }

    fn occluded_each(&self, packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        let Level { root, lower, kernels, .. } = &*self.level;
        // SAFETY: as above.
        unsafe { kernels.occluded_each(root, lower, packets, rays, occluded) };
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Quat, Vec3, Vec3A};

    use super::*;

    /// Eight small triangles, in two objects of four; the first object's stand `lift` higher.
    fn triangles(lift: f32) -> Triangles {
        let corner = |number: u32| {
            let (turn, rise) = (2.4 * number as f32, if number < 12 { lift } else { 0.0 });
            Vec3A::new(0.1 * turn.cos(), 0.02 * (number % 12) as f32 + rise, 0.1 * turn.sin())
        };
        let indices = (0..8).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        Triangles::new((0..24).map(corner).collect(), indices).expect("they are near")
    }

    /// They circle the middle, each at one of seven speeds.
    fn walkers(moment: f32) -> Arc<Instances> {
        let placed = (0..90u32).map(|number| {
            let way = 0.7 * number as f32 + moment * ((number % 7) as f32 - 3.0);
            let at = Quat::from_rotation_y(way) * Vec3::X * (3.0 + (number % 5) as f32);
            (number % 2, Affine3A::from_rotation_translation(Quat::from_rotation_y(way), at))
        });
        Arc::new(Instances::new(8, vec![0..4, 4..8], placed).expect("they are sound"))
    }

    #[test]
    fn trees_of_objects_that_rest_are_kept_and_the_level_follows_as_it_is_told() {
        let device = Device::open(0).expect("Embree starts");
        let parameters = TreeParameters::default();
        let built = |lift: f32, moment: f32| {
            TwoLevel::build(&device, &triangles(lift), &walkers(moment), &parameters).expect("it builds")
        };
        let roots = |two_level: &TwoLevel| {
            let nodes = two_level.objects.iter().map(|tree| tree.root.node.into_raw().addr());
            nodes.collect::<Vec<usize>>()
        };
        let fresh = built(0.0, 2.0).statistics().sah_cost;
        for (update, most) in
            [(Update::Rebuild, 1.0001), (Update::partial(1.1), 1.0001), (Update::Refit, f64::INFINITY)]
        {
            let mut two_level = built(0.0, 0.0);
            let kept = roots(&two_level);
            two_level
                .update(&device, &triangles(0.0), Some(&walkers(2.0)), update)
                .expect("they are its own objects");
            two_level.validate().expect("it is sound");
            assert_eq!(roots(&two_level), kept, "{update:?}");
            assert!(two_level.objects.iter().all(|tree| tree.motion.is_none()), "{update:?}");
            let growth = two_level.statistics().sah_cost / fresh;
            assert!(growth < most && (most.is_finite() || growth > 1.5), "{update:?}: {growth}");
        }
        let mut two_level = built(0.0, 0.0);
        let is_refitted =
            |two_level: &TwoLevel| [0, 1].map(|object| two_level.objects[object].motion.is_some());
        for (update, refitted) in [(Update::Refit, [true, false]), (Update::Rebuild, [false, false])] {
            two_level.update(&device, &triangles(0.3), None, update).expect("they are as many");
            two_level.validate().expect("it is sound");
            assert_eq!(is_refitted(&two_level), refitted, "{update:?}");
        }
        let fewer = Arc::new(walkers(0.0).moved([]).expect("there is none"));
        let error = two_level.update(&device, &triangles(0.3), Some(&fewer), Update::Refit);
        assert_eq!(error, Err(BuildError::OtherInstances));
    }
}
