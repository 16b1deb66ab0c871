//! Triangles with holes: an alpha test during traversal, so that leaf cards and fences let rays through.
//!
//! A [`Card`] is hit only where its mask, an alpha channel with a cutoff, is solid. Barycentric weights are
//! computed again (Möller and Trumbore 1997), so the side of an edge does not depend on the structure.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec3A};

use crate::limits::{MASK_EDGE_MAX, MASKS_MAX};
use crate::{error::GeometryError, rays::Ray};

/// The continuation of an image beyond its edges. Texture coordinates 0 to 1 span the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image again, every other time mirrored.
    Mirror,
    /// The outermost pixels.
    Clamp,
}

impl Wrap {
    /// The pixel of a row of `size` pixels (at least 1) that stands at `place`.
    #[inline]
    pub fn index(self, place: i32, size: u32) -> u32 {
        let (place, size) = (i64::from(place), i64::from(size));
        let index = match self {
            Self::Repeat => place.rem_euclid(size),
            Self::Mirror => {
                let there = place.rem_euclid(2 * size);
                if there < size { there } else { 2 * size - 1 - there }
            }
            Self::Clamp => place.clamp(0, size - 1),
        };
        index as u32
    }
}

/// An alpha channel with the value from which on it is solid.
#[derive(Clone, Debug)]
pub struct Mask {
    width: u32,
    height: u32,
    alpha: Arc<[u8]>,
    /// 0 to 255, or above for a mask that is nowhere solid.
    cutoff: f32,
    wrap: [Wrap; 2],
}

impl Mask {
    /// An image's alpha, row by row from the row at `v = 0`, solid from `cutoff` (0 to 1) on.
    ///
    /// # Errors
    /// [`GeometryError::BadMask`] if there are not `width` × `height` values or an edge is 0 or beyond
    /// [`MASK_EDGE_MAX`].
    pub fn new(
        width: u32,
        height: u32,
        alpha: Arc<[u8]>,
        cutoff: f32,
        wrap: [Wrap; 2],
    ) -> Result<Self, GeometryError> {
        let edges = 1..=MASK_EDGE_MAX;
        let fits = edges.contains(&width)
            && edges.contains(&height)
            && alpha.len() == width as usize * height as usize
            && cutoff >= 0.0;
        if fits {
            Ok(Self { width, height, alpha, cutoff: cutoff * 255.0, wrap })
        } else {
            Err(GeometryError::BadMask { width, height, values: alpha.len() })
        }
    }

    /// Whether it is solid at a place, by the alpha between the four nearest pixels.
    #[inline]
    pub fn is_solid(&self, at: Vec2) -> bool {
        let scaled = at * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        let low = scaled.floor();
        let share = scaled - low;
        // Numbers too large for pixels, and NaN, become some pixel.
        let (x, y) = (low.x as i32, low.y as i32);
        let [wrap_x, wrap_y] = self.wrap;
        let columns = [x, x.saturating_add(1)].map(|x| wrap_x.index(x, self.width) as usize);
        let row = |y: i32| {
            let row = wrap_y.index(y, self.height) as usize * self.width as usize;
            let [a, b] = columns.map(|column| f32::from(self.alpha[row + column]));
            a + (b - a) * share.x
        };
        let (a, b) = (row(y), row(y.saturating_add(1)));
        a + (b - a) * share.y >= self.cutoff
    }
}

/// A triangle's mask, and the texture coordinates of its corners.
#[derive(Clone, Copy, Debug)]
pub struct Card {
    /// Number of its mask.
    pub mask: u32,
    /// One a corner, in the triangle's order.
    pub corners: [Vec2; 3],
}

/// In place of a card's number: the triangle is solid everywhere.
const SOLID: u32 = u32::MAX;

/// The masks of some triangles and which of them has which.
#[derive(Clone, Debug)]
pub(crate) struct Masks {
    masks: Arc<Vec<Mask>>,
    cards: Arc<Vec<Card>>,
    card_of: Vec<u32>,
}

impl Masks {
    /// Of `triangles` triangles; `cards` with the numbers of theirs.
    pub(crate) fn new(
        triangles: usize,
        masks: Vec<Mask>,
        cards: impl IntoIterator<Item = (u32, Card)>,
    ) -> Result<Self, GeometryError> {
        if masks.len() > MASKS_MAX {
            return Err(GeometryError::TooManyMasks(masks.len()));
        }
        let mut card_of = vec![SOLID; triangles];
        let mut all = Vec::new();
        for (triangle, card) in cards {
            let place = card_of.get_mut(triangle as usize).filter(|_| (card.mask as usize) < masks.len());
            let Some(place) = place else {
                return Err(GeometryError::NoSuchMask { triangle, mask: card.mask });
            };
            *place = all.len() as u32;
            all.push(card);
        }
        Ok(Self { masks: Arc::new(masks), cards: Arc::new(all), card_of })
    }

    pub(crate) fn subset(&self, numbers: impl Iterator<Item = usize>) -> Self {
        let card_of = numbers.map(|number| self.card_of[number]).collect();
        Self { masks: Arc::clone(&self.masks), cards: Arc::clone(&self.cards), card_of }
    }

    #[inline]
    pub(crate) fn is_card(&self, triangle: usize) -> bool {
        self.card_of[triangle] != SOLID
    }

