//! The user that PostgreSQL may run as.

use std::os::unix::fs::{MetadataExt as _, chown};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;

/// A user without special rights.
#[derive(Clone, Copy)]
pub(crate) struct User {
    /// None where this process has no special rights itself.
    ids: Option<(u32, u32)>,
}

impl User {
    /// Finds one: this process's own user, or for root `postgres` or `nobody`.
    pub(crate) fn unprivileged() -> Self {
        let own = std::fs::metadata("/proc/self").expect("a process has an owner").uid();
        if own != 0 {
            return Self { ids: None };
        }
        let users = std::fs::read_to_string("/etc/passwd").expect("there is a list of users");
        let find = |wanted: &str| {
            let mut fields = users.lines().find(|line| line.split(':').next() == Some(wanted))?.split(':');
            Some((fields.nth(2)?.parse().ok()?, fields.next()?.parse().ok()?))
        };
        let ids = find("postgres").or_else(|| find("nobody"));
        Self { ids: Some(ids.expect("there is a user postgres or nobody, as whom PostgreSQL can run")) }
    }

    /// Hands a file or folder over.
    pub(crate) fn own(self, path: &Path) {
        if let Some((user, group)) = self.ids {
            chown(path, Some(user), Some(group)).expect("root can hand files over");
        }
    }

    /// Lets a command run as this user.
    pub(crate) fn run(self, command: &mut Command) -> &mut Command {
        match self.ids {
            Some((user, group)) => command.uid(user).gid(group),
            None => command,
        }
    }
}
