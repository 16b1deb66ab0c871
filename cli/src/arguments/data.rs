//! Arguments of what lists, exports, imports and watches trials.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

use super::indicator;

pub(crate) const TRIALS_HELP: &str = "\
Filter: comparisons joined by AND, with = != < <= > >=, text in double quotes. Fields: state (OPEN,
COMPLETED, ABANDONED, EXPIRED), mode (DEFAULT, EXPLORE, EXPLOIT, PINNED), outcome (OK, INFEASIBLE,
ABORTED, FAILED), client_id, state_id, number, cost, late, measurement.NAME, config.NAME, indicator.NAME.

Examples:
  treewright trials sponza --order-by cost --limit 5
  treewright trials sponza --after 50
  treewright trials sponza --filter 'outcome = INFEASIBLE AND config.max_depth < 20'
  treewright trials sponza --format csv --all > trials.csv";

pub(crate) const EXPORT_HELP: &str = "\
JSON Lines hold all: the first line is the study, as `study show --format json` has it, every further one
a trial. CSV has a column for each parameter, indicator and measurement. Every trial carries its origin,
SITE/studies/ID/trials/NUMBER, by which an import knows it again.

Examples:
  treewright export sponza --out sponza.jsonl
  treewright export sponza --format csv --filter 'outcome = OK' > sponza.csv";

pub(crate) const IMPORT_HELP: &str = "\
Trials are added with the result that they had elsewhere: nothing is run. Each keeps its machine, its
client and its origin; one that came from this study, or was imported before, is passed over, so that
databases of several sites can be merged in any order and as often as wished. Only trials with a result
are taken: OK, INFEASIBLE and ABORTED.

A CSV file needs a header: config.NAME, indicator.NAME, measurement.NAME, and if wished outcome (OK,
INFEASIBLE, ABORTED), lower_bound, client_id, origin. A database of Optuna (RDB storage in SQLite) is read with
--optuna-study, one of OSS Vizier with --vizier-study; the objective becomes the study's first metric,
and a study that does not exist is created after the other one's parameters.

Examples:
  treewright import sponza.jsonl
  treewright import farm-b.jsonl --study sponza
  treewright import measured.csv --study zstd
  treewright import optuna.db --optuna-study no-name-1 --study mine
  treewright import vizier.db --vizier-study owners/me/studies/mine --study mine";

pub(crate) const ANALYZE_HELP: &str = "\
Correlation, rank correlation, mutual information and variance-based sensitivity of every parameter with every
measurement, maps of pairs, and ranges that keep the best trials. Costs are compared within their state.
Trials drawn at random say most: treewright-render sample records them.

Examples:
  treewright analyze sample-paper --condition 'config.compact = false' --out analysis
  treewright analyze sample-paper --filter 'indicator.triangles = 262267' --metric render_ms
  treewright analyze sponza --map intersection_cost,traversal_cost";

/// What to analyse.
#[derive(Debug, Args)]
pub(crate) struct Analyze {
    /// The study's id, e.g. `sample-paper`
    pub(crate) study: String,
    /// Only trials for which this holds, as for `trials`
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// Look once more at only those trials for which this holds, e.g. `config.compact = false`; may be given several times
    #[arg(long = "condition", value_name = "FILTER")]
    pub(crate) conditions: Vec<String>,
    /// A measurement, or a sum written A+B; may be given several times. All that there are when left out
    #[arg(long = "metric", value_name = "NAME")]
    pub(crate) metrics: Vec<String>,
    /// Two parameters to draw a map of; may be given several times. Those that the study orders when left out
    #[arg(long = "map", value_name = "NAME,NAME", value_parser = names)]
    pub(crate) maps: Vec<(String, String)>,
    /// Write analysis.json and analysis.html into this folder
    #[arg(long, value_name = "FOLDER")]
    pub(crate) out: Option<PathBuf>,
}

/// `NAME,NAME`.
fn names(text: &str) -> Result<(String, String), String> {
    let (a, b) = text.split_once(',').ok_or("it must be written NAME,NAME")?;
    Ok((a.trim().to_owned(), b.trim().to_owned()))
}

/// Which trials.
#[derive(Debug, Args)]
pub(crate) struct Trials {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    /// Only trials for which this holds
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// `number`, `cost` or `measurement.NAME`, each with an optional ` desc`
    #[arg(long, default_value = "", value_name = "FIELD")]
    pub(crate) order_by: String,
    /// Only trials with a higher number: the next page of a list by number
    #[arg(long, value_name = "NUMBER")]
    pub(crate) after: Option<u64>,
    /// At most so many
    #[arg(long, default_value_t = 50, value_name = "COUNT")]
    pub(crate) limit: usize,
    /// All that there are
    #[arg(long, conflicts_with = "limit")]
    pub(crate) all: bool,
    /// How to write them; --json is --format json
    #[arg(long, value_enum, default_value = "table")]
    pub(crate) format: TrialFormat,
}

/// How trials are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TrialFormat {
    /// For people
    Table,
    /// One list
    Json,
    /// A column for each parameter, indicator and measurement
    Csv,
}

/// What to write.
#[derive(Debug, Args)]
pub(crate) struct Export {
    /// The study's id
    pub(crate) study: String,
    /// In which form
    #[arg(long, value_enum, default_value = "jsonl")]
    pub(crate) format: ExportFormat,
    /// Into this file; else to standard output
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Only trials for which this holds, as for `trials`
    #[arg(long, default_value = "")]
    pub(crate) filter: String,
    /// What this database is called in origins; the machine's name when left out
    #[arg(long, value_name = "NAME")]
    pub(crate) site: Option<String>,
}

/// Forms of exported studies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// JSON Lines, with everything
    Jsonl,
    /// Comma-separated values, for tables
    Csv,
}

/// What to read.
#[derive(Debug, Args)]
pub(crate) struct Import {
    /// JSON Lines, CSV, or a SQLite database of Optuna or Vizier
    pub(crate) file: PathBuf,
    /// The study to import into; that of the file when left out
    #[arg(long, value_name = "ID")]
    pub(crate) study: Option<String>,
    /// What this database is called in origins; the machine's name when left out
    #[arg(long, value_name = "NAME")]
    pub(crate) site: Option<String>,
    /// An indicator that the file does not have; once for each
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// The study in Optuna's database
    #[arg(long, value_name = "NAME", requires = "study")]
    pub(crate) optuna_study: Option<String>,
    /// The study in Vizier's database
    #[arg(long, value_name = "NAME", requires = "study", conflicts_with = "optuna_study")]
    pub(crate) vizier_study: Option<String>,
    /// Read and check everything, and import nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// What to watch.
#[derive(Debug, Args)]
pub(crate) struct Watch {
    /// The study's id; all studies when left out
    pub(crate) study: Option<String>,
    /// Look so often
    #[arg(long, default_value = "1s", value_name = "TIME", value_parser = humantime::parse_duration)]
    pub(crate) every: Duration,
    /// Look once, and end
    #[arg(long)]
    pub(crate) once: bool,
}
