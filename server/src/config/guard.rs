//! The options of encryption and authentication.

use std::net::SocketAddr;
use std::path::PathBuf;

/// Encryption and authentication.
///
/// On the loopback both are optional. Any other address needs both, or `--insecure`.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Security")]
pub struct GuardConfig {
    /// Certificate of the daemon, in PEM, followed by its intermediate certificates. Reloaded when the file
    /// changes.
    #[arg(long, env = "TREEWRIGHT_TLS_CERT", value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,

    /// Private key of the certificate, in PEM. Reloaded when the file changes.
    #[arg(long, env = "TREEWRIGHT_TLS_KEY", value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,

    /// Accept only clients with a certificate from one of these CAs, in PEM.
    #[arg(long, env = "TREEWRIGHT_TLS_CLIENT_CA", value_name = "FILE", requires = "tls_cert")]
    pub tls_client_ca: Option<PathBuf>,

    /// Require tokens on the loopback too. Create them with `treewrightd token create`.
    #[arg(long, env = "TREEWRIGHT_TOKENS")]
    pub tokens: bool,

    /// Listen beyond this machine without encryption, and without tokens unless --tokens is given. Anyone who
    /// reaches the port can read and change every study.
    #[arg(long, env = "TREEWRIGHT_INSECURE")]
    pub insecure: bool,
}

impl GuardConfig {
    /// Checks what the options mean together.
    pub(super) fn check(&self, listen: SocketAddr) -> Result<(), String> {
        if listen.ip().is_loopback() || self.insecure || self.tls_cert.is_some() {
            return Ok(());
        }
        Err(format!(
            "{listen} can be reached from other machines, without encryption or authentication; give it a \
             certificate with --tls-cert and --tls-key and make tokens with `treewrightd token create`, listen on \
             127.0.0.1, or say --insecure if the network is trusted"
        ))
    }

    /// Whether callers must show a token.
    pub fn asks_for_tokens(&self, listen: SocketAddr) -> bool {
        self.tokens || (!listen.ip().is_loopback() && !self.insecure)
    }
}
