//! Certificates: read from files, and read again when the files change.
//!
//! The contents of the files are compared every two seconds, not their dates. So links that are turned over
//! (as orchestrators do) count as well. SIGHUP looks at once. A connection keeps the certificate it began
//! with. Unusable files are refused with a line in the log, and the old certificate stays.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use tokio::signal::unix::Signal;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject as _;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{RootCertStore, ServerConfig, version};
use tonic::transport::{Certificate, ClientTlsConfig, Identity};

use crate::{certificate, limits};

/// The paths of certificates, as PEM.
#[derive(Clone, Debug, Default)]
pub struct TlsFiles {
    /// The daemon's certificate, and those between it and its authority.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// Authorities for clients' certificates; without it clients need none.
    pub client_authority: Option<PathBuf>,
    /// Authorities for other replicas' certificates; without it those for clients, and without these the
    /// system's.
    pub peer_authority: Option<PathBuf>,
    /// The name to expect in other replicas' certificates, where it is not the one in their address.
    pub peer_name: Option<String>,
}

/// Why TLS cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read.
    #[error("{}: {}", .0.display(), .1)]
    Read(PathBuf, std::io::Error),
    /// A file has no usable content.
    #[error("{}: {}", .0.display(), .1)]
    Content(PathBuf, String),
    /// The parts do not fit each other.
    #[error("certificate {} with key {}: {problem}", certificate.display(), key.display())]
    Mismatch {
        /// The certificate's file.
        certificate: PathBuf,
        /// The key's file.
        key: PathBuf,
        /// The mistake.
        problem: String,
    },
}

/// The contents of the files. Not to be printed: one is a private key.
#[derive(PartialEq, Eq)]
struct Contents {
    certificate: Vec<u8>,
    key: Vec<u8>,
    client_authority: Option<Vec<u8>>,
    peer_authority: Option<Vec<u8>>,
}

/// TLS settings from the last usable certificate files.
struct Made {
    server: Arc<ServerConfig>,
    /// For connections to other replicas. The daemon shows its own certificate there.
    client: ClientTlsConfig,
    /// The earliest end of its certificates, in seconds since 1970.
    expiry_s: i64,
    /// Rises with each reload, so that connections with old settings can be found.
    number: u64,
}

/// The certificates in force.
pub struct Tls {
    files: TlsFiles,
    current: RwLock<Made>,
    /// The contents that were last read, usable or not.
    seen: Mutex<Contents>,
}

impl Tls {
    /// Reads the files.
    pub fn load(files: TlsFiles) -> Result<Self, TlsError> {
        let contents = files.read()?;
        let made = files.make(&contents, 0)?;
        Ok(Self { files, current: RwLock::new(made), seen: Mutex::new(contents) })
    }

    /// The configuration of a new connection.
    pub fn current(&self) -> Arc<ServerConfig> {
        Arc::clone(&self.current.read().unwrap_or_else(PoisonError::into_inner).server)
    }

    /// The configuration of a new connection to another replica, and a number that rises when it changes.
    pub fn outgoing(&self) -> (u64, ClientTlsConfig) {
        let made = self.current.read().unwrap_or_else(PoisonError::into_inner);
        (made.number, made.client.clone())
    }

    /// The earliest end of the certificates in force, in seconds since 1970.
    pub fn expiry_s(&self) -> i64 {
        self.current.read().unwrap_or_else(PoisonError::into_inner).expiry_s
    }

    /// Reads the files again. True when new certificates are in force.
    ///
    /// # Errors
    /// Why changed files cannot be used; logged once for each change. The old ones stay in force.
    pub fn reload(&self) -> Result<bool, TlsError> {
        let contents = self.files.read()?;
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if *seen == contents {
            return Ok(false);
        }
        let number = self.outgoing().0 + 1;
        let made = self.files.make(&contents, number);
        *seen = contents;
        let made = made?;
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        assert!(current.number < made.number, "certificates {} follow {}", made.number, current.number);
        *current = made;
        Ok(true)
    }

