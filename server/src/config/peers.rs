//! The options by which daemons on one PostgreSQL find and know each other.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::database::Database;
use super::guard::GuardConfig;
use crate::tls::TlsFiles;

/// Several daemons on one database pass requests on to the one that holds the study.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Several daemons on one PostgreSQL")]
pub struct PeersConfig {
    /// Address at which the other daemons reach this one, e.g. https://10.0.0.7:50611. Default: the address
    /// it listens on.
    #[arg(long, env = "TREEWRIGHT_ADVERTISE", value_name = "URL")]
    pub advertise: Option<String>,

    /// CA certificates for checking the other daemons' certificates, in PEM. Default: those of
    /// --tls-client-ca, or else the system's. Reloaded when the file changes.
    #[arg(long, env = "TREEWRIGHT_PEER_CA", value_name = "FILE", requires = "tls_cert")]
    pub peer_ca: Option<PathBuf>,

    /// Name to expect in the other daemons' certificates, if it differs from the name in their address. One
    /// certificate can then serve all of them.
    #[arg(long, env = "TREEWRIGHT_PEER_NAME", value_name = "NAME", requires = "tls_cert")]
    pub peer_name: Option<String>,
}

impl PeersConfig {
    /// The certificates, if there is to be TLS.
    pub fn tls_files(&self, guard: &GuardConfig) -> Option<TlsFiles> {
        let (certificate, key) = (guard.tls_cert.clone()?, guard.tls_key.clone()?);
        Some(TlsFiles {
            certificate,
            key,
            client_authority: guard.tls_client_ca.clone(),
            peer_authority: self.peer_ca.clone(),
            peer_name: self.peer_name.clone(),
        })
    }

    /// Checks that the others can reach this daemon, and that no credentials are passed on in plain text by
    /// mistake.
    pub(super) fn check(
        &self,
        database: &Database,
        listen: SocketAddr,
        guard: &GuardConfig,
    ) -> Result<(), String> {
        let given = [
            ("--advertise", self.advertise.is_some()),
            ("--peer-ca", self.peer_ca.is_some()),
            ("--peer-name", self.peer_name.is_some()),
        ];
        let shared = database.is_shared();
        if let Some((option, _)) = given.into_iter().find(|(_, given)| *given && !shared) {
            return Err(format!("{option} goes with --database postgres://..."));
        }
        match &self.advertise {
            None if shared && listen.ip().is_unspecified() => Err(format!(
                "other daemons on the same database cannot reach this one at {listen}; say \
                 --advertise URL"
            )),
            Some(url) if !(url.starts_with("http://") || url.starts_with("https://")) => {
                Err(format!("--advertise {url:?}: write http://HOST:PORT or https://HOST:PORT"))
            }
            Some(url) if url.starts_with("http://") && guard.tls_cert.is_some() => Err(format!(
                "--advertise {url:?}: this daemon speaks TLS, so the others must reach it by https://"
            )),
            _ => Ok(()),
        }
    }
}
