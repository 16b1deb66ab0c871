//! Listeners for browsers and monitoring: HTTP/1.1, a few connections, and the newest is always served.
//!
//! Where all are taken, one makes room by the [rule](super::slots) of all connections, with one difference. A
//! request under way does not protect it, because browsers and monitors ask again by themselves. So neither
//! silent connections nor ones with endless requests keep an orchestrator from probing the daemon.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use http::{Request, Response};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpListener;
use tokio::time::timeout;

use super::pause;
use super::slots::{ConnectionLimits, ConnectionSlot, ConnectionSlots};
use crate::limits;
use crate::trouble::Trouble;

pub(crate) trait Pages: Send + Sync + 'static {
    type Body: hyper::body::Body<Data = Bytes, Error = Infallible> + Send + 'static;

    /// Whether a connection may ask several times.
    const KEEPS_ALIVE: bool;

    /// The longest life of a connection.
    const STAY: Duration;

    /// Answers one request. It calls [`ConnectionSlot::settle`] once the request is known to be authorised.
    fn answer(
        self: &Arc<Self>,
        request: Request<Incoming>,
        slot: &ConnectionSlot,
    ) -> impl Future<Output = Response<Self::Body>> + Send;
}

/// Serves at most `connections` connections at once until it is dropped.
pub(crate) async fn serve<P: Pages>(listener: TcpListener, pages: P, connections: usize) {
    let pages = Arc::new(pages);
    let most = ConnectionLimits { total: connections, newcomers: connections, per_address: connections };
    let slots = ConnectionSlots::new(most);
    let mut trouble = Trouble::default();
    loop {
        let (stream, address) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                pause(&error, &mut trouble).await;
                continue;
            }
        };
        let Ok(slot) = slots.take(Some(address.ip()).into()).await else { continue };
        let pages = Arc::clone(&pages);
        tokio::spawn(async move {
            let service = service_fn(async |request| {
                slot.used(false);
                Ok::<_, Infallible>(pages.answer(request, &slot).await)
            });
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(limits::WATCH)
                .keep_alive(P::KEEPS_ALIVE)
                .serve_connection(TokioIo::new(stream), service);
            tokio::select! {
                // An error only concerns the client.
                _ = timeout(P::STAY, served) => {}
                () = slot.dismissed() => {}
            }
        });
    }
}
