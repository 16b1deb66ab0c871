//! What the command line `treewright` understands: its commands and their arguments.

use std::time::Duration;

use clap::{ArgGroup, Args, Parser, Subcommand};
use treewright_client::{CredentialArguments, Value};

use crate::setting_flags::{SettingFlags, change_arguments};

const EXAMPLES: &str = "\
Examples:
  treewright studies
  treewright best sponza
  treewright trials sponza --filter 'state = COMPLETED AND cost < 12.5' --order-by cost --limit 10
  treewright predict sponza --indicator triangles=262267 --indicator camera_distance=12.5
  treewright policy sponza --epsilon 0.1 --pin max_depth=32,compact=true
  treewright --json trials sponza | jq '.[].cost'

Exit codes:
  0  done
  1  the operation failed, e.g. there is no such study
  2  the command line makes no sense
  3  the daemon cannot be reached
";

/// Looks at a tuning daemon: studies, trials, the best configurations, and the policy.
#[derive(Debug, Parser)]
#[command(name = "treewright", version, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Where the daemon listens; several on one database are parted by commas
    #[arg(
        long,
        global = true,
        env = "TREEWRIGHT_SERVER",
        value_name = "URLS",
        default_value = "http://127.0.0.1:50611"
    )]
    pub(crate) server: String,

    /// Print JSON, for scripts
    #[arg(long, global = true)]
    pub(crate) json: bool,

    /// How long to wait for the daemon, e.g. 500ms or 10s
    #[arg(long, global = true, value_name = "TIME", default_value = "5s", value_parser = humantime::parse_duration)]
    pub(crate) timeout: Duration,

    #[command(flatten)]
    pub(crate) credentials: CredentialArguments,

    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Lists the studies
    Studies,
    /// Shows or deletes one study
    #[command(subcommand)]
    Study(StudyCommand),
    /// Lists a study's trials
    #[command(after_help = "\
Filter: comparisons joined by AND, with = != < <= > >=, text in double quotes. Fields: state (OPEN,
COMPLETED, ABANDONED, EXPIRED), mode (DEFAULT, EXPLORE, EXPLOIT, PINNED), outcome (OK, INFEASIBLE,
ABORTED, FAILED), client_id, state_id, number, cost, late, measurement.NAME, config.NAME, indicator.NAME.

Examples:
  treewright trials sponza --order-by cost --limit 5
  treewright trials sponza --filter 'outcome = INFEASIBLE AND config.max_depth < 20'
  treewright trials sponza --order-by 'measurement.render_ms desc'")]
    Trials(Trials),
    /// Shows the best known configuration, of one state or of all
    #[command(after_help = "Example:\n  treewright best sponza --indicator triangles=262267")]
    Best(State),
    /// Shows what would be exploited for a state; writes nothing
    #[command(after_help = "Example:\n  treewright predict sponza --indicator triangles=262267")]
    Predict(State),
    /// Tells why a state is answered as it is: the rule, the gain to expect, noise, and what is left out
    #[command(after_help = "Example:\n  treewright explain sponza --indicator triangles=262267")]
    Explain(State),
    /// Changes how a study decides; fields that are not named stay as they are
    #[command(after_help = "\
Examples:
  treewright policy sponza --epsilon 0.1 --search nelder-mead
  treewright policy sponza --pin max_depth=32,compact=true
  treewright policy sponza --unpin
  treewright policy sponza --regret-budget 0.05 --abort-above 1.5
  treewright policy sponza --operation freeze
  treewright policy sponza --clear regret_budget,operation")]
    Policy(Policy),
    /// Asks whether the daemon serves
    Ping,
}

/// What to do with one study.
#[derive(Debug, Subcommand)]
pub(crate) enum StudyCommand {
    /// Shows its space, indicators, objective and policy
    Show {
        /// Its id, e.g. `sponza`
        name: String,
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
    /// At most so many
    #[arg(long, default_value_t = 50, value_name = "COUNT")]
    pub(crate) limit: usize,
}

/// A study and a state.
#[derive(Debug, Args)]
pub(crate) struct State {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    /// An indicator's raw value; once for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
}

/// A change of policy.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("change").required(true).multiple(true).args(change_arguments()))]
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

fn indicator(text: &str) -> Result<(String, f64), String> {
    let (name, number) = pair(text)?;
    match number.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok((name, value)),
        _ => Err(format!("`{number}` is not a finite number")),
    }
}

fn parameter(text: &str) -> Result<(String, Value), String> {
    let (name, value) = pair(text)?;
    Ok((name, Value::parse(value)))
}

fn pair(text: &str) -> Result<(String, &str), String> {
    let (name, value) = text.split_once('=').ok_or("it must be written NAME=VALUE")?;
    Ok((name.trim().to_owned(), value.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn every_field_of_a_policy_has_a_flag() {
        let read = |arguments: &[&str]| {
            let all = ["treewright", "policy", "sponza"].iter().chain(arguments);
            match Arguments::try_parse_from(all).map(|arguments| arguments.command) {
                Ok(Command::Policy(policy)) => Ok(policy.settings.0),
                Ok(other) => panic!("{other:?}"),
                Err(error) => Err(error.to_string()),
            }
        };
        let set = read(&["--search", "nelder-mead", "--lease-s", "5", "--weigh-gain", "true"]).unwrap();
        assert_eq!(
            set,
            treewright_client::Policy::new()
                .search(treewright_client::SearchMethod::NelderMead)
                .lease_s(5)
                .weigh_gain(true)
        );
        assert!(read(&[]).unwrap_err().contains("--epsilon"));
        assert!(read(&["--search", "best"]).unwrap_err().contains("nelder-mead"));
        assert!(read(&["--epsilon", "often"]).unwrap_err().contains("`often` is not a number"));
        let help = Arguments::try_parse_from(["treewright", "policy", "--help"]).unwrap_err().to_string();
        for field in treewright_client::Policy::FIELDS.iter().filter(|field| field.name != "pinned") {
            assert!(help.contains(&format!("--{} <", field.name.replace('_', "-"))), "{}", field.name);
        }
    }

    #[test]
    fn pairs_are_read() {
        assert_eq!(indicator("triangles=1e6").unwrap(), ("triangles".into(), 1e6));
        assert!(indicator("triangles=nan").unwrap_err().contains("finite"));
        assert_eq!(parameter("compact = true").unwrap(), ("compact".into(), Value::from(true)));
        assert!(parameter("compact").is_err());
    }
}
