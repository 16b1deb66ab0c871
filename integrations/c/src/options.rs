//! Options of a client. Making the client returns the first mistake.

use std::path::Path;
use std::time::Duration;

use treewright_client::{ClientError, Credentials};

use crate::edge::{Draft, ErrorOut, Text, guard};
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

impl Draft for Options {
    fn mistake(&mut self) -> &mut Option<String> {
        &mut self.mistake
    }
}

fn keep(options: &mut Options, credentials: Result<Credentials, ClientError>) -> Result<(), String> {
    options.credentials = credentials.map_err(|error| error.to_string())?;
    Ok(())
}

exports! {
    fn tw_options_new() -> Option<Box<Options>> {
        guard(ErrorOut::nowhere(), || Ok(Box::default()))
    }

    fn tw_options_free(options: Options);

    fn tw_options_client_id(mut options: Options, client_id: Text) {
        options.options.client_id = client_id.words("the client id")?.to_owned();
    }

    fn tw_options_deadline_ms(mut options: Options, ms: f64) {
        options.options.deadline = milliseconds(ms)?;
    }

    fn tw_options_call_deadline_ms(mut options: Options, ms: f64) {
        options.options.call_deadline = milliseconds(ms)?;
    }

    fn tw_options_queue(mut options: Options, reports: usize) {
        options.options.queue = reports;
    }

    fn tw_options_can_abort(mut options: Options, can_abort: bool) {
        options.options.can_abort = can_abort;
    }

    fn tw_options_fidelities(mut options: Options, fidelities: bool) {
        options.options.fidelities = fidelities;
    }

    fn tw_options_software(mut options: Options, name: Text, version: Text) {
        let (name, version) = (name.words("the software's name")?, version.words("its version")?);
        options.options.fingerprint = options.options.fingerprint.clone().software(name, version);
    }

    fn tw_options_token(mut options: Options, token: Text) {
        let credentials = options.credentials.clone().token(token.words("the token")?);
        keep(options, credentials)?;
    }

    fn tw_options_token_file(mut options: Options, path: Text) {
        let credentials = options.credentials.clone().token_file(Path::new(path.words("the token file")?));
        keep(options, credentials)?;
    }

    fn tw_options_authority_file(mut options: Options, path: Text) {
        let path = path.words("the authority file")?;
        let credentials = options.credentials.clone().authority_file(Path::new(path));
        keep(options, credentials)?;
    }

    fn tw_options_certificate_files(mut options: Options, certificate: Text, key: Text) {
        let (certificate, key) = (certificate.words("the certificate file")?, key.words("the key file")?);
        let credentials =
            options.credentials.clone().certificate_files(Path::new(certificate), Path::new(key));
        keep(options, credentials)?;
    }
}
