//! Requests over a Unix socket with any `:authority`.
//!
//! Over a Unix socket there is no host to name. Clients on gRPC's C core (C++, Python, Ruby, C#) name the
//! path of the socket, percent-encoded, which the HTTP library refuses as a malformed host. The daemon does
//! not use the authority, so characters that cannot stand in a host are replaced on their way in, one for
//! one. So the lengths of frames and strings, and the sizes of HPACK's tables, stay those of the client (RFC
//! 9113, section 4.1; RFC 7541, sections 5 and 6). Strings in Huffman code, which the C core does not use
//! here, stay as they are.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, Join, ReadBuf, join};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

/// Bytes with which every HTTP/2 connection begins.
const PREFACE_BYTES: usize = 24;
const HEADERS: u8 = 1;
const CONTINUATION: u8 = 9;
const PADDED: u8 = 0x8;
const PRIORITY: u8 = 0x20;
/// Place of `:authority` in HPACK's static table.
const AUTHORITY: usize = 1;

/// A Unix socket whose requests name valid hosts.
pub(super) fn with_valid_hosts(socket: UnixStream) -> Join<impl AsyncRead + Send + Unpin, OwnedWriteHalf> {
    let (socket, writer) = socket.into_split();
    join(LocalReader { socket, rewriter: Rewriter::default() }, writer)
}

struct LocalReader {
    socket: OwnedReadHalf,
    rewriter: Rewriter,
}

impl AsyncRead for LocalReader {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.socket).poll_read(context, buffer))?;
        self.rewriter.rewrite(&mut buffer.filled_mut()[before..]);
        Poll::Ready(Ok(()))
    }
}

/// Follows the frames of a connection in pieces of any length.
#[derive(Debug, Default)]
struct Rewriter {
    /// Bytes of the preface that have arrived.
    preface: usize,
    head: [u8; 9],
    head_bytes: usize,
    /// Bytes of the frame's payload that are missing.
    payload: usize,
    /// Bytes of a frame of headers before its fields.
    before_fields: usize,
    is_pad_length_next: bool,
    padding: usize,
    fields: Option<Fields>,
}

impl Rewriter {
    fn rewrite(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            if self.preface < PREFACE_BYTES {
                self.preface += 1;
            } else if self.payload > 0 {
                self.payload_byte(byte);
            } else {
                self.head_byte(*byte);
            }
        }
    }

    fn head_byte(&mut self, byte: u8) {
        self.head[self.head_bytes] = byte;
        self.head_bytes += 1;
        if self.head_bytes < self.head.len() {
            return;
        }
        self.head_bytes = 0;
        let [a, b, c, kind, flags, ..] = self.head;
        self.payload = usize::from(a) << 16 | usize::from(b) << 8 | usize::from(c);
        self.is_pad_length_next = kind == HEADERS && flags & PADDED != 0;
        self.before_fields = if kind == HEADERS && flags & PRIORITY != 0 { 5 } else { 0 };
        self.padding = 0;
        match kind {
            HEADERS => self.fields = Some(Fields::default()),
            // The fields go on where they stopped.
            CONTINUATION => {}
            _ => self.fields = None,
        }
    }

    fn payload_byte(&mut self, byte: &mut u8) {
        self.payload -= 1;
        if self.is_pad_length_next {
            (self.is_pad_length_next, self.padding) = (false, usize::from(*byte));
        } else if self.before_fields > 0 {
            self.before_fields -= 1;
        } else if self.payload >= self.padding
            && let Some(fields) = &mut self.fields
        {
            fields.byte(byte);
        }
    }
}

/// Follows the fields of one block of HPACK.
#[derive(Debug, Default)]
struct Fields {
    at: Part,
    /// An integer of several bytes: its value so far, and the shift of the next seven bits.
    integer: Option<(usize, u32)>,
    is_authority: bool,
    is_huffman: bool,
}

#[derive(Clone, Copy, Debug, Default)]
enum Part {
    #[default]
    Field,
    /// The rest of the number of an entry, or of a table's size, after which a field comes.
    Number,
    /// The rest of the number of a name.
    NameNumber,
    NameLength,
    Name(usize),
    ValueLength,
    Value(usize),
}

impl Fields {
    fn byte(&mut self, byte: &mut u8) {
        match self.at {
            Part::Field => self.field(*byte),
            Part::Number | Part::NameNumber => {
                if let Some(number) = self.more(*byte) {
                    self.numbered(number);
                }
            }
            Part::NameLength | Part::ValueLength => {
                let length = match self.integer {
                    Some(_) => self.more(*byte),
                    None => {
                        self.is_huffman = *byte & 0x80 != 0;
                        self.begin(*byte, 0x7f)
                    }
                };
                if let Some(length) = length {
                    self.long(length);
                }
            }
            Part::Name(left) => self.at = if left > 1 { Part::Name(left - 1) } else { Part::ValueLength },
            Part::Value(left) => {
                if self.is_authority && !self.is_huffman && !is_of_a_host(*byte) {
                    *byte = b'-';
                }
                self.at = if left > 1 { Part::Value(left - 1) } else { Part::Field };
            }
        }
    }

