//! The daemon that a user's programs start for themselves. It is found by its database in every session, and
//! out of the reach of other users of the machine.

use std::os::unix::fs::{PermissionsExt as _, chown, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use treewright_tests::programs::{program, stderr};
use treewright_tests::sandbox::skip;

use crate::site::json;

/// The program of a user with this home, and with this session if any.
pub(crate) fn at_home(home: &Path, session: Option<&Path>) -> Command {
    let mut command = Command::new(program("treewright"));
    for variable in ["TREEWRIGHT_SERVER", "XDG_DATA_HOME", "XDG_RUNTIME_DIR"] {
        command.env_remove(variable);
    }
    if let Some(session) = session {
        command.env("XDG_RUNTIME_DIR", session);
    }
    command.env("HOME", home).env("TREEWRIGHT_LOCAL_IDLE_S", "3");
    command
}

fn ping(home: &Path) -> Output {
    let mut command = at_home(home, None);
    command.args(["--server", "local", "--json", "ping"]).output().expect("the program starts")
}

fn server(output: &Output) -> String {
    json(output)["server"].as_str().expect("an address").to_owned()
}

fn refused(output: &Output, why: &str) {
    assert_eq!(output.status.code(), Some(3), "{}", stderr(output));
    assert!(stderr(output).contains(why), "{}", stderr(output));
}

fn data(home: &Path) -> PathBuf {
    home.join(".local/share/treewright")
}

/// The path of a socket has 107 bytes at most; a port of the loopback would be open to every user of the
/// machine.
#[test]
fn a_long_path_is_no_reason_to_listen_on_a_port() {
    let folder = tempfile::tempdir().expect("a folder");
    let home = folder.path().join("long".repeat(30));
    std::fs::create_dir(&home).expect("a home");
    let first = ping(&home);
    assert!(server(&first).starts_with("unix:/tmp/treewright-"), "{}", server(&first));
    assert_eq!(server(&first), server(&ping(&home)));
    let socket = PathBuf::from(server(&first).trim_start_matches("unix:"));
    let runtime = socket.parent().expect("a folder");
    assert_eq!(std::fs::metadata(runtime).expect("there").permissions().mode() & 0o777, 0o700);
    std::fs::remove_dir_all(runtime).expect("it can be removed");
}

#[test]
fn folders_that_are_not_the_users_alone_are_not_used() {
    let home = tempfile::tempdir().expect("a home");
    let url = server(&ping(home.path()));
    let runtime = PathBuf::from(url.trim_start_matches("unix:"));
    let runtime = runtime.parent().expect("a folder").file_name().expect("a name").to_owned();

    // A link to a folder where a file has the name of the daemon's log.
    let home = tempfile::tempdir().expect("a home");
    let diary = home.path().join("diary");
    std::fs::create_dir_all(data(home.path())).expect("a folder");
    std::fs::create_dir(&diary).expect("a folder");
    std::fs::write(diary.join("daemon.log"), "dear diary").expect("written");
    symlink(&diary, data(home.path()).join(&runtime)).expect("a link");
    refused(&ping(home.path()), "is a link");
    assert_eq!(std::fs::read_to_string(diary.join("daemon.log")).expect("there"), "dear diary");
    std::fs::remove_file(data(home.path()).join(&runtime)).expect("removed");

    // Both may be written by others.
    let open = |folder: &Path, mode| {
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(mode)).expect("its owner may");
    };
    open(&data(home.path()), 0o777);
    refused(&ping(home.path()), "can be written by others");
    open(&data(home.path()), 0o700);
    std::fs::create_dir(data(home.path()).join(&runtime)).expect("a folder");
    open(&data(home.path()).join(&runtime), 0o770);
    refused(&ping(home.path()), "can be written by others");
    std::fs::remove_dir(data(home.path()).join(&runtime)).expect("removed");

    // A link of one's own to another disk.
    let disk = tempfile::tempdir().expect("a disk");
    let moved = disk.path().join("treewright");
    std::fs::rename(data(home.path()), &moved).expect("moved");
    symlink(&moved, data(home.path())).expect("a link");
    server(&ping(home.path()));

    // A folder of another user.
    let home = tempfile::tempdir().expect("a home");
    std::fs::create_dir_all(data(home.path())).expect("a folder");
    if chown(data(home.path()), Some(12_345), None).is_err() {
        return skip("a folder of another user", "it takes root to make one");
    }
    refused(&ping(home.path()), "belongs to another user");
}
