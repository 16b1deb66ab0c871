//! Exploring a study: the searches of its states, their walk and their repeats, the races that confirm them,
//! and what is exploited meanwhile.

pub(super) mod confirmation;
pub(super) mod exploiting;
pub(super) mod exploration;
pub(super) mod few;
pub(super) mod race;
pub(super) mod repeats;
pub(super) mod searches;
pub(super) mod standings;
mod telling;
pub(super) mod transfer;
pub(super) mod walk;