    /// Whether a triangle with these corners is solid where a ray meets it.
    #[inline]
    pub(crate) fn is_met(&self, triangle: usize, corners: [Vec3A; 3], ray: &Ray) -> bool {
        let Some(card) = self.cards.get(self.card_of[triangle] as usize) else { return true };
        let (u, v) = weights(ray, corners.map(Vec3::from));
        let [a, b, c] = card.corners;
        self.masks[card.mask as usize].is_solid(a + (b - a) * u + (c - a) * v)
    }

    /// The mask and texture coordinates of a triangle.
    pub(crate) fn card(&self, triangle: usize) -> Option<&Card> {
        self.cards.get(self.card_of[triangle] as usize)
    }

    pub(crate) fn masks(&self) -> &[Mask] {
        &self.masks
    }
}

/// Weights of the second and third corner where a ray meets a triangle's plane; 0 for a ray in it.
#[inline]
fn weights(ray: &Ray, [a, b, c]: [Vec3; 3]) -> (f32, f32) {
    let (ab, ac) = (b - a, c - a);
    let across = ray.direction.cross(ac);
    let inverse = 1.0 / ab.dot(across);
    let from = ray.origin - a;
    let u = from.dot(across) * inverse;
    let v = ray.direction.dot(from.cross(ab)) * inverse;
    if !(u.is_finite() && v.is_finite()) {
        return (0.0, 0.0);
    }
    let u = u.clamp(0.0, 1.0);
    (u, v.clamp(0.0, 1.0 - u))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checks(wrap: Wrap) -> Mask {
        // Solid on the left half, in a picture of 4 × 2.
        let alpha: Arc<[u8]> = vec![255, 255, 0, 0, 255, 255, 0, 0].into();
        Mask::new(4, 2, alpha, 0.5, [wrap, Wrap::Clamp]).expect("it is sound")
    }

    #[test]
    fn rows_go_on_as_they_are_told() {
        let indices = |wrap: Wrap| [-3, -2, -1, 0, 1, 2, 3, 4].map(|place| wrap.index(place, 2));
        assert_eq!(indices(Wrap::Repeat), [1, 0, 1, 0, 1, 0, 1, 0]);
        assert_eq!(indices(Wrap::Mirror), [1, 1, 0, 0, 1, 1, 0, 0]);
        assert_eq!(indices(Wrap::Clamp), [0, 0, 0, 0, 1, 1, 1, 1]);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for place in [i32::MIN, i32::MAX] {
                assert!(wrap.index(place, 3) < 3);
            }
        }
    }

    #[test]
    fn masks_are_solid_where_alpha_is() {
        let at = |wrap, u| checks(wrap).is_solid(Vec2::new(u, 0.3));
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            assert!(at(wrap, 0.25) && !at(wrap, 0.75));
            // Between the second and the third pixel alpha falls linearly, to the cutoff in the middle.
            assert!(at(wrap, 0.49) && !at(wrap, 0.51));
        }
        assert!(at(Wrap::Repeat, 1.25) && !at(Wrap::Mirror, 1.25) && !at(Wrap::Clamp, 1.25));
        assert!(!at(Wrap::Repeat, -0.25) && at(Wrap::Mirror, -0.25) && at(Wrap::Clamp, -0.25));
        for odd in [f32::NAN, f32::INFINITY, 1e30, -1e30] {
            at(Wrap::Repeat, odd);
        }
    }

    #[test]
    fn masks_of_the_wrong_size_are_refused() {
        let make = |width, height, values: usize, cutoff| {
            Mask::new(width, height, vec![0; values].into(), cutoff, [Wrap::Repeat; 2])
        };
        assert!(make(2, 3, 6, 0.0).is_ok() && make(2, 3, 6, 7.0).is_ok());
        for (width, height, values, cutoff) in
            [(0, 3, 0, 0.5), (2, 3, 5, 0.5), (MASK_EDGE_MAX + 1, 1, 1 << 20, 0.5), (2, 3, 6, f32::NAN)]
        {
            assert!(matches!(make(width, height, values, cutoff), Err(GeometryError::BadMask { .. })));
        }
        let card = |mask| Card { mask, corners: [Vec2::ZERO; 3] };
        let masks = |triangle, mask| Masks::new(4, vec![checks(Wrap::Repeat)], [(triangle, card(mask))]);
        assert!(masks(3, 0).is_ok_and(|masks| masks.is_card(3) && !masks.is_card(2)));
        assert!(matches!(masks(4, 0), Err(GeometryError::NoSuchMask { triangle: 4, mask: 0 })));
        assert!(matches!(masks(3, 1), Err(GeometryError::NoSuchMask { triangle: 3, mask: 1 })));
    }

    #[test]
    fn weights_are_those_of_the_point_met() {
        let ray = Ray { origin: Vec3::new(0.5, 0.25, 3.0), direction: Vec3::NEG_Z, t_min: 0.0, t_max: 9.0 };
        let corners = [Vec3::ZERO, Vec3::X * 2.0, Vec3::Y];
        assert_eq!(weights(&ray, corners), (0.25, 0.25));
        assert_eq!(weights(&Ray { direction: Vec3::X, ..ray }, corners), (0.0, 0.0));
    }
}
