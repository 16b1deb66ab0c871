//! Objects that are copied into the world. A ray meets a small object, or one that is placed once, sooner as
//! part of one tree than as an object of its own. The box of an object overlaps others, and every ray has to
//! be taken into its space.

use std::sync::Arc;

use glam::{Affine3A, Vec3A};

use super::Tree;
use crate::embree::Device;
use crate::error::BuildError;
use crate::geometry::Triangles;
use crate::instances::{Instance, Instances};
use crate::layout::Bounds;
use crate::limits::{FLATTENED_TRIANGLES_MAX, INSTANCES_MAX};
use crate::parameters::TreeParameters;

/// Greatest ratio of the vertices between the first and the last that an object names to its triangles; above
/// it its corners are copied one by one.
const VERTICES_PER_TRIANGLE: usize = 3;

/// The tree of the copied objects.
#[derive(Debug)]
pub(super) struct Flat {
    pub(super) tree: Tree,
    /// Number of each triangle in the scene, and of its instance.
    pub(super) numbers: Vec<(u32, u32)>,
}

/// Which objects are copied: those whose placed triangles are at most as many as the parameters say, the
/// smallest first as far as the limit of all together goes.
pub(super) fn flattened(instances: &Instances, parameters: &TreeParameters) -> Vec<bool> {
    let mut placed: Vec<u64> = vec![0; instances.objects().len()];
    for instance in instances.placed() {
        placed[instance.object as usize] += instances.objects()[instance.object as usize].len() as u64;
    }
    let mut order: Vec<usize> = (0..placed.len())
        .filter(|&object| placed[object] > 0 && placed[object] <= u64::from(parameters.flatten_below))
        .collect();
    order.sort_by_key(|&object| placed[object]);
    let mut flattened = vec![false; placed.len()];
    let mut sum = 0;
    for object in order {
        sum += placed[object];
        if sum > FLATTENED_TRIANGLES_MAX {
            break;
        }
        flattened[object] = true;
    }
    flattened
}

/// An instance by the identity, for the tree of the copied objects.
pub(super) fn in_the_world(object: usize) -> Instance {
    Instance { object: object as u32, to_world: Affine3A::IDENTITY, to_object: Affine3A::IDENTITY }
}

const _: () = assert!(INSTANCES_MAX < u32::MAX as usize);

impl Flat {
    /// Copies the flattened objects and builds their tree; `None` if there are none, or if they end up beyond
    /// the coordinates that triangles may have.
    pub(super) fn build(
        device: &Device,
        triangles: &Triangles,
        instances: &Instances,
        flattened: &[bool],
        parameters: &TreeParameters,
    ) -> Result<Option<Self>, BuildError> {
        if !flattened.contains(&true) {
            return Ok(None);
        }
        let Some(copied) = copied(triangles, instances, flattened) else {
            return Ok(None);
        };
        let mut numbers = Vec::with_capacity(copied.len());
        for (number, instance) in placed(instances, flattened) {
            let range = instances.objects()[instance.object as usize].clone();
            numbers.extend(range.map(|triangle| (triangle, number as u32)));
        }
        let tree = Tree::build(device, &Arc::new(copied), parameters)?;
        Ok(Some(Self { tree, numbers }))
    }

    /// The box around everything.
    pub(super) fn bounds(&self) -> Bounds {
        self.tree.bounds()
    }
}

/// The instances of flattened objects.
fn placed<'a>(
    instances: &'a Instances,
    flattened: &'a [bool],
) -> impl Iterator<Item = (usize, &'a Instance)> + 'a {
    instances.placed().iter().enumerate().filter(|(_, instance)| flattened[instance.object as usize])
}

/// The flattened objects' triangles in the world, by instance.
pub(super) fn copied(triangles: &Triangles, instances: &Instances, flattened: &[bool]) -> Option<Triangles> {
    let (mut positions, mut indices): (Vec<Vec3A>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
    let ranges: Vec<Option<(u32, u32)>> = instances
        .objects()
        .iter()
        .zip(flattened)
        .map(|(range, &flattened)| {
            let of = &triangles.indices()[range.start as usize..range.end as usize];
            let named = flattened.then(|| of.iter().flatten().copied());
            let named = named.and_then(|all| Some((all.clone().min()?, all.max()?)))?;
            let span = (named.1 - named.0) as usize + 1;
            (span <= VERTICES_PER_TRIANGLE * of.len()).then_some(named)
        })
        .collect();
    for (_, instance) in placed(instances, flattened) {
        let range = instances.objects()[instance.object as usize].clone();
        let of = &triangles.indices()[range.start as usize..range.end as usize];
        let begin = u32::try_from(positions.len()).ok()?;
        let by = &instance.to_world;
        let to_world = |&at: &Vec3A| by.transform_point3a(at);
        match ranges[instance.object as usize] {
            Some((first, last)) => {
                positions.extend(triangles.positions()[first as usize..=last as usize].iter().map(to_world));
                indices.extend(of.iter().map(|corners| corners.map(|corner| corner - first + begin)));
            }
            None => {
                for (number, corners) in (0..).zip(of) {
                    positions.extend(corners.map(|corner| to_world(&triangles.positions()[corner as usize])));
                    indices.push([0, 1, 2].map(|corner| begin + 3 * number + corner));
                }
            }
        }
    }
    let sources = placed(instances, flattened)
        .flat_map(|(_, instance)| instances.objects()[instance.object as usize].clone())
        .map(|triangle| triangle as usize);
    Some(Triangles::new(positions, indices).ok()?.masked_as(triangles, sources))
}
