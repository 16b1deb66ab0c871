//! All results of a comparison, for JSON.

use serde::Serialize;
use treewright_client::{Configuration, Fingerprint};

use super::bootstrap::{Interval, mean_of};
use super::curve::{Curve, Run};
use super::equal_error::EqualError;
use treewright_renderer::tuning::results::SceneFacts;

/// A finished comparison.
#[derive(Clone, Debug, Serialize)]
pub struct ComparisonResults {
    /// The rendered scene.
    pub scene: SceneFacts,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Most bounces of a path.
    pub bounces: u32,
    /// The machine.
    pub machine: Fingerprint,
    /// Version of Embree: major, minor, patch.
    pub embree: (u32, u32, u32),
    /// Time for building and rendering that each contender got in each run.
    pub budget_ms: f64,
    /// The picture that errors are measured against.
    pub reference: ReferenceFacts,
    /// The contenders.
    pub contenders: Vec<ContenderResult>,
    /// Times of contenders to equal errors.
    pub equal_error: Vec<EqualError>,
}

/// The description of a reference for people.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceFacts {
    /// Samples a pixel.
    pub samples: u32,
    /// SHA-256 of the geometry of the scene it shows.
    pub scene_hash: String,
    /// Its own relative mean squared error, estimated from its halves. It is part of every error.
    pub relative_mse: f64,
    /// Errors below this are not trusted.
    pub trusted_from: f64,
}

/// The results of one contender.
#[derive(Clone, Debug, Serialize)]
pub struct ContenderResult {
    /// Its measurements.
    #[serde(flatten)]
    pub curve: Curve,
    /// Its configuration, where it has one of a tuning space.
    pub configuration: Option<Configuration>,
    /// Where the configuration comes from, in words.
    pub origin: String,
    /// Building; mean over runs.
    pub build_ms: Option<Interval>,
    /// One sample a pixel; mean over runs.
    pub frame_ms: Option<Interval>,
    /// Samples when the time was up; mean over runs.
    pub samples: Option<Interval>,
    /// Relative error when the time was up; mean over runs.
    pub relative_mse: Option<Interval>,
}

impl ContenderResult {
    /// Evaluates a curve.
    pub fn new(curve: Curve, configuration: Option<Configuration>, origin: String) -> Self {
        let mean = |value: &dyn Fn(&Run) -> f64| mean_of(&curve.runs.iter().map(value).collect::<Vec<_>>());
        Self {
            build_ms: mean(&|run| run.build_ms),
            frame_ms: mean(&|run| run.end.render_ms / f64::from(run.end.samples)),
            samples: mean(&|run| f64::from(run.end.samples)),
            relative_mse: mean(&|run| run.end.relative_mse),
            curve,
            configuration,
            origin,
        }
    }
}
