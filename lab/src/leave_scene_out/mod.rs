//! What a tuning service is worth on a scene it has never seen: leave one scene out, search it, and compare
//! its answers after 1, 8, 16, 32 and 60 frames with what anybody could have had.
//!
//! | module | what it holds |
//! |---|---|
//! | `suite` | scenes and settings |
//! | `hand` | configurations that anybody can write down |
//! | `daemon` | a tuning daemon of one's own |
//! | `steps` | what is measured: candidates, searches, winners of other scenes, the final rounds |
//! | `book` | everything measured, on disk |
//! | `judge` | tables from the book |
//!
//! A scene's own data are never used for its own prediction: the daemon that serves it knows the searches of
//! the other scenes and nothing of this one, and the fixed configuration it is compared with was chosen on
//! the others alone.

pub(crate) mod book;
pub(crate) mod daemon;
pub(crate) mod hand;
pub(crate) mod judge;
pub(crate) mod steps;
pub(crate) mod suite;
