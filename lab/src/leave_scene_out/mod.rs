//! The gain from a tuning service on a scene that it has never seen. Leave one scene out, search it, and
//! compare the answers after 1, 8, 16, 32 and 60 frames with configurations that need no tuning there.
//!
//! | module | holds |
//! |---|---|
//! | `suite` | scenes and settings |
//! | `hand` | configurations that anybody can write down |
//! | `daemon` | a private tuning daemon |
//! | `steps` | the measurements: candidates, searches, winners of other scenes, the final rounds |
//! | `book` | everything measured, on disk |
//! | `judge` | tables from the book |
//!
//! A scene's own data are never used for its own prediction. The daemon that serves it knows the searches of
//! the other scenes and nothing of this one. The fixed configuration it is compared with was chosen on the
//! others alone.

pub(crate) mod book;
pub(crate) mod daemon;
pub(crate) mod hand;
pub(crate) mod judge;
pub(crate) mod steps;
pub(crate) mod suite;
