//! Addresses to which a daemon can come back after it was killed.
//!
//! A port that the system chose is free again the moment its owner is gone, and may be given to the next
//! program that asks for any. The ports handed out here lie below those that Linux gives away by itself
//! (`ip(7)`, `ip_local_port_range`: 32768 and above), so a program gets one only by its number.

use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicU32, Ordering};

const FIRST: u32 = 12_000;
const COUNT: u32 = 20_000;

/// `127.0.0.1:PORT` with a [lasting port](lasting_port).
pub fn lasting_address() -> String {
    format!("127.0.0.1:{}", lasting_port())
}

/// A port of the loopback that is free now and that no other program is given while its owner is away.
pub fn lasting_port() -> u16 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    // Test programs that run at the same time begin far from one another.
    let begin = std::process::id().wrapping_mul(613);
    let candidate = |_| {
        let place = begin.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % COUNT;
        let port = u16::try_from(FIRST + place).expect("ports below 32,000");
        TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok().then_some(port)
    };
    (0..1000).find_map(candidate).expect("one of a thousand ports is free")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_port_is_handed_out_twice() {
        let (first, second) = (lasting_port(), lasting_port());
        assert_ne!(first, second);
        let _owner = TcpListener::bind((Ipv4Addr::LOCALHOST, first)).expect("it is free");
    }
}
