//! The space of light sampling, with the recommended tree.
//!
//! All choices give pictures of equal expectation; the objective is the time to an error. A scene has the
//! parameters of the lights that it has: a study for each set of kinds. The default is a way that served
//! fifteen scenes well (docs/measurements/light-sampling.md), with the map's own sampling under a map.

use serde::{Deserialize, Serialize};
use treewright_scene::Scene;

use super::Premises;
use super::explained::{Explained, choice};
use crate::integrator::Lights;

/// Which kinds of light a scene has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LightKinds {
    /// Emissive triangles, more than one lamp of them.
    pub lamps: bool,
    /// A sky that is not black: a gradient or a map.
    pub sky: bool,
    /// The sky is a map, whose bright places are drawn without learning.
    pub map: bool,
}

impl LightKinds {
    /// All that can be together, under a gradient.
    pub const ALL: Self = Self { lamps: true, sky: true, map: false };

    /// The kinds of light of a scene.
    pub fn of(scene: &Scene) -> Self {
        let lights = Lights::new(scene);
        let gradient = scene.sky.horizon.max_element().max(scene.sky.zenith.max_element()) > 0.0;
        Self {
            lamps: lights.triangle_count() > 2,
            sky: scene.environment.is_some() || gradient,
            map: scene.environment.is_some(),
        }
    }

    /// The mark that distinguishes the space of these kinds from others, e.g. `-lamps-sky`.
    pub(super) fn mark(self) -> String {
        let kinds = [(self.lamps, "-lamps"), (self.sky && !self.map, "-sky"), (self.map, "-map")];
        kinds.into_iter().filter(|(is_there, _)| *is_there).map(|(_, mark)| mark).collect()
    }
}

pub(super) fn parameters(premises: &Premises) -> Vec<Explained> {
    let LightKinds { lamps, sky, map } = premises.lights;
    let mut all = Vec::new();
    if lamps {
        all.extend([
            choice(
                "candidates",
                [1, 2, 4, 8, 16],
                2,
                "among how many points on lamps one is chosen by what it would bring",
            ),
            choice(
                "lamps",
                ["plain", "learnt"],
                "plain",
                "how these points are drawn: by power, or also by which lamps lit the place in a few frames before",
            ),
            choice(
                "lamp_weight",
                [1.0, 2.0, 4.0, 8.0, 16.0, 64.0],
                1.0,
                "how much a lamp that is drawn counts against one that a bounce finds",
            ),
        ]);
    }
    if sky {
        all.push(choice(
            "sky",
            ["plain", "learnt"],
            if map { "plain" } else { "learnt" },
            "how the sky is found: by bounces and its map, or also by a few frames before, which share out all shadow rays",
        ));
    }
    all.extend([
        choice(
            "shadow_roulette",
            [0.0, 0.03, 0.1, 0.2, 0.4],
            0.2,
            "shadow rays for less than this share of the picture's mean light are traced now and then",
        ),
        choice(
            "path_roulette",
            [0.0, 0.1, 0.2, 0.3, 0.5, 0.8],
            0.5,
            "paths that carry less than this share of what they did after their first hit go on now and then",
        ),
    ]);
    all
}
