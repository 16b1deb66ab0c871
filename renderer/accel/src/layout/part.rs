//! The placed objects in the leaves of the upper level of two.

use super::NodeRef;
use crate::instances::Instance;

/// A placed object: where a ray goes on, and how it gets into the object's space. One cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct PlacedPart {
    /// From the world to the object, by row: three factors and the translation.
    pub(crate) to_object: [[f32; 4]; 3],
    /// Root of the object's tree.
    pub(crate) node: NodeRef,
    pub(crate) object: u32,
    pub(crate) instance: u32,
}

const _: () = assert!(size_of::<PlacedPart>() == 64);

impl PlacedPart {
    pub(crate) fn new(instance: &Instance, number: u32, node: NodeRef) -> Self {
        let (linear, moved) = (instance.to_object.matrix3, instance.to_object.translation);
        let row = |axis: usize| [linear.x_axis[axis], linear.y_axis[axis], linear.z_axis[axis], moved[axis]];
        let to_object = [row(0), row(1), row(2)];
        Self { to_object, node, object: instance.object, instance: number }
    }
}
