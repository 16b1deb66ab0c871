//! Accepts connections up to a limit, encrypts them if configured, and ends those that only wait.
//!
//! A connection must make progress. Its TLS handshake, the first bytes of HTTP/2 and its first authorised
//! request each have a time limit. An idle connection is closed after a while. So a client that opens many
//! and sends little ("slow loris") cannot hold slots that others need. `activity` keeps that time, `slots`
//! counts connections and decides who makes room, `unfinished` limits the bytes of unfinished messages, and
//! `body` counts them. `pages` serves the listeners for browsers and monitoring by these rules, too.
//! [`middleware`](crate::middleware) has the limits of a request that has begun.

mod activity;
mod authority;
mod body;
pub(crate) mod pages;
mod slots;
mod unfinished;

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpStream, UnixStream};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, Sleep, sleep_until, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

use crate::limits;
use crate::listeners::Listeners;
use crate::metrics::Metrics;
use crate::tls::Tls;
use crate::trouble::Trouble;

pub(crate) use activity::{Activity, UnderWay};
use authority::with_valid_hosts;
pub(crate) use body::{answer_body, request_body};
pub use slots::ConnectionLimits;
pub(crate) use slots::{ConnectionSlot, ConnectionSlots};
pub(crate) use unfinished::Unfinished;

/// A connection that counts until it is dropped.
pub(crate) struct Connection {
    transport: Box<dyn Transport>,
    activity: Arc<Activity>,
    deadline: Pin<Box<Sleep>>,
    /// The metrics that count its loss, once.
    metrics: Option<Arc<Metrics>>,
}

/// The carrier of the bytes: TCP, TLS over it, or a Unix socket.
trait Transport: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Transport for T {}

/// Takes connections and hands them to the server.
#[derive(Clone)]
struct Acceptor {
    ready: mpsc::Sender<io::Result<Connection>>,
    tls: Option<Arc<Tls>>,
    slots: ConnectionSlots,
    unfinished: Unfinished,
    metrics: Arc<Metrics>,
}

/// The connections of all listeners. One without room is closed at once, which its client sees as
/// UNAVAILABLE. Handshakes run side by side, so that a slow one does not delay others. Each listener has a
/// task in `accepting`, which ends before the stream of connections only by a defect.
pub(crate) fn accept(
    accepting: &mut JoinSet<()>,
    listeners: Listeners,
    tls: Option<Arc<Tls>>,
    slots: ConnectionSlots,
    unfinished: Unfinished,
    metrics: Arc<Metrics>,
) -> impl Stream<Item = io::Result<Connection>> + use<> {
    let (ready, connections) = mpsc::channel(limits::CONNECTIONS_READY);
    let acceptor = Acceptor { ready, tls, slots, unfinished, metrics };
    for listener in listeners.tcp {
        accepting.spawn(acceptor.clone().run(async move |acceptor| {
            let (stream, address) = listener.accept().await?;
            acceptor.take_tcp(stream, address).await;
            Ok(())
        }));
    }
    for listener in listeners.unix {
        accepting.spawn(acceptor.clone().run(async move |acceptor| {
            let (stream, _) = listener.accept().await?;
            acceptor.take_local(stream).await;
            Ok(())
        }));
    }
    ReceiverStream::new(connections)
}

impl Acceptor {
    /// Takes one connection after the other until the server is gone.
    async fn run(self, mut next: impl AsyncFnMut(&Self) -> io::Result<()>) {
        let mut trouble = Trouble::default();
        loop {
            let accepted = tokio::select! {
                () = self.ready.closed() => return,
                accepted = next(&self) => accepted,
            };
            if let Err(error) = accepted {
                pause(&error, &mut trouble).await;
            }
        }
    }

