//! The loop of the paper's Figure 1, over the wire: indicators, suggestion, build, render, report.
//!
//! | module | what it does |
//! |---|---|
//! | `objective` | what is minimised, and the study that says so |
//! | `workload` | what describes a frame to the service |
//! | `reuse` | how many frames a tree serves, for the objective `auto` |
//! | `search` | the loop itself, frame by frame |
//! | `patience` | asking a frame ahead, and waiting for a daemon that is slow |
//! | `ending` | when more of a search is worth less than it takes |
//! | `confirmation` | the best few of a search and natives against the incumbent |
//! | `sampling` | random configurations as a numbered sequence, for exploration without a search |
//! | `verdict` | whom the winner is compared with, and when tuning pays off |
//! | `results` | everything a run found out, for JSON and the report |

pub mod confirmation;
pub mod ending;
pub mod objective;
pub mod patience;
pub mod results;
pub mod reuse;
pub mod sampling;
pub mod search;
pub mod verdict;
pub mod workload;
