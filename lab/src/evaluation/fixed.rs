//! Configurations of the paper's space that anybody can write down: candidates for the best fixed one.
//!
//! The first is the recommended default. The others follow the paper's own observations (section 4.4):
//! splitting for rendering, small leaves for rendering and large ones for builds, blocks of the machine's
//! vectors.

use treewright_render_cli::error::Result;
use treewright_renderer::space::{TuningSpace, parse};

/// As texts; missing values are the recommended ones.
const PAPER: [&str; 8] = [
    "quality=3,branching_factor=8,sah_block_size=4",
    "quality=3,branching_factor=4,sah_block_size=4",
    "quality=2,branching_factor=8,sah_block_size=4,min_leaf_size=4,max_leaf_size=8",
    "quality=2,branching_factor=4,sah_block_size=4,min_leaf_size=4,max_leaf_size=10",
    "quality=2,branching_factor=8,sah_block_size=4,min_leaf_size=1,max_leaf_size=8",
    "quality=2,branching_factor=8,sah_block_size=8,min_leaf_size=8,max_leaf_size=16",
    "quality=1,branching_factor=8,min_leaf_size=4,max_leaf_size=16",
    "quality=1,branching_factor=8,min_leaf_size=20,max_leaf_size=30",
];

/// The default of a space, then the candidates where it is the paper's.
pub(crate) fn candidates(space: &TuningSpace) -> Result<Vec<treewright_client::Configuration>> {
    let mut all = vec![space.default_configuration()];
    if space.name() == "paper" {
        for text in PAPER {
            all.push(space.complete(&parse(text)?)?);
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_candidate_is_of_the_space_and_there_once() {
        let all = candidates(&TuningSpace::paper()).expect("all are sound");
        let distinct: std::collections::BTreeSet<_> = all.iter().collect();
        assert_eq!((all.len(), distinct.len()), (PAPER.len() + 1, PAPER.len() + 1));
    }
}
