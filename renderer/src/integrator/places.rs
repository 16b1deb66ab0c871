//! The places of a path's random numbers ([`PathRandom`](super::random::PathRandom)): each decision has its
//! own, since two that shared one would bias a picture.

/// The camera's: the point of the pixel.
pub(super) const CAMERA: u32 = 0;
/// Places of a vertex: which light, the point on it, the choice of a lobe, and its direction.
pub(super) const PER_VERTEX: u32 = 4;
/// Beyond all vertices.
const SOLIDS: u32 = 1 << 24;
/// Beyond all vertices and solids.
const ROULETTE: u32 = 1 << 25;
/// Beyond all of those.
const LAST_RAYS: u32 = 1 << 26;

/// The first of the [`PER_VERTEX`] places of a vertex.
#[inline(always)]
pub(super) const fn of_vertex(vertex: u16) -> u32 {
    CAMERA + 1 + vertex as u32 * PER_VERTEX
}

/// The choice between ways at a solid's surface, at the vertex whose places begin at `place`.
#[inline(always)]
pub(super) const fn of_solid(place: u32) -> u32 {
    SOLIDS + place
}

/// Whether the shadow ray (the first number) and the path (the second one) of a vertex go on.
#[inline(always)]
pub(super) const fn of_roulette(vertex: u16) -> u32 {
    ROULETTE + vertex as u32
}

/// Whether a last ray leaves the vertex whose places begin at `place`.
#[inline(always)]
pub(super) const fn of_last_ray(place: u32) -> u32 {
    LAST_RAYS + place
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_decisions_share_a_place() {
        let of = |vertex: u16| {
            let first = of_vertex(vertex);
            let others = [of_solid(first), of_roulette(vertex), of_last_ray(first)];
            (first..first + PER_VERTEX).chain(others)
        };
        let mut seen = HashSet::from([CAMERA]);
        for vertex in 0..=u16::MAX {
            for place in of(vertex) {
                assert!(seen.insert(place), "place {place} of vertex {vertex} has another decision");
            }
        }
    }
}
