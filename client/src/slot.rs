//! Names that only one process of a machine can hold at a time. A name is held by a Unix socket in the
//! abstract namespace (`unix(7)`). The system frees it when the process ends, also after a crash, and it
//! leaves no file behind. Containers that share a machine's network share these names as well.

use std::os::unix::net::UnixDatagram;

const NAME_BYTES: usize = 107;

/// The result of asking for a name.
#[derive(Debug)]
pub(crate) enum Slot {
    /// It is held for as long as this lives; without a socket where the system has none of that kind.
    Held(Option<UnixDatagram>),
    /// Another process holds it.
    Taken,
}

impl Slot {
    /// Takes the name if it is free. Of a longer name only the first 107 bytes count.
    pub(crate) fn take(name: &str) -> Self {
        match bound(&name.as_bytes()[..name.len().min(NAME_BYTES)]) {
            Ok(socket) => Self::Held(Some(socket)),
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => Self::Taken,
            Err(_) => Self::Held(None),
        }
    }
}

#[cfg(target_os = "linux")]
fn bound(name: &[u8]) -> std::io::Result<UnixDatagram> {
    use std::os::linux::net::SocketAddrExt as _;
    UnixDatagram::bind_addr(&std::os::unix::net::SocketAddr::from_abstract_name(name)?)
}

/// Other systems have no such namespace.
#[cfg(not(target_os = "linux"))]
fn bound(_: &[u8]) -> std::io::Result<UnixDatagram> {
    Err(std::io::ErrorKind::Unsupported.into())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_held_once_and_free_again_afterwards() {
        let name = format!("a slot of {}", std::process::id());
        let held = Slot::take(&name);
        assert!(matches!((&held, Slot::take(&name)), (Slot::Held(Some(_)), Slot::Taken)));
        drop(held);
        assert!(matches!(Slot::take(&name), Slot::Held(_)));
    }
}
