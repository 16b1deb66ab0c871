//! The watertight triangle test: Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013),
//! on all triangles of a block at once.
//!
//! Corners are moved and sheared so that the ray becomes the z axis; which side of an edge the axis lies
//! on is then one difference of two products, exactly opposite for the two triangles that share the
//! edge. No fused operation may be used for it: its single rounding would break that symmetry.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::lanes::{Lanes, Stored};
use super::triangles::Blocks;
use crate::geometry::{Hit, NO_INSTANCE, Ray};
use crate::tree::layout::Block;

/// Triangles as three corners.
#[derive(Clone, Copy)]
pub(crate) struct WatertightBlocks<L> {
    /// Axes: the third is the one the ray runs along most.
    axes: [usize; 3],
    /// Shear of the first two axes and scale of the third.
    shear: [L; 3],
    /// Origin in the order of `axes`.
    origin: [L; 3],
    t_min: L,
}

struct Found<L> {
    hits: u32,
    t: L,
    /// Weights of the second and third corner, unnormalised, and the sum of all three.
    u: L,
    v: L,
    sum: L,
}

impl<L: Lanes> WatertightBlocks<L> {
    /// One corner of each triangle, moved and sheared, with its coordinate along the ray.
    #[inline(always)]
    unsafe fn sheared<const B: usize>(&self, corner: &[[f32; B]; 3]) -> [L; 3] {
        let along = |axis: usize| L::load(corner[self.axes[axis]].as_ptr()).sub(self.origin[axis]);
        let [shear_x, shear_y, scale_z] = self.shear;
        let (x, y, z) = (along(0), along(1), along(2));
        [x.sub(shear_x.mul(z)), y.sub(shear_y.mul(z)), scale_z.mul(z)]
    }

    #[inline(always)]
    unsafe fn test<const B: usize>(&self, block: &Block<B>, t_max: f32) -> Found<L> {
        let [ax, ay, az] = self.sheared(&block.vertices[0]);
        let [bx, by, bz] = self.sheared(&block.vertices[1]);
        let [cx, cy, cz] = self.sheared(&block.vertices[2]);
        let mut u = cx.mul(by).sub(cy.mul(bx));
        let mut v = ax.mul(cy).sub(ay.mul(cx));
        let mut w = bx.mul(ay).sub(by.mul(ax));
        let zero = L::splat(0.0);
        let on_edge = L::or(L::or(u.equal(zero), v.equal(zero)), w.equal(zero));
        if L::bits(on_edge) != 0 {
            [u, v, w] = edges_in_double([[ax, ay], [bx, by], [cx, cy]]);
        }
        let positive = L::and(L::and(zero.less_equal(u), zero.less_equal(v)), zero.less_equal(w));
        let negative = L::and(L::and(u.less_equal(zero), v.less_equal(zero)), w.less_equal(zero));
        let inside = L::or(positive, negative);
        let sum = u.add(v).add(w);
        let found = |hits, t| Found { hits, t, u: v, v: w, sum };
        if L::bits(inside) == 0 {
            return found(0, zero);
        }
        // A sum of zero gives infinity or NaN, which fails the comparisons.
        let t = u.mul(az).add(v.mul(bz)).add(w.mul(cz)).div(sum);
        let between = L::and(self.t_min.less(t), t.less(L::splat(t_max)));
        let hits = L::bits(L::and(L::and(inside, between), zero.less(sum.abs())));
        found(hits, t)
    }
}

/// The three edge values where single precision says zero: double precision has room for the exact
/// products, so that only true zeros remain. Rare, hence out of the way.
#[cold]
#[inline(never)]
fn in_double(corners: [[[f32; 16]; 2]; 3]) -> [[f32; 16]; 3] {
    let side = |[px, py]: [[f32; 16]; 2], [qx, qy]: [[f32; 16]; 2]| {
        std::array::from_fn(|lane| {
            (f64::from(px[lane]) * f64::from(qy[lane]) - f64::from(py[lane]) * f64::from(qx[lane])) as f32
        })
    };
    let [a, b, c] = corners;
    [side(c, b), side(a, c), side(b, a)]
}

#[inline(always)]
unsafe fn edges_in_double<L: Lanes>(corners: [[L; 2]; 3]) -> [L; 3] {
    let [[ax, ay], [bx, by], [cx, cy]] = corners;
    let stored = |x, y| [Stored::from(x).0, Stored::from(y).0];
    let [u, v, w] = in_double([stored(ax, ay), stored(bx, by), stored(cx, cy)]).map(Stored);
    [L::load(u.0.as_ptr()), L::load(v.0.as_ptr()), L::load(w.0.as_ptr())]
}

impl<L: Lanes, const B: usize> Blocks<B> for WatertightBlocks<L> {
    #[inline(always)]
    unsafe fn new(ray: &Ray) -> Self {
        let (direction, size) = (ray.direction, ray.direction.abs());
        let main = if size.x > size.y && size.x > size.z {
            0
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let axes = [(main + 1) % 3, (main + 2) % 3, main];
        let [x, y, z] = axes.map(|axis| direction[axis]);
        let [ox, oy, oz] = axes.map(|axis| ray.origin[axis]);
        Self {
            axes,
            shear: [L::splat(x / z), L::splat(y / z), L::splat(1.0 / z)],
            origin: [L::splat(ox), L::splat(oy), L::splat(oz)],
            t_min: L::splat(ray.t_min),
        }
    }

    #[inline(always)]
    unsafe fn closest(&self, block: &Block<B>, hit: &mut Hit) {
        let Found { hits, t, u, v, sum } = self.test(block, hit.t);
        if hits == 0 {
            return;
        }
        let times = Stored::from(t).0;
        let mut left = hits;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            if times[lane] < hit.t {
                let (u, v) = (Stored::from(u.div(sum)).0[lane], Stored::from(v.div(sum)).0[lane]);
                *hit = Hit { t: times[lane], u, v, triangle: block.triangles[lane], instance: NO_INSTANCE };
            }
        }
    }

    #[inline(always)]
    unsafe fn any(&self, block: &Block<B>, t_max: f32) -> bool {
        self.test(block, t_max).hits != 0
    }
}
