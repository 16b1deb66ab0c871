//! The path and the permissions of a database, checked without opening the file.
//!
//! In a process that has a database open, only SQLite may open its files. SQLite's locks (`fcntl`) belong to
//! the process and not to a descriptor. The system drops all of them when the process closes *any* descriptor
//! of the file. Another program may then see no lock, fold the write-ahead log into the file and delete it
//! (<https://sqlite.org/howtocorrupt.html>, 2.2). So every check here works on the name: `stat(2)`,
//! `statx(2)`, `statfs(2)`, `access(2)`, `chmod(2)`.

use std::ffi::OsString;
use std::fs::{self, OpenOptions, Permissions};
use std::io::ErrorKind;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use rustix::fs::{Access, AtFlags, CWD};

use crate::error::OpenError;

/// Mode of files that only the owner may read: they hold hashes of tokens, and measurements.
pub(super) const PRIVATE: u32 = 0o600;

/// Finds the causes for which SQLite only says "unable to open".
pub(crate) fn check(path: &Path) -> Result<(), OpenError> {
    check_name(path)?;
    if path.is_dir() {
        return Err(OpenError::Directory(path.to_owned()));
    }
    let directory = folder(path);
    if !directory.is_dir() {
        return Err(OpenError::NoDirectory(directory.to_owned()));
    }
    match rustix::fs::accessat(CWD, path, Access::READ_OK | Access::WRITE_OK, AtFlags::EACCESS) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => {
            let problem = std::io::Error::from(error).to_string();
            Err(OpenError::NotWritable(path.to_owned(), problem))
        }
    }
}

/// Refuses names that SQLite or other programs would not take for a file of this name.
pub(crate) fn check_name(path: &Path) -> Result<(), OpenError> {
    // In SQLite these names stand for databases that vanish when they are closed.
    if path.as_os_str().is_empty() || path.as_os_str() == ":memory:" {
        return Err(OpenError::NoName(path.to_owned()));
    }
    let text = path.to_string_lossy();
    let scheme = text.split_once(':').map(|(scheme, _)| scheme).filter(|scheme| {
        let is_word = scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphabetic());
        is_word
            && (text[scheme.len()..].starts_with("://")
                || ["file", "sqlite"].contains(&&*scheme.to_lowercase()))
    });
    match scheme {
        Some(_) => Err(OpenError::Url(path.to_owned())),
        None => Ok(()),
    }
}

/// Refuses a file with a second name: SQLite's write-ahead log and our lock lie beside the given name. Two
/// programs with different names would not see each other, and the log's contents would be missing under the
/// other name.
pub(crate) fn check_names(path: &Path) -> Result<(), OpenError> {
    let Ok(file) = fs::metadata(path) else { return Ok(()) };
    let path = path.to_owned();
    match file.nlink() {
        _ if is_mounted_alone(&path) => Err(OpenError::MountedAlone(path)),
        count @ 2.. => Err(OpenError::ManyNames { path, count }),
        _ => Ok(()),
    }
}

/// Whether the file itself, and not the folder that it lies in, was mounted, as containers do it with volumes
/// of one file.
fn is_mounted_alone(path: &Path) -> bool {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{StatxAttributes, StatxFlags, statx};
        statx(CWD, path, AtFlags::empty(), StatxFlags::BASIC_STATS)
            .is_ok_and(|file| file.stx_attributes.contains(StatxAttributes::MOUNT_ROOT))
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = path;
        false
    }
}

/// Makes the database where there is none yet, and makes it private. SQLite gives its permissions to the
/// files beside it. To be called under the lock.
pub(super) fn make_private(path: &Path) -> Result<(), OpenError> {
    // A new file has no locks yet, so closing it drops none.
    match OpenOptions::new().write(true).create_new(true).mode(PRIVATE).open(path) {
        Ok(_) => return Ok(()),
        // Also for a link whose target is missing: SQLite follows it.
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        Err(error) => {
            return Err(OpenError::NotWritable(path.to_owned(), error.to_string()));
        }
    }
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    for suffix in ["", "-wal", "-shm"] {
        tighten(&beside(&path, suffix));
    }
    Ok(())
}

