//! Arguments of what runs programs and of ask and tell in a shell.

use std::time::Duration;

use clap::{Args, ValueEnum};
use treewright_client::{Indicators, Value};

use super::{indicator, parameter};
use crate::exec::program::Metric;
use crate::failure::Failure;
use crate::study_file::{ParameterEntry, StudyFile, TermEntry};

pub(crate) const EXEC_EXAMPLES: &str = "\
Places for parameters: {level} is the value, {long?--long} is --long where the switch is on,
{long?yes:no} one or the other. An argument whose parameter is inactive is left out. The program
finds each value in its environment, too, as TREEWRIGHT_PARAM_LEVEL.

Metrics: wall_ms and cpu_ms are always taken; with --metric json also every number of the last
line that is a JSON object, and {\"infeasible\": \"reason\"} says that it cannot work so. A program
that ends with an error is reported as infeasible.

Examples:
  treewright exec zstd --tune 'level=1..19:3' --tune 'threads=1..4:1' \\
      --trials 30 --confirm -- zstd -{level} -T{threads} -kf data.tar
  treewright exec study.toml --confirm=20 -- ./solver --blocks {blocks} {fast?--fast}
  treewright exec loss --metric json --tune 'rate=0.001..1.0:0.1:log' --minimise loss \\
      -- python3 train.py --rate {rate}";

/// How to tune a program.
#[derive(Debug, Args)]
pub(crate) struct Exec {
    /// A study's id, or a study file, from which the study is created where there is none
    pub(crate) study: String,
    /// A parameter of a study that is made up here: NAME=LOW..HIGH:DEFAULT, NAME=ONE|OTHER:DEFAULT or NAME=bool:DEFAULT,
    /// numbers with :log where equal ratios are to be equal steps
    #[arg(long, value_name = "NAME=VALUES:DEFAULT", value_parser = ParameterEntry::inline)]
    pub(crate) tune: Vec<ParameterEntry>,
    /// What such a study minimises
    #[arg(long, value_name = "METRIC", default_value = "wall_ms", requires = "tune")]
    pub(crate) minimise: String,
    /// Run the program at most so often
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) trials: Option<u32>,
    /// Where the numbers come from
    #[arg(long, value_enum, default_value = "time")]
    pub(crate) metric: Metric,
    /// End a run that takes longer, e.g. 30s; its configuration counts as infeasible
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub(crate) run_timeout: Option<Duration>,
    /// Let the winner run against the default at the end, in so many interleaved pairs
    #[arg(
        long,
        value_name = "PAIRS",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "10",
        value_parser = clap::value_parser!(u32).range(1..=10_000)
    )]
    pub(crate) confirm: Option<u32>,
    /// Pass on what the program writes, to standard error
    #[arg(long)]
    pub(crate) show_output: bool,
    /// An indicator of the input; once for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Who measures; two that tune at once need different names. Default: this machine and process
    #[arg(long, value_name = "NAME")]
    pub(crate) client: Option<String>,
    /// The program and its arguments, with places for parameters
    #[arg(last = true, required = true, value_name = "COMMAND")]
    pub(crate) command: Vec<String>,
}

impl Exec {
    pub(crate) fn indicators(&self) -> Indicators {
        self.indicators.iter().cloned().collect()
    }

    /// The study that is made up on the command line, if one is.
    pub(crate) fn inline_study(&self) -> Result<Option<StudyFile>, Failure> {
        if self.tune.is_empty() {
            return Ok(None);
        }
        let objective = vec![TermEntry { metric: self.minimise.clone(), weight: 1.0 }];
        Ok(Some(StudyFile { parameters: self.tune.clone(), objective, ..StudyFile::default() }))
    }
}

/// How a suggestion is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SuggestFormat {
    /// Lines for a shell: eval "$(treewright suggest STUDY)"
    Env,
    /// One JSON object
    Json,
    /// --name=value for each parameter, on one line; the trial's name is on standard error
    Args,
}

/// Ask for the next configuration.
#[derive(Debug, Args)]
pub(crate) struct Suggest {
    /// The study's id
    pub(crate) study: String,
    /// How to write it
    #[arg(long, value_enum, default_value = "env")]
    pub(crate) format: SuggestFormat,
    /// What stands before the names of variables
    #[arg(long, default_value = "TREEWRIGHT_PARAM_", value_name = "TEXT", value_parser = prefix)]
    pub(crate) prefix: String,
    /// An indicator of the input; once for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Measure this configuration; parameters that are not named take their defaults
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = parameter)]
    pub(crate) wanted: Vec<(String, Value)>,
    /// Who asks. The same client gets the same trial again until it has reported it
    #[arg(long, value_name = "NAME")]
    pub(crate) client: Option<String>,
}

/// A prefix of names that shells take.
fn prefix(text: &str) -> Result<String, String> {
    let starts = text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_');
    if starts && text.chars().all(|each| each.is_ascii_alphanumeric() || each == '_') {
        Ok(text.to_owned())
    } else {
        Err("a variable's name has letters, digits and _, and begins with no digit".to_owned())
    }
}

/// Tell what came of it.
#[derive(Debug, Args)]
pub(crate) struct Report {
    /// The trial's name, as `suggest` gave it
    pub(crate) trial: String,
    /// What was measured
    #[arg(value_name = "METRIC=NUMBER", value_parser = indicator)]
    pub(crate) measurements: Vec<(String, f64)>,
    /// The configuration cannot work here
    #[arg(long, value_name = "REASON", group = "bad")]
    pub(crate) infeasible: Option<String>,
    /// It failed for a reason that says nothing of the configuration; it may be tried again
    #[arg(long, value_name = "REASON", group = "bad")]
    pub(crate) failed: Option<String>,
    /// It was stopped; the objective would have been at least this
    #[arg(long, value_name = "COST", group = "bad")]
    pub(crate) aborted: Option<f64>,
    /// Give it back unmeasured
    #[arg(long, group = "bad", conflicts_with = "measurements")]
    pub(crate) abandon: bool,
}
