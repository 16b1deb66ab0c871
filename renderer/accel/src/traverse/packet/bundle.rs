//! Sixteen rays side by side, number by number, and their hits.

use super::PACKET;
use crate::geometry::{Hit, NO_INSTANCE, NO_TRIANGLE, Ray};
use crate::traverse::lanes::{Lanes, Lanes3, Stored};

/// Sixteen rays; where they end is kept with their hits.
pub(crate) struct Bundle {
    pub(crate) origin: [Stored; 3],
    pub(crate) direction: [Stored; 3],
    pub(crate) t_min: Stored,
}

/// The lanes of the first `count` rays.
#[inline(always)]
pub(crate) fn lanes_of(count: usize) -> u32 {
    (1 << count) - 1
}

/// Calls `each` with the number of every lane whose bit is set.
#[inline(always)]
pub(crate) fn each_lane(mut lanes: u32, mut each: impl FnMut(usize)) {
    while lanes != 0 {
        each(lanes.trailing_zeros() as usize);
        lanes &= lanes - 1;
    }
}

impl Bundle {
    /// At most sixteen rays; lanes left over have rays without a direction.
    #[inline(always)]
    pub(crate) fn new(rays: &[Ray]) -> Self {
        let mut bundle = Self {
            origin: [Stored([0.0; PACKET]); 3],
            direction: [Stored([0.0; PACKET]); 3],
            t_min: Stored([0.0; PACKET]),
        };
        for (lane, ray) in rays.iter().enumerate().take(PACKET) {
            for axis in 0..3 {
                bundle.origin[axis].0[lane] = ray.origin[axis];
                bundle.direction[axis].0[lane] = ray.direction[axis];
            }
            bundle.t_min.0[lane] = ray.t_min;
        }
        bundle
    }

    #[inline(always)]
    pub(crate) fn ray(&self, lane: usize, t_max: f32) -> Ray {
        let of = |numbers: &[Stored; 3]| {
            glam::Vec3::new(numbers[0].0[lane], numbers[1].0[lane], numbers[2].0[lane])
        };
        Ray { origin: of(&self.origin), direction: of(&self.direction), t_min: self.t_min.0[lane], t_max }
    }

    /// Origins.
    ///
    /// # Safety
    /// As for [`Lanes`], here and below; `L` has sixteen lanes.
    #[inline(always)]
    pub(crate) unsafe fn origins<L: Lanes>(&self) -> Lanes3<L> {
        debug_assert!(L::COUNT == PACKET);
        let [x, y, z] = &self.origin;
        Lanes3([L::load(x.0.as_ptr()), L::load(y.0.as_ptr()), L::load(z.0.as_ptr())])
    }

    #[inline(always)]
    pub(crate) unsafe fn directions<L: Lanes>(&self) -> Lanes3<L> {
        let [x, y, z] = &self.direction;
        Lanes3([L::load(x.0.as_ptr()), L::load(y.0.as_ptr()), L::load(z.0.as_ptr())])
    }

    #[inline(always)]
    pub(crate) unsafe fn t_min<L: Lanes>(&self) -> L {
        L::load(self.t_min.0.as_ptr())
    }

    /// Which rays are valid in the sense of [`Ray::is_valid`], if they end there.
    #[inline(always)]
    pub(crate) unsafe fn valid<L: Lanes>(&self, t_max: L) -> u32 {
        let zero = L::splat(0.0);
        let ([ox, oy, oz], [dx, dy, dz]) = (self.origins::<L>().0, self.directions::<L>().0);
        // Zero times a number is zero; times infinity or NaN it is NaN, which fails the comparison.
        let origin = ox.mul(zero).add(oy.mul(zero)).add(oz.mul(zero));
        let sum = origin.add(dx.mul(zero)).add(dy.mul(zero)).add(dz.mul(zero));
        let t_min = self.t_min::<L>();
        let between = L::and(zero.less_equal(t_min), t_min.less_equal(t_max));
        L::bits(L::and(sum.equal(zero), between))
    }

