//! The point where a path meets the scene: position, normals, and an origin for the next ray that does not
//! meet this surface again.
//!
//! Barycentric weights are computed again (Möller and Trumbore 1997): one triangle gives one point, with any
//! accelerator. All that shading needs of a triangle lies in one cache line, a [`Facet`].

use glam::{Vec3, Vec3A, Vec4};
use treewright_accel::{Hit, Instance, Ray};

/// Distance of a new ray's start from the surface, relative to the hit point's magnitude (Wächter and Binder,
/// A Fast and Robust Method for Avoiding Self-Intersection, Ray Tracing Gems 2019, chapter 6).
const OFFSET_OF_POSITION: f32 = 64.0 * f32::EPSILON;
/// That offset relative to the triangle's longest edge: an intersection test loses this share of it.
const OFFSET_OF_EDGE: f32 = 8.0 * f32::EPSILON;
/// Scale of a normal's components as 16-bit integers: a direction good to 3e-5, which no picture shows.
const NORMAL_SCALE: f32 = 32_767.0;
/// Normals that differ from the triangle's own by less than this (chord length) are taken for equal.
const FLAT_WITHIN: f32 = 1e-4;
/// Marks a facet with interpolated normals.
const SMOOTH: u32 = 1 << 31;

/// The data of a triangle for shading: 64 bytes, one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Facet {
    /// First corner; w holds the bits of material and [`SMOOTH`].
    a: Vec4,
    /// Edge to the second corner; w is the largest component of both edges.
    ab: Vec4,
    /// Edge to the third corner; w is the last component of the third normal.
    ac: Vec4,
    /// Normals of the corners as integers, all components but the last.
    normals: [i16; 8],
}

const _: () = assert!(size_of::<Facet>() == 64);

impl Facet {
    /// A triangle with a material (below 2³¹) and the normals of its corners, if it has any.
    pub(super) fn new([a, b, c]: [Vec3A; 3], material: u32, normals: Option<[Vec3; 3]>) -> Self {
        let (ab, ac) = (b - a, c - a);
        let own = Vec3::from(ab.cross(ac)).normalize_or_zero();
        let smooth = normals.filter(|normals| {
            let flat = |normal: &Vec3| {
                (*normal - own).length() < FLAT_WITHIN || (*normal + own).length() < FLAT_WITHIN
            };
            !normals.iter().all(flat)
        });
        let mark = if smooth.is_some() { SMOOTH } else { 0 };
        let [n, o, p] = smooth
            .unwrap_or_default()
            .map(|normal| (normal * NORMAL_SCALE).round().to_array().map(|component| component as i16));
        Self {
            a: a.extend(f32::from_bits(material | mark)),
            ab: ab.extend(longest(ab, ac)),
            ac: ac.extend(f32::from(p[2])),
            normals: [n[0], n[1], n[2], o[0], o[1], o[2], p[0], p[1]],
        }
    }

    #[inline(always)]
    pub(super) fn material(&self) -> usize {
        (self.a.w.to_bits() & !SMOOTH) as usize
    }

    #[inline(always)]
    pub(super) fn is_smooth(&self) -> bool {
        self.a.w.to_bits() & SMOOTH != 0
    }

    /// The normals of the corners, of one length.
    #[inline(always)]
    pub(super) fn normals(&self) -> [Vec3; 3] {
        let [a, b, c, d, e, f, g, h] = self.normals.map(f32::from);
        [Vec3::new(a, b, c), Vec3::new(d, e, f), Vec3::new(g, h, self.ac.w)]
    }

    #[inline(always)]
    pub(super) fn corner_and_edges(&self) -> [Vec3; 3] {
        [self.a, self.ab, self.ac].map(Vec4::truncate)
    }
}

/// A facet where it stands in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct WorldFacet {
    pub(super) corner_and_edges: [Vec3; 3],
    /// Of the corners, of any length. Zero where no facet is smooth.
    pub(super) normals: [Vec3; 3],
    /// The largest component of its edges.
    pub(super) longest: f32,
    /// Distance of its object from the origin: a ray's way into the object's space rounds at this magnitude.
    pub(super) place: f32,
    pub(super) is_smooth: bool,
    /// Whether its object is mirrored, which turns its front away.
    pub(super) is_mirrored: bool,
}

impl WorldFacet {
    /// `INTERPOLATE` is false where no facet is smooth.
    #[inline(always)]
    pub(super) fn new<const INTERPOLATE: bool>(facet: &Facet, instance: Option<&Instance>) -> Self {
        let corner_and_edges = facet.corner_and_edges();
        let normals = if INTERPOLATE { facet.normals() } else { [Vec3::ZERO; 3] };
        let Some(Instance { to_world, to_object, .. }) = instance else {
            let is_smooth = INTERPOLATE && facet.is_smooth();
            return Self {
                corner_and_edges,
                normals,
                longest: facet.ab.w,
                place: 0.0,
                is_smooth,
                is_mirrored: false,
            };
        };
        let [a, ab, ac] = corner_and_edges.map(Vec3A::from);
        let a = to_world.transform_point3a(a);
        let [ab, ac] = [ab, ac].map(|edge| to_world.transform_vector3a(edge));
        // Normals go to the world by the inverse's transpose.
        let turn = to_object.matrix3.transpose();
        Self {
            corner_and_edges: [a, ab, ac].map(Vec3::from),
            normals: if INTERPOLATE { normals.map(|normal| turn * normal) } else { normals },
            longest: longest(ab, ac),
            place: to_world.translation.abs().max_element(),
            is_smooth: INTERPOLATE && facet.is_smooth(),
            is_mirrored: to_world.matrix3.determinant() < 0.0,
        }
    }
}

