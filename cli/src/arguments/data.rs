//! Arguments of the commands that list, export, import and watch trials.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use super::indicator;

pub(crate) const TRIALS_HELP: &str = "\
Filter: comparisons joined by AND, with = != < <= > >=, text in double quotes. Fields: state (OPEN, \
COMPLETED, ABANDONED, EXPIRED), mode (DEFAULT, EXPLORE, EXPLOIT, PINNED), outcome (OK, INFEASIBLE, \
ABORTED, FAILED), client_id, state_id, number, cost, late, excluded, measurement.NAME, config.NAME, \
indicator.NAME.

Examples:
  treewright trials sponza --order-by cost --limit 5
  treewright trials sponza --after 50
  treewright trials sponza --filter 'outcome = INFEASIBLE AND config.max_depth < 20'
  treewright trials sponza --format csv --all > trials.csv";

pub(crate) const EXPORT_HELP: &str = "\
JSON Lines contain everything: the first line is the study, as written by `study show --format json`, \
and each further line is a trial. Parquet and CSV are tables with a column for each parameter, indicator and \
measurement. Parquet has types, and holds the study and the machines too; CSV does not. Of a study that \
maximises one metric both tables have the column `value` in the place of `cost`, and `lower_bound` stays a \
cost. Every trial carries its origin, SITE/studies/ID@UID/trials/NUMBER, by whose identity UID an import \
recognises it.

Examples:
  treewright export sponza --out sponza.jsonl
  treewright export sponza --format parquet --out sponza.parquet
  treewright export sponza --format csv --filter 'outcome = OK' > sponza.csv";

pub(crate) const IMPORT_HELP: &str = "\
Trials are added with the results they had elsewhere; nothing is run. Each keeps its machine, client and \
origin. Trials that came from this study, or were imported before, are skipped, so databases of several \
sites can be merged in any order and as often as you like. Only trials with a result are imported: OK, \
INFEASIBLE and ABORTED. Excluded ones are not.

A CSV or Parquet file needs columns config.NAME, indicator.NAME and measurement.NAME. Optional columns \
are standard_error.NAME, outcome (OK, INFEASIBLE, ABORTED), lower_bound, client_id, origin and exclusion. An \
exported Parquet file also contains the study; for other tables, name it with --study.

--optuna-study reads a database of Optuna (RDB storage in SQLite), and --vizier-study one of OSS Vizier. \
If the study does not exist, it is created with the other one's parameters; else its first metric gets the \
objective's values.

Examples:
  treewright import sponza.jsonl
  treewright import farm-b.parquet --study sponza
  treewright import measured.csv --study zstd
  treewright import optuna.db --optuna-study no-name-1 --study mine
  treewright import vizier.db --vizier-study owners/me/studies/mine --study mine";

pub(crate) const ANALYZE_HELP: &str = "\
For every parameter and measurement: correlation, rank correlation, mutual information and \
variance-based sensitivity; maps of pairs; and ranges that keep the best trials. Costs are compared \
within their state. Random trials work best: record them with treewright-render sample.

Examples:
  treewright analyze sample-paper --condition 'config.compact = false' --out analysis
  treewright analyze sample-paper --filter 'indicator.triangles = 262267' --metric render_ms
  treewright analyze sponza --map intersection_cost,traversal_cost";

/// The study to analyse, and the form of the result.
#[derive(Debug, Args)]
pub(crate) struct Analyze {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    /// Only trials that match, as for `trials`
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// Repeat the analysis for only the trials that match, e.g. `config.compact = false`; can be repeated
    #[arg(long = "condition", value_name = "FILTER")]
    pub(crate) conditions: Vec<String>,
    /// A measurement, or a sum written A+B; can be repeated. Default: all
    #[arg(long = "metric", value_name = "NAME")]
    pub(crate) metrics: Vec<String>,
    /// Two parameters to map against each other; can be repeated. Default: those that the study orders
    #[arg(long = "map", value_name = "NAME,NAME", value_parser = names)]
    pub(crate) maps: Vec<(String, String)>,
    /// Write analysis.json and analysis.html to this folder
    #[arg(long, value_name = "FOLDER")]
    pub(crate) out: Option<PathBuf>,
}

