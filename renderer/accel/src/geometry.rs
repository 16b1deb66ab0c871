//! The triangles of a scene, flattened to world space.
//!
//! One shared vertex array and one index array serve every back end: positions are 16 bytes apart
//! because Embree reads 16 bytes a vertex from shared buffers.

use std::{ops::Range, sync::Arc};

use glam::Vec3A;

pub use crate::error::GeometryError;
use crate::limits::{COORDINATE_MAX, TRIANGLES_MAX};
use crate::masks::{Card, Mask, Masks};
pub(crate) use crate::rays::{CARD, NO_TRIANGLE};
pub use crate::rays::{Hit, Intersector, NO_INSTANCE, Packets, Ray};

/// Indexed triangles in one space, checked once: indices in range, coordinates finite and at most
/// [`COORDINATE_MAX`]. The arrays are shared: clones and [parts](Self::part) cost nothing.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    positions: Arc<Vec<Vec3A>>,
    indices: Arc<Vec<[u32; 3]>>,
    /// Of all `indices`; nothing where every triangle is solid.
    masks: Option<Arc<Masks>>,
    /// Which of `indices` are meant.
    range: Range<usize>,
}

impl Triangles {
    /// Checks and takes over the arrays. Only vertices that a triangle names must be finite.
    pub fn new(positions: Vec<Vec3A>, indices: Vec<[u32; 3]>) -> Result<Self, GeometryError> {
        check(&positions, &indices)?;
        let range = 0..indices.len();
        Ok(Self { positions: Arc::new(positions), indices: Arc::new(indices), masks: None, range })
    }

    /// These triangles with their vertices elsewhere.
    pub fn moved(&self, positions: Vec<Vec3A>) -> Result<Self, GeometryError> {
        check(&positions, self.indices())?;
        Ok(Self { positions: Arc::new(positions), ..self.clone() })
    }

    /// These triangles, of which some have masks: rays go through those where the mask is not solid.
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

    /// Whether a triangle is solid where a ray meets it.
    #[inline]
    pub(crate) fn is_met(&self, triangle: usize, ray: &Ray) -> bool {
        let masks = self.masks.as_deref();
        masks.is_none_or(|masks| masks.is_met(self.range.start + triangle, self.corners(triangle), ray))
    }

    /// Some of these triangles, numbered in the order given, over all vertices.
    pub(crate) fn subset(&self, numbers: &[u32]) -> Self {
        let indices: Vec<_> = numbers.iter().map(|&number| self.indices()[number as usize]).collect();
        let range = 0..indices.len();
        let within = || numbers.iter().map(|&number| self.range.start + number as usize);
        let masks = self.masks.as_deref().map(|masks| Arc::new(masks.subset(within())));
        Self { positions: Arc::clone(&self.positions), indices: Arc::new(indices), masks, range }
    }

    /// Whether both have equal numbers of vertices at their corners.
    pub(crate) fn same_indices(&self, other: &Self) -> bool {
        (Arc::ptr_eq(&self.indices, &other.indices) && self.range == other.range)
            || self.indices() == other.indices()
    }

    /// Whether the other's triangles are equal, with their corners in equal places: O(triangles).
    pub(crate) fn rest_as(&self, other: &Self) -> bool {
        let same_masks = match (&self.masks, &other.masks) {
            (None, None) => true,
            (Some(own), Some(other)) => Arc::ptr_eq(own, other),
            _ => false,
        };
        let same_places = || {
            let rests = |vertex: &u32| self.positions[*vertex as usize] == other.positions[*vertex as usize];
            Arc::ptr_eq(&self.positions, &other.positions) || self.indices().iter().flatten().all(rests)
        };
        same_masks && self.same_indices(other) && same_places()
    }

    /// A run of these triangles, numbered from 0 again, over all vertices.
    ///
    /// # Panics
    /// If the run ends beyond the last triangle.
    pub fn part(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "a part lies inside the whole");
        let range = self.range.start + range.start..self.range.start + range.end;
        Self { range, ..self.clone() }
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
        return Err(GeometryError::TooMany(indices.len()));
    }
    for (triangle, corners) in indices.iter().enumerate() {
        for &vertex in corners {
            let Some(position) = positions.get(vertex as usize) else {
                return Err(GeometryError::IndexOutOfRange { triangle, vertex, vertices: positions.len() });
            };
            // NaN fails the comparison and is refused with the rest.
            if !position.abs().cmple(Vec3A::splat(COORDINATE_MAX)).all() {
                return Err(GeometryError::BadCoordinate(vertex as usize));
            }
        }
    }
    Ok(())
}
