//! Error against run time: how soon each configuration's picture is as good as it must be.
//!
//! The gain of a faster structure is the time saved until a picture is good enough, build and tuning
//! included. So every contender renders progressively, and the clock is stopped while its picture is compared
//! with a converged reference. The results are errors over seconds: curves, and how much earlier than another
//! a contender reaches an error.
//!
//! | module | contents |
//! |---|---|
//! | `metrics` | error of a picture: relative squared error |
//! | `reference` | the converged picture, and its own error |
//! | `curve` | several contenders, interleaved, over several independent runs |
//! | `bootstrap` | intervals of any statistic of independent runs |
//! | `equal_error` | how much earlier one contender reaches an error than another |
//! | `results` | all results, for JSON |

pub mod bootstrap;
pub(crate) mod curve;
pub(crate) mod equal_error;
pub(crate) mod metrics;
pub(crate) mod reference;
pub(crate) mod results;

#[cfg(test)]
mod testing {
    //! A scene with mild noise, so that its errors show after few samples; and made-up results.

    use std::sync::Arc;

    use treewright_accel::BuildChoice;
    use treewright_renderer::{frame::Renderer, integrator::View, tuning::who::Who};
    use treewright_scene::{Material, builtin};

    use super::curve::{Curve, Point, Run};

    /// A run of frames of one length, with an error by samples, up to `end` of them.
    pub(super) fn run(build_ms: f64, frame_ms: f64, end: u32, error: impl Fn(f64) -> f64) -> Run {
        let point = |samples: u32| Point {
            samples,
            render_ms: frame_ms * f64::from(samples),
            relative_mse: error(f64::from(samples)),
        };
        let marks = [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 91, 128].into_iter();
        let points = marks.filter(|samples| *samples <= end).map(point).collect();
        Run { seed: 1, build_ms, points, end: point(end) }
    }

    pub(super) fn curve(who: Who, setup_ms: f64, runs: Vec<Run>) -> Curve {
        Curve { who, choice: BuildChoice::BruteForce.into(), setup_ms, runs, failure: None }
    }

    pub(super) fn matt_scene() -> (Renderer, View) {
        let options = builtin::Options { detail: 0.05, ..builtin::Options::default() };
        let mut scene = builtin::build("quick", &options).expect("it is built in");
        for material in &mut scene.materials {
            *material = Material { base_color: material.base_color, ..Material::default() };
        }
        scene.sky.sun = None;
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 1 };
        (Renderer::new(Arc::new(scene), 0).expect("it starts"), view)
    }
}
