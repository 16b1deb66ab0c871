//! Arguments of the commands for studies: create, show, copy, delete, steer.

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

/// The commands for one study.
#[derive(Debug, Subcommand)]
pub(crate) enum StudyCommand {
    /// Creates a study from a file in TOML or JSON
    #[command(after_help = CREATE_EXAMPLE)]
    Create {
        /// The file; - for standard input
        file: PathBuf,
        /// The study's id. Default: the id in the file, or else the file's name
        #[arg(long, value_name = "ID")]
        id: Option<String>,
    },
    /// Shows the parameters, indicators, objective and policy of a study
    Show {
        /// Its id, e.g. `sponza`
        name: String,
        /// Print a study file that `study create` can read
        #[arg(long, value_enum)]
        format: Option<Language>,
    },
    /// Prints the JSON schema of study files
    Schema,
    /// Changes the parameters and constraints of a study, which keeps its trials, or its note and tags
    #[command(after_help = "\
Without --yes it only shows what would change. Trials from before count with the default of each new \
parameter, or with what it kept if it was there before; those with a value that the file no longer has \
are kept and left out, until another change takes them in again. Programs that work with the \
parameters from before go on. For other changes, such as another indicator, use `study clone --spec`; \
for the policy, `treewright policy`. The note, the tags and the display name change at once. Where a file \
has another policy or other texts, these stay, and it says so.

Examples:
  treewright study show sponza --format toml > sponza.toml
  treewright study edit sponza sponza.toml
  treewright study edit sponza sponza.toml --yes
  treewright study edit sponza sponza.toml --fixed compact=true
  treewright study edit sponza --note 'with the new driver' --tag gpu --untag draft")]
    Edit(EditStudy),
    /// Copies a study and what it learnt, optionally with a changed specification
    #[command(after_help = "\
With --spec the copy gets another specification. Old trials get the default of each new parameter, and \
the value that you give for each new indicator. Trials that no longer fit are skipped and counted. \
Copied trials do not count towards the search's limit: each state of the copy is searched with its whole \
budget, and with all that is known.

Examples:
  treewright study clone sponza sponza-copy
  treewright study clone sponza sponza-2 --spec with-lights.toml --indicator lights=4
  treewright study clone sponza sponza-empty --no-trials")]
    Clone(CloneStudy),
    /// Gives a study another id; running programs go on with it
    Rename {
        /// Its id
        name: String,
        /// The new id
        to: String,
    },
    /// Deletes a study with its trials and models
    Delete {
        /// Its id, e.g. `sponza`
        name: String,
        /// Confirm the deletion
        #[arg(long)]
        yes: bool,
    },
}

/// The flags that change texts.
const TEXTS: [&str; 4] = ["display_name", "note", "tags", "untags"];

/// The study to change, and its new texts or file.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("edit").multiple(true).required(true).arg("file").args(TEXTS))]
pub(crate) struct EditStudy {
    /// Its id, e.g. `sponza`
    pub(crate) name: String,
    /// A study file with the new parameters and constraints; - for standard input
    #[arg(conflicts_with_all = TEXTS)]
    pub(crate) file: Option<PathBuf>,
    /// Value of a new parameter in all trials before, or of one that is gone in all later ones; repeat for
    /// each. Default: its default
    #[arg(long, value_name = "NAME=VALUE", value_parser = parameter)]
    #[arg(requires = "file", conflicts_with_all = TEXTS)]
    pub(crate) fixed: Vec<(String, Value)>,
    /// Make the change
    #[arg(long, requires = "file", conflicts_with_all = TEXTS)]
    pub(crate) yes: bool,
    /// A line about the study; a front is found by its own, and keeps that
    #[arg(long, value_name = "TEXT")]
    pub(crate) display_name: Option<String>,
    /// A note of several lines, in place of the one before; an empty one removes it
    #[arg(long, value_name = "TEXT")]
    pub(crate) note: Option<String>,
    /// Add tags, by which `treewright studies --tag` finds the study
    #[arg(long = "tag", value_name = "TAG,…", value_delimiter = ',')]
    pub(crate) tags: Vec<String>,
    /// Remove tags
    #[arg(long = "untag", value_name = "TAG,…", value_delimiter = ',')]
    pub(crate) untags: Vec<String>,
}

/// The study to copy, and the copy's id.
#[derive(Debug, Args)]
pub(crate) struct CloneStudy {
    /// The study's id
    pub(crate) name: String,
    /// The id of the copy
    pub(crate) to: String,
    /// Specification of the copy: a study file
    #[arg(long, value_name = "FILE")]
    pub(crate) spec: Option<PathBuf>,
    /// Value of a new indicator for the old trials; repeat for each
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Copy only the specification
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
    /// Give every client this configuration; parameters you do not name take their defaults
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = parameter)]
    pub(crate) pin: Vec<(String, Value)>,
    /// End `--pin`
    #[arg(long, conflicts_with = "pin")]
    pub(crate) unpin: bool,
    /// Reset fields to their defaults, e.g. regret_budget
    #[arg(long, value_name = "FIELD,…", value_delimiter = ',')]
    pub(crate) clear: Vec<String>,
}

/// A configuration for all.
#[derive(Debug, Args)]
pub(crate) struct Pin {
    /// The study's id
    pub(crate) study: String,
    /// The values; parameters you do not name take their defaults. Default: the best known configuration
    #[arg(value_name = "NAME=VALUE", value_parser = parameter)]
    pub(crate) values: Vec<(String, Value)>,
    /// Use the best configuration of this state, if the study has several
    #[arg(long, value_name = "NUMBER", conflicts_with = "values")]
    pub(crate) state: Option<i64>,
}
