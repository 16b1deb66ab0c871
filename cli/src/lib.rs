//! What the command line `treewright` shares with the tests that fuzz it: how it reads what programs print.

pub mod printed;
