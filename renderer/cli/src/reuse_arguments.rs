//! The argument for the number of frames that a tree serves.

use clap::Args;
use treewright_renderer::{tuning::objective::Objective, tuning::reuse::FRAMES_PER_BUILD_MAX};

use crate::error::{CliError, Result};

/// Where none is given.
const FRAMES_PER_BUILD: u32 = 16;

/// How many frames a tree serves.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct ReuseArguments {
    /// With `--objective auto`: how many frames a tree serves, 1 to 1024. It is a part of the state, so what
    /// is learnt for 16 frames helps at 64. Default: 16.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_PER_BUILD_MAX)))]
    frames_per_build: Option<u32>,
}

impl ReuseArguments {
    /// An objective with its number of frames.
    ///
    /// # Errors
    /// A number of frames was given for another objective than `auto`.
    pub(crate) fn of(self, objective: Objective) -> Result<Objective> {
        match (objective, self.frames_per_build) {
            (Objective::Auto(_), frames) => Ok(Objective::Auto(frames.unwrap_or(FRAMES_PER_BUILD))),
            (other, None) => Ok(other),
            (other, Some(_)) => Err(CliError::Usage(format!(
                "--frames-per-build goes with --objective auto; {} has a number of its own",
                other.name()
            ))),
        }
    }
}
