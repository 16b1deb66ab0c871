//! Options of light sampling. Every choice gives pictures of equal expectation; time and noise differ.

use serde::{Deserialize, Serialize};

/// Options of light sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightSampling {
    /// Points on lamps, of which one is chosen by the light that it would bring: 1 to 16.
    pub candidates: u32,
    /// How these points are drawn.
    pub lamps: LampChoice,
    /// Factor on a sampled lamp's weight against a bounce's, 1 and more, for the choice of candidates.
    pub lamp_weight: f32,
    /// The sampling of the sky.
    pub sky: SkyChoice,
    /// Shadow rays for less than this share of the mean are rarer, and brighter; 0 traces all.
    pub shadow_roulette: f32,
    /// A path of less throughput, relative to that after its first vertex, goes on with a lower probability,
    /// brighter if it does; 0 ends none.
    pub path_roulette: f32,
}

/// The draw of lamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LampChoice {
    /// By power.
    #[default]
    Plain,
    /// Also by which of them were found to light the place in a few frames before.
    Learnt,
}

/// The sampling of the sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SkyChoice {
    /// By the surfaces' own sampling; an environment map also by its brightness.
    #[default]
    Plain,
    /// Also by where it was seen from in a few frames before, as through windows. Shadow rays are shared out
    /// among the kinds of light by how much each would lessen the variance there.
    Learnt,
}

impl LightSampling {
    /// Whether it needs pilot frames.
    pub fn learns(&self) -> bool {
        self.sky == SkyChoice::Learnt || self.lamps == LampChoice::Learnt || self.shadow_roulette > 0.0
    }
}

/// The times of learning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LearningTimes {
    /// Of the pilot frames, and of what is learnt of the sky.
    pub frames_ms: f64,
    /// Of trying lamps, after the frames.
    pub lamps_ms: f64,
}

impl LearningTimes {
    /// The time that sampling light in this way pays for, in milliseconds.
    pub fn of(&self, how: &LightSampling) -> f64 {
        let frames_ms = if how.learns() { self.frames_ms } else { 0.0 };
        frames_ms + if how.lamps == LampChoice::Learnt { self.lamps_ms } else { 0.0 }
    }
}

impl Default for LightSampling {
    fn default() -> Self {
        Self {
            candidates: 2,
            lamps: LampChoice::Plain,
            lamp_weight: 1.0,
            sky: SkyChoice::Plain,
            shadow_roulette: 0.0,
            path_roulette: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_pays_for_what_it_learns() {
        let times = LearningTimes { frames_ms: 100.0, lamps_ms: 10.0 };
        let plain = LightSampling::default();
        assert_eq!(times.of(&plain), 0.0);
        assert_eq!(times.of(&LightSampling { sky: SkyChoice::Learnt, ..plain }), 100.0);
        assert_eq!(times.of(&LightSampling { shadow_roulette: 0.1, ..plain }), 100.0);
        assert_eq!(times.of(&LightSampling { lamps: LampChoice::Learnt, ..plain }), 110.0);
    }

    #[test]
    fn a_way_that_was_recorded_with_first_shadow_rays_is_read() {
        let recorded = r#"{"candidates":4,"first_shadow_rays":1,"path_roulette":0.5}"#;
        let read: LightSampling = serde_json::from_str(recorded).expect("it is one");
        assert_eq!(read, LightSampling { candidates: 4, path_roulette: 0.5, ..LightSampling::default() });
    }
}
