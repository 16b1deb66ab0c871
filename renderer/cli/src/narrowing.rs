//! `--fix`, `--range` and `--recommended`: a part of a space, for commands that search or sample one.

use clap::Args;

use crate::error::Result;
use treewright_renderer::space::{Narrowing, Recommendation, TuningSpace, short_hash};

/// Which part of the space.
#[derive(Args, Clone, Debug, Default)]
pub struct NarrowingArguments {
    /// Fix a parameter to a value; can be repeated.
    #[arg(long, value_name = "NAME=VALUE", value_parser = Narrowing::fix)]
    pub fix: Vec<Narrowing>,

    /// Restrict a parameter to a part of its range; can be repeated. `treewright analyze` recommends such
    /// ranges.
    #[arg(long, value_name = "NAME=LOW..HIGH", value_parser = Narrowing::range)]
    pub range: Vec<Narrowing>,

    /// Restrict parameters to what the paper recommends for an objective (section 4.4): paper-render or
    /// paper-total.
    #[arg(long, value_name = "NAME")]
    pub recommended: Option<Recommendation>,
}

impl NarrowingArguments {
    /// Whether anything is asked for.
    pub fn is_empty(&self) -> bool {
        self.fix.is_empty() && self.range.is_empty() && self.recommended.is_none()
    }

    /// The part of a space that is left. Recommended parameters that the space lacks are passed over.
    pub fn of(&self, space: &TuningSpace) -> Result<TuningSpace> {
        let has = |one: &Narrowing| space.explained().any(|known| known.parameter.name == one.name());
        let recommended = self.recommended.map(Recommendation::narrowings).unwrap_or_default();
        let mut all: Vec<Narrowing> = recommended.into_iter().filter(has).collect();
        all.extend(self.range.iter().chain(&self.fix).cloned());
        Ok(space.narrowed(&all)?)
    }

    /// The mark of a study of this part: a few letters, equal for equal parts.
    pub fn mark(&self, part: &TuningSpace) -> String {
        if self.is_empty() {
            return String::new();
        }
        let text: String = part.explained().map(|one| format!("{:?};", one.parameter)).collect();
        let text = text + &part.with_held(&part.default_configuration()).to_string();
        format!("-part-{}", short_hash(&text))
    }
}