#[inline(always)]
pub(super) fn interpolated([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    let w = 1.0 - u - v;
    a * w + b * u + c * v
}

#[inline(always)]
fn longest(ab: Vec3A, ac: Vec3A) -> f32 {
    ab.abs().max(ac.abs()).max_element()
}

/// A point on a triangle, seen from a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub(super) position: Vec3,
    /// Unit normal of the triangle, on the viewer's side.
    pub(super) geometric_normal: Vec3,
    /// Unit normal for shading, on the viewer's side of both surfaces.
    pub(super) shading_normal: Vec3,
    /// Distance by which new rays start off the surface.
    pub(super) offset: f32,
}

impl Surface {
    /// Where `ray` meets the facet of `hit` in the world, if it has an area. `INTERPOLATE`: any is smooth.
    #[inline(always)]
    pub(super) fn new<const INTERPOLATE: bool>(standing: &WorldFacet, ray: &Ray, hit: &Hit) -> Option<Self> {
        let WorldFacet { corner_and_edges, normals, longest, place, is_smooth, .. } = *standing;
        let [a, ab, ac] = corner_and_edges;
        let (u, v) = barycentric(ray.origin, ray.direction, corner_and_edges, (hit.u, hit.v));
        let across = ab.cross(ac);
        // Squares of tiny triangles underflow; the slower way is right for them.
        let unit = unit_normal(across).or_else(|| across.try_normalize())?;
        let geometric_normal = facing(unit, ray.direction);
        let shading_normal = if INTERPOLATE && is_smooth {
            guarded(interpolated(normals, u, v), geometric_normal, ray.direction)
        } else {
            geometric_normal
        };
        let position = a + ab * u + ac * v;
        Some(Self { position, geometric_normal, shading_normal, offset: offset(position, place, longest) })
    }

    /// Where a ray in `direction` starts: off the surface, on the side it goes to.
    #[inline(always)]
    pub(super) fn start(&self, direction: Vec3) -> Vec3 {
        let side = self.offset.copysign(direction.dot(self.geometric_normal));
        self.position + self.geometric_normal * side
    }
}

/// Distance by which rays start off a surface, by the longest edge and its object's place.
#[inline(always)]
pub(super) fn offset(position: Vec3, place: f32, edge: f32) -> f32 {
    let magnitude = position.abs().max_element().max(place);
    OFFSET_OF_POSITION * magnitude + OFFSET_OF_EDGE * edge
}

/// The normal of a triangle from the cross product of its edges, unless squares of that leave the range.
#[inline(always)]
pub(super) fn unit_normal(across: Vec3) -> Option<Vec3> {
    let scale = across.length_squared();
    (scale > 1e-30 && scale < 1e30).then(|| across * (1.0 / scale.sqrt()))
}

/// A normal, turned to the side a direction comes from.
#[inline(always)]
pub(super) fn facing(normal: Vec3, direction: Vec3) -> Vec3 {
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

/// The interpolated normal, or the triangle's where that turns away from viewer or triangle.
#[inline(always)]
pub(super) fn guarded(interpolated: Vec3, geometric_normal: Vec3, direction: Vec3) -> Vec3 {
    let side = interpolated.dot(geometric_normal);
    let normal = interpolated * (1.0_f32.copysign(side) / interpolated.length());
    // Also when corners' normals cancel and there is nothing to normalise.
    if normal.dot(direction) < 0.0 { normal } else { geometric_normal }
}

/// Weights of the second and third corner, clamped to the triangle; `otherwise` for a ray in its plane.
#[inline(always)]
pub(super) fn barycentric(
    origin: Vec3,
    direction: Vec3,
    [a, ab, ac]: [Vec3; 3],
    otherwise: (f32, f32),
) -> (f32, f32) {
    let across = direction.cross(ac);
    let inverse = 1.0 / ab.dot(across);
    let from = origin - a;
    let u = from.dot(across) * inverse;
    let v = direction.dot(from.cross(ab)) * inverse;
    if !(u.is_finite() && v.is_finite()) {
        return otherwise;
    }
    let u = clamped(u, 1.0);
    (u, clamped(v, 1.0 - u))
}

/// A finite number moved into the range from 0 to `most`.
#[inline(always)]
fn clamped(value: f32, most: f32) -> f32 {
    let value = if value < 0.0 { 0.0 } else { value };
    if value > most { most } else { value }
}