    async fn take_tcp(&self, stream: TcpStream, address: SocketAddr) {
        let Some(activity) = self.slot(Some(address.ip())).await else {
            return;
        };
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%error, "small messages to this connection may be delayed");
        }
        let Some(tls) = &self.tls else {
            return self.hand_over(Box::new(stream), activity).await;
        };
        let (this, tls) = (self.clone(), Arc::clone(tls));
        tokio::spawn(async move {
            let shaken = tokio::select! {
                shaken = handshake(stream, address, &tls, &this.metrics) => shaken,
                () = activity.dismissed() => {
                    this.metrics.connection_lost("made_room");
                    None
                }
            };
            if let Some(stream) = shaken {
                this.hand_over(Box::new(stream), activity).await;
            }
        });
    }

    /// A Unix socket needs no encryption, because only its two ends read it.
    async fn take_local(&self, stream: UnixStream) {
        if let Some(activity) = self.slot(None).await {
            self.hand_over(Box::new(with_valid_hosts(stream)), activity).await;
        }
    }

    async fn slot(&self, address: Option<IpAddr>) -> Option<Arc<Activity>> {
        match self.slots.take(address.into()).await {
            Ok(slot) => Some(Arc::new(Activity::new(Instant::now(), slot, self.unfinished.clone()))),
            Err(reason) => {
                self.metrics.connection_lost(reason);
                tracing::debug!(?address, reason, "connection refused: too many are open");
                None
            }
        }
    }

    async fn hand_over(&self, transport: Box<dyn Transport>, activity: Arc<Activity>) {
        let deadline = Box::pin(sleep_until(activity.deadline()));
        let metrics = Some(Arc::clone(&self.metrics));
        let connection = Connection { transport, activity, deadline, metrics };
        // The server may just have ended.
        drop(self.ready.send(Ok(connection)).await);
    }
}

/// Waits a moment after a failure to accept a connection: an immediate retry would fail as well.
async fn pause(error: &io::Error, trouble: &mut Trouble) {
    if trouble.is_worth_a_line() {
        tracing::warn!(%error, "a connection could not be accepted");
    }
    tokio::time::sleep(std::time::Duration::from_millis(50)).await;
}

async fn handshake(
    stream: TcpStream,
    address: SocketAddr,
    tls: &Tls,
    metrics: &Metrics,
) -> Option<TlsStream<TcpStream>> {
    let acceptor = TlsAcceptor::from(tls.current());
    match timeout(limits::HANDSHAKE, acceptor.accept(stream)).await {
        Ok(Ok(stream)) => Some(stream),
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
    /// Whether the connection has to make room for others, which is counted.
    fn check_dismissed(&mut self, context: &Context<'_>) -> io::Result<()> {
        if !self.activity.has_to_go(context) {
            return Ok(());
        }
        self.count_lost("made_room");
        Err(io::ErrorKind::ConnectionAborted.into())
    }

    fn count_lost(&mut self, reason: &'static str) {
        // Counted once, because reading and writing both notice it.
        if let Some(metrics) = self.metrics.take() {
            metrics.connection_lost(reason);
        }
    }

    /// The result of writing. A dismissed connection ends even when its other side reads nothing.
    fn written<T>(&mut self, context: &Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_pending() {
            self.check_dismissed(context)?;
        }
        written
    }

    /// Whether the connection has missed its deadline.
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
        self.check_dismissed(context)?;
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.transport).poll_read(context, buffer);
        if read.is_ready() {
            self.activity.read((buffer.filled().len() - before) as u64);
        } else if self.poll_overdue(context).is_ready() {
            self.count_lost("overdue");
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
        let written = Pin::new(&mut self.transport).poll_write(context, bytes);
        self.written(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.transport).poll_write_vectored(context, slices);
        self.written(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.transport.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.transport).poll_flush(context);
        self.written(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let shut = Pin::new(&mut self.transport).poll_shutdown(context);
        self.written(context, shut)
    }
}

#[cfg(test)]
mod tests {
    use tokio::net::{TcpListener, UnixListener};

    use super::*;

    /// The holder of the set learns of each task that ends.
    #[tokio::test]
    async fn every_listener_has_a_task_in_the_set() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut listeners = Listeners::default();
        for _ in 0..2 {
            listeners.tcp.push(TcpListener::bind("127.0.0.1:0").await.expect("a port"));
        }
        listeners.unix.push(UnixListener::bind(folder.path().join("daemon.sock")).expect("a socket"));
        let (slots, unfinished) =
            (ConnectionSlots::new(ConnectionLimits::default()), Unfinished::new(limits::UNFINISHED_BYTES));
        let mut accepting = JoinSet::new();
        let connections = accept(&mut accepting, listeners, None, slots, unfinished, Arc::default());
        tokio::task::yield_now().await;
        assert_eq!(accepting.len(), 3);
        assert!(accepting.try_join_next().is_none(), "they go on");
        drop(connections);
        for _ in 0..3 {
            assert!(accepting.join_next().await.is_some_and(|ended| ended.is_ok()));
        }
    }
}
