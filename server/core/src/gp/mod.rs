//! Gaussian processes: one regression, and the tools of a search with it.
//!
//! Two parts of the core model cost by a Gaussian process: the model-based search inside one state
//! (`search::model`) and the contextual predictor across states (`predict::contextual`). Both use this
//! module. Its inputs are features, values and random numbers, not studies, trials or configurations:
//! - [`kernel`]: the covariance of two points whose features are numbers, categories or a linear term;
//! - [`sample`]: the points that a process is fitted to;
//! - [`hyper`]: lengths and noise, their prior, and one step of learning them;
//! - [`likelihood`]: the gradient that such a step follows;
//! - [`regression`]: the fitted process, its mean and its deviation;
//! - [`warping`]: the transformations through which it sees costs;
//! - [`acquisition`]: the worth of measuring a point;
//! - [`local_search`]: the climb to the point of highest worth.
//!
//! Source: Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006; further ones stand beside
//! their use. All transcendental functions are those of `libm`, so that results are equal on every platform.

pub(crate) mod acquisition;
mod ascent;
pub(crate) mod hyper;
pub(crate) mod kernel;
mod likelihood;
pub(crate) mod local_search;
pub(crate) mod regression;
pub(crate) mod sample;
pub(crate) mod warping;

pub(crate) use hyper::{Hyperparameters, Prior};
pub(crate) use regression::{Covariances, Posterior, Process, Schedule, SharedFeatures};
pub(crate) use sample::Sample;

#[cfg(test)]
mod tests;
