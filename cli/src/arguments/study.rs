//! Arguments of what concerns studies: create, show, copy, delete, steer.

use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand};
use treewright_client::Value;

use super::{indicator, parameter};
use crate::setting_flags::{SettingFlags, change_arguments};
use crate::study_file::Language;

const CREATE_EXAMPLE: &str = r#"A study file in TOML; `treewright study schema` describes it for editors:

  [[parameters]]
  name = "level"
  type = "integer"          # or float, categorical, boolean
  min = 1
  max = 19
  default = 3               # what you use today

  [[objective]]
  metric = "wall_ms"

Examples:
  treewright study create zstd.toml
  treewright study show sponza --format toml > sponza.toml
  treewright study create sponza.toml --id sponza-2"#;

/// What to do with one study.
#[derive(Debug, Subcommand)]
pub(crate) enum StudyCommand {
    /// Creates one from a file in TOML or JSON
    #[command(after_help = CREATE_EXAMPLE)]
    Create {
        /// The file; - is standard input
        file: PathBuf,
        /// Its id, instead of the one in the file or the file's name
        #[arg(long, value_name = "ID")]
        id: Option<String>,
    },
    /// Shows its space, indicators, objective and policy
    Show {
        /// Its id, e.g. `sponza`
        name: String,
        /// As a study file, which `study create` reads
        #[arg(long, value_enum)]
        format: Option<Language>,
    },
    /// Prints the JSON schema of study files
    Schema,
    /// Copies it with what was learnt, if wished with a changed specification
    #[command(after_help = "\
With --spec the copy is of another specification: parameters that are new there take their default in
what was measured before, and each new indicator needs the value that it had then. Trials that do not
fit any more are left out and counted. A search counts what was carried over among its trials; give it
room with `treewright policy COPY --trials-per-state COUNT`.

Examples:
  treewright study clone sponza sponza-copy
  treewright study clone sponza sponza-2 --spec with-lights.toml --indicator lights=4
  treewright study clone sponza sponza-empty --no-trials")]
    Clone(CloneStudy),
    /// Gives it another id: copies it with its trials, and deletes the old one
    Rename {
        /// Its id
        name: String,
        /// The new id
        to: String,
    },
    /// Deletes it, with its trials and models
    Delete {
        /// Its id, e.g. `sponza`
        name: String,
        /// Really do it
        #[arg(long)]
        yes: bool,
    },
}

/// What to copy.
#[derive(Debug, Args)]
pub(crate) struct CloneStudy {
    /// The study's id
    pub(crate) name: String,
    /// The id of the copy
    pub(crate) to: String,
    /// The specification of the copy, from a study file
    #[arg(long, value_name = "FILE")]
    pub(crate) spec: Option<PathBuf>,
    /// What a new indicator was when the trials were measured; once for each
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Only the specification
    #[arg(long)]
    pub(crate) no_trials: bool,
}

/// A change of policy, or none.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("change").multiple(true).args(change_arguments()))]
pub(crate) struct Policy {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    #[command(flatten)]
    pub(crate) settings: SettingFlags,
    /// Give every client this configuration; parameters that are not named take their defaults
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = parameter)]
    pub(crate) pin: Vec<(String, Value)>,
    /// Give no fixed configuration any more
    #[arg(long, conflicts_with = "pin")]
    pub(crate) unpin: bool,
    /// Set fields back to their defaults, e.g. regret_budget
    #[arg(long, value_name = "FIELD,…", value_delimiter = ',')]
    pub(crate) clear: Vec<String>,
}

/// A configuration for all.
#[derive(Debug, Args)]
pub(crate) struct Pin {
    /// The study's id
    pub(crate) study: String,
    /// The values; parameters that are not named take their defaults. Without any: the best that is known
    #[arg(value_name = "NAME=VALUE", value_parser = parameter)]
    pub(crate) values: Vec<(String, Value)>,
    /// The best of this state, where the study has several
    #[arg(long, value_name = "NUMBER", conflicts_with = "values")]
    pub(crate) state: Option<i64>,
}
