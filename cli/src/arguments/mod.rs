//! The commands of `treewright` and their arguments. `study`, `exec` and `data` hold those of one field each.

pub(crate) mod data;
pub(crate) mod exec;
pub(crate) mod study;

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use treewright_client::{CredentialArguments, Value};

use data::{Analyze, Export, FrontOf, Import, Trials, Watch};
use exec::{EXEC_EXAMPLES, Exec, Report, Suggest};
use study::{Pin, Policy, StudyCommand};

const EXAMPLES: &str = "\
Examples:
  treewright exec zstd --tune 'level=1..19:3' --confirm -- zstd -{level} -kf data.tar
  treewright studies
  treewright best sponza --state 3
  treewright trials sponza --filter 'state = COMPLETED AND cost < 12.5' --order-by cost --limit 10
  treewright policy sponza --epsilon 0.1
  treewright --json trials sponza | jq '.[].cost'

Exit codes:
  0  done
  1  the operation failed, e.g. the study does not exist
  2  wrong usage
  3  the daemon cannot be reached
";

/// Tunes programs, and inspects and controls a tuning daemon: studies, trials, best configurations, policies
#[derive(Debug, Parser)]
#[command(name = "treewright", version, after_help = EXAMPLES, max_term_width = 100)]
pub(crate) struct Arguments {
    /// Address of the daemon, e.g. http://127.0.0.1:50611; separate several that share a database by commas.
    /// `local` is a daemon of your own, started when needed. Default: the daemon on port 50611 of this
    /// machine, or else `local`
    #[arg(long, global = true, env = "TREEWRIGHT_SERVER", value_name = "URLS", help_heading = "Connection")]
    pub(crate) server: Option<String>,

    /// Print JSON, for scripts
    #[arg(long, global = true, help_heading = "Output")]
    pub(crate) json: bool,

    /// How long to wait for the daemon, e.g. 500ms or 10s
    #[arg(
        long,
        global = true,
        value_name = "TIME",
        default_value = "5s",
        value_parser = humantime::parse_duration,
        help_heading = "Connection"
    )]
    pub(crate) timeout: Duration,

    #[command(flatten)]
    pub(crate) credentials: CredentialArguments,

    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The command.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Tunes any program by running it with different configurations
    #[command(after_help = EXEC_EXAMPLES)]
    Exec(Exec),
    /// Asks for the next configuration of a study
    #[command(after_help = "\
Example:
  eval \"$(treewright suggest zstd)\"
  zstd -$TREEWRIGHT_PARAM_LEVEL -kf data.tar
  treewright report \"$TREEWRIGHT_TRIAL\" wall_ms=812.5")]
    Suggest(Suggest),
    /// Reports the result of a trial
    #[command(after_help = "\
Examples:
  treewright report studies/zstd/trials/12 wall_ms=812.5 bytes=4711
  treewright report studies/zstd/trials/12 --infeasible 'out of memory'
  treewright report studies/zstd/trials/12 --abandon")]
    Report(Report),
    /// Lists all studies
    Studies {
        /// Also show in how many states something better than the default is proven, and the median gain
        #[arg(long)]
        standing: bool,
        /// Only studies with all these tags, which `treewright study edit --tag` sets
        #[arg(long = "tag", value_name = "TAG,…", value_delimiter = ',')]
        tags: Vec<String>,
    },
    /// Creates, shows, changes, copies, renames or deletes a study
    #[command(subcommand)]
    Study(StudyCommand),
    /// Lists the trials of a study
    #[command(after_help = data::TRIALS_HELP)]
    Trials(Trials),
    /// Shows how each parameter affects each measurement, and which ranges keep the best trials
    #[command(after_help = data::ANALYZE_HELP)]
    Analyze(Analyze),
    /// Shows the configurations that nothing is better than in all of two or three measurements
    #[command(after_help = "\
Examples:
  treewright front toy --svg front.svg
  treewright front sponza --metrics build_ms,render_ms --state 3")]
    Front(FrontOf),
    /// Shows the best known configuration of each state
    #[command(after_help = "\
Examples:
  treewright best sponza --indicator triangles=262267
  treewright best sponza --state 3")]
    Best(State),
    /// Predicts the best configuration of a state, without recording anything
    #[command(after_help = "Example:\n  treewright predict sponza --indicator triangles=262267")]
    Predict(State),
    /// Explains the answer for a state, or a trial (STUDY/trials/NUMBER): the rule, the expected gain, the
    /// noise, what is left out
    #[command(after_help = "\
Examples:
  treewright explain sponza --indicator triangles=262267
  treewright explain sponza --state 3
  treewright explain studies/sponza/trials/12")]
    Explain(State),
    /// Shows or changes the policy of a study; fields that you do not name stay as they are
    #[command(after_help = "\
