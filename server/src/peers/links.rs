//! Connections to the other replicas, over TLS where they ask for it.
//!
//! A connection is made when it is first used, mends itself, and is shared by all requests. New certificates
//! replace all connections. The log has one line when a replica is away, and one when it is back.

use std::collections::HashMap;
use std::error::Error;
use std::sync::{Arc, Mutex, PoisonError};

use tonic::Status;
use tonic::transport::{Channel, ClientTlsConfig, Endpoint};

use crate::limits;
use crate::metrics::Metrics;
use crate::tls::Tls;

#[derive(Default)]
pub(super) struct Links {
    tls: Option<Arc<Tls>>,
    known: Mutex<KnownLinks>,
    metrics: Arc<Metrics>,
}

#[derive(Default)]
struct KnownLinks {
    /// The number of the certificates with which the connections were made.
    number: u64,
    by_address: HashMap<String, PeerLink>,
}

struct PeerLink {
    channel: Channel,
    is_silent: bool,
}

impl Links {
    pub(super) fn new(tls: Option<Arc<Tls>>, metrics: Arc<Metrics>) -> Self {
        Self { tls, known: Mutex::default(), metrics }
    }

    pub(super) fn channel(&self, address: &str) -> Result<Channel, Status> {
        let (number, config) = match &self.tls {
            Some(tls) => tls.outgoing(),
            // A proxy before the other replica may speak TLS for it.
            None => (0, ClientTlsConfig::new().with_native_roots()),
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.number != number || known.by_address.len() >= limits::PEERS {
            known.by_address.clear();
            known.number = number;
        }
        if let Some(link) = known.by_address.get(address) {
            return Ok(link.channel.clone());
        }
        let endpoint = Endpoint::from_shared(address.to_owned()).map_err(|_| {
            Status::internal(format!("the replica's address {address:?} is no URL; see its --advertise"))
        })?;
        let endpoint = if address.starts_with("https://") {
            let problem = |error| Status::internal(format!("no TLS to {address}: {}", causes(&error)));
            endpoint.tls_config(config).map_err(problem)?
        } else {
            endpoint
        };
        let channel = endpoint
            .connect_timeout(limits::PEER_CONNECT)
            .tcp_nodelay(true)
            .http2_keep_alive_interval(limits::KEEPALIVE)
            .keep_alive_timeout(limits::KEEPALIVE)
            .connect_lazy();
        let link = PeerLink { channel: channel.clone(), is_silent: false };
        known.by_address.insert(address.to_owned(), link);
        Ok(channel)
    }

    pub(super) fn answered(&self, address: &str) {
        self.metrics.forwarded("answered");
        if self.note(address, false) {
            tracing::info!(address, "the replica answers again");
        }
    }

    pub(super) fn silent(&self, address: &str, error: &(dyn Error + 'static)) {
        self.metrics.forwarded("silent");
        if self.note(address, true) {
            let problem = causes(error);
            tracing::warn!(
                address,
                problem,
                "a replica does not answer; its studies are taken over if it is gone"
            );
        }
    }

    /// Notes whether a replica is silent; true when that has changed.
    fn note(&self, address: &str, is_silent: bool) -> bool {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(link) = known.by_address.get_mut(address) else {
            return false;
        };
        std::mem::replace(&mut link.is_silent, is_silent) != is_silent
    }
}

/// An error with its causes: the outermost alone only says "transport error".
fn causes(error: &(dyn Error + 'static)) -> String {
    let mut said = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let text = cause.to_string();
        if !said.ends_with(&text) {
            said = format!("{said}: {text}");
        }
        next = cause.source();
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_silence_is_noted_once_and_its_end_once() {
        let links = Links::default();
        let address = "http://127.0.0.1:9";
        assert!(!links.note(address, true), "there is no connection");
        links.channel(address).unwrap();
        assert!(!links.note(address, false));
        let said = [true, true, false, false, true].map(|silent| links.note(address, silent));
        assert_eq!(said, [true, false, true, false, true]);
        links.channel(address).unwrap();
        assert!(!links.note(address, true), "the connection lasts");
    }

    #[tokio::test]
    async fn addresses_that_are_none_are_named() {
        let links = Links::default();
        let status = links.channel("not a url").unwrap_err();
        assert!(status.message().contains("--advertise"), "{status}");
        links.channel("https://replica.example:1").unwrap();
    }

    #[test]
    fn errors_are_told_with_their_causes() {
        let inner = std::io::Error::new(std::io::ErrorKind::ConnectionRefused, "refused");
        let status = Status::from_error(Box::new(inner));
        assert!(causes(&status).contains("refused"), "{}", causes(&status));
    }
}
