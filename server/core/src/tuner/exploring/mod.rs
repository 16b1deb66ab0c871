//! Exploring a study: the searches of its states, their walk and their repeats, the races that confirm them,
//! and what is exploited meanwhile.

pub(super) mod confirmation;
mod decide;
mod exploiting;
pub(super) mod exploration;
mod few;
mod race;
mod repeats;
mod searches;
mod standings;
mod start;
mod telling;
pub(super) mod transfer;
mod walk;
mod wishes;

pub(crate) use confirmation::Racing;
pub(crate) use exploiting::Exploiting;
pub(crate) use repeats::Repeats;
pub(crate) use searches::{Searches, is_spent};
pub(crate) use standings::Standings;
pub(crate) use transfer::Transfer;
pub(crate) use walk::{NextPoint, Walk, drawn, unseen};
pub(crate) use wishes::Wishes;
