//! The Treewright path tracer: film, integrator, measured frames, and the loop that tunes them.
//!
//! | module | what it does |
//! |---|---|
//! | `integrator` | paths from the camera to the light, in stages or one by one |
//! | `film`, `tone`, `image_file` | the picture, as it is shown, and PNG and EXR files of it |
//! | `frame`, `render_options` | one frame: build, render, how long each took |
//! | `follow` | structures that follow a moving scene, and episodes of it |
//! | `shelf` | structures that are kept for later trials |
//! | `space` | what can be tuned, and what a configuration means |
//! | `disturbance` | what else a machine did while something was measured |
//! | `scheduling` | what threads got of the processors, and how long they waited for one |
//! | `measure`, `statistics` | contenders in interleaved rounds, and what may be concluded from them |
//! | `tuning` | the loop of the paper's Figure 1, over the wire |
//! | `recorder` | the rays of a frame in a file |
//!
//! Scenes come from the crate `treewright-scene`, command lines stand in `treewright-render-cli`.

pub mod disturbance;
pub mod film;
pub mod follow;
pub mod frame;
pub mod image_file;
pub mod integrator;
pub mod light_sampling;
pub mod limits;
pub mod measure;
pub mod noise;
pub mod recorder;
pub mod render_options;
pub mod scheduling;
mod shelf;
pub mod space;
pub mod statistics;
pub mod tone;
pub mod tuning;

pub use treewright_scene as scene;
