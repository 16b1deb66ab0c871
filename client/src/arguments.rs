//! Credentials as command line arguments, for every program that talks to a daemon.

use std::path::PathBuf;

use crate::{ClientError, Credentials};

/// The environment variable that holds a token. There is no argument for it: every user of a machine can read
/// the arguments of every program.
const TOKEN_VARIABLE: &str = "TREEWRIGHT_TOKEN";

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

/// The command, for which an empty variable is as one that is not set: `VARIABLE=` in a file of settings, or
/// `${VARIABLE:-}` in one for containers, means just that.
pub fn without_empty_variables(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|argument| {
        let value = argument.get_env().and_then(std::env::var_os);
        if value.is_some_and(|value| value.is_empty()) {
            argument.env(None::<&'static str>)
        } else {
            argument
        }
    });
    command.mut_subcommands(without_empty_variables)
}
