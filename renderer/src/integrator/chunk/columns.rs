//! A chunk of hits as columns: one array a number, so that a loop over them becomes vector instructions.
//!
//! Each group of columns has a `get` and a `set` with the type the scalar code knows, so that a pass reads
//! like it.

use glam::Vec3;

use crate::integrator::LightSample;
use crate::integrator::bsdf::Gloss;
use crate::integrator::lamp::Lamp;
use crate::integrator::multiple::{Losses, Multiple};
use crate::integrator::random::PathRandom;
use crate::integrator::surface::{Surface, WorldFacet};

/// Hits of a chunk: the columns stay in the first-level cache, and the cost of a pass is spread wide enough.
pub(super) const LANES: usize = 64;

/// A number of each hit.
pub(super) type Column<T = f32> = [T; LANES];

/// What columns hold before anything was set.
pub(super) trait Zero {
    const ZERO: Self;
}

impl Zero for f32 {
    const ZERO: Self = 0.0;
}

impl Zero for u32 {
    const ZERO: Self = 0;
}

impl Zero for PathRandom {
    const ZERO: Self = Self::NONE;
}

impl<T: Zero + Copy, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

/// Groups of columns, which begin with zeros.
macro_rules! columns {
    ($($(#[$about:meta])* $seen:vis struct $name:ident {
        $($(#[$of_field:meta])* $field_seen:vis $field:ident: $kind:ty,)*
    })*) => {$(
        $(#[$about])*
        $seen struct $name {
            $($(#[$of_field])* $field_seen $field: $kind,)*
        }

        impl Zero for $name {
            const ZERO: Self = Self { $($field: Zero::ZERO,)* };
        }
    )*};
}

pub(super) use columns;

columns! {
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Vectors {
        x: Column,
        y: Column,
        z: Column,
    }

    /// Triangles, as they stand in the world.
    #[derive(Clone, Debug)]
    pub(super) struct Facets {
        corner: Vectors,
        edges: [Vectors; 2],
        pub(super) longest: Column,
        pub(super) place: Column,
        normals: [Vectors; 3],
        /// 1 where normals are interpolated.
        pub(super) smooth: Column<u32>,
    }

    #[derive(Clone, Debug)]
    pub(super) struct Surfaces {
        pub(super) position: Vectors,
        pub(super) geometric_normal: Vectors,
        pub(super) shading_normal: Vectors,
        pub(super) offset: Column,
    }

    /// The materials of surfaces: one column for matt ones, the last ones where there are metals.
    #[derive(Clone, Debug)]
    pub(super) struct Materials {
        pub(super) diffuse: Vectors,
        outward: Vectors,
        f0: Vectors,
        f90: Column,
        layer_f90: Vectors,
        alpha: Column,
        multiple: Vectors,
        multiple_scale: Column,
        losses: [Column; 4],
    }

    #[derive(Clone, Debug)]
    pub(super) struct Lamps {
        corner: Vectors,
        edges: [Vectors; 2],
        normal: Vectors,
        emission: Vectors,
        density: Column,
    }

    #[derive(Clone, Debug)]
    pub(super) struct LightSamples {
        direction: Vectors,
        distance: Column,
        radiance: Vectors,
        pdf: Column,
    }

    /// The paths that arrive: their rays, and the values that they carry.
    #[derive(Clone, Debug)]
    pub(super) struct Arrivals {
        pub(super) origin: Vectors,
        pub(super) direction: Vectors,
        /// The weights that the accelerator gave, for rays in the plane of their triangle.
        pub(super) weights: [Column; 2],
        pub(super) throughput: Vectors,
        pub(super) random: Column<PathRandom>,
        /// Where the vertex's random numbers begin.
        pub(super) place: Column<u32>,
        /// 1 where no bounce is left.
        pub(super) last: Column<u32>,
        /// The factor on the light of the ray that follows, 0 where none does.
        pub(super) follow: Column,
    }

    /// The random numbers of a vertex, by their places.
    #[derive(Clone, Debug)]
    pub(super) struct Numbers {
        pub(super) pick: [Column; 2],
        pub(super) light: [Column; 2],
        pub(super) choice: Column,
        pub(super) turn: [Column; 2],
    }

    /// The requests of vertices: a shadow ray, and the next ray of the path.
    #[derive(Clone, Debug)]
    pub(super) struct Departures {
        /// 1 where there is a shadow ray.
        pub(super) shadow: Column<u32>,
        pub(super) shadow_origin: Vectors,
        pub(super) shadow_direction: Vectors,
        pub(super) shadow_t_max: Column,
        pub(super) light: Vectors,
        /// 1 where the path goes on.
        pub(super) goes_on: Column<u32>,
        pub(super) origin: Vectors,
        pub(super) direction: Vectors,
        pub(super) throughput: Vectors,
        pub(super) pdf: Column,
    }
}

impl Vectors {
    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, vector: Vec3) {
        self.x[lane] = vector.x;
        self.y[lane] = vector.y;
        self.z[lane] = vector.z;
    }
}

impl Facets {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, standing: &WorldFacet) {
        let [corner, ab, ac] = standing.corner_and_edges;
        self.corner.set(lane, corner);
        self.edges[0].set(lane, ab);
        self.edges[1].set(lane, ac);
        self.longest[lane] = standing.longest;
        self.place[lane] = standing.place;
    }

    #[inline(always)]
    pub(super) fn set_normals(&mut self, lane: usize, standing: &WorldFacet) {
        for (column, normal) in self.normals.iter_mut().zip(standing.normals) {
            column.set(lane, normal);
        }
        self.smooth[lane] = standing.is_smooth.into();
    }

    #[inline(always)]
    pub(super) fn corner_and_edges(&self, lane: usize) -> [Vec3; 3] {
        [self.corner.get(lane), self.edges[0].get(lane), self.edges[1].get(lane)]
    }

    #[inline(always)]
    pub(super) fn normals(&self, lane: usize) -> [Vec3; 3] {
        [self.normals[0].get(lane), self.normals[1].get(lane), self.normals[2].get(lane)]
    }
}

impl Surfaces {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, surface: &Surface) {
        self.position.set(lane, surface.position);
        self.geometric_normal.set(lane, surface.geometric_normal);
        self.shading_normal.set(lane, surface.shading_normal);
        self.offset[lane] = surface.offset;
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> Surface {
        Surface {
            position: self.position.get(lane),
            geometric_normal: self.geometric_normal.get(lane),
            shading_normal: self.shading_normal.get(lane),
            offset: self.offset[lane],
        }
    }
}

impl Materials {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, gloss: &Gloss) {
        self.diffuse.set(lane, gloss.diffuse);
        self.outward.set(lane, gloss.outward);
        self.f0.set(lane, gloss.f0);
        self.f90[lane] = gloss.f90;
        self.layer_f90.set(lane, gloss.layer_f90);
        self.alpha[lane] = gloss.alpha;
    }

    /// The additional lobe of rough metals, nothing for any other surface.
    #[inline(always)]
    pub(super) fn set_multiple(&mut self, lane: usize, multiple: Option<Multiple>) {
        let Multiple { albedo, scale, losses } = multiple.unwrap_or(Multiple::NONE);
        self.multiple.set(lane, albedo);
        self.multiple_scale[lane] = scale;
        for (column, coefficient) in self.losses.iter_mut().zip(losses.0) {
            column[lane] = coefficient;
        }
    }

    #[inline(always)]
    pub(super) fn get<const METALS: bool>(&self, lane: usize) -> Gloss {
        Gloss {
            diffuse: self.diffuse.get(lane),
            outward: self.outward.get(lane),
            f0: self.f0.get(lane),
            f90: self.f90[lane],
            layer_f90: self.layer_f90.get(lane),
            alpha: self.alpha[lane],
            multiple: METALS.then(|| Multiple {
                albedo: self.multiple.get(lane),
                scale: self.multiple_scale[lane],
                losses: Losses([0, 1, 2, 3].map(|power: usize| self.losses[power][lane])),
            }),
        }
    }
}

impl Lamps {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, lamp: &Lamp) {
        self.corner.set(lane, lamp.corner);
        self.edges[0].set(lane, lamp.edges[0]);
        self.edges[1].set(lane, lamp.edges[1]);
        self.normal.set(lane, lamp.normal);
        self.emission.set(lane, lamp.emission);
        self.density[lane] = lamp.density;
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> Lamp {
        Lamp {
            corner: self.corner.get(lane),
            edges: [self.edges[0].get(lane), self.edges[1].get(lane)],
            normal: self.normal.get(lane),
            emission: self.emission.get(lane),
            density: self.density[lane],
        }
    }
}

impl LightSamples {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, light: &LightSample) {
        self.direction.set(lane, light.direction);
        self.distance[lane] = light.distance;
        self.radiance.set(lane, light.radiance);
        self.pdf[lane] = light.pdf;
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> LightSample {
        LightSample {
            direction: self.direction.get(lane),
            distance: self.distance[lane],
            radiance: self.radiance.get(lane),
            pdf: self.pdf[lane],
        }
    }
}
