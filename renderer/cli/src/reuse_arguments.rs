//! The argument that says how many frames a tree serves.

use clap::Args;
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::reuse::FRAMES_PER_BUILD_MAX;

/// How many frames a tree serves.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct ReuseArguments {
    /// With `--objective auto`: how many frames a tree serves, 1 to 1024. It is a part of the state, so what
    /// is learnt for 16 frames helps at 64.
    #[arg(long, value_name = "N", default_value_t = 16, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_PER_BUILD_MAX)))]
    frames_per_build: u32,
}

impl ReuseArguments {
    /// An objective with its number of frames.
    pub(crate) fn of(self, objective: Objective) -> Objective {
        match objective {
            Objective::Auto(_) => Objective::Auto(self.frames_per_build),
            other => other,
        }
    }

    /// What the service is told of it.
    pub(crate) fn told(self, objective: Objective) -> Option<u32> {
        matches!(objective, Objective::Auto(_)).then_some(self.frames_per_build)
    }
}
