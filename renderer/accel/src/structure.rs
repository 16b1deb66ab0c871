//! One entry for every back end: [`build`] a [`Structure`], ask it for hits.

use std::sync::Arc;

use serde::Serialize;

use crate::brute_force::BruteForce;
use crate::embree::{Device, NativeScene};
use crate::error::BuildError;
use crate::geometry::{Hit, Intersector, Ray, Triangles};
use crate::parameters::{BuildChoice, NativeOptions, NativeQuality};

/// A built acceleration structure. Each variant is an [`Intersector`] of its own; [`Structure::visit`]
/// runs code that is compiled once per variant.
#[derive(Debug)]
pub enum Structure {
    /// A native Embree scene.
    Native(NativeScene),
    /// No structure.
    BruteForce(BruteForce),
}

/// Code to be compiled for each kind of [`Intersector`]; see [`Structure::visit`].
pub trait Visitor {
    /// What the visit gives back.
    type Output;
    /// Does the work with one concrete intersector.
    fn visit<I: Intersector>(self, intersector: &I) -> Self::Output;
}

/// Size of a structure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Statistics {
    /// Bytes of memory beyond the triangles themselves.
    pub bytes: usize,
}

/// Builds a structure over the triangles. Zero triangles give a structure that every ray misses.
pub fn build(
    device: &Device,
    triangles: &Arc<Triangles>,
    choice: &BuildChoice,
) -> Result<Structure, BuildError> {
    match choice {
        BuildChoice::Tree(parameters) => {
            // The tree is the next step: until then its place is taken by the native scene.
            let options = NativeOptions {
                quality: NativeQuality::Medium,
                compact: parameters.compact,
                dynamic: !parameters.static_scene,
                robust: parameters.robust,
            };
            NativeScene::build(device, triangles, &options).map(Structure::Native)
        }
        BuildChoice::Native(options) => {
            NativeScene::build(device, triangles, options).map(Structure::Native)
        }
        BuildChoice::BruteForce => Ok(Structure::BruteForce(BruteForce::new(triangles))),
    }
}

impl Structure {
    /// Runs `visitor` with the concrete intersector inside, so that its ray loop is compiled without a
    /// choice per ray.
    pub fn visit<V: Visitor>(&self, visitor: V) -> V::Output {
        match self {
            Self::Native(native) => visitor.visit(native),
            Self::BruteForce(brute_force) => visitor.visit(brute_force),
        }
    }

    /// Size of the structure.
    pub fn statistics(&self) -> Statistics {
        let bytes = match self {
            Self::Native(native) => native.bytes(),
            Self::BruteForce(_) => 0,
        };
        Statistics { bytes }
    }
}

impl Intersector for Structure {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Native(native) => native.closest(ray),
            Self::BruteForce(brute_force) => brute_force.closest(ray),
        }
    }

    fn occluded(&self, ray: &Ray) -> bool {
        match self {
            Self::Native(native) => native.occluded(ray),
            Self::BruteForce(brute_force) => brute_force.occluded(ray),
        }
    }
}
