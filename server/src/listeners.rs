//! The listeners for clients: TCP, Unix sockets, or sockets that systemd opened for the daemon ("socket
//! activation", see `systemd.socket(5)` and `sd_listen_fds(3)`).
//!
//! A Unix socket can only be reached by the user whose daemon it is: its file is made unreadable to all
//! others.

use std::io;
use std::net::SocketAddr;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use listenfd::ListenFd;
use tokio::net::{TcpListener, UnixListener};

/// Sockets on which connections are accepted.
#[derive(Debug, Default)]
pub struct Listeners {
    /// The files of sockets that were made here. They are removed at the end, before the sockets close.
    files: Vec<SocketFile>,
    pub(crate) tcp: Vec<TcpListener>,
    pub(crate) unix: Vec<UnixListener>,
}

/// The file of a Unix socket; removed when dropped, unless another has taken its place. To be dropped while
/// the socket still listens: afterwards another process may replace a deserted file at any moment.
#[derive(Debug)]
pub(crate) struct SocketFile {
    path: PathBuf,
    /// Device and number of the file.
    file: (u64, u64),
}

impl SocketFile {
    fn made(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), file: identity(path)? })
    }
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    let file = std::fs::symlink_metadata(path)?;
    Ok((file.dev(), file.ino()))
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        // The file may be gone already.
        if identity(&self.path).is_ok_and(|file| file == self.file) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl From<TcpListener> for Listeners {
    fn from(listener: TcpListener) -> Self {
        Self { tcp: vec![listener], ..Self::default() }
    }
}

impl Listeners {
    /// The sockets that the system opened before it started this process; none where it did not.
    ///
    /// # Errors
    /// When one of them is not a listening stream socket.
    pub fn inherited() -> io::Result<Self> {
        let mut given = ListenFd::from_env();
        let mut listeners = Self::default();
        for place in 0..given.len() {
            match given.take_tcp_listener(place) {
                Ok(Some(tcp)) => {
                    tcp.set_nonblocking(true)?;
                    listeners.tcp.push(TcpListener::from_std(tcp)?);
                }
                _ => {
                    let Some(unix) = given.take_unix_listener(place)? else { continue };
                    unix.set_nonblocking(true)?;
                    listeners.unix.push(UnixListener::from_std(unix)?);
                }
            }
        }
        Ok(listeners)
    }

    /// Listens on a TCP address as well.
    pub async fn bind_tcp(&mut self, address: SocketAddr) -> io::Result<()> {
        self.tcp.push(TcpListener::bind(address).await?);
        Ok(())
    }

    /// Listens on a Unix socket as well, for this user alone. The file of a deserted socket is replaced.
    ///
    /// # Errors
    /// [`io::ErrorKind::AddrInUse`] when another process listens there, and the system's errors.
    pub async fn bind_unix(&mut self, path: &Path) -> io::Result<()> {
        let is_socket = std::fs::symlink_metadata(path).is_ok_and(|file| file.file_type().is_socket());
        let is_deserted = || {
            let tried = std::os::unix::net::UnixStream::connect(path);
            tried.is_err_and(|error| error.kind() == io::ErrorKind::ConnectionRefused)
        };
        if is_socket && is_deserted() {
            std::fs::remove_file(path)?;
        }
        let listener = UnixListener::bind(path)?;
        self.files.push(SocketFile::made(path)?);
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
        self.unix.push(listener);
        Ok(())
    }

    /// Whether there is no socket.
    pub fn is_empty(&self) -> bool {
        self.tcp.is_empty() && self.unix.is_empty()
    }

    /// The first TCP address that is listened on.
    pub fn address(&self) -> Option<SocketAddr> {
        self.tcp.first()?.local_addr().ok()
    }

    /// Every TCP address that is listened on.
    pub fn addresses(&self) -> Vec<SocketAddr> {
        self.tcp.iter().filter_map(|one| one.local_addr().ok()).collect()
    }

    /// Every address, as a client writes it; `scheme` is that of TCP.
    pub fn urls(&self, scheme: &str) -> Vec<String> {
        let tcp = self.tcp.iter().filter_map(|one| Some(format!("{scheme}://{}", one.local_addr().ok()?)));
        let path =
            |one: &UnixListener| Some(format!("unix:{}", one.local_addr().ok()?.as_pathname()?.display()));
        tcp.chain(self.unix.iter().filter_map(path)).collect()
    }

    /// Takes the files of the sockets out, to be kept while clients may connect.
    pub(crate) fn take_files(&mut self) -> Vec<SocketFile> {
        std::mem::take(&mut self.files)
    }
}

#[cfg(test)]
mod tests {
    use tokio::net::UnixStream;

    use super::*;

    #[tokio::test]
    async fn a_socket_is_for_its_user_alone_and_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("daemon.sock");
        let mut listeners = Listeners::default();
        listeners.bind_unix(&path).await.expect("a socket");
        assert_eq!(listeners.urls("http"), [format!("unix:{}", path.display())]);
        let mode = std::fs::metadata(&path).expect("a file").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let taken = Listeners::default().bind_unix(&path).await.expect_err("somebody listens");
        assert_eq!(taken.kind(), io::ErrorKind::AddrInUse);
        drop(listeners);
        assert!(!path.exists());
    }

    #[tokio::test]
    async fn an_ending_daemon_leaves_the_socket_of_its_successor() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("daemon.sock");
        let mut ending = Listeners::default();
        ending.bind_unix(&path).await.expect("a socket");
        let files = ending.take_files();
        // While the first still listens, its file is removed and another socket takes its name.
        std::fs::remove_file(&path).expect("its file");
        let mut next = Listeners::default();
        next.bind_unix(&path).await.expect("a socket");
        drop(files);
        assert!(path.exists(), "it is the next one's");
        UnixStream::connect(&path).await.expect("and it listens");
    }

    #[tokio::test]
    async fn what_a_killed_daemon_left_behind_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("daemon.sock");
        drop(UnixListener::bind(&path).expect("a socket"));
        assert!(path.exists(), "its file stays");
        let mut listeners = Listeners::default();
        listeners.bind_unix(&path).await.expect("it is replaced");
        // A file that is not ours stays.
        let other = folder.path().join("notes.txt");
        std::fs::write(&other, "mine").expect("written");
        listeners.bind_unix(&other).await.expect_err("a file of somebody's");
        assert_eq!(std::fs::read_to_string(&other).expect("there"), "mine");
    }
}
