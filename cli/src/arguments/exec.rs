//! Arguments of the command that runs programs, and of ask and tell in a shell.

use std::time::Duration;

use clap::{Args, ValueEnum};
use treewright_client::{ClientError, Front, Indicators, Value};

use super::{indicator, parameter};
use crate::exec::program::MetricSource;
use crate::failure::{Failure, Result};
use crate::study_file::{
    ConstraintEntry, FidelityEntry, IndicatorEntry, LimitEntry, ParameterEntry, Plain, PolicyEntry,
    StudyFile, TermEntry,
};

pub(crate) const EXEC_EXAMPLES: &str = "\
In the command, {level} is replaced by the value, {long?--long} by --long if the switch is on, and \
{long?yes:no} by one or the other. An argument whose parameter is inactive is left out. Each value is \
also in the environment, as TREEWRIGHT_PARAM_LEVEL.

Metrics: wall_ms and cpu_ms are always measured. With --metric json, so is every number in the last \
JSON object that the program prints; {\"infeasible\": \"reason\"} says that the configuration cannot be \
used. A run that exits with an error, or whose last JSON object lacks what is minimised, has failed. A \
configuration that fails twice and never worked counts as infeasible.

Examples:
  treewright exec zstd --tune 'level=1..19:3' --tune 'threads=1..4:1' \\
      --trials 30 --confirm -- zstd -{level} -T{threads} -kf data.tar
  treewright exec study.toml --confirm=20 -- ./solver --blocks {blocks} {fast?--fast}
  treewright exec gemm --tune 'x=1..64:8' --tune 'y=1..64:8' --constraint 'x * y <= 1024 and x % y == 0' \
      -- ./gemm {x} {y}
  treewright exec loss --metric json --tune 'rate=0.001..1.0:0.1:log' --minimise loss \\
      -- python3 train.py --rate {rate}";

/// How to tune a program.
#[derive(Debug, Args)]
pub(crate) struct Exec {
    /// The study's id, or a study file; the study is created if it does not exist
    pub(crate) study: String,
    /// Parameter of a new study: NAME=LOW..HIGH:DEFAULT, NAME=ONE|OTHER:DEFAULT or NAME=bool:DEFAULT; append
    /// :log to numbers for a logarithmic scale, and /STEP to HIGH for steps
    #[arg(long, value_name = "NAME=VALUES:DEFAULT", value_parser = ParameterEntry::inline)]
    pub(crate) tune: Vec<ParameterEntry>,
    /// Parameters of a new study whose change needs a set-up, such as a compilation; the search then keeps
    /// what is set up for a few runs
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', requires = "tune")]
    pub(crate) setup: Vec<String>,
    /// Condition that every configuration of a new study fulfils, e.g. 'block_x * block_y <= 1024'; may be
    /// repeated
    #[arg(long = "constraint", value_name = "EXPRESSION", requires = "tune")]
    pub(crate) constraints: Vec<String>,
    /// Limit of a measurement of a new study, e.g. 'memory_mb<=2000'; a run beyond it counts as infeasible.
    /// May be repeated
    #[arg(long = "limit", value_name = "METRIC<=NUMBER", requires = "tune", value_parser = LimitEntry::inline)]
    pub(crate) limits: Vec<LimitEntry>,
    /// Cheaper level of a new study at which a run says whether a full one is worth its time, the cheapest
    /// first: its name, and the cost of a run there as a share of a full one, e.g. 'small=0.1'. The command
    /// has {fidelity} or {fidelity:FULL} in its place, or reads TREEWRIGHT_FIDELITY. At most four
    #[arg(
        long = "fidelity",
        value_name = "NAME=COST",
        requires = "tune",
        conflicts_with = "front",
        value_parser = FidelityEntry::inline
    )]
    pub(crate) fidelities: Vec<FidelityEntry>,
    /// Metric to maximise in a new study, such as a rate; its reciprocal is the cost
    #[arg(long, value_name = "METRIC", requires = "tune", conflicts_with = "minimise")]
    pub(crate) maximise: Option<String>,
    /// Metric to minimise in a new study
    #[arg(long, value_name = "METRIC", default_value = "wall_ms", requires = "tune")]
    pub(crate) minimise: String,
    /// Two or three metrics of a new study of which none is given up for another; 1/rate for one that is to
    /// be large. Prints the Pareto front: the configurations that no other is better than in all of them
    #[arg(
        long,
        value_name = "METRIC,METRIC",
        value_delimiter = ',',
        requires = "tune",
        conflicts_with_all = ["confirm", "minimise", "maximise", "indicators"]
    )]
    pub(crate) front: Vec<String>,
    /// Maximum number of runs
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) trials: Option<u32>,
    /// Where measurements come from
    #[arg(long, value_enum, default_value = "time")]
    pub(crate) metric: MetricSource,
    /// Exit codes besides 0 with which a run counts, e.g. 1,3
    #[arg(long, value_name = "CODES", value_delimiter = ',', value_parser = clap::value_parser!(i32).range(1..=255))]
    pub(crate) accept_exit: Vec<i32>,
    /// Kill runs that take longer, e.g. 30s; such a configuration counts as infeasible
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub(crate) run_timeout: Option<Duration>,
    /// Finally run the winner against the default in this many interleaved pairs
    #[arg(
        long,
        value_name = "PAIRS",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "10",
        value_parser = clap::value_parser!(u32).range(1..=10_000)
    )]
    pub(crate) confirm: Option<u32>,
    /// Show the program's output on standard error
    #[arg(long)]
    pub(crate) show_output: bool,
    /// Value of an indicator; repeat for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Name of this client; clients that run at once need different names. Default: this machine and process
    #[arg(long, value_name = "NAME")]
    pub(crate) client: Option<String>,
    /// The program and its arguments, with {name} in place of values
    #[arg(last = true, required = true, value_name = "COMMAND")]
    pub(crate) command: Vec<String>,
}

