//! All results of a comparison, for JSON.

use serde::Serialize;
use treewright_client::{Configuration, Fingerprint};

use super::bootstrap::{Interval, mean_of};
use super::curve::{Curve, Entrant, Run};
use super::equal_error::EqualError;
use treewright_renderer::tuning::results::SceneFacts;

#[derive(Clone, Debug, Serialize)]
pub(crate) struct ComparisonResults {
    pub(crate) scene: SceneFacts,
    /// Pixels across and down.
    pub(crate) size: [u32; 2],
    pub(crate) bounces: u32,
    pub(crate) machine: Fingerprint,
    /// Version of Embree: major, minor, patch.
    pub(crate) embree: (u32, u32, u32),
    /// Time for building and rendering that each contender got in each run.
    pub(crate) budget_ms: f64,
    pub(crate) reference: ReferenceFacts,
    pub(crate) contenders: Vec<ContenderResult>,
    pub(crate) equal_error: Vec<EqualError>,
}

/// The picture that errors are measured against.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ReferenceFacts {
    /// Samples a pixel.
    pub(crate) samples: u32,
    /// SHA-256 of the geometry of the scene it shows.
    pub(crate) scene_hash: String,
    /// Its own relative mean squared error, estimated from its halves. It is part of every error.
    pub(crate) relative_mse: f64,
    /// Errors below this are not trusted.
    pub(crate) trusted_from: f64,
}

/// One contender; figures are means over its runs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ContenderResult {
    #[serde(flatten)]
    pub(crate) curve: Curve,
    /// Where it has one of a tuning space.
    pub(crate) configuration: Option<Configuration>,
    /// See [`Entrant::origin`].
    pub(crate) origin: String,
    pub(crate) build_ms: Option<Interval>,
    /// Of one sample a pixel.
    pub(crate) frame_ms: Option<Interval>,
    /// When the time was up.
    pub(crate) samples: Option<Interval>,
    /// When the time was up.
    pub(crate) relative_mse: Option<Interval>,
}

impl ContenderResult {
    pub(crate) fn new(curve: Curve, entrant: Entrant) -> Self {
        let mean = |value: &dyn Fn(&Run) -> f64| mean_of(&curve.runs.iter().map(value).collect::<Vec<_>>());
        Self {
            build_ms: mean(&|run| run.build_ms),
            frame_ms: mean(&|run| run.end.render_ms / f64::from(run.end.samples)),
            samples: mean(&|run| f64::from(run.end.samples)),
            relative_mse: mean(&|run| run.end.relative_mse),
            curve,
            configuration: entrant.rival.configuration,
            origin: entrant.origin,
        }
    }
}
