//! Shading many hits at once, stage by stage: the common cases, as loops over columns that the compiler turns
//! into vector instructions.
//!
//! A chunk gathers hits on matt surfaces and on rough, opaque layers, in two runs of lanes, one from either
//! end (compare Lee et al., Vectorized Production Path Tracing, HPG 2017). Rare cases go through
//! [`Kernel::vertex`](super::vertex::Kernel) as in the path-by-path way. Both give equal bits. The loops are
//! compiled for each instruction set ([`Isa::run`]).

mod columns;
mod passes;

use treewright_accel::{Hit, Isa, Ray};

use columns::{
    Arrivals, Column, Departures, Facets, LANES, Lamps, LightSamples, Materials, Numbers, Surfaces, Zero,
    columns,
};
use passes::Passes;

use super::prepared::{Prepared, Shading};
use super::vertex::{Next, Path, Shadow, Tracing};
use super::{Needs, places, surface::WorldFacet};

pub(super) const HITS: usize = LANES;

/// Up to [`HITS`] hits.
#[derive(Debug)]
pub(super) struct Chunk {
    isa: Isa,
    /// Hits on matt surfaces, from the first lane on.
    matt: usize,
    /// Hits on rough layers, from the last lane back.
    glossy: usize,
    columns: Box<Columns>,
}

columns! {
    #[derive(Debug)]
    struct Columns {
        arrivals: Arrivals,
        facets: Facets,
        materials: Materials,
        surfaces: Surfaces,
        /// 1 where the triangle is too small or too large.
        odd: Column<u32>,
        numbers: Numbers,
        lamps: Lamps,
        sampled: LightSamples,
        /// 1 where the sampled light can light the surface.
        lit: Column<u32>,
        departures: Departures,
    }
}

impl Default for Chunk {
    fn default() -> Self {
        Self { isa: Isa::detect(), matt: 0, glossy: 0, columns: Box::new(Columns::ZERO) }
    }
}

impl Chunk {
    pub(super) fn clear(&mut self) {
        (self.matt, self.glossy) = (0, 0);
    }

    /// Takes a hit if it is of a common kind: the lane it has. At most [`HITS`] between two [`Chunk::clear`].
    #[inline(always)]
    pub(super) fn gather(
        &mut self,
        needs: Needs,
        tracing: &Tracing,
        (path, ray, hit): (&Path, &Ray, &Hit),
        (standing, shading): (&WorldFacet, &Shading),
    ) -> Option<usize> {
        if shading.glows || shading.solid || (needs.lamps && tracing.is_last_ray(path)) {
            return None;
        }
        let lane = if !needs.layers || shading.bsdf.is_matt() {
            let lane = self.matt;
            self.columns.materials.diffuse.set(lane, shading.bsdf.diffuse());
            self.matt += 1;
            lane
        } else {
            let gloss = shading.bsdf.gloss()?;
            self.glossy += 1;
            let lane = LANES - self.glossy;
            self.columns.materials.set(lane, &gloss);
            if needs.metals {
                self.columns.materials.set_multiple(lane, gloss.multiple);
            }
            lane
        };
        let Columns { arrivals, facets, .. } = &mut *self.columns;
        facets.set(lane, standing);
        if needs.smooth {
            facets.set_normals(lane, standing);
        }
        arrivals.origin.set(lane, ray.origin);
        arrivals.direction.set(lane, ray.direction);
        arrivals.weights[0][lane] = hit.u;
        arrivals.weights[1][lane] = hit.v;
        arrivals.throughput.set(lane, path.throughput);
        arrivals.random[lane] = path.random;
        let place = places::of_vertex(path.vertex);
        arrivals.place[lane] = place;
        arrivals.last[lane] = (u32::from(path.bounce) == tracing.bounces).into();
        arrivals.follow[lane] = tracing.follow(path, place);
        Some(lane)
    }

    pub(super) fn shade(&mut self, prepared: &Prepared, needs: Needs) {
        self.isa.run(Passes { lights: &prepared.lights, needs, chunk: self });
    }

    /// The result of the hit in a lane; `None` if the common way does not suit it.
    #[inline(always)]
    pub(super) fn scatter(
        &self,
        lane: usize,
        path: &mut Path,
        ray: &mut Ray,
        shadow: &mut Shadow,
    ) -> Option<Next> {
        let Columns { surfaces, departures, odd, .. } = &*self.columns;
        if odd[lane] != 0 {
            return None;
        }
        let next = Next { shadow: departures.shadow[lane] != 0, goes_on: departures.goes_on[lane] != 0 };
        if next.shadow {
            *shadow = Shadow {
                ray: Ray {
                    origin: departures.shadow_origin.get(lane),
                    direction: departures.shadow_direction.get(lane),
                    t_min: 0.0,
                    t_max: departures.shadow_t_max[lane],
                },
                light: departures.light.get(lane),
            };
        }
        if next.goes_on {
            path.vertex += 1;
            path.bounce += 1;
            path.sheets = 0;
            path.throughput = departures.throughput.get(lane);
            path.pdf = departures.pdf[lane];
            path.from = surfaces.position.get(lane);
            *ray = Ray {
                origin: departures.origin.get(lane),
                direction: departures.direction.get(lane),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
        }
        Some(next)
    }
}