    /// Follows the files until dropped. A signal has them read at once.
    pub async fn follow(&self, mut hang_up: Signal) {
        let mut unreadable = false;
        loop {
            let asked = tokio::select! {
                _ = hang_up.recv() => true,
                () = tokio::time::sleep(limits::CERTIFICATES_PERIOD) => false,
            };
            match self.reload() {
                Ok(true) => tracing::info!("new certificates are in force"),
                Ok(false) if asked => tracing::info!("the certificates have not changed"),
                Ok(false) => {}
                // A file that is missing for a moment, while it is replaced, is not worth a line each time.
                Err(TlsError::Read { .. }) if unreadable && !asked => continue,
                Err(error) => {
                    unreadable = matches!(error, TlsError::Read { .. });
                    tracing::error!(%error, "the new certificates cannot be used; the old ones stay in force");
                    continue;
                }
            }
            unreadable = false;
        }
    }
}

impl TlsFiles {
    fn read(&self) -> Result<Contents, TlsError> {
        Ok(Contents {
            certificate: read(&self.certificate)?,
            key: read(&self.key)?,
            client_authority: self.client_authority.as_deref().map(read).transpose()?,
            peer_authority: self.peer_authority.as_deref().map(read).transpose()?,
        })
    }

    fn make(&self, contents: &Contents, number: u64) -> Result<Made, TlsError> {
        assert_eq!(
            self.peer_authority.is_some(),
            contents.peer_authority.is_some(),
            "replicas would be judged by other authorities"
        );
        let server = Arc::new(self.config(contents)?);
        let authority = match (&self.peer_authority, &contents.peer_authority) {
            (Some(path), Some(authority)) => {
                certificates(path, authority)?;
                Some(authority)
            }
            _ => contents.client_authority.as_ref(),
        };
        let identity = Identity::from_pem(&contents.certificate, &contents.key);
        let client = ClientTlsConfig::new().identity(identity);
        let client = match authority {
            Some(authority) => client.ca_certificate(Certificate::from_pem(authority)),
            None => client.with_native_roots(),
        };
        let client = match &self.peer_name {
            Some(name) => client.domain_name(name),
            None => client,
        };
        let chain = certificates(&self.certificate, &contents.certificate)?;
        let expiries: Option<Vec<_>> = chain.iter().map(|one| certificate::expiry_s(one)).collect();
        let unread = || content(&self.certificate, "a certificate that does not say when it ends".to_owned());
        let expiry_s = expiries.and_then(|all| all.into_iter().min()).ok_or_else(unread)?;
        Ok(Made { server, client, expiry_s, number })
    }

    fn config(&self, contents: &Contents) -> Result<ServerConfig, TlsError> {
        assert_eq!(
            self.client_authority.is_some(),
            contents.client_authority.is_some(),
            "clients would be let in without a certificate"
        );
        let provider = Arc::new(ring::default_provider());
        let chain = certificates(&self.certificate, &contents.certificate)?;
        let key = PrivateKeyDer::from_pem_slice(&contents.key)
            // An error message might quote it.
            .map_err(|_| content(&self.key, "no private key in PEM".to_owned()))?;
        // Every gRPC library of the last years speaks 1.3, so older versions are not supported.
        let builder = ServerConfig::builder_with_provider(Arc::clone(&provider))
            .with_protocol_versions(&[&version::TLS13])
            .map_err(|error| self.mismatch(&error))?;
        let builder = match (&self.client_authority, &contents.client_authority) {
            (Some(path), Some(authority)) => {
                let mut roots = RootCertStore::empty();
                for root in certificates(path, authority)? {
                    roots.add(root).map_err(|error| content(path, error.to_string()))?;
                }
                let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider)
                    .build()
                    .map_err(|error| content(path, error.to_string()))?;
                builder.with_client_cert_verifier(verifier)
            }
            _ => builder.with_no_client_auth(),
        };
        let mut config = builder.with_single_cert(chain, key).map_err(|error| self.mismatch(&error))?;
        config.alpn_protocols = vec![b"h2".to_vec()];
        Ok(config)
    }

    fn mismatch(&self, problem: &tokio_rustls::rustls::Error) -> TlsError {
        let (certificate, key) = (self.certificate.clone(), self.key.clone());
        TlsError::Mismatch { certificate, key, problem: problem.to_string() }
    }
}

fn content(path: &Path, problem: String) -> TlsError {
    TlsError::Content(path.to_owned(), problem)
}

