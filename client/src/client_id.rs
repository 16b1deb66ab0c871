//! The default id of a client. It is unique among running clients, and a restarted program gets it again.
//!
//! It names program, machine and user, and a slot that distinguishes clients that run side by side.
//! Containers that share a machine's network share its slots as well. Those with a network of their own have
//! a host name of their own.

use std::sync::Mutex;

use crate::limits::CLIENT_SLOTS;
use crate::locks::lock;
use crate::slot::Slot;

/// An id that is taken for as long as this lives.
#[derive(Debug)]
struct DefaultId {
    id: String,
    /// One that was forked has its parent's slot, and needs one of its own.
    process: u32,
    _slot: Slot,
}

static OURS: Mutex<Option<DefaultId>> = Mutex::new(None);

/// The id of this process, which holds it from the first question to its end.
pub(crate) fn default_client_id() -> String {
    let mut ours = lock(&OURS);
    if let Some(slot) = ours.as_ref().filter(|slot| slot.process == std::process::id()) {
        return slot.id.clone();
    }
    ours.insert(DefaultId::take(&identity())).id.clone()
}

impl DefaultId {
    /// The first slot of `who` that is free.
    fn take(who: &str) -> Self {
        let process = std::process::id();
        for number in 0..CLIENT_SLOTS {
            match Slot::take(&format!("treewright-client-{number}-{who}")) {
                Slot::Taken => {}
                Slot::Held(None) => break,
                slot => return Self { id: format!("{who}/{number}"), process, _slot: slot },
            }
        }
        // Where there are no such sockets, the id is at least unique.
        Self { id: format!("{who}-{process}"), process, _slot: Slot::Held(None) }
    }
}

/// `PROGRAM@MACHINE/USER`, of what can be found out.
fn identity() -> String {
    let program = std::env::current_exe()
        .ok()
        .and_then(|path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()))
        .unwrap_or_else(|| "client".to_owned());
    let user =
        std::env::var("USER").or_else(|_| std::env::var("LOGNAME")).unwrap_or_else(|_| "user".to_owned());
    format!("{}@{}/{}", short(&program, 32), machine_name(), short(&user, 24))
}

/// The host's name, and a number that distinguishes hosts of one name: a hash of `machine-id(5)`, which
/// itself is confidential.
pub(crate) fn machine_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = if name.trim().is_empty() { "machine" } else { name.trim() };
    let number = std::fs::read("/etc/machine-id").map_or(0, |bytes| hash(&bytes));
    format!("{}-{number:08x}", short(name, 32))
}

fn short(text: &str, most: usize) -> String {
    text.chars().filter(|each| !each.is_control()).take(most).collect()
}

/// FNV-1a with 32 bits (Fowler, Noll and Vo, draft-eastlake-fnv).
pub(crate) fn hash(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_run_side_by_side_differ_and_who_starts_again_is_the_same() {
        let who = format!("a test of {}", std::process::id());
        let (first, second) = (DefaultId::take(&who), DefaultId::take(&who));
        assert_eq!((first.id.as_str(), second.id.as_str()), (&*format!("{who}/0"), &*format!("{who}/1")));
        drop(first);
        assert_eq!(DefaultId::take(&who).id, format!("{who}/0"));
        // Names that are too long for a socket are not taken twice either.
        let long = "x".repeat(200);
        let both = [DefaultId::take(&long), DefaultId::take(&long)];
        assert_ne!(both[0].id, both[1].id);
    }

    /// Test vectors of draft-eastlake-fnv.
    #[test]
    fn machines_are_told_apart_by_fnv() {
        for (text, expected) in [("", 0x811c_9dc5), ("a", 0xe40c_292c), ("foobar", 0xbf9c_f968)] {
            assert_eq!(hash(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn a_process_has_one_id() {
        let id = default_client_id();
        assert_eq!(default_client_id(), id);
        let program = std::env::current_exe().expect("a program");
        let program = program.file_stem().expect("a name").to_string_lossy();
        assert!(id.starts_with(&program[..program.len().min(32)]) && id.contains('@'), "{id}");
        assert!(id.chars().count() <= treewright_model::limits::CLIENT_ID_CHARACTERS_MAX);
    }
}