/// Which front.
#[derive(Debug, Args)]
pub(crate) struct FrontOf {
    /// The study's id
    pub(crate) study: String,
    /// Two or three measurements; 1/rate for one that is to be large. Default: those that the study was made
    /// for
    #[arg(long, value_name = "METRIC,METRIC", value_delimiter = ',')]
    pub(crate) metrics: Vec<String>,
    /// Number of the state, as shown by `trials`
    #[arg(long, value_name = "NUMBER")]
    pub(crate) state: Option<i64>,
    /// A value of each metric, to which the hypervolume refers. Default: what the default measured
    #[arg(long, value_name = "NUMBER,NUMBER", value_delimiter = ',', value_parser = positive)]
    pub(crate) reference: Vec<f64>,
    /// Draw the front to this file
    #[arg(long, value_name = "FILE")]
    pub(crate) svg: Option<PathBuf>,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    number.ok_or_else(|| format!("`{text}` is not a number above 0"))
}

/// `NAME,NAME`.
fn names(text: &str) -> Result<(String, String), String> {
    let (a, b) = text.split_once(',').ok_or("write it as NAME,NAME")?;
    Ok((a.trim().to_owned(), b.trim().to_owned()))
}

/// Which trials.
#[derive(Debug, Args)]
pub(crate) struct Trials {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    /// Only trials that match
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// `number`, `cost` or `measurement.NAME`, optionally followed by ` desc`
    #[arg(long, default_value = "", value_name = "FIELD")]
    pub(crate) order_by: String,
    /// Only trials with a higher number, for the next page
    #[arg(long, value_name = "NUMBER")]
    pub(crate) after: Option<u64>,
    /// Maximum number of trials
    #[arg(long, default_value_t = 50, value_name = "COUNT")]
    pub(crate) limit: usize,
    /// Show all trials
    #[arg(long, conflicts_with = "limit")]
    pub(crate) all: bool,
    /// Output format; --json means --format json
    #[arg(long, value_enum, default_value = "table")]
    pub(crate) format: TrialFormat,
}

/// How trials are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TrialFormat {
    /// For people
    Table,
    /// A JSON list
    Json,
    /// A column for each parameter, indicator and measurement
    Csv,
}

/// The study to write, and the file.
#[derive(Debug, Args)]
pub(crate) struct Export {
    /// The study's id
    pub(crate) study: String,
    /// File format
    #[arg(long, value_enum, default_value = "jsonl")]
    pub(crate) format: ExportFormat,
    /// File to write. Default: standard output
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(long, requires = "out")]
    pub(crate) overwrite: bool,
    /// Only trials for which this holds, as for `trials`
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// Name of this database in the trials' origins. Default: the machine's name
    #[arg(long, value_name = "NAME")]
    pub(crate) site: Option<String>,
}

/// Forms of exported studies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// JSON Lines, with everything
    Jsonl,
    /// Comma-separated values: a table, without the study and the machines
    Csv,
    /// Apache Parquet: a table with types, with the study and the machines
    #[cfg(feature = "parquet")]
    Parquet,
}

/// The file to read, and its place.
#[derive(Debug, Args)]
pub(crate) struct Import {
    /// File to read: JSON Lines, Parquet (.parquet), CSV (.csv), or an SQLite database of Optuna or Vizier
    pub(crate) file: PathBuf,
    /// Study to import into. Default: the study in the file
    #[arg(long, value_name = "ID")]
    pub(crate) study: Option<String>,
    /// Name of this database in origins; the machine's name when left out
    #[arg(long, value_name = "NAME")]
    pub(crate) site: Option<String>,
    /// Value of an indicator that the file lacks; can be repeated
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// The study in Optuna's database
    #[arg(long, value_name = "NAME", requires = "study")]
    pub(crate) optuna_study: Option<String>,
    /// The study in Vizier's database
    #[arg(long, value_name = "NAME", requires = "study", conflicts_with = "optuna_study")]
    pub(crate) vizier_study: Option<String>,
    /// Check the file without importing anything
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// The studies to watch.
#[derive(Debug, Args)]
pub(crate) struct Watch {
    /// The study's id. Default: all studies
    pub(crate) study: Option<String>,
    /// Time between updates
    #[arg(long, default_value = "1s", value_name = "TIME", value_parser = humantime::parse_duration)]
    pub(crate) every: Duration,
    /// Show the current state once and exit
    #[arg(long)]
    pub(crate) once: bool,
}
