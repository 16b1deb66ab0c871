//! Options of light sampling. Every choice gives pictures of the same expectation; time and noise differ.

use serde::{Deserialize, Serialize};

/// Options of light sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightSampling {
    /// Points on lamps drawn by power, of which one is chosen by the light that it would bring: 1 to 16.
    pub candidates: u32,
    /// Factor on the weight of a sampled lamp, against one that a bounce finds, over that of its density by
    /// power: 1 and more. It accounts for the choice among lamps, which is better than by power alone.
    pub lamp_weight: f32,
    /// Share of shadow rays that turn to the sun where there are lamps, too: 0.05 to 0.95.
    pub sun_share: f32,
    /// The sampling of the sky.
    pub sky: SkyChoice,
    /// Share of shadow rays that turn to the sky where it is sampled and there are other lights: 0.05 to
    /// 0.95.
    pub sky_share: f32,
    /// Whether shadow rays are divided by the shares learnt with the sky, instead of the two constants.
    pub learnt_shares: bool,
    /// A shadow ray for less light than this share of the picture's mean is traced with a lower probability,
    /// and brings more if it is; 0 to trace them all.
    pub shadow_roulette: f32,
    /// A path whose throughput is below this goes on with a lower probability, and brings more light if it
    /// does; 0 to end none.
    pub path_roulette: f32,
}

/// The sampling of the sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SkyChoice {
    /// By the surfaces' own sampling; an environment map also by its brightness.
    #[default]
    Plain,
    /// Also by where it was seen from in a few frames before, as through windows.
    Learnt,
}

impl LightSampling {
    /// Whether it needs pilot frames.
    pub fn learns(&self) -> bool {
        self.sky == SkyChoice::Learnt || self.shadow_roulette > 0.0
    }
}

impl Default for LightSampling {
    fn default() -> Self {
        Self {
            candidates: 2,
            lamp_weight: 1.0,
            sun_share: 0.5,
            sky: SkyChoice::Plain,
            sky_share: 0.5,
            learnt_shares: false,
            shadow_roulette: 0.0,
            path_roulette: 0.0,
        }
    }
}
