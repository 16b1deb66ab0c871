//! The command line of `treewrightd token`.

use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use treewright_core::words::Word as _;
use treewright_store::tokens::{Quota, Scope, Studies};

use super::database::DatabaseConfig;
use crate::convert::names;

/// The commands for tokens.
#[derive(Debug, Subcommand)]
pub enum TokenCommand {
    /// Create a token and print it. It cannot be shown again: only its hash is stored.
    #[command(after_help = "\
Examples:
  treewrightd token create --database tuning.db --name operator --scope admin
  treewrightd token create --database tuning.db --name farm-3 --scope tune --study 'farm-3-*' \\
      --expires 90d --requests-per-s 500 --trials-per-day 1000000 > farm-3.token
  treewrightd token create --database postgres://treewright@db/treewright \\
      --database-password-file password --name watcher --scope read")]
    Create(Box<CreateConfig>),
    /// List all tokens, without their secrets.
    List {
        /// The database.
        #[command(flatten)]
        database: DatabaseConfig,
        /// Print JSON, for scripts.
        #[arg(long)]
        json: bool,
    },
    /// Revoke a token, at once and for good.
    Revoke {
        /// The database.
        #[command(flatten)]
        database: DatabaseConfig,
        /// The token's id, as `list` shows it.
        id: String,
        /// Also delete its record from the database.
        #[arg(long)]
        forget: bool,
    },
}

/// The token to make.
#[derive(Debug, Args)]
pub struct CreateConfig {
    /// The database.
    #[command(flatten)]
    pub database: DatabaseConfig,

    /// Description of its holder, at most 100 characters.
    #[arg(long, value_parser = token_name)]
    pub name: String,

    /// The scope of the token.
    #[arg(long, value_parser = scope())]
    pub scope: Scope,

    /// Only for this study, or for all studies whose id starts with the text before a final `*`. Can be
    /// repeated. Default: all studies.
    #[arg(long = "study", value_name = "ID", value_parser = pattern)]
    pub studies: Vec<String>,

    /// Lifetime, e.g. 12h or 90d. Default: unlimited.
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub expires: Option<Duration>,

    /// Maximum requests and stream frames per second.
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub requests_per_s: Option<u32>,

    /// Maximum number of studies it may create.
    #[arg(long, value_name = "COUNT")]
    pub max_studies: Option<u64>,

    /// Maximum number of trials in total.
    #[arg(long, value_name = "COUNT")]
    pub max_trials: Option<u64>,

    /// Maximum number of trials per day (UTC).
    #[arg(long, value_name = "COUNT")]
    pub trials_per_day: Option<u64>,

    /// Maximum bytes of requests per day (UTC).
    #[arg(long, value_name = "BYTES")]
    pub bytes_per_day: Option<u64>,
}

impl CreateConfig {
    /// The studies it is good for.
    pub fn reach(&self) -> Studies {
        Studies(self.studies.clone())
    }

    /// The quota of the new token.
    pub fn quota(&self) -> Quota {
        Quota {
            requests_per_s: self.requests_per_s,
            studies: self.max_studies,
            trials: self.max_trials,
            trials_per_day: self.trials_per_day,
            bytes_per_day: self.bytes_per_day,
        }
    }
}

/// Reads a scope, as it is written on the command line.
fn scope() -> impl TypedValueParser<Value = Scope> {
    let scopes = [
        ("read", "Read studies and trials, and predict"),
        ("tune", "Also create studies and tune"),
        ("admin", "Also change policies and spaces, exclude trials, rename and delete studies"),
    ];
    PossibleValuesParser::new(scopes.map(|(word, about)| PossibleValue::new(word).help(about)))
        .map(|word| Scope::from_word(&word.to_uppercase()).expect("clap passes on what is possible"))
}

fn token_name(text: &str) -> Result<String, String> {
    let characters = text.chars().count();
    if (1..=100).contains(&characters) && !text.chars().any(char::is_control) {
        return Ok(text.to_owned());
    }
    Err("it must have 1 to 100 printable characters".to_owned())
}

/// A study's id, or the beginning of ids with a `*` behind it.
fn pattern(text: &str) -> Result<String, String> {
    let id = text.strip_suffix('*').unwrap_or(text);
    names::study_id("study", id).map(|_| text.to_owned()).map_err(|error| error.to_string())
}
