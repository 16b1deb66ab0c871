//! The house rules as tests: which crate may know which, where `unsafe` and I/O may stand, how long a
//! file may be, what it may be linked with, and what must not be left lying about.

mod circles;
mod dependencies;
mod documents;
mod layering;
mod packages;
mod tidiness;
mod words;
