//! The Treewright path tracer: film, integrator, measured frames, and the loop that tunes them.
//!
//! | module | contents |
//! |---|---|
//! | `integrator` | paths from the camera to the light, in stages or one by one |
//! | `film`, `tone`, `image_file` | the picture, as it is shown, and PNG and EXR files of it |
//! | `frame`, `render_options` | one frame: build, render, the time of each |
//! | `follow` | structures that follow a moving scene, and episodes of it |
//! | `shelf` | structures that are kept for later trials |
//! | `swap` | a quick tree first, and a better one built behind the frames |
//! | `space` | tuning spaces, and the meaning of a configuration |
//! | `disturbance` | the other work of a machine during a measurement |
//! | `scheduling` | threads' processor times, and their waits for a processor |
//! | `noise`, `bias` | the error of a picture, and the guard of its expectation |
//! | `measure`, `statistics` | contenders in interleaved rounds, and conclusions from them |
//! | `processes` | the difference between rounds of two processes |
//! | `tuning` | the loop of the paper's Figure 1, over the wire |
//! | `recorder` | the rays of a frame in a file |
//!
//! Scenes come from the crate `treewright-scene`, command lines stand in `treewright-render-cli`.

pub mod bias;
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
pub mod processes;
pub mod recorder;
pub mod render_options;
pub mod scheduling;
mod shelf;
pub mod space;
pub mod statistics;
pub mod swap;
pub mod tone;
pub mod tuning;

pub use treewright_scene as scene;
