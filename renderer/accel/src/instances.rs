//! Instances: objects placed many times, so that memory is needed for each object once.
//!
//! An object is a run of triangles in its own space; an instance places one in the world. A hit names the
//! triangle (its number among all triangles) and the instance it was met in.

use std::{ops::Range, sync::Arc};

use glam::Affine3A;

use crate::geometry::{Ray, Triangles};
use crate::{error::BuildError, limits::INSTANCES_MAX};

/// Objects and their instances over one set of triangles. Immutable and checked once.
#[derive(Clone, Debug)]
pub struct Instances {
    objects: Vec<Range<u32>>,
    placed: Vec<Instance>,
}

/// One placed object.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Number of the object.
    pub object: u32,
    /// From the object's space to the world. Invertible.
    pub to_world: Affine3A,
    /// The inverse.
    pub to_object: Affine3A,
}

impl Instance {
    /// A ray in the object's space, up to another end; distances do not change.
    #[inline]
    pub(crate) fn ray_in_object(&self, ray: &Ray, t_max: f32) -> Ray {
        Ray {
            origin: self.to_object.transform_point3(ray.origin),
            direction: self.to_object.transform_vector3(ray.direction),
            t_min: ray.t_min,
            t_max,
        }
    }
}

/// Why instances were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InstanceError {
    /// An object names triangles that do not exist.
    #[error("object {object} ends at triangle {end}, but there are only {triangles} triangles")]
    ObjectOutOfRange {
        /// Number of the object.
        object: usize,
        /// The end of its range.
        end: u32,
        /// Number of triangles.
        triangles: usize,
    },
    /// An instance names an object that does not exist.
    #[error("instance {instance} places object {object}, but there are only {objects} objects")]
    NoSuchObject {
        /// Number of the instance.
        instance: usize,
        /// The object that it names.
        object: u32,
        /// Number of objects.
        objects: usize,
    },
    /// An instance with a transformation that is not finite or flattens the object.
    #[error("instance {0} has a transformation that cannot be inverted")]
    NotInvertible(usize),
    /// More instances than the limit.
    #[error("{0} instances are more than the limit of {INSTANCES_MAX}")]
    TooMany(usize),
}

impl Instances {
    /// Checks and takes over: `objects` as ranges of triangles, `placed` as pairs of object and place.
    pub fn new(
        triangles: usize,
        objects: Vec<Range<u32>>,
        placed: impl IntoIterator<Item = (u32, Affine3A)>,
    ) -> Result<Self, InstanceError> {
        for (object, range) in objects.iter().enumerate() {
            if range.start > range.end || range.end as usize > triangles {
                return Err(InstanceError::ObjectOutOfRange { object, end: range.end, triangles });
            }
        }
        let placed = placed
            .into_iter()
            .enumerate()
            .map(|(instance, (object, to_world))| {
                if object as usize >= objects.len() {
                    return Err(InstanceError::NoSuchObject { instance, object, objects: objects.len() });
                }
                let to_object = to_world.inverse();
                if !(to_world.is_finite() && to_object.is_finite()) || to_world.matrix3.determinant() == 0.0 {
                    return Err(InstanceError::NotInvertible(instance));
                }
                Ok(Instance { object, to_world, to_object })
            })
            .collect::<Result<Vec<_>, _>>()?;
        if placed.len() > INSTANCES_MAX {
            return Err(InstanceError::TooMany(placed.len()));
        }
        Ok(Self { objects, placed })
    }

    /// These objects in other places: one transformation to the world an instance.
    ///
    /// # Errors
    /// [`InstanceError::NotInvertible`].
    pub fn moved(&self, places: impl IntoIterator<Item = Affine3A>) -> Result<Self, InstanceError> {
        let objects = self.placed.iter().map(|instance| instance.object);
        // The objects were checked.
        Self::new(usize::MAX, self.objects.clone(), objects.zip(places))
    }

    /// Whether others place these objects in this order, maybe elsewhere.
    pub fn same_objects(&self, other: &Self) -> bool {
        let ours = self.placed.iter().map(|instance| instance.object);
        self.objects == other.objects && ours.eq(other.placed.iter().map(|instance| instance.object))
    }

    /// These instances at a later moment: as given, or where they are.
    pub(crate) fn followed_by(self: &Arc<Self>, later: Option<&Arc<Self>>) -> Result<Arc<Self>, BuildError> {
        match later {
            None => Ok(Arc::clone(self)),
            Some(later) if self.same_objects(later) => Ok(Arc::clone(later)),
            Some(_) => Err(BuildError::OtherInstances),
        }
    }

    /// Triangle numbers of each object.
    pub fn objects(&self) -> &[Range<u32>] {
        &self.objects
    }

    /// The instances, by number.
    pub fn placed(&self) -> &[Instance] {
        &self.placed
    }

    /// The triangles of each object, numbered from 0 again; none for an object that nothing places.
    pub(crate) fn parts<'a>(&'a self, triangles: &'a Triangles) -> impl Iterator<Item = Triangles> + 'a {
        let mut is_placed = vec![false; self.objects.len()];
        for instance in &self.placed {
            is_placed[instance.object as usize] = true;
        }
        self.objects.iter().zip(is_placed).map(|(range, is_placed)| {
            let end = if is_placed { range.end } else { range.start };
            triangles.part(range.start as usize..end as usize)
        })
    }

    /// Triangles as a ray meets them: those of every instance counted.
    pub fn placed_triangles(&self) -> u64 {
        self.placed.iter().map(|instance| self.objects[instance.object as usize].len() as u64).sum()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn mistakes_are_named() {
        let make = |end, object, scale| {
            Instances::new(
                4,
                std::iter::once(0..end).collect(),
                [(object, Affine3A::from_scale(Vec3::splat(scale)))],
            )
        };
        assert!(make(4, 0, 2.0).is_ok_and(|good| good.placed_triangles() == 4));
        let good = make(4, 0, 2.0).expect("it is good");
        let error = good.moved([Affine3A::from_scale(Vec3::ZERO)]).expect_err("it is refused");
        assert_eq!(error, InstanceError::NotInvertible(0));
        let moved = good.moved([Affine3A::IDENTITY]).expect("it is good");
        assert!(good.same_objects(&moved) && moved.placed()[0].to_object == Affine3A::IDENTITY);
        assert!(!good.same_objects(&make(3, 0, 2.0).expect("it is good")), "a smaller object");
        assert!(!good.same_objects(&good.moved([]).expect("it is good")), "no instance");
        let bad = |end, object, scale| make(end, object, scale).expect_err("it is refused");
        assert!(matches!(bad(5, 0, 1.0), InstanceError::ObjectOutOfRange { end: 5, .. }));
        assert!(matches!(bad(4, 1, 1.0), InstanceError::NoSuchObject { object: 1, .. }));
        assert!(matches!(bad(4, 0, 0.0), InstanceError::NotInvertible(0)));
        assert!(matches!(bad(4, 0, f32::NAN), InstanceError::NotInvertible(_)));
    }
}
