//! Accepts connections up to a limit, encrypts them where that is wished, and ends those that only wait.
//!
//! A connection must get on: its TLS handshake, the first bytes of HTTP/2 and its first request each have a time
//! limit, and one on which nothing is under way for long is closed. So whoever opens many and says little or
//! nothing ("slow loris") cannot hold places that others need. What happens once a request has begun is limited
//! in `front`.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::{Instant, Sleep, sleep_until, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

use crate::limits;
use crate::metrics::METRICS;
use crate::tls::Tls;

/// Bytes with which every HTTP/2 connection begins (RFC 9113, section 3.4).
const PREFACE_BYTES: u64 = 24;

/// A connection that counts until it is dropped.
pub(crate) struct Connection {
    transport: Transport,
    activity: Arc<Activity>,
    deadline: Pin<Box<Sleep>>,
    _permit: OwnedSemaphorePermit,
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
) -> impl Stream<Item = io::Result<Connection>> {
    let (ready, connections) = mpsc::channel(limits::CONNECTIONS);
    tokio::spawn(async move {
        let permits = Arc::new(Semaphore::new(limits::CONNECTIONS));
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
            let Ok(permit) = Arc::clone(&permits).try_acquire_owned() else {
                METRICS.connection_lost("limit");
                tracing::warn!(%address, limit = limits::CONNECTIONS, "connection refused: too many are open");
                continue;
            };
            let (ready, tls) = (ready.clone(), tls.clone());
            if tls.is_none() {
                drop(ready.send(Ok(Connection::new(Transport::Plain(stream), permit))).await);
                continue;
            }
            tokio::spawn(async move {
                if let Some(transport) = handshake(stream, address, tls).await {
                    drop(ready.send(Ok(Connection::new(transport, permit))).await);
                }
            });
        }
    });
    ReceiverStream::new(connections)
}

async fn handshake(stream: TcpStream, address: SocketAddr, tls: Option<Arc<Tls>>) -> Option<Transport> {
    let acceptor = TlsAcceptor::from(tls?.current());
    match timeout(limits::HANDSHAKE, acceptor.accept(stream)).await {
        Ok(Ok(stream)) => Some(Transport::Tls(Box::new(stream))),
        Ok(Err(error)) => {
            METRICS.connection_lost("tls");
            tracing::info!(%address, %error, "TLS handshake failed");
            None
        }
        Err(_) => {
            METRICS.connection_lost("overdue");
            tracing::info!(%address, "TLS handshake took too long");
            None
        }
    }
}

impl Connection {
    fn new(transport: Transport, permit: OwnedSemaphorePermit) -> Self {
        let tcp = match &transport {
            Transport::Plain(stream) => stream,
            Transport::Tls(stream) => stream.get_ref().0,
        };
        if let Err(error) = tcp.set_nodelay(true) {
            tracing::debug!(%error, "small messages to this connection may be delayed");
        }
        let activity = Arc::new(Activity::new(Instant::now()));
        let deadline = Box::pin(sleep_until(activity.deadline()));
        Self { transport, activity, deadline, _permit: permit }
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

/// What happens on a connection: shared by it and its requests.
#[derive(Debug)]
pub(crate) struct Activity {
    opened: Instant,
    state: Mutex<State>,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    bytes: u64,
    under_way: usize,
    last: Option<Instant>,
}

/// A request or stream under way, until dropped.
#[derive(Debug)]
pub(crate) struct UnderWay {
    activity: Arc<Activity>,
}

impl Activity {
    fn new(opened: Instant) -> Self {
        Self { opened, state: Mutex::default() }
    }

    fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// A request begins.
    pub(crate) fn begin(self: &Arc<Self>) -> UnderWay {
        self.with(|state| state.under_way += 1);
        UnderWay { activity: Arc::clone(self) }
    }

    /// Until when something must happen.
    fn deadline(&self) -> Instant {
        let state = self.with(|state| *state);
        match state.last {
            _ if state.under_way > 0 => Instant::now() + limits::IDLE,
            Some(last) => last + limits::IDLE,
            None if state.bytes < PREFACE_BYTES => self.opened + limits::PREFACE,
            None => self.opened + limits::FIRST_REQUEST,
        }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.activity.with(|state| {
            state.under_way -= 1;
            state.last = Some(Instant::now());
        });
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
            self.activity.with(|state| state.bytes += more);
        } else if self.poll_overdue(context).is_ready() {
            METRICS.connection_lost("overdue");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_connection_must_get_on() {
        let opened = Instant::now();
        let activity = Arc::new(Activity::new(opened));
        assert_eq!(activity.deadline(), opened + limits::PREFACE);
        activity.with(|state| state.bytes = PREFACE_BYTES);
        assert_eq!(activity.deadline(), opened + limits::FIRST_REQUEST);
        let (first, second) = (activity.begin(), activity.begin());
        tokio::time::advance(2 * limits::IDLE).await;
        drop(first);
        assert!(activity.deadline() > Instant::now(), "something is under way");
        drop(second);
        assert_eq!(activity.deadline(), Instant::now() + limits::IDLE);
        tokio::time::advance(limits::IDLE).await;
        assert!(activity.deadline() <= Instant::now());
    }
}
