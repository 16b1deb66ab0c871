//! Rays, hits, and the interface of structures that answer rays.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::limits::TRIANGLES_MAX;

/// A ray segment: `origin + t * direction`, `t_min < t < t_max`; a hit at exactly `t_max` is left open.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes.
    pub direction: Vec3,
    /// Begin of the segment, at least 0.
    pub t_min: f32,
    /// End of the segment; infinity for none.
    pub t_max: f32,
}

impl Ray {
    /// Whether origin and direction are finite and `0 <= t_min <= t_max`. Other rays miss.
    #[inline]
    pub fn is_valid(&self) -> bool {
        // Zero times a finite number is zero; times infinity or NaN it is NaN, which fails the comparison.
        let zero = (self.origin * 0.0 + self.direction * 0.0).element_sum();
        zero == 0.0 && 0.0 <= self.t_min && self.t_min <= self.t_max
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
    /// Number of the triangle.
    pub triangle: u32,
    /// Number of the instance the triangle was met in; [`NO_INSTANCE`] in a scene without instances.
    pub instance: u32,
}

impl Hit {
    /// The start of a search for the nearest hit before `t_max`.
    #[inline(always)]
    pub(crate) fn none(t_max: f32) -> Self {
        Self { t: t_max, u: 0.0, v: 0.0, triangle: NO_TRIANGLE, instance: NO_INSTANCE }
    }

    /// Itself, if a triangle was found since [`Hit::none`].
    #[inline(always)]
    pub(crate) fn found(self) -> Option<Self> {
        (self.triangle != NO_TRIANGLE).then_some(self)
    }
}

/// A number no triangle has.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;
/// Marks the number of a triangle with a mask, in the leaves of a tree.
pub(crate) const CARD: u32 = 1 << 31;
const _: () = assert!(TRIANGLES_MAX <= CARD as usize);
/// The value of [`Hit::instance`] in a scene without instances.
pub const NO_INSTANCE: u32 = u32::MAX;

/// The grouping of rays of a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Packets {
    /// One by one.
    #[default]
    Single,
    /// Four at a time, each on its own way. Native scenes trace them one by one.
    Four,
    /// Eight at a time, each on its own way.
    Eight,
    /// Eight at a time that mostly go one way.
    EightCoherent,
    /// Sixteen at a time, each on its own way. Trees of our own have eight at most.
    Sixteen,
    /// Sixteen at a time that mostly go one way.
    SixteenCoherent,
}

impl Packets {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Single, Self::Four, Self::Eight, Self::EightCoherent, Self::Sixteen, Self::SixteenCoherent];
}

/// Anything that answers ray queries over [`Triangles`](crate::Triangles). Invalid rays miss.
pub trait Intersector: Sync + Send {
    /// The nearest hit inside the segment.
    fn closest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything lies inside the segment.
    fn occluded(&self, ray: &Ray) -> bool;

    /// The nearest hit of each ray, as [`Intersector::closest`] with every packing. The slices are as long.
    fn closest_each(&self, _packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        one_by_one(rays, hits, |ray| self.closest(ray));
    }

    /// Whether anything lies inside each segment; `occluded` is as long as `rays`.
    fn occluded_each(&self, _packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        one_by_one(rays, occluded, |ray| self.occluded(ray));
    }
}

/// The answer of each ray by itself.
#[inline(always)]
pub(crate) fn one_by_one<T>(rays: &[Ray], answers: &mut [T], alone: impl Fn(&Ray) -> T) {
    assert_eq!(rays.len(), answers.len(), "one answer a ray");
    for (ray, answer) in rays.iter().zip(answers) {
        *answer = alone(ray);
    }
}
