//! Clusters on their way to a tree, and the search for pairs of them.

use crate::{layout::Bounds, traverse::Isa};

/// Clusters that are looked at together.
pub(super) const LANES: usize = 16;
/// Places behind the last cluster that are read: the largest radius, and a vector less one.
const FREE_BEHIND: usize = 32 + LANES;
/// Places of a stack of clusters at first; more are made where the curve is deep.
const ROOM: usize = 256;
/// Marks a link as a triangle.
pub(super) const TRIANGLE: u32 = 1 << 31;

/// A node of the tree, or a triangle of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ClusterLink(pub(super) u32);

impl ClusterLink {
    /// Its triangle, if it is one.
    pub(super) fn triangle(self) -> Option<u32> {
        (self.0 & TRIANGLE != 0).then_some(self.0 & !TRIANGLE)
    }
}

/// A cluster, but for its box.
#[derive(Clone, Copy)]
pub(super) struct Cluster {
    pub(super) link: ClusterLink,
    /// An unused place among the nodes: there is one for each cluster.
    pub(super) free: u32,
    pub(super) triangles: u32,
    /// Expected cost of the subtree, times the area of its box.
    pub(super) cost: f32,
}

/// A stack of clusters along the curve, a part's at its top; behind are [`LANES`] and a radius of places.
pub(super) struct Clusters {
    lower: [Vec<f32>; 3],
    upper: [Vec<f32>; 3],
    pub(super) rest: Vec<Cluster>,
}

impl Clusters {
    pub(super) fn new() -> Self {
        let planes = |free: f32| std::array::from_fn(|_| vec![free; ROOM]);
        // The box of a free place makes none but infinite ones.
        Self {
            lower: planes(f32::NEG_INFINITY),
            upper: planes(f32::INFINITY),
            rest: Vec::with_capacity(ROOM),
        }
    }

    pub(super) fn bounds(&self, place: usize) -> Bounds {
        let at = |planes: &[Vec<f32>; 3]| [planes[0][place], planes[1][place], planes[2][place]];
        Bounds { lower: at(&self.lower), upper: at(&self.upper) }
    }

    pub(super) fn set(&mut self, place: usize, bounds: &Bounds) {
        for axis in 0..3 {
            self.lower[axis][place] = bounds.lower[axis];
            self.upper[axis][place] = bounds.upper[axis];
        }
    }

    pub(super) fn push(&mut self, bounds: &Bounds, cluster: Cluster) {
        let place = self.rest.len();
        if place + FREE_BEHIND >= self.lower[0].len() {
            self.make_room();
        }
        self.set(place, bounds);
        self.rest.push(cluster);
    }

    #[cold]
    fn make_room(&mut self) {
        let places = 2 * self.lower[0].len();
        self.lower.iter_mut().for_each(|plane| plane.resize(places, f32::NEG_INFINITY));
        self.upper.iter_mut().for_each(|plane| plane.resize(places, f32::INFINITY));
    }

    pub(super) fn move_to(&mut self, to: usize, from: usize) {
        if to < from {
            let bounds = self.bounds(from);
            self.set(to, &bounds);
            self.rest[to] = self.rest[from];
        }
    }

    pub(super) fn truncate(&mut self, count: usize) {
        let nothing = Bounds { lower: [f32::NEG_INFINITY; 3], upper: [f32::INFINITY; 3] };
        for place in count..self.rest.len() {
            self.set(place, &nothing);
        }
        self.rest.truncate(count);
    }
}

/// For each cluster from `base` on, at most `P` less the radius, the partner at most `R` places away that
/// makes the smallest box with it. A key is the area's highest bits and the exclusive or of both places:
/// equal for both of a pair, so that of equal areas too there is always one pair whose two choose each other.
#[inline(always)]
fn nearest<const R: usize, const P: usize>(clusters: &Clusters, base: usize, best: &mut [u32; P]) {
    const { assert!(R + LANES <= FREE_BEHIND) };
    best.fill(u32::MAX);
    let mask = P.next_power_of_two() as u32 - 1;
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let most = |a: f32, b: f32| if a > b { a } else { b };
    let [lx, ly, lz] = [0, 1, 2].map(|axis| &clusters.lower[axis][base..]);
    let [ux, uy, uz] = [0, 1, 2].map(|axis| &clusters.upper[axis][base..]);
    // The compiler makes vectors of the loops over `lane`. Free places take part and come to nothing.
    for start in (0..clusters.rest.len() - base).step_by(LANES) {
        let [lx_own, ly_own, lz_own] = [lx, ly, lz].map(|planes| lanes(planes, start));
        let [ux_own, uy_own, uz_own] = [ux, uy, uz].map(|planes| lanes(planes, start));
        let mut of_start = [u32::MAX; LANES];
        for step in 1..=R {
            let other = start + step;
            let [lx_other, ly_other, lz_other] = [lx, ly, lz].map(|planes| lanes(planes, other));
            let [ux_other, uy_other, uz_other] = [ux, uy, uz].map(|planes| lanes(planes, other));
            let mut keys = [0; LANES];
            for lane in 0..LANES {
                let x = most(ux_own[lane], ux_other[lane]) - least(lx_own[lane], lx_other[lane]);
                let y = most(uy_own[lane], uy_other[lane]) - least(ly_own[lane], ly_other[lane]);
                let z = most(uz_own[lane], uz_other[lane]) - least(lz_own[lane], lz_other[lane]);
                let area = x * y + (x + y) * z;
                keys[lane] = (area.to_bits() & !mask) | ((start + lane) ^ (other + lane)) as u32;
            }
            let of_other: &mut [u32; LANES] =
                (&mut best[other..other + LANES]).try_into().expect("a slice of LANES");
            for lane in 0..LANES {
                of_start[lane] = of_start[lane].min(keys[lane]);
                of_other[lane] = of_other[lane].min(keys[lane]);
            }
        }
        for (best, own) in best[start..].iter_mut().zip(of_start) {
            *best = own.min(*best);
        }
    }
}

/// `LANES` numbers from a place on.
#[inline(always)]
fn lanes(of: &[f32], place: usize) -> &[f32; LANES] {
    of[place..].first_chunk().expect("behind the last cluster there is room")
}

pub(super) type Nearest<const P: usize> = unsafe fn(&Clusters, usize, &mut [u32; P]);

/// [`nearest`] compiled with the given processor features, which the caller has.
macro_rules! nearest {
    ($(#[$feature:meta])* $name:ident) => {
        $(#[$feature])*
        unsafe fn $name<const R: usize, const P: usize>(
            clusters: &Clusters,
            base: usize,
            best: &mut [u32; P],
        ) {
            nearest::<R, P>(clusters, base, best);
        }
    };
}

nearest!(nearest_plain);
#[cfg(all(target_arch = "x86_64", kernels_avx2))]
nearest!(
    #[target_feature(enable = "avx2")]
    nearest_avx2
);
#[cfg(all(target_arch = "x86_64", kernels_avx512))]
nearest!(
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2")]
    nearest_avx512
);

/// The fastest of them that this processor can run.
pub(super) fn select<const R: usize, const P: usize>() -> Nearest<P> {
    match Isa::detect() {
        #[cfg(all(target_arch = "x86_64", kernels_avx512))]
        Isa::Avx512 => nearest_avx512::<R, P>,
        #[cfg(all(target_arch = "x86_64", kernels_avx2))]
        Isa::Avx2 => nearest_avx2::<R, P>,
        _ => nearest_plain::<R, P>,
    }
}