    /// Reads the first byte of a field, which gives its kind (RFC 7541, section 6).
    fn field(&mut self, byte: u8) {
        let (at, mask) = match byte {
            0x80.. => (Part::Number, 0x7f),
            0x40..0x80 => (Part::NameNumber, 0x3f),
            0x20..0x40 => (Part::Number, 0x1f),
            _ => (Part::NameNumber, 0x0f),
        };
        self.at = at;
        if let Some(number) = self.begin(byte, mask) {
            self.numbered(number);
        }
    }

    fn numbered(&mut self, number: usize) {
        self.is_authority = number == AUTHORITY;
        self.at = match self.at {
            Part::NameNumber if number == 0 => Part::NameLength,
            Part::NameNumber => Part::ValueLength,
            _ => Part::Field,
        };
    }

    fn long(&mut self, length: usize) {
        self.at = match (self.at, length) {
            (Part::NameLength, 0) => Part::ValueLength,
            (Part::NameLength, length) => Part::Name(length),
            (_, 0) => Part::Field,
            (_, length) => Part::Value(length),
        };
    }

    /// An integer whose first bits stand in this byte (RFC 7541, section 5.1); none where more bytes follow.
    fn begin(&mut self, byte: u8, mask: u8) -> Option<usize> {
        if byte & mask < mask {
            return Some(usize::from(byte & mask));
        }
        self.integer = Some((usize::from(mask), 0));
        None
    }

    fn more(&mut self, byte: u8) -> Option<usize> {
        let (value, shift) = self.integer?;
        // The HTTP library refuses too large an integer, so the bytes after it do not matter.
        let value = value.saturating_add(usize::from(byte & 0x7f).checked_shl(shift).unwrap_or(usize::MAX));
        self.integer = (byte & 0x80 != 0).then_some((value, shift + 7));
        self.integer.is_none().then_some(value)
    }
}

fn is_of_a_host(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'.' | b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

    fn frame(kind: u8, flags: u8, payload: &[u8]) -> Vec<u8> {
        let length = u32::try_from(payload.len()).expect("short").to_be_bytes();
        [&length[1..], &[kind, flags, 0, 0, 0, 1], payload].concat()
    }

    /// A header whose name is that of an entry of the static table.
    fn named(first: u8, value: &[u8]) -> Vec<u8> {
        assert!(value.len() < 127);
        [&[first, value.len() as u8], value].concat()
    }

    fn rewritten(bytes: &[u8], piece: usize) -> Vec<u8> {
        let (mut rewriter, mut all) = (Rewriter::default(), bytes.to_vec());
        all.chunks_mut(piece).for_each(|piece| rewriter.rewrite(piece));
        all
    }

    #[test]
    fn a_path_becomes_a_host_and_all_else_stays() {
        let long = vec![b'%'; 300];
        let length = [0x7f, 0x80 | (300 - 127) as u8 & 0x7f, ((300 - 127) >> 7) as u8];
        let fields = |authority: &[u8]| {
            [
                vec![0x3f, 0xe1, 0x1f, 0x83, 0x86],
                named(0x44, b"/a%2Fb"),
                [&[0x0f, 0x2f][..], &length, &long].concat(),
                [&[0x00, 0x03][..], b"x%y", &[0x02], b"a%"].concat(),
                named(0x41, authority),
                named(0x01, authority),
                vec![0xbe, 0xff, 0x00],
            ]
            .concat()
        };
        let stream = |authority: &[u8]| {
            let all = fields(authority);
            let (begin, rest) = all.split_at(340);
            let padded = [&[4][..], &[0, 0, 0, 0, 7], &all, b"%%%%"].concat();
            let frames = [
                frame(4, 0, b"\x41\x03%%%"),
                frame(HEADERS, 0, begin),
                frame(CONTINUATION, 4, rest),
                frame(0, 0, b"\x41\x03%%%"),
                frame(HEADERS, PADDED | PRIORITY | 4, &padded),
            ];
            [PREFACE.to_vec(), frames.concat()].concat()
        };
        let (given, right) = (stream(b"%2Ftmp%2Fa.sock"), stream(b"-2Ftmp-2Fa.sock"));
        for piece in [1, 2, 3, 7, 100, given.len()] {
            assert_eq!(rewritten(&given, piece), right, "in pieces of {piece}");
        }
        assert_eq!(rewritten(&right, 5), right);
    }

    #[test]
    fn whatever_comes_is_followed_without_end() {
        let mut seed = 1_u32;
        let mut noise: Vec<u8> = (0..200_000)
            .map(|_| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 24) as u8
            })
            .collect();
        Rewriter::default().rewrite(&mut noise);
        let fields = frame(HEADERS, 0, &noise[..16_000]);
        assert_eq!(rewritten(&[PREFACE, &fields].concat(), 9).len(), PREFACE.len() + fields.len());
    }
}
