//! The triangles of a scene, flattened to world space, and the rays that meet them.
//!
//! One shared vertex array and one index array serve every back end: positions are 16 bytes apart
//! because Embree reads 16 bytes a vertex from shared buffers.

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec3, Vec3A};
use serde::{Deserialize, Serialize};

use crate::limits::{COORDINATE_MAX, MASK_EDGE_MAX, MASKS_MAX, TRIANGLES_MAX};
use crate::masks::{Card, Mask, Masks};

/// Indexed triangles in one space, checked once: indices in range, coordinates finite and at most
/// [`COORDINATE_MAX`] in magnitude. A triangle's number is its index everywhere. The arrays are shared: clones and
/// [parts](Self::part) cost nothing.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    positions: Arc<Vec<Vec3A>>,
    indices: Arc<Vec<[u32; 3]>>,
    /// Of all `indices`; nothing where every triangle is solid.
    masks: Option<Arc<Masks>>,
    /// Which of `indices` are meant.
    range: Range<usize>,
}

/// Why triangles were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GeometryError {
    /// An index names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are only {vertices} vertices")]
    IndexOutOfRange {
        /// Number of the triangle.
        triangle: usize,
        /// The index it holds.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is NaN, infinite or too large for single-precision intersection.
    #[error("vertex {vertex} has a coordinate that is not finite or beyond ±{COORDINATE_MAX:e}")]
    BadCoordinate {
        /// Number of the vertex.
        vertex: usize,
    },
    /// A mask without its pixels, or too large.
    #[error(
        "a mask of {width}x{height} pixels with {values} values: it takes one a pixel, at most {MASK_EDGE_MAX} an edge, and a cutoff from 0"
    )]
    BadMask {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// How many values there are.
        values: usize,
    },
    /// A card names a triangle or a mask that does not exist.
    #[error("triangle {triangle} is to have mask {mask}, but one of them does not exist")]
    NoSuchMask {
        /// Number of the triangle.
        triangle: u32,
        /// Number of the mask.
        mask: u32,
    },
    /// More masks than the limit.
    #[error("{count} masks are more than the limit of {MASKS_MAX}")]
    TooManyMasks {
        /// How many there are.
        count: usize,
    },
    /// More triangles than the limit.
    #[error("{count} triangles are more than the limit of {TRIANGLES_MAX}")]
    TooMany {
        /// How many there are.
        count: usize,
    },
}

impl Triangles {
    /// Checks and takes over the arrays. Only vertices that a triangle names must be finite.
    pub fn new(positions: Vec<Vec3A>, indices: Vec<[u32; 3]>) -> Result<Self, GeometryError> {
        check(&positions, &indices)?;
        let range = 0..indices.len();
        Ok(Self { positions: Arc::new(positions), indices: Arc::new(indices), masks: None, range })
    }

    /// The same triangles with their vertices elsewhere.
    pub fn moved(&self, positions: Vec<Vec3A>) -> Result<Self, GeometryError> {
        check(&positions, self.indices())?;
        Ok(Self {
            positions: Arc::new(positions),
            indices: Arc::clone(&self.indices),
            masks: self.masks.clone(),
            range: self.range.clone(),
        })
    }

    /// The same triangles, of which some have masks: rays go through those where the mask is not solid.
    ///
    /// # Errors
    /// [`GeometryError`] for a card that names a triangle or a mask that does not exist, and too many masks.
    pub fn masked(
        self,
        masks: Vec<Mask>,
        cards: impl IntoIterator<Item = (u32, Card)>,
    ) -> Result<Self, GeometryError> {
        let first = self.range.start as u32;
        let cards = cards.into_iter().map(|(triangle, card)| (triangle.saturating_add(first), card));
        let masks = Masks::new(self.indices.len(), masks, cards)?;
        Ok(Self { masks: Some(Arc::new(masks)), ..self })
    }

    /// These triangles with the masks of others, given by their numbers in the order of these.
    pub(crate) fn masked_as(self, others: &Self, numbers: impl Iterator<Item = usize>) -> Self {
        let first = others.range.start;
        let masks = others.masks.as_deref();
        Self {
            masks: masks.map(|masks| Arc::new(masks.subset(numbers.map(|number| first + number)))),
            ..self
        }
    }

    /// Whether any triangle has a mask: O(triangles).
    pub fn has_masks(&self) -> bool {
        let masks = self.masks.as_deref();
        masks.is_some_and(|masks| self.range.clone().any(|triangle| masks.is_card(triangle)))
    }

    /// Whether a triangle has a mask.
    #[inline]
    pub fn is_card(&self, triangle: usize) -> bool {
        self.masks.as_deref().is_some_and(|masks| masks.is_card(self.range.start + triangle))
    }

    /// The mask's number and the texture coordinates of a triangle that has one.
    pub fn card(&self, triangle: usize) -> Option<Card> {
        self.masks.as_deref()?.card(self.range.start + triangle).copied()
    }

