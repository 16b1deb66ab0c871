//! Credentials as command line arguments, for every program that talks to a daemon.

use std::path::PathBuf;

use crate::{ClientError, Credentials};

/// The environment variable that holds a token. There is no argument for it: every user of a machine can read
/// the arguments of every program.
const TOKEN_VARIABLE: &str = "TREEWRIGHT_TOKEN";

/// The arguments that only an address with TLS uses.
const TLS_ARGUMENTS: [&str; 3] = ["tls_ca", "tls_cert", "tls_key"];

/// Token and certificates. The heading stands at each argument: one for the whole would also hold for what a
/// program lists after them.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct CredentialArguments {
    /// File with the token. Default: the variable TREEWRIGHT_TOKEN
    #[arg(
        long,
        global = true,
        help_heading = "Security",
        env = "TREEWRIGHT_TOKEN_FILE",
        value_name = "FILE"
    )]
    pub token_file: Option<PathBuf>,

    /// CA certificate for checking the daemon's certificate, in PEM. Default: the system's
    #[arg(long, global = true, help_heading = "Security", env = "TREEWRIGHT_TLS_CA", value_name = "FILE")]
    pub tls_ca: Option<PathBuf>,

    /// Client certificate, in PEM, for daemons that require one
    #[arg(
        long,
        global = true,
        help_heading = "Security",
        env = "TREEWRIGHT_CLIENT_CERT",
        value_name = "FILE",
        requires = "tls_key"
    )]
    pub tls_cert: Option<PathBuf>,

    /// Private key of the client certificate, in PEM
    #[arg(
        long,
        global = true,
        help_heading = "Security",
        env = "TREEWRIGHT_CLIENT_KEY",
        value_name = "FILE",
        requires = "tls_cert"
    )]
    pub tls_key: Option<PathBuf>,
}

impl CredentialArguments {
    /// Reads what the arguments name.
    ///
    /// Errors: [`ClientError::Invalid`] for a file that cannot be read or has the wrong contents.
    pub fn credentials(&self) -> Result<Credentials, ClientError> {
        let mut credentials = Credentials::new();
        if let Some(path) = &self.token_file {
            credentials = credentials.token_file(path)?;
        } else if let Some(token) = std::env::var(TOKEN_VARIABLE).ok().filter(|token| !token.is_empty()) {
            credentials = credentials.token(&token)?;
        }
        if let Some(path) = &self.tls_ca {
            credentials = credentials.authority_file(path)?;
        }
        if let (Some(certificate), Some(key)) = (&self.tls_cert, &self.tls_key) {
            credentials = credentials.certificate_files(certificate, key)?;
        }
        Ok(credentials)
    }
}

/// The process's arguments, and the environment where a variable holds something. TLS settings of the
/// environment are left out where an address among the arguments has no TLS. Ends the process where they are
/// wrong.
pub fn parse_arguments<T: clap::Parser>() -> T {
    let mut command = without_empty_variables(T::command());
    let mut matches = command.get_matches_mut();
    let mut chosen = &matches;
    while let Some((_, inner)) = chosen.subcommand() {
        chosen = inner;
    }
    if overrules_tls(chosen) {
        command = without_tls_variables(without_empty_variables(T::command()));
        matches = command.get_matches_mut();
    }
    T::from_arg_matches(&matches).unwrap_or_else(|error| error.format(&mut command).exit())
}

/// Whether the argument `server` overrules the TLS settings, which are for another daemon then and are left
/// out. Then its addresses have no TLS, and it comes from a place that goes before theirs. Where one of them
/// comes from the place of the address, or goes before it, all stay, and connecting refuses them. `matches`
/// are those of the command that has the arguments.
fn overrules_tls(matches: &clap::ArgMatches) -> bool {
    let Ok(Some(server)) = matches.try_get_one::<String>("server") else { return false };
    let has_tls = server.split(',').any(|url| url.trim().starts_with("https://"));
    let place = matches.value_source("server");
    // A command with an address may have no credentials.
    let is_given = |name: &str| matches.try_contains_id(name).is_ok_and(|is_given| is_given);
    let is_lower = |name: &str| !is_given(name) || matches.value_source(name) < place;
    !has_tls && TLS_ARGUMENTS.iter().all(|name| is_lower(name))
}

/// The command, which reads no TLS settings from the environment.
fn without_tls_variables(command: clap::Command) -> clap::Command {
    without_variables(command, &|argument| TLS_ARGUMENTS.contains(&argument.get_id().as_str()))
}

/// The command, for which an empty variable is as one that is not set: `VARIABLE=` in a file of settings, or
/// `${VARIABLE:-}` in one for containers, means just that.
fn without_empty_variables(command: clap::Command) -> clap::Command {
    without_variables(command, &|argument| {
        argument.get_env().and_then(std::env::var_os).is_some_and(|value| value.is_empty())
    })
}

/// The command, whose arguments of this kind are not read from the environment.
fn without_variables(command: clap::Command, is_meant: &dyn Fn(&clap::Arg) -> bool) -> clap::Command {
    let command = command
        .mut_args(|argument| if is_meant(&argument) { argument.env(None::<&'static str>) } else { argument });
    command.mut_subcommands(|inner| without_variables(inner, is_meant))
}

#[cfg(test)]
mod tests {
    use clap::{Arg, Args as _, Command};

    use super::*;

    #[test]
    fn an_address_overrules_tls_settings_of_lower_places_and_no_others() {
        let server = Arg::new("server").long("server").default_value("http://a:1");
        let own = CredentialArguments::augment_args(Command::new("own").arg(server));
        let overrules = |command: &Command, line: &[&str]| {
            let line = ["own"].iter().chain(line);
            overrules_tls(&command.clone().try_get_matches_from(line).expect("a command line"))
        };
        let lower = own.clone().mut_arg("tls_ca", |argument| argument.default_value("ca.pem"));
        for url in ["http://b:1", "unix:/run/a.sock,http://b:1"] {
            assert!(overrules(&lower, &["--server", url]), "{url}");
        }
        assert!(!overrules(&lower, &["--server", "http://b:1,https://c:1"]));
        assert!(!overrules(&lower, &[]), "both are defaults");
        assert!(!overrules(&lower, &["--server", "http://b:1", "--tls-ca", "d.pem"]));
        assert!(!overrules(&own, &["--tls-ca", "d.pem"]), "it goes before the address");
        assert!(!overrules(&Command::new("own"), &[]), "it has no address");
        let all = Command::new("all").subcommand(own);
        let inner = |command: &Command| command.find_subcommand("own").cloned().expect("it is there");
        let read = |command: &Command, name: &str| {
            let mut all = command.get_arguments();
            all.any(|argument| argument.get_id() == name && argument.get_env().is_some())
        };
        let without = inner(&without_tls_variables(all.clone()));
        for name in TLS_ARGUMENTS {
            assert!(read(&inner(&all), name) && !read(&without, name), "{name}");
        }
        assert!(read(&without, "token_file"));
    }
}