impl Exec {
    pub(crate) fn indicators(&self) -> Indicators {
        self.indicators.iter().cloned().collect()
    }

    /// The front that is looked for, if one is.
    pub(crate) fn front(&self) -> Result<Option<Front>> {
        if self.front.is_empty() {
            return Ok(None);
        }
        Ok(Some(Front::new(&self.front).map_err(ClientError::from)?))
    }

    /// The study that is made up on the command line, if one is.
    pub(crate) fn inline_study(&self) -> Result<Option<StudyFile>> {
        if self.tune.is_empty() {
            return Ok(None);
        }
        let front = self.front()?;
        let metric = match &front {
            Some(_) => Front::COST.to_owned(),
            None => self.maximise.as_ref().unwrap_or(&self.minimise).clone(),
        };
        let objective = vec![TermEntry { metric, weight: 1.0, maximise: self.maximise.is_some() }];
        let constraints = self.constraints.iter().cloned().map(ConstraintEntry::Expression).collect();
        let mut parameters = self.tune.clone();
        for name in &self.setup {
            let named = parameters.iter_mut().find(|entry| entry.name == *name);
            let unknown = || Failure::Usage(format!("--setup {name}: there is no --tune {name}=…"));
            named.ok_or_else(unknown)?.setup = true;
        }
        let (limits, fidelities) = (self.limits.clone(), self.fidelities.clone());
        let file =
            StudyFile { parameters, constraints, objective, limits, fidelities, ..StudyFile::default() };
        let Some(front) = front else { return Ok(Some(file)) };
        Ok(Some(StudyFile {
            display_name: Some(front.study_name()),
            indicators: vec![IndicatorEntry::inline(Front::DIRECTION, front.range())],
            // A race would be one of a single direction.
            policy: [("confirm_rounds".to_owned(), PolicyEntry::Value(Plain::Integer(0)))].into(),
            ..file
        }))
    }
}

/// How a suggestion is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SuggestFormat {
    /// Shell variables: eval "$(treewright suggest STUDY)"
    Env,
    /// A JSON object
    Json,
    /// --name=value for each parameter on one line; the trial's name goes to standard error
    Args,
}

/// Ask for the next configuration.
#[derive(Debug, Args)]
pub(crate) struct Suggest {
    /// The study's id
    pub(crate) study: String,
    /// Output format
    #[arg(long, value_enum, default_value = "env")]
    pub(crate) format: SuggestFormat,
    /// Prefix of the variables' names
    #[arg(long, default_value = "TREEWRIGHT_PARAM_", value_name = "TEXT", value_parser = prefix)]
    pub(crate) prefix: String,
    /// An indicator of the input; once for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Ask for this configuration; parameters you do not name take their defaults
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = parameter)]
    pub(crate) wanted: Vec<(String, Value)>,
    /// The values that your program has by default, where they are not the study's; give them each time. They
    /// are measured first, and answers are what is better. Parameters you do not name take their defaults
    #[arg(long, value_name = "NAME=VALUE,…", value_delimiter = ',', value_parser = parameter)]
    pub(crate) start: Vec<(String, Value)>,
    /// Name of this client. A client gets the same trial until it has reported it
    #[arg(long, value_name = "NAME")]
    pub(crate) client: Option<String>,
}

/// A prefix of names that shells take.
fn prefix(text: &str) -> Result<String, String> {
    let starts = text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_');
    if starts && text.chars().all(|each| each.is_ascii_alphanumeric() || each == '_') {
        Ok(text.to_owned())
    } else {
        Err("use letters, digits and _, and do not start with a digit".to_owned())
    }
}

/// Tell what came of it.
#[derive(Debug, Args)]
pub(crate) struct Report {
    /// The trial's name, from `suggest`
    pub(crate) trial: String,
    /// The measurements
    #[arg(value_name = "METRIC=NUMBER", value_parser = indicator)]
    pub(crate) measurements: Vec<(String, f64)>,
    /// The configuration cannot be used
    #[arg(long, value_name = "REASON", group = "bad")]
    pub(crate) infeasible: Option<String>,
    /// The run failed for another reason; the configuration may be tried again
    #[arg(long, value_name = "REASON", group = "bad")]
    pub(crate) failed: Option<String>,
    /// The run was stopped early; the cost would have been at least this
    #[arg(long, value_name = "COST", group = "bad")]
    pub(crate) aborted: Option<f64>,
    /// Give the trial back unmeasured
    #[arg(long, group = "bad", conflicts_with = "measurements")]
    pub(crate) abandon: bool,
}