    /// All masks.
    pub fn masks(&self) -> &[Mask] {
        self.masks.as_deref().map_or(&[], Masks::masks)
    }

    /// Whether a ray that meets a triangle meets something solid there.
    #[inline]
    pub(crate) fn is_met(&self, triangle: usize, ray: &Ray) -> bool {
        let masks = self.masks.as_deref();
        masks.is_none_or(|masks| masks.is_met(self.range.start + triangle, self.corners(triangle), ray))
    }

    /// Some of these triangles, numbered in the order given, over the same vertices.
    pub(crate) fn subset(&self, numbers: &[u32]) -> Self {
        let indices: Vec<_> = numbers.iter().map(|&number| self.indices()[number as usize]).collect();
        let range = 0..indices.len();
        let within = || numbers.iter().map(|&number| self.range.start + number as usize);
        let masks = self.masks.as_deref().map(|masks| Arc::new(masks.subset(within())));
        Self { positions: Arc::clone(&self.positions), indices: Arc::new(indices), masks, range }
    }

    /// Whether both are made of the same vertices' numbers.
    pub(crate) fn same_indices(&self, other: &Self) -> bool {
        (Arc::ptr_eq(&self.indices, &other.indices) && self.range == other.range)
            || self.indices() == other.indices()
    }

    /// A run of these triangles, numbered from 0 again, over the same vertices.
    ///
    /// # Panics
    /// If the run ends beyond the last triangle.
    pub fn part(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "a part lies inside the whole");
        let range = self.range.start + range.start..self.range.start + range.end;
        let masks = self.masks.clone();
        Self { positions: Arc::clone(&self.positions), indices: Arc::clone(&self.indices), masks, range }
    }

    /// Vertex positions, 16 bytes apart.
    pub fn positions(&self) -> &[Vec3A] {
        &self.positions
    }

    /// Three vertex numbers a triangle.
    pub fn indices(&self) -> &[[u32; 3]] {
        &self.indices[self.range.clone()]
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.range.len()
    }

    /// No triangle at all.
    pub fn is_empty(&self) -> bool {
        self.range.is_empty()
    }

    /// The three corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3A; 3] {
        self.indices()[triangle].map(|vertex| self.positions[vertex as usize])
    }
}

/// Indices in range, coordinates finite and not too large.
fn check(positions: &[Vec3A], indices: &[[u32; 3]]) -> Result<(), GeometryError> {
    if indices.len() > TRIANGLES_MAX {
        return Err(GeometryError::TooMany { count: indices.len() });
    }
    for (triangle, corners) in indices.iter().enumerate() {
        for &vertex in corners {
            let Some(position) = positions.get(vertex as usize) else {
                return Err(GeometryError::IndexOutOfRange { triangle, vertex, vertices: positions.len() });
            };
            // NaN fails the comparison and is refused with the rest.
            if !position.abs().cmple(Vec3A::splat(COORDINATE_MAX)).all() {
                return Err(GeometryError::BadCoordinate { vertex: vertex as usize });
            }
        }
    }
    Ok(())
}

/// A ray segment: `origin + t * direction` for `t_min < t < t_max`. The direction need not be normalised.
/// Whether a hit at exactly `t_max` counts is left open: native Embree counts it, the others do not.
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
    /// Whether origin and direction are finite and `0 <= t_min <= t_max` are numbers. Rays that are not valid
    /// miss.
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
    /// What a search for the nearest hit before `t_max` begins with.
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

/// What [`Hit::instance`] holds in a scene without instances.
pub const NO_INSTANCE: u32 = u32::MAX;

/// How the rays of a batch are traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Packets {
    /// One by one.
    #[default]
    Single,
    /// Eight at a time, each on its own way.
    Eight,
    /// Eight at a time that mostly go the same way.
    EightCoherent,
    /// Sixteen at a time, each on its own way.
    Sixteen,
    /// Sixteen at a time that mostly go the same way.
    SixteenCoherent,
}

impl Packets {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Single, Self::Eight, Self::EightCoherent, Self::Sixteen, Self::SixteenCoherent];
}

/// Anything that answers ray queries over [`Triangles`]. Queries never fail: rays with non-finite
/// components miss.
pub trait Intersector: Sync + Send {
    /// The nearest hit inside the segment.
    fn closest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything lies inside the segment.
    fn occluded(&self, ray: &Ray) -> bool;

    /// The nearest hit of each ray; `hits` is as long as `rays`. The answers are those of
    /// [`Intersector::closest`] however the rays are packed.
    fn closest_each(&self, _packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest(ray);
        }
    }

    /// Whether anything lies inside each segment; `occluded` is as long as `rays`.
    fn occluded_each(&self, _packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer a ray");
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = self.occluded(ray);
        }
    }
}
