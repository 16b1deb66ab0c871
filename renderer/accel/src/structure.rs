//! One entry for every back end: [`build`] a [`Structure`], ask it for hits.

use std::sync::Arc;

use serde::Serialize;

use crate::embree::{Device, NativeInstances, NativeScene};
use crate::geometry::{Hit, Intersector, Packets, Ray, Triangles};
use crate::parameters::{BuildChoice, NativeOptions, TreeParameters, Update};
use crate::tree::{Tree, TreeStatistics, TwoLevel};
use crate::{brute_force::BruteForce, error::BuildError, instances::Instances};

/// A built acceleration structure; [`Structure::visit`] runs code that is compiled for each variant.
#[derive(Debug)]
pub enum Structure {
    /// A tunable tree.
    Tree(Tree),
    /// A native Embree scene.
    Native(NativeScene),
    /// Tunable trees under their instances.
    TwoLevel(TwoLevel),
    /// Native Embree scenes under their instances.
    NativeInstances(NativeInstances),
    /// No structure.
    BruteForce(BruteForce),
}

/// Work that is written once for every variant and compiled for each.
macro_rules! of_each {
    ($structure:expr, $one:ident => $work:expr) => {
        match $structure {
            Structure::Tree($one) => $work,
            Structure::Native($one) => $work,
            Structure::TwoLevel($one) => $work,
            Structure::NativeInstances($one) => $work,
            Structure::BruteForce($one) => $work,
        }
    };
}

/// Code to be compiled for each kind of [`Intersector`]; see [`Structure::visit`].
pub trait Visitor {
    /// The result of the visit.
    type Output;
    /// Does the work with one concrete intersector.
    fn visit<I: Intersector>(self, intersector: &I) -> Self::Output;
}

/// Size of a structure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Statistics {
    /// Bytes of memory beyond the triangles themselves.
    pub bytes: usize,
    /// Shape of a tree of our own; Embree does not report that of its native ones.
    pub tree: Option<TreeStatistics>,
}

/// Builds a structure over the triangles. Zero triangles give a structure that every ray misses.
pub fn build(
    device: &Device,
    triangles: &Arc<Triangles>,
    choice: &BuildChoice,
) -> Result<Structure, BuildError> {
    match acting(choice) {
        BuildChoice::Tree(parameters) => Tree::build(device, triangles, &parameters).map(Structure::Tree),
        BuildChoice::Native(options) => {
            NativeScene::build(&device.suited(&options)?, triangles, &options).map(Structure::Native)
        }
        BuildChoice::BruteForce => Ok(Structure::BruteForce(BruteForce::new(triangles))),
    }
}

/// Builds two levels: `choice` for each object, and a tree over instances. Only placed triangles are met.
pub fn build_instanced(
    device: &Device,
    triangles: &Arc<Triangles>,
    instances: &Arc<Instances>,
    choice: &BuildChoice,
) -> Result<Structure, BuildError> {
    match acting(choice) {
        BuildChoice::Tree(parameters) => {
            TwoLevel::build(device, triangles, instances, &parameters).map(Structure::TwoLevel)
        }
        // Objects and their instances must be on one device.
        BuildChoice::Native(options) => {
            NativeInstances::build(&device.suited(&options)?, triangles, instances, &options)
                .map(Structure::NativeInstances)
        }
        BuildChoice::BruteForce => Ok(Structure::BruteForce(BruteForce::instanced(triangles, instances))),
    }
}

/// The choice as it acts: the paper's `compact` is Embree's own compact scene.
fn acting(choice: &BuildChoice) -> BuildChoice {
    match *choice {
        BuildChoice::Tree(TreeParameters { compact: true, robust, .. }) => {
            BuildChoice::Native(NativeOptions { compact: true, robust, ..NativeOptions::default() })
        }
        other => other,
    }
}

impl Structure {
    /// Brings the structure up to date with as many triangles that moved, and with moved `instances` of its
    /// objects in its order; without any, all stand as before.
    ///
    /// Objects that rest keep their structure. Where all do, the tree over the instances is fitted, and
    /// rebuilt for [`Update::Rebuild`] or beyond the threshold of [`Update::Partial`]; native ones always
    /// rebuild it. After an error the structure is unchanged or refitted, and can be used.
    pub fn update(
        &mut self,
        device: &Device,
        triangles: &Arc<Triangles>,
        instances: Option<&Arc<Instances>>,
        update: Update,
    ) -> Result<(), BuildError> {
        match self {
            Self::TwoLevel(two_level) => two_level.update(device, triangles, instances, update),
            Self::NativeInstances(native) => native.update(triangles, instances, update),
            Self::BruteForce(brute_force) => brute_force.update(triangles, instances),
            Self::Tree(_) | Self::Native(_) if instances.is_some() => Err(BuildError::OtherInstances),
            Self::Tree(tree) => tree.update(device, triangles, update),
            Self::Native(native) => native.update(triangles, update),
        }
    }

    /// Runs `visitor` with the concrete intersector, so that its loop is compiled without a choice per ray.
    pub fn visit<V: Visitor>(&self, visitor: V) -> V::Output {
        of_each!(self, one => visitor.visit(one))
    }

    /// Size and, for a tree of our own, shape. Walks the tree: milliseconds per million triangles.
    pub fn statistics(&self) -> Statistics {
        match self {
            Self::Tree(tree) => {
                let shape = tree.statistics();
                Statistics { bytes: shape.bytes, tree: Some(shape) }
            }
            Self::TwoLevel(two_level) => {
                let shape = two_level.statistics();
                Statistics { bytes: shape.bytes, tree: Some(shape) }
            }
            Self::Native(native) => Statistics { bytes: native.bytes(), tree: None },
            Self::NativeInstances(native) => Statistics { bytes: native.bytes(), tree: None },
            Self::BruteForce(_) => Statistics { bytes: 0, tree: None },
        }
    }
}

impl Intersector for Structure {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        of_each!(self, one => one.closest(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        of_each!(self, one => one.occluded(ray))
    }

    fn closest_each(&self, packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        of_each!(self, one => one.closest_each(packets, rays, hits))
    }

    fn occluded_each(&self, packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        of_each!(self, one => one.occluded_each(packets, rays, occluded))
    }
}
