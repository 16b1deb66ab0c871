//! The loop of the paper's Figure 1, over the wire: indicators, suggestion, build, render, report.
//!
//! | module | contents |
//! |---|---|
//! | `objective` | objectives, and the study of each |
//! | `workload` | the indicators of a frame |
//! | `reuse` | the number of frames that a tree serves, for the objective `auto` |
//! | `search` | the loop itself, frame by frame |
//! | `apart` | frames of real time that need not be rendered again |
//! | `patience` | asking a frame ahead, and waiting for a daemon that is slow |
//! | `ending` | the end of a search whose further trials do not pay |
//! | `confirmation` | the best few of a search and natives against the incumbent |
//! | `sampling` | random configurations as a numbered sequence, for exploration without a search |
//! | `who` | who takes part in a comparison, and the name of each for people |
//! | `safety` | frames of a search that cost more than its start |
//! | `verdict` | the rivals of the winner, and the frame at which tuning pays off |
//! | `results` | all results of a run, for JSON and the report |

mod apart;
pub mod confirmation;
pub mod ending;
pub mod objective;
pub mod patience;
pub mod results;
pub mod reuse;
pub mod safety;
pub mod sampling;
pub mod search;
pub mod verdict;
pub mod who;
pub mod workload;
