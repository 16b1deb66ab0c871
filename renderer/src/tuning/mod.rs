//! The loop of the paper's Figure 1, over the wire: indicators, suggestion, build, render, report.
//!
//! | module | what it does |
//! |---|---|
//! | `objective` | what is minimised, and the study that says so |
//! | `search` | the loop itself, frame by frame |
//! | `verdict` | measures the winner again, against the default and Embree's own structures |
//! | `results` | everything a run found out, for JSON and the report |

pub mod objective;
pub mod results;
pub mod search;
pub mod verdict;
