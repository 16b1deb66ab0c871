//! Acceleration structures: Embree's builders, our own tree layout and traversal, Embree's native
//! scenes, and a brute-force oracle. Every `unsafe` line of the workspace lives in this crate.

pub mod geometry;
pub mod limits;
pub mod parameters;

pub use embree4_sys as _;
pub use geometry::{GeometryError, Hit, Intersector, Ray, Triangles};
pub use parameters::{BuildChoice, NativeOptions, NativeQuality, Quality, TreeParameters};
