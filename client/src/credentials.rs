//! Credentials of a client and those that it asks of a daemon: tokens and certificates.
//!
//! No credential appears in debug output or in errors. A token is only sent where nobody can listen: over
//! TLS, or to this machine.

use std::fmt;
use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;

use tonic::metadata::{Ascii, MetadataValue};
use tonic::transport::{Certificate, ClientTlsConfig, Identity};

use crate::{ClientError, limits};

/// The contents of a PEM file.
type Pem = Arc<[u8]>;

/// Token and certificates. The default has none. That is enough for a daemon on this machine. It is also
/// enough for one that asks for no token, and whose certificate comes from an authority that the system
/// trusts.
#[derive(Clone, Default)]
pub struct Credentials {
    token: Option<MetadataValue<Ascii>>,
    authority: Option<Pem>,
    certificate: Option<(Pem, Pem)>,
    server_name: Option<String>,
}

impl Credentials {
    /// None.
    pub fn new() -> Self {
        Self::default()
    }

    /// Shows this token, as `treewrightd token create` printed it.
    ///
    /// Errors: [`ClientError::Invalid`] when it cannot be one.
    pub fn token(mut self, token: &str) -> Result<Self, ClientError> {
        let token = token.trim();
        let bad = |problem: String| ClientError::invalid("token", problem);
        if token.is_empty() || token.len() > limits::TOKEN_BYTES {
            return Err(bad(format!("it must have 1 to {} characters", limits::TOKEN_BYTES)));
        }
        let mut value = MetadataValue::try_from(format!("Bearer {token}"))
            .map_err(|_| bad("it holds characters that no token has".to_owned()))?;
        // Kept out of debug output and out of the tables of the header compression.
        value.set_sensitive(true);
        self.token = Some(value);
        Ok(self)
    }

    /// Shows the token that a file holds.
    ///
    /// Errors: [`ClientError::Invalid`] when it cannot be read or holds no token.
    pub fn token_file(self, path: &Path) -> Result<Self, ClientError> {
        let bytes = read("token file", path)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| ClientError::invalid("token file", format!("{} is not text", path.display())))?;
        self.token(&text)
    }

    /// Trusts a daemon whose certificate comes from an authority of this PEM file, and no other. Only for
    /// `https:` addresses.
    ///
    /// Errors: [`ClientError::Invalid`] when it cannot be read.
    pub fn authority_file(mut self, path: &Path) -> Result<Self, ClientError> {
        self.authority = Some(read("authority file", path)?.into());
        Ok(self)
    }

    /// Shows the certificate of these PEM files to a daemon that asks for one. Only for `https:` addresses.
    ///
    /// Errors: [`ClientError::Invalid`] when they cannot be read.
    pub fn certificate_files(mut self, certificate: &Path, key: &Path) -> Result<Self, ClientError> {
        let (certificate, key) = (read("certificate file", certificate)?, read("key file", key)?);
        self.certificate = Some((certificate.into(), key.into()));
        Ok(self)
    }

    /// Expects this name in the daemon's certificate instead of the one in its address. Only for `https:`
    /// addresses.
    #[must_use]
    pub fn server_name(mut self, name: impl Into<String>) -> Self {
        self.server_name = Some(name.into());
        self
    }

    pub(crate) fn bearer(&self) -> Option<MetadataValue<Ascii>> {
        self.token.clone()
    }

    /// The name of a setting that a connection in plain text would leave unused, if there is one.
    pub(crate) fn only_for_tls(&self) -> Option<&'static str> {
        let certificate = self.certificate.as_ref().map(|_| "client certificate");
        let authority = self.authority.as_ref().map(|_| "certificate authority");
        certificate.or(authority).or(self.server_name.as_ref().map(|_| "server name"))
    }

    pub(crate) fn tls(&self) -> ClientTlsConfig {
        let mut config = ClientTlsConfig::new();
        config = match &self.authority {
            Some(pem) => config.ca_certificate(Certificate::from_pem(pem)),
            None => config.with_native_roots(),
        };
        if let Some((certificate, key)) = &self.certificate {
            config = config.identity(Identity::from_pem(certificate, key));
        }
        if let Some(name) = &self.server_name {
            config = config.domain_name(name);
        }
        config
    }
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("token", &self.token.is_some())
            .field("authority", &self.authority.is_some())
            .field("certificate", &self.certificate.is_some())
            .field("server_name", &self.server_name)
            .finish()
    }
}

fn read(what: &str, path: &Path) -> Result<Vec<u8>, ClientError> {
    let bad = |problem: String| ClientError::invalid(what, format!("{}: {problem}", path.display()));
    let file = std::fs::File::open(path).map_err(|error| bad(error.to_string()))?;
    let mut bytes = Vec::new();
    file.take(limits::CREDENTIAL_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| bad(error.to_string()))?;
    if bytes.len() as u64 > limits::CREDENTIAL_BYTES {
        return Err(bad(format!("it is larger than {} bytes", limits::CREDENTIAL_BYTES)));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;

    #[test]
    fn secrets_are_not_shown() {
        let credentials = Credentials::new().token("tw1_0123_hunter2").unwrap();
        let options = Options::new().credentials(credentials.clone());
        for shown in
            [format!("{credentials:?}"), format!("{options:#?}"), format!("{:?}", credentials.bearer())]
        {
            assert!(!shown.contains("hunter2"), "{shown}");
        }
        let error = Credentials::new().token("hunter2\u{7}").unwrap_err();
        assert!(!format!("{error} {error:?}").contains("hunter2"));
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let error = Credentials::new().token_file(Path::new("/nowhere/token")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/token"), "{error}");
        assert!(Credentials::new().token("").is_err());
        assert!(Credentials::new().token(&"x".repeat(5000)).is_err());
    }
}
