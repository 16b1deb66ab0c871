//! Accepts connections up to a limit, encrypts them where that is wished, and ends those that only wait.
//!
//! A connection must get on: its TLS handshake, the first bytes of HTTP/2 and its first authorised request each have a
//! time limit, and one on which nothing is under way for long is closed. So whoever opens many and says little or
//! nothing ("slow loris") cannot hold slots that others need. `activity` keeps that time, `slots` counts connections
//! and decides who makes room. What happens once a request has begun is limited in
//! [`middleware`](crate::middleware).

mod activity;
mod slots;

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::time::{Instant, Sleep, sleep_until, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

use crate::limits;
use crate::metrics::Metrics;
use crate::tls::Tls;

pub(crate) use activity::{Activity, UnderWay};
pub use slots::ConnectionLimits;
pub(crate) use slots::ConnectionSlots;

/// A connection that counts until it is dropped.
pub(crate) struct Connection {
    transport: Transport,
    activity: Arc<Activity>,
    deadline: Pin<Box<Sleep>>,
    metrics: Arc<Metrics>,
}

enum Transport {
    Plain(TcpStream),
    Tls(Box<TlsStream<TcpStream>>),
}

/// The connections of a listener. One above the limit is closed at once, which its client sees as
/// UNAVAILABLE. Handshakes run side by side, so that a slow one holds up nobody.
pub(crate) fn accept(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    slots: ConnectionSlots,
    metrics: Arc<Metrics>,
) -> impl Stream<Item = io::Result<Connection>> {
    let (ready, connections) = mpsc::channel(limits::CONNECTIONS_READY);
    tokio::spawn(async move {
        loop {
            let accepted = tokio::select! {
                () = ready.closed() => return,
                accepted = listener.accept() => accepted,
            };
            let (stream, address) = match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    // Too many open files, chiefly: there is no use in asking again at once.
                    tracing::warn!(%error, "a connection could not be accepted");
                    tokio::time::sleep(std::time::Duration::from_millis(50)).await;
                    continue;
                }
            };
            let slot = match slots.take(Some(address.ip().to_canonical())) {
                Ok(slot) => slot,
                Err(reason) => {
                    metrics.connection_lost(reason);
                    tracing::debug!(%address, reason, "connection refused: too many are open");
                    continue;
                }
            };
            let activity = Arc::new(Activity::new(Instant::now(), slot));
            let (ready, tls, metrics) = (ready.clone(), tls.clone(), Arc::clone(&metrics));
            if tls.is_none() {
                drop(ready.send(Ok(Connection::new(Transport::Plain(stream), activity, metrics))).await);
                continue;
            }
            tokio::spawn(async move {
                if let Some(transport) = handshake(stream, address, tls, &metrics).await {
                    drop(ready.send(Ok(Connection::new(transport, activity, metrics))).await);
                }
            });
        }
    });
    ReceiverStream::new(connections)
}

async fn handshake(
    stream: TcpStream,
    address: SocketAddr,
    tls: Option<Arc<Tls>>,
    metrics: &Metrics,
) -> Option<Transport> {
    let acceptor = TlsAcceptor::from(tls?.current());
    match timeout(limits::HANDSHAKE, acceptor.accept(stream)).await {
        Ok(Ok(stream)) => Some(Transport::Tls(Box::new(stream))),
        Ok(Err(error)) => {
            metrics.connection_lost("tls");
            tracing::info!(%address, %error, "TLS handshake failed");
            None
        }
        Err(_) => {
            metrics.connection_lost("overdue");
            tracing::info!(%address, "TLS handshake took too long");
            None
        }
    }
}

impl Connection {
    fn new(transport: Transport, activity: Arc<Activity>, metrics: Arc<Metrics>) -> Self {
        let tcp = match &transport {
            Transport::Plain(stream) => stream,
            Transport::Tls(stream) => stream.get_ref().0,
        };
        if let Err(error) = tcp.set_nodelay(true) {
            tracing::debug!(%error, "small messages to this connection may be delayed");
        }
        let deadline = Box::pin(sleep_until(activity.deadline()));
        Self { transport, activity, deadline, metrics }
    }

    /// Whether the connection has not got on in time.
    fn poll_overdue(&mut self, context: &mut Context<'_>) -> Poll<()> {
        loop {
            ready!(self.deadline.as_mut().poll(context));
            let deadline = self.activity.deadline();
            if deadline <= Instant::now() {
                return Poll::Ready(());
            }
            self.deadline.as_mut().reset(deadline);
        }
    }
}

impl Connected for Connection {
    type ConnectInfo = Arc<Activity>;

    fn connect_info(&self) -> Arc<Activity> {
        Arc::clone(&self.activity)
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = match &mut self.transport {
            Transport::Plain(stream) => Pin::new(stream).poll_read(context, buffer),
            Transport::Tls(stream) => Pin::new(stream).poll_read(context, buffer),
        };
        if read.is_ready() {
            let more = (buffer.filled().len() - before) as u64;
            self.activity.read(more);
        } else if self.activity.has_to_go(context) {
            self.metrics.connection_lost("made_room");
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        } else if self.poll_overdue(context).is_ready() {
            self.metrics.connection_lost("overdue");
            tracing::debug!("a connection on which nothing happened in time is closed");
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        match &mut self.transport {
            Transport::Plain(stream) => Pin::new(stream).poll_write(context, bytes),
            Transport::Tls(stream) => Pin::new(stream).poll_write(context, bytes),
        }
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        match &mut self.transport {
            Transport::Plain(stream) => Pin::new(stream).poll_write_vectored(context, slices),
            Transport::Tls(stream) => Pin::new(stream).poll_write_vectored(context, slices),
        }
    }

    fn is_write_vectored(&self) -> bool {
        match &self.transport {
            Transport::Plain(stream) => stream.is_write_vectored(),
            Transport::Tls(stream) => stream.is_write_vectored(),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.transport {
            Transport::Plain(stream) => Pin::new(stream).poll_flush(context),
            Transport::Tls(stream) => Pin::new(stream).poll_flush(context),
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.transport {
            Transport::Plain(stream) => Pin::new(stream).poll_shutdown(context),
            Transport::Tls(stream) => Pin::new(stream).poll_shutdown(context),
        }
    }
}
