//! The paper's section 7: searches and predictors along a camera path of every scene; and its section 4: the
//! influence of the parameters.
//!
//! Recording and judging are separate. Recording renders: searches of every camera, fixed configurations, and
//! the predictors' answers. Judging computes from the record alone and without chance, so that predictors can
//! be compared on one data set any number of times.
//!
//! | module | holds |
//! |---|---|
//! | `record` | the measurements as JSON Lines: only added to, so that a stopped run goes on where it stood |
//! | `measure` | a search, and groups of configurations in interleaved rounds |
//! | `folds` | which cameras teach and which examine: random splits, and each scene left out |
//! | `answers` | predictors of the core, taught a fold, asked about its other cameras |
//! | `parts` | section 4: which parameters are searched alone, and pairs without and with splitting |
//! | `fixed` | configurations by hand, the best of which is the fixed one |
//! | `judge` | each answer against the search, its best, the default and the best fixed configuration |
//! | `summary` | over all cameras: means, intervals, shares |
//! | `progress` | the searches' best after each number of trials and its time, measured again |
//! | `figures`, `part_figures`, `progress_figures` | the paper's figures, as SVG |
//! | `page`, `part_page`, `markup` | the report in words, tables and figures |

pub(crate) mod answers;
pub(crate) mod figures;
pub(crate) mod fixed;
pub(crate) mod folds;
pub(crate) mod judge;
pub(crate) mod markup;
pub(crate) mod measure;
pub(crate) mod page;
pub(crate) mod part_figures;
pub(crate) mod part_page;
pub(crate) mod parts;
pub(crate) mod progress;
pub(crate) mod progress_figures;
pub(crate) mod record;
pub(crate) mod summary;
#[cfg(test)]
mod testing;
