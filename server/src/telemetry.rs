//! The log, on standard error. Every text that looks like a token is hidden, because at the finest level the
//! libraries log bytes from the wire. `traces` sends spans to a collector.

#[cfg_attr(not(feature = "traces"), path = "telemetry/no_traces.rs")]
pub mod traces;

use std::io::{self, IsTerminal as _, Write};

use clap::ValueEnum;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::{ParseError, Targets};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::access::token::{SECRET_CHARACTERS, TOKEN_MARK};
use traces::Traces;

/// Forms of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line.
    Json,
}

/// Reads a filter such as `info,treewright_server=debug`.
pub fn filter(text: &str) -> Result<Targets, ParseError> {
    text.parse()
}

/// Begins to log, and to make spans for a collector, if there is one. Only the first call in a process
/// counts.
pub fn begin(format: LogFormat, filter: Targets, traces: Option<&Traces>) {
    let log = tracing_subscriber::fmt::layer().with_writer(|| Blotting(io::stderr()));
    let log = match format {
        LogFormat::Text => log.with_ansi(std::io::stderr().is_terminal()).with_target(false).boxed(),
        LogFormat::Json => log.json().boxed(),
    };
    let all = tracing_subscriber::registry().with(log.with_filter(filter)).with(traces.map(Traces::layer));
    // A second subscriber is refused, which a process with several daemons in it may ignore.
    let _ = all.try_init();
}

/// Hides the secrets of tokens in written text. A line of the log comes as one piece.
struct Blotting<W>(W);

impl<W: Write> Write for Blotting<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match blotted(bytes) {
            Some(clean) => self.0.write_all(&clean)?,
            None => self.0.write_all(bytes)?,
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// The bytes without secrets; `None` if there are none.
fn blotted(bytes: &[u8]) -> Option<Vec<u8>> {
    let mark = TOKEN_MARK.as_bytes();
    let mut clean: Option<Vec<u8>> = None;
    let mut place = 0;
    while let Some(found) = bytes[place..].windows(mark.len()).position(|window| window == mark) {
        // Behind the mark come the id, which is public, an underscore and the secret.
        place += found + mark.len();
        let Some(end) = bytes[place..].iter().position(|byte| *byte == b'_') else {
            break;
        };
        place += end + 1;
        let secret = bytes[place..]
            .iter()
            .take(SECRET_CHARACTERS)
            .take_while(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_'));
        let length = secret.count();
        clean.get_or_insert_with(|| bytes.to_vec())[place..place + length].fill(b'*');
        place += length;
    }
    clean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::token::Token;

    #[test]
    fn secrets_are_blotted_out_wherever_they_stand() {
        let (one, two) = (Token::make().unwrap(), Token::make().unwrap());
        let line =
            format!("a \"Bearer {}\" b={:?} tw1_ tw1_x", one.text(), two.text().as_bytes().escape_ascii());
        let line = format!("{line} {}", two.text());
        let clean = String::from_utf8(blotted(line.as_bytes()).unwrap()).unwrap();
        for token in [one, two] {
            let secret = &token.text()[TOKEN_MARK.len() + 13..];
            assert!(line.contains(secret) && !clean.contains(secret), "{clean}");
            assert!(clean.contains(token.id()));
        }
        assert!(blotted(b"nothing to hide").is_none());
        let mut out = Vec::new();
        Blotting(&mut out).write_all(b"plain").unwrap();
        assert_eq!(out, b"plain");
    }
}