fn read(path: &Path) -> Result<Vec<u8>, TlsError> {
    let failed = |problem| TlsError::Read(path.to_owned(), problem);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(limits::CERTIFICATE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limits::CERTIFICATE_BYTES {
        // An error of reading, which is logged once, because these contents are not compared.
        let problem = format!("larger than {} bytes", limits::CERTIFICATE_BYTES);
        return Err(failed(std::io::Error::new(ErrorKind::FileTooLarge, problem)));
    }
    Ok(bytes)
}

fn certificates(path: &Path, pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    match found {
        Ok(found) if !found.is_empty() => Ok(found),
        Ok(_) => Err(content(path, "no certificate in PEM".to_owned())),
        Err(error) => Err(content(path, format!("no certificate in PEM ({error:?})"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str) -> TlsFiles {
        let made = rcgen::generate_simple_self_signed([name.to_owned()]).unwrap();
        let (certificate, key) = (folder.join("cert.pem"), folder.join("key.pem"));
        std::fs::write(&certificate, made.cert.pem()).unwrap();
        std::fs::write(&key, made.signing_key.serialize_pem()).unwrap();
        TlsFiles { certificate, key, ..TlsFiles::default() }
    }

    #[test]
    fn new_files_come_into_force_and_broken_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let files = write(folder.path(), "one.example");
        let tls = Tls::load(files.clone()).unwrap();
        let first = tls.current();
        assert!(!tls.reload().unwrap());

        let old_key = std::fs::read(&files.key).unwrap();
        write(folder.path(), "two.example");
        let new_key = std::fs::read(&files.key).unwrap();
        std::fs::write(&files.key, &old_key).unwrap();
        assert!(matches!(tls.reload(), Err(TlsError::Mismatch { .. })), "a key of another certificate");
        assert!(!tls.reload().unwrap(), "said once");
        assert!(Arc::ptr_eq(&first, &tls.current()));

        std::fs::write(&files.key, &new_key).unwrap();
        assert_eq!(tls.outgoing().0, 0, "what is in force has not changed");
        assert!(tls.reload().unwrap());
        assert!(!Arc::ptr_eq(&first, &tls.current()));
        assert_eq!(tls.outgoing().0, 1, "connections to replicas are made again");

        let second = tls.current();
        for broken in [&b""[..], b"hello", b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"]
        {
            std::fs::write(&files.certificate, broken).unwrap();
            assert!(tls.reload().is_err());
        }
        std::fs::write(&files.certificate, vec![b'x'; limits::CERTIFICATE_BYTES as usize + 1]).unwrap();
        let large = tls.reload().unwrap_err();
        assert!(matches!(large, TlsError::Read { .. }) && large.to_string().contains("larger"), "{large}");
        std::fs::remove_file(&files.certificate).unwrap();
        assert!(matches!(tls.reload(), Err(TlsError::Read { .. })));
        assert!(Arc::ptr_eq(&second, &tls.current()));
    }

    #[test]
    fn the_first_end_among_the_certificates_is_known_and_follows_them() {
        let folder = tempfile::tempdir().unwrap();
        let files = write(folder.path(), "one.example");
        let pem = |year| {
            let mut parameters = rcgen::CertificateParams::new(vec!["one.example".to_owned()]).unwrap();
            parameters.not_after = rcgen::date_time_ymd(year, 1, 1);
            let key = rcgen::KeyPair::generate().unwrap();
            (parameters.self_signed(&key).unwrap().pem(), key.serialize_pem())
        };
        let ((leaf, key), (above, _)) = (pem(2030), pem(2029));
        std::fs::write(&files.certificate, format!("{leaf}{above}")).unwrap();
        std::fs::write(&files.key, key).unwrap();
        let tls = Tls::load(files.clone()).unwrap();
        assert_eq!(tls.expiry_s(), 1_861_920_000, "2029 began");
        std::fs::write(&files.certificate, leaf).unwrap();
        assert!(tls.reload().unwrap());
        assert_eq!(tls.expiry_s(), 1_893_456_000, "2030 began");
    }

    #[test]
    fn files_that_are_no_certificates_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let files = write(folder.path(), "one.example");
        let missing = TlsFiles { key: folder.path().join("nowhere.pem"), ..files.clone() };
        assert!(Tls::load(missing).err().unwrap().to_string().contains("nowhere.pem"));
        let swapped = TlsFiles { certificate: files.key.clone(), ..files.clone() };
        assert!(Tls::load(swapped).err().unwrap().to_string().contains("no certificate"));
        let no_authority = TlsFiles { client_authority: Some(files.key.clone()), ..files.clone() };
        assert!(Tls::load(no_authority).err().unwrap().to_string().contains("no certificate"));
        let no_authority = TlsFiles { peer_authority: Some(files.key.clone()), ..files };
        assert!(Tls::load(no_authority).err().unwrap().to_string().contains("no certificate"));
    }
}
