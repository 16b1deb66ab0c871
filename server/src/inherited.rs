//! Descriptors that the daemon's parent process left open.
//!
//! A renderer that starts a daemon for its user ([`--idle-exit-s`](crate::config::ServeConfig::idle_exit_s))
//! passes on every file and socket that it did not mark as its own. The daemon would keep the renderer's
//! ports taken and its files open long after the renderer has ended. So such a daemon closes them first of
//! all, as `daemon(7)` advises. The daemon does it, not the client, because only a process without threads
//! and files can know that they are not in use.

use std::os::fd::RawFd;

/// Standard input, output and error.
const STANDARD: RawFd = 2;

/// The variable that systemd sets for a process to which it hands sockets (`sd_listen_fds(3)`).
const HANDED_OVER: &str = "LISTEN_FDS";

/// Closes every descriptor but the three standard ones, unless systemd handed some over. To be called before
/// any file is opened. Does nothing where the system does not list a process's descriptors in `/proc/self/fd`
/// or `/dev/fd`.
pub fn close_descriptors() {
    if std::env::var_os(HANDED_OVER).is_some() {
        return;
    }
    for descriptor in open_descriptors() {
        // The descriptor of the listing is closed already.
        let _ = nix::unistd::close(descriptor);
    }
}

fn open_descriptors() -> Vec<RawFd> {
    let listed = std::fs::read_dir("/proc/self/fd").or_else(|_| std::fs::read_dir("/dev/fd"));
    let names =
        listed.into_iter().flatten().flatten().filter_map(|entry| entry.file_name().into_string().ok());
    names.filter_map(|name| name.parse().ok()).filter(|descriptor| *descriptor > STANDARD).collect()
}
