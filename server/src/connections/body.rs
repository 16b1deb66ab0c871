//! Bodies of requests and answers, whose bytes count while they are unfinished.
//!
//! The head of a request counts, then the message under way. It counts with the length that its prefix gives,
//! because that much memory is reserved for it (a frame of gRPC is a flag, a length in four bytes, and the
//! message). Each piece of an answer counts until the connection has written it.

use std::sync::Arc;

use bytes::Bytes;
use http::{HeaderMap, Request};
use http_body_util::BodyExt as _;
use hyper::body::Frame;
use tonic::body::Body;

use super::activity::{Activity, HeldBytes, UnderWay};
use crate::limits;

/// The flag and the length before each message.
const PREFIX_BYTES: usize = 5;

#[derive(Debug, Default)]
struct Messages {
    prefix: [u8; PREFIX_BYTES],
    /// The number of bytes of the prefix that have arrived.
    prefix_bytes: usize,
    missing: usize,
    /// Size of the message under way, in bytes.
    under_way: usize,
    /// Size of the largest message, whose memory the gRPC library keeps for later ones.
    kept: usize,
}

impl Messages {
    fn read(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            if self.missing == 0 {
                let taken = bytes.len().min(PREFIX_BYTES - self.prefix_bytes);
                let (here, rest) = bytes.split_at(taken);
                self.prefix[self.prefix_bytes..self.prefix_bytes + taken].copy_from_slice(here);
                (self.prefix_bytes, bytes) = (self.prefix_bytes + taken, rest);
                if self.prefix_bytes < PREFIX_BYTES {
                    self.check();
                    return;
                }
                let [flag, length @ ..] = self.prefix;
                // A longer one is refused by the gRPC library as soon as it reads this.
                self.missing = (u32::from_be_bytes(length) as usize).min(limits::REQUEST_BYTES);
                // The size of a compressed message is not known before.
                self.under_way = if flag == 0 { self.missing } else { limits::REQUEST_BYTES };
            }
            let taken = bytes.len().min(self.missing);
            (self.missing, bytes) = (self.missing - taken, &bytes[taken..]);
            if self.missing == 0 {
                self.kept = self.kept.max(self.under_way);
                (self.prefix_bytes, self.under_way) = (0, 0);
            }
        }
        self.check();
    }

    /// Checks the state between two pieces: a message is under way from its whole prefix to its last byte.
    fn check(&self) {
        assert_eq!(self.missing > 0, self.prefix_bytes == PREFIX_BYTES, "{self:?}");
        assert_eq!(self.missing > 0, self.under_way > 0, "{self:?}");
        assert!(self.missing <= self.under_way && self.under_way <= limits::REQUEST_BYTES, "{self:?}");
        assert!(self.kept <= limits::REQUEST_BYTES, "{self:?}");
    }

    fn held(&self) -> usize {
        let kept = if self.kept > limits::MESSAGE_BYTES_SMALL { self.kept } else { 0 };
        self.under_way.max(kept)
    }

    fn is_between(&self) -> bool {
        self.prefix_bytes == 0
    }
}

/// A request whose bytes count on its connection until they are a whole message.
pub(crate) fn request_body(activity: &Arc<Activity>, request: Request<Body>) -> Request<Body> {
    // Until the first message is there, the head counts.
    let mut head = limits::REQUEST_HEAD_BYTES + header_bytes(request.headers());
    let (mut messages, mut held) = (Messages::default(), activity.hold(head));
    let count = move |frame: &Frame<Bytes>| {
        if let Some(data) = frame.data_ref() {
            messages.read(data);
            if messages.is_between() {
                head = 0;
            }
            held.set(head + messages.held());
        }
    };
    request.map(|inner| Body::new(inner.inspect_frame(count)))
}

fn header_bytes(headers: &HeaderMap) -> usize {
    headers.iter().map(|(name, value)| name.as_str().len() + value.len()).sum()
}

/// A piece of an answer that counts until its last owner has dropped it: until it is written.
struct Piece {
    bytes: Bytes,
    _held: HeldBytes,
}

impl AsRef<[u8]> for Piece {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// An answer whose bytes count on its connection until they are written. Its request, where it is given, is
/// under way until the answer has ended.
pub(crate) fn answer_body(activity: &Arc<Activity>, inner: Body, under_way: Option<Arc<UnderWay>>) -> Body {
    let activity = Arc::clone(activity);
    let counted = move |frame: Frame<Bytes>| {
        // The closure keeps it until the answer has ended.
        let _ = &under_way;
        frame.map_data(|bytes| Bytes::from_owner(Piece { _held: activity.hold(bytes.len()), bytes }))
    };
    Body::new(inner.map_frame(counted))
}

#[cfg(test)]
mod tests {
    use tokio::time::{Instant, advance};
    use tonic::Status;

    use super::super::slots::{ConnectionLimits, ConnectionSlots};
    use super::super::unfinished::Unfinished;
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_connection_with_a_stream_alone_lives_as_long_as_the_stream() {
        let slots = ConnectionSlots::new(ConnectionLimits::default());
        let slot = slots.take(None.into()).await.expect("room");
        let activity = Arc::new(Activity::new(Instant::now(), slot, Unfinished::new(100)));
        activity.read(100);
        // It says nothing more, and does not end.
        let silent = http_body_util::StreamBody::new(tokio_stream::pending::<Result<Frame<Bytes>, Status>>());
        let stream = answer_body(&activity, Body::new(silent), Some(Arc::new(activity.begin())));
        advance(3 * limits::FIRST_REQUEST).await;
        assert!(activity.deadline() > Instant::now(), "it watches");
        drop(stream);
        assert!(activity.deadline() <= Instant::now(), "it never sent a request that was authorised");
    }

    fn message(flag: u8, length: u32) -> Vec<u8> {
        [&[flag][..], &length.to_be_bytes(), &vec![7; length as usize]].concat()
    }

    #[test]
    fn messages_are_followed_however_they_are_cut() {
        let all = [message(0, 3), message(0, 0), message(0, 100)].concat();
        for size in 1..=all.len() {
            let mut messages = Messages::default();
            let mut most = 0;
            for piece in all.chunks(size) {
                messages.read(piece);
                most = most.max(messages.held());
            }
            assert!(messages.is_between() && messages.held() == 0, "{size}: {messages:?}");
            // Whole messages hold no bytes.
            assert_eq!(most, if size < all.len() { 100 } else { 0 }, "{size}");
        }
    }

    #[test]
    fn a_beginning_counts_as_much_as_it_announces() {
        let mut messages = Messages::default();
        messages.read(&message(0, 1 << 19)[..5]);
        assert_eq!(messages.held(), 1 << 19);
        let mut messages = Messages::default();
        messages.read(&message(1, 100)[..50]);
        assert_eq!(messages.held(), limits::REQUEST_BYTES, "it may become as large when it is unpacked");
        let mut messages = Messages::default();
        messages.read(&[0, 255, 255, 255, 255]);
        assert_eq!(messages.held(), limits::REQUEST_BYTES, "more is refused");
    }

    #[test]
    fn the_room_of_a_large_message_stays_with_its_stream() {
        let mut messages = Messages::default();
        messages.read(&message(0, 1 << 19));
        assert_eq!(messages.held(), 1 << 19);
        messages.read(&message(0, 10));
        assert_eq!(messages.held(), 1 << 19);
    }
}
