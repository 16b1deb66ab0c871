//! Options of a client. The first mistake is kept, and making the client returns it.

use std::path::Path;
use std::time::Duration;

use treewright_client::{ClientError, Credentials};

use crate::edge::{ErrorOut, Text, guard, set};
use crate::error::Failure;

/// Longest deadline, in milliseconds: an hour.
const DEADLINE_MS_MAX: f64 = 3.6e6;

#[derive(Debug, Default)]
pub(crate) struct Options {
    options: treewright_client::Options,
    credentials: Credentials,
    mistake: Option<String>,
}

impl Options {
    pub(crate) fn finish(&self) -> Result<treewright_client::Options, Failure> {
        match &self.mistake {
            Some(mistake) => Err(Failure::invalid(mistake)),
            None => Ok(self.options.clone().credentials(self.credentials.clone())),
        }
    }
}

pub(crate) fn milliseconds(ms: f64) -> Result<Duration, String> {
    if (0.0..=DEADLINE_MS_MAX).contains(&ms) {
        return Ok(Duration::from_secs_f64(ms / 1e3));
    }
    Err(format!("a deadline of {ms} ms is not within 0 to {DEADLINE_MS_MAX}"))
}

/// Changes options; a mistake is kept for later.
fn change(options: Option<&mut Options>, change: impl FnOnce(&mut Options) -> Result<(), String>) {
    if let Some(options) = options
        && let Err(mistake) = change(options)
    {
        options.mistake.get_or_insert(mistake);
    }
}

fn keep(options: &mut Options, credentials: Result<Credentials, ClientError>) -> Result<(), String> {
    options.credentials = credentials.map_err(|error| error.to_string())?;
    Ok(())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_new() -> Option<Box<Options>> {
    guard(ErrorOut::nowhere(), || Ok(Box::default()))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_free(options: Option<Box<Options>>) {
    drop(options);
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_client_id(options: Option<&mut Options>, client_id: Text) {
    change(options, |options| {
        options.options.client_id = client_id.words("the client id")?.to_owned();
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_deadline_ms(options: Option<&mut Options>, ms: f64) {
    change(options, |options| {
        options.options.deadline = milliseconds(ms)?;
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_call_deadline_ms(options: Option<&mut Options>, ms: f64) {
    change(options, |options| {
        options.options.call_deadline = milliseconds(ms)?;
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_queue(options: Option<&mut Options>, reports: usize) {
    set(options, |options| options.options.queue = reports);
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_can_abort(options: Option<&mut Options>, can_abort: bool) {
    set(options, |options| options.options.can_abort = can_abort);
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_fidelities(options: Option<&mut Options>, fidelities: bool) {
    set(options, |options| options.options.fidelities = fidelities);
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_software(options: Option<&mut Options>, name: Text, version: Text) {
    change(options, |options| {
        let (name, version) = (name.words("the software's name")?, version.words("its version")?);
        options.options.fingerprint = options.options.fingerprint.clone().software(name, version);
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_token(options: Option<&mut Options>, token: Text) {
    change(options, |options| {
        let credentials = options.credentials.clone().token(token.words("the token")?);
        keep(options, credentials)
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_token_file(options: Option<&mut Options>, path: Text) {
    change(options, |options| {
        let credentials = options.credentials.clone().token_file(Path::new(path.words("the token file")?));
        keep(options, credentials)
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_authority_file(options: Option<&mut Options>, path: Text) {
    change(options, |options| {
        let path = path.words("the authority file")?;
        let credentials = options.credentials.clone().authority_file(Path::new(path));
        keep(options, credentials)
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_options_certificate_files(
    options: Option<&mut Options>,
    certificate: Text,
    key: Text,
) {
    change(options, |options| {
        let (certificate, key) = (certificate.words("the certificate file")?, key.words("the key file")?);
        let credentials =
            options.credentials.clone().certificate_files(Path::new(certificate), Path::new(key));
        keep(options, credentials)
    });
}
