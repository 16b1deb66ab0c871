//! The reader of program output, which the command line `treewright` shares with the tests that fuzz it.

pub mod printed;