Examples:
  treewright policy sponza
  treewright policy sponza --epsilon 0.1 --search nelder-mead
  treewright policy sponza --regret-budget 0.05 --abort-above 1.5
  treewright policy sponza --clear regret_budget,operation")]
    Policy(Policy),
    /// Gives every client one configuration: the one you name, or the best known
    #[command(
        after_help = "Examples:\n  treewright pin sponza max_depth=32 compact=true\n  treewright pin sponza"
    )]
    Pin(Pin),
    /// Ends `pin`
    Unpin {
        /// The study's id
        study: String,
    },
    /// Freezes a study: it answers from what it knows, without exploring or learning
    Freeze {
        /// The study's id
        study: String,
    },
    /// Ends `freeze`
    Thaw {
        /// The study's id
        study: String,
    },
    /// Excludes a completed trial, e.g. of a disturbed machine: it is kept, and nothing is learnt from it
    #[command(
        after_help = "Example:\n  treewright exclude studies/zstd/trials/12 'another program ran beside it'"
    )]
    Exclude {
        /// The trial's name, STUDY/trials/NUMBER
        trial: String,
        /// Why it does not count
        reason: String,
    },
    /// Ends `exclude`: the trial counts again
    Include {
        /// The trial's name, STUDY/trials/NUMBER
        trial: String,
    },
    /// Writes a study and its trials to a file
    #[command(after_help = data::EXPORT_HELP)]
    Export(Export),
    /// Adds trials from a file to a study; trials that are already there are skipped
    #[command(after_help = data::IMPORT_HELP)]
    Import(Import),
    /// Shows a study live: best configuration, gain, trials per second, clients, leases
    Watch(Watch),
    /// Checks this machine, the programs and the daemon, and says what is wrong
    Doctor,
    /// Checks whether the daemon answers
    Ping,
    /// Prints the completion script for a shell
    #[command(
        after_help = "Example:\n  treewright completions bash > ~/.local/share/bash-completion/completions/treewright"
    )]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Writes the manual pages
    Man {
        /// Folder to write them to
        folder: PathBuf,
    },
}

/// A study and a state.
#[derive(Debug, Args)]
pub(crate) struct State {
    /// The study's id, e.g. `sponza`
    pub(crate) study: String,
    /// Value of an indicator; repeat for each indicator of the study
    #[arg(long = "indicator", value_name = "NAME=NUMBER", value_parser = indicator)]
    pub(crate) indicators: Vec<(String, f64)>,
    /// Number of the state, as shown by `trials`
    #[arg(long, value_name = "NUMBER", conflicts_with = "indicators")]
    pub(crate) state: Option<i64>,
}

/// `NAME=NUMBER`.
pub(crate) fn indicator(text: &str) -> Result<(String, f64), String> {
    let (name, number) = pair(text)?;
    match number.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok((name, value)),
        _ => Err(format!("`{number}` is not a finite number")),
    }
}

/// `NAME=VALUE`.
pub(crate) fn parameter(text: &str) -> Result<(String, Value), String> {
    let (name, value) = pair(text)?;
    Ok((name, Value::parse(value)))
}

fn pair(text: &str) -> Result<(String, &str), String> {
    let (name, value) = text.split_once('=').ok_or("write it as NAME=VALUE")?;
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
        assert_eq!(read(&[]).unwrap(), treewright_client::Policy::new());
        let paper = read(&["--epsilon", "0.5", "--preset", "paper"]).unwrap();
        assert_eq!(paper, treewright_client::Policy::paper().epsilon(0.5));
        assert!(read(&["--search", "best"]).unwrap_err().contains("nelder-mead"));
        assert!(read(&["--epsilon", "often"]).unwrap_err().contains("`often` is not a number"));
        let help = Arguments::try_parse_from(["treewright", "policy", "--help"]).unwrap_err().to_string();
        for field in treewright_client::Policy::FIELDS.iter().filter(|field| field.name != "pinned") {
            assert!(help.contains(&format!("--{} <", field.name.replace('_', "-"))), "{}", field.name);
        }
    }

    #[test]
    fn only_credentials_stand_under_security() {
        let mut command = Arguments::command();
        command.build();
        let check = |command: &clap::Command| {
            for argument in command.get_arguments() {
                let is_credential =
                    ["token_file", "tls_ca", "tls_cert", "tls_key"].contains(&argument.get_id().as_str());
                let is_security = argument.get_help_heading() == Some("Security");
                assert_eq!(is_security, is_credential, "{} of {}", argument.get_id(), command.get_name());
            }
        };
        check(&command);
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn pairs_are_read() {
        assert_eq!(indicator("triangles=1e6").unwrap(), ("triangles".into(), 1e6));
        assert!(indicator("triangles=nan").unwrap_err().contains("finite"));
        assert_eq!(parameter("compact = true").unwrap(), ("compact".into(), Value::from(true)));
        assert!(parameter("compact").is_err());
    }
}
