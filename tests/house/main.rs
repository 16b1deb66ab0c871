//! The house rules as tests: arrows between crates, places of `unsafe` and I/O, lengths of files, linked
//! crates, and leftovers.

mod circles;
mod dependencies;
mod documents;
mod layering;
mod packages;
mod tidiness;
mod words;
