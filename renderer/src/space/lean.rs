//! The full space without the parameters that gain nothing over its default.
//!
//! Each value of each parameter was tried alone beside the default, on scenes and instruction sets of which
//! `docs/measurements/lean.md` has the table. What is left out is held at its default. With another start than
//! the recommended one these parameters gain much, so such a search has the full space.

use super::{Narrowing, Preset, TuningSpace};

/// What is left out.
const HELD: [&str; 6] = ["staged", "threads", "tile", "tile_order", "primary", "sort"];

/// The lean part of a full space.
pub(super) fn of(full: &TuningSpace) -> TuningSpace {
    let held = full.explained().filter(|one| HELD.contains(&one.parameter.name.as_str()));
    let fixed: Vec<Narrowing> =
        held.map(|one| Narrowing::Fix { name: one.parameter.name, value: one.parameter.default }).collect();
    let lean = full.narrowed(&fixed).expect("defaults are values of their parameters");
    TuningSpace { preset: Preset::Lean, ..lean }
}
