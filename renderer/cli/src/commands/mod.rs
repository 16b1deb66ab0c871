//! One file for each command of `treewright-render`: its arguments and its work.

pub(crate) mod bench;
pub(crate) mod best;
pub(crate) mod image;
pub(crate) mod info;
pub(crate) mod play;
pub(crate) mod rays;
pub(crate) mod rounds;
pub(crate) mod sample;
pub(crate) mod tune;
mod tune_arguments;
mod tune_output;