/// Removes the permissions of all users but the owner. A failure is logged.
pub(super) fn tighten(path: &Path) {
    let Ok(file) = fs::metadata(path) else { return };
    if file.mode() & 0o077 == 0 {
        return;
    }
    let mode = file.mode() & 0o700;
    match fs::set_permissions(path, Permissions::from_mode(mode)) {
        Ok(()) => tracing::info!(file = %path.display(), "others could read this file, and no longer can"),
        Err(error) => tracing::warn!(
            file = %path.display(),
            %error,
            "others can read this file or hold it locked; run `chmod go=` on it as its owner"
        ),
    }
}

/// Warns where the file lies on another machine: SQLite's write-ahead log needs memory that all its processes
/// share (<https://sqlite.org/wal.html>), and many file servers do not lock or sync as promised.
pub(super) fn warn_of_network(path: &Path) {
    let system = rustix::fs::statfs(folder(path)).ok().and_then(|found| network(found.f_type as u64));
    if let Some(system) = system {
        tracing::warn!(
            database = %path.display(),
            system,
            "the database lies on a network file system, where neither its locks nor its syncs can be relied on; \
             put it on a disk of this machine, or use PostgreSQL"
        );
    }
}

/// The name of a file system that is reached over a network, or by way of another program, by its number
/// (`statfs(2)`).
fn network(number: u64) -> Option<&'static str> {
    // Some are negative as 32 bits, and are widened on the way.
    Some(match number & 0xffff_ffff {
        0x6969 => "NFS",
        0x517b | 0xfe53_4d42 | 0xff53_4d42 => "SMB",
        0x5346_414f | 0x6b41_4653 => "AFS",
        0x7375_7245 => "Coda",
        0x564c => "NCP",
        0x0102_1997 => "9P",
        0x00c3_6400 => "Ceph",
        0x0bd0_0bd0 => "Lustre",
        0x0116_1970 => "GFS2",
        0x7461_636f => "OCFS2",
        0x4750_4653 => "GPFS",
        0x1983_0326 => "BeeGFS",
        0xaad7_aaea => "PanFS",
        0x7866_6d74 | 0x786f_4256 => "a shared folder of a virtual machine",
        0x6573_5546 => "FUSE",
        _ => return None,
    })
}

pub(crate) fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// `PATH` with something behind its name.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_system_that_is_reached_over_a_network_is_known_by_its_number() {
        let numbers = [
            0x6969, 0x517b, 0xfe534d42, 0xff534d42, 0x5346414f, 0x6b414653, 0x73757245, 0x564c, 0x01021997,
            0x00c36400, 0x0bd00bd0, 0x01161970, 0x7461636f, 0x47504653, 0x19830326, 0xaad7aaea, 0x78666d74,
            0x786f4256, 0x65735546,
        ];
        // As 32 bits with a sign they are widened with ones.
        for number in numbers {
            assert!(network(number).is_some() && network(number | !0xffff_ffff).is_some(), "{number:#x}");
        }
        assert_eq!([0x6969, 0xff534d42, 0x65735546].map(network), [Some("NFS"), Some("SMB"), Some("FUSE")]);
        let folder = tempfile::tempdir().expect("a folder");
        let here = rustix::fs::statfs(folder.path()).expect("some file system").f_type as u64;
        // ext4, XFS, btrfs, tmpfs, ZFS, overlayfs.
        for number in [here, 0xef53, 0x58465342, 0x9123683e, 0x01021994, 0x2fc12fc1, 0x794c7630] {
            assert_eq!(network(number), None, "{number:#x}");
        }
    }

    #[test]
    fn names_that_are_no_files_are_refused() {
        for name in [
            "file:x.db",
            "file:x.db?mode=memory",
            "file:///tmp/x.db",
            "File:x.db",
            "sqlite:x.db",
            "sqlite:///x.db",
            "mysql://u@h/d",
        ] {
            let refused = check_name(Path::new(name)).expect_err(name);
            assert!(matches!(refused, OpenError::Url { .. }), "{name}: {refused}");
        }
        for name in ["x.db", "./file:x.db", "C:x.db", "farm 3: tuning.db", "data/a:b.db", "filed:x.db"] {
            check_name(Path::new(name)).expect("a file's name");
        }
    }
}
