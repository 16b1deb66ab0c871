//! Listeners for browsers and for those who watch: HTTP/1.1, a few connections, and whoever comes last is served.
//!
//! Their connections follow the rules of all others, with one difference: where all are taken, the one that stands still for
//! longest ends even if it waits for something. So neither connections that say nothing nor ones that never end their
//! question keep an orchestrator from asking whether the daemon lives.

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
use tokio::time::{Instant, timeout};

use super::slots::{ConnectionLimits, ConnectionSlots};
use super::{Activity, Connection, Unfinished, pause};
use crate::limits;

/// What answers on such a listener.
pub(crate) trait Pages: Send + Sync + 'static {
    /// The body of an answer.
    type Body: hyper::body::Body<Data = Bytes, Error = Infallible> + Send + 'static;

    /// Whether a connection may ask several times.
    const KEEPS_ALIVE: bool;

    /// After so long a connection ends.
    const STAY: Duration;

    /// Answers one request. It calls [`Activity::settle`] once it knows that whoever asks may.
    fn answer(
        self: &Arc<Self>,
        request: Request<Incoming>,
        activity: &Arc<Activity>,
    ) -> impl Future<Output = Response<Self::Body>> + Send;
}

/// Serves at most so many at once until it is dropped.
pub(crate) async fn serve<P: Pages>(listener: TcpListener, pages: P, connections: usize) {
    let pages = Arc::new(pages);
    let slots = ConnectionSlots::new(ConnectionLimits::for_pages(connections));
    // A few connections, whose questions are short and whose answers have limits of their own.
    let unfinished = Unfinished::new(usize::MAX);
    loop {
        let (stream, address) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                pause(&error).await;
                continue;
            }
        };
        let Ok(slot) = slots.take(Some(address.ip()).into()) else { continue };
        let activity = Arc::new(Activity::new(Instant::now(), slot, unfinished.clone()));
        let connection = Connection::new(Box::new(stream), Arc::clone(&activity), None);
        let pages = Arc::clone(&pages);
        tokio::spawn(async move {
            let service = service_fn(async |request| {
                let _under_way = activity.begin();
                Ok::<_, Infallible>(pages.answer(request, &activity).await)
            });
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(limits::WATCH)
                .keep_alive(P::KEEPS_ALIVE)
                .serve_connection(TokioIo::new(connection), service);
            // Whatever went wrong is the asker's affair.
            let _ = timeout(P::STAY, served).await;
        });
    }
}