    /// These rays, with that of `lane` in place of those that are not in `group`.
    #[inline(always)]
    pub(crate) unsafe fn filled<L: Lanes>(&self, group: u32, lane: usize) -> Self {
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.origin, &self.direction);
        Self {
            origin: [
                filled::<L>(ox, group, lane),
                filled::<L>(oy, group, lane),
                filled::<L>(oz, group, lane),
            ],
            direction: [
                filled::<L>(dx, group, lane),
                filled::<L>(dy, group, lane),
                filled::<L>(dz, group, lane),
            ],
            t_min: filled::<L>(&self.t_min, group, lane),
        }
    }

    /// The rays in another space, by the operations of [`crate::traverse::placed::moved`] in their order.
    #[inline(always)]
    pub(crate) unsafe fn moved<L: Lanes>(&self, rows: &[[f32; 4]; 3]) -> Self {
        let (origins, directions) = (self.origins::<L>(), self.directions::<L>());
        let [x, y, z] = rows;
        Self {
            origin: [placed(x, &origins), placed(y, &origins), placed(z, &origins)],
            direction: [
                Stored::from(turned(x, &directions)),
                Stored::from(turned(y, &directions)),
                Stored::from(turned(z, &directions)),
            ],
            t_min: self.t_min,
        }
    }
}

#[inline(always)]
unsafe fn filled<L: Lanes>(numbers: &Stored, group: u32, lane: usize) -> Stored {
    Stored::from(L::choose(group, L::load(numbers.0.as_ptr()), L::splat(numbers.0[lane])))
}

/// A row's factors times vectors.
#[inline(always)]
unsafe fn turned<L: Lanes>(row: &[f32; 4], of: &Lanes3<L>) -> L {
    let [x, y, z] = of.0;
    x.mul(L::splat(row[0])).add(y.mul(L::splat(row[1]))).add(z.mul(L::splat(row[2])))
}

/// Transforms points.
#[inline(always)]
unsafe fn placed<L: Lanes>(row: &[f32; 4], of: &Lanes3<L>) -> Stored {
    Stored::from(turned(row, of).add(L::splat(row[3])))
}

/// The hits so far, one a ray, and where the rays end.
pub(crate) struct Hits {
    pub(crate) t: Stored,
    pub(crate) u: Stored,
    pub(crate) v: Stored,
    pub(crate) triangles: [u32; PACKET],
    pub(crate) instances: [u32; PACKET],
}

impl Hits {
    /// None yet; lanes left over end before they begin.
    #[inline(always)]
    pub(crate) fn new(rays: &[Ray]) -> Self {
        let mut t = Stored([-1.0; PACKET]);
        for (t, ray) in t.0.iter_mut().zip(rays) {
            *t = ray.t_max;
        }
        Self {
            t,
            u: Stored([0.0; PACKET]),
            v: Stored([0.0; PACKET]),
            triangles: [NO_TRIANGLE; PACKET],
            instances: [NO_INSTANCE; PACKET],
        }
    }

    /// Where the rays end.
    ///
    /// # Safety
    /// As for [`Lanes`]; `L` has sixteen lanes.
    #[inline(always)]
    pub(crate) unsafe fn ends<L: Lanes>(&self) -> L {
        L::load(self.t.0.as_ptr())
    }

    #[inline(always)]
    pub(crate) fn of(&self, lane: usize) -> Hit {
        let (t, u, v, triangle) = (self.t.0[lane], self.u.0[lane], self.v.0[lane], self.triangles[lane]);
        Hit { t, u, v, triangle, instance: self.instances[lane] }
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, hit: &Hit) {
        (self.t.0[lane], self.u.0[lane], self.v.0[lane]) = (hit.t, hit.u, hit.v);
        (self.triangles[lane], self.instances[lane]) = (hit.triangle, hit.instance);
    }
}

/// The latest end of the rays of a group. The bits of numbers not below zero order like the numbers.
///
/// # Safety
/// As for [`Lanes`]; `L` has sixteen lanes.
#[inline(always)]
pub(crate) unsafe fn farthest<L: Lanes>(group: u32, ends: L) -> f32 {
    let bits = Stored::from(L::choose(group, ends, L::splat(0.0))).0.map(|t| t.to_bits() as i32);
    f32::from_bits(bits.into_iter().fold(0, i32::max) as u32)
}
