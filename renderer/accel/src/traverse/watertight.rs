//! The watertight triangle test: Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013),
//! on many pairs of ray and triangle at once, as in [`super::triangles`].
//!
//! Corners are moved and sheared so that the ray becomes the z axis. The side of an edge on which the axis
//! lies is then the sign of one difference of two products. It is exactly opposite for the two triangles that
//! share the edge. No fused operation may be used for it: its single rounding would break that symmetry.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use super::lanes::{Lanes, Stored};
use super::triangles::{Blocks, Found, take_nearest};
use crate::geometry::{Hit, Ray, Triangles};
use crate::layout::{Block, is_any_met};

/// The axes of a ray, the one it runs along most last.
#[inline(always)]
pub(super) fn axes(ray: &Ray) -> [usize; 3] {
    let size = ray.direction.abs();
    let main = if size.x > size.y && size.x > size.z {
        0
    } else if size.y > size.z {
        1
    } else {
        2
    };
    [(main + 1) % 3, (main + 2) % 3, main]
}

/// One ray, or several that run along one axis most.
#[derive(Clone, Copy)]
pub(super) struct Sheared<L> {
    /// Origin in the order of the axes.
    pub(super) origin: [L; 3],
    /// Shear of the first two axes and scale of the third: direction over its third, and one over that.
    pub(super) shear: [L; 3],
    pub(super) t_min: L,
}

impl<L: Lanes> Sheared<L> {
    /// A corner, in the order of the axes, moved and sheared, with its coordinate along the ray.
    #[inline(always)]
    unsafe fn moved(&self, corner: [L; 3]) -> [L; 3] {
        let ([x, y, z], [ox, oy, oz], [shear_x, shear_y, scale_z]) = (corner, self.origin, self.shear);
        let (x, y, z) = (x.sub(ox), y.sub(oy), z.sub(oz));
        [x.sub(shear_x.mul(z)), y.sub(shear_y.mul(z)), scale_z.mul(z)]
    }

    /// The test itself. The distance found is the true one, the weights are scaled.
    #[inline(always)]
    pub(super) unsafe fn meet(&self, corners: [[L; 3]; 3], t_max: L) -> Found<L> {
        let [a, b, c] = corners;
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (self.moved(a), self.moved(b), self.moved(c));
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
        let scale = u.add(v).add(w);
        if L::bits(inside) == 0 {
            return Found { hits: 0, t: zero, u: v, v: w, scale };
        }
        // A sum of zero gives infinity or NaN, which fails the comparisons.
        let t = u.mul(az).add(v.mul(bz)).add(w.mul(cz)).div(scale);
        let between = L::and(self.t_min.less(t), t.less(t_max));
        let hits = L::bits(L::and(L::and(inside, between), zero.less(scale.abs())));
        Found { hits, t, u: v, v: w, scale }
    }
}

/// The three edge values where single precision says zero; double has room for the exact products.
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

/// One ray against triangles that are stored as three corners.
#[derive(Clone, Copy)]
pub(crate) struct WatertightBlocks<L> {
    axes: [usize; 3],
    ray: Sheared<L>,
}

impl<L: Lanes> WatertightBlocks<L> {
    #[inline(always)]
    unsafe fn test<const B: usize>(&self, block: &Block<B>, t_max: f32) -> Found<L> {
        let [x, y, z] = self.axes;
        let corner = |which: usize| {
            let planes = &block.vertices[which];
            [L::load(planes[x].as_ptr()), L::load(planes[y].as_ptr()), L::load(planes[z].as_ptr())]
        };
        self.ray.meet([corner(0), corner(1), corner(2)], L::splat(t_max))
    }
}

impl<L: Lanes, const B: usize> Blocks<B> for WatertightBlocks<L> {
    #[inline(always)]
    unsafe fn new(ray: &Ray) -> Self {
        let axes = axes(ray);
        let [x, y, z] = axes.map(|axis| ray.direction[axis]);
        let [ox, oy, oz] = axes.map(|axis| ray.origin[axis]);
        let ray = Sheared {
            origin: [L::splat(ox), L::splat(oy), L::splat(oz)],
            shear: [L::splat(x / z), L::splat(y / z), L::splat(1.0 / z)],
            t_min: L::splat(ray.t_min),
        };
        Self { axes, ray }
    }

    #[inline(always)]
    unsafe fn closest(&self, block: &Block<B>, ray: &Ray, all: &Triangles, hit: &mut Hit) {
        let found = self.test(block, hit.t);
        if found.hits != 0 {
            take_nearest(&found, found.t, (&block.triangles, all), ray, hit);
        }
    }

    #[inline(always)]
    unsafe fn any(&self, block: &Block<B>, ray: &Ray, all: &Triangles) -> bool {
        is_any_met(all, &block.triangles, self.test(block, ray.t_max).hits, ray)
    }
}
