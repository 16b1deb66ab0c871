//! The supervisor between `exec` and a program that it runs: this program once more, as a process of its own.
//! It starts the other program, measures it, and ends the processes that it leaves behind.
//!
//! A process that is killed cannot clean up after itself, but its sockets close. So the two are joined by a
//! pair of sockets. As soon as `exec` shuts its end, because a limit is reached or because it was killed, the
//! supervisor ends the program with everything below it. It is their subreaper (`prctl(2)`), which is how it
//! finds even those that went into a session of their own and whose parents have ended.

use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::signal::{Signal, kill, killpg};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use serde::{Deserialize, Serialize};

/// The first argument that makes this program a supervisor. Nobody types it.
const MARK: &str = "supervise-a-run";
/// Longest time in which the processes below are killed again and again until none is left.
const END_ALL: Duration = Duration::from_secs(1);

/// The fate of a program, as sent over the socket: one line of JSON.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Fate {
    /// It could not be started, with this number of the system's error.
    NotStarted(Option<i32>),
    Ended {
        /// The status from `wait(2)`.
        status: i32,
        wall_ms: f64,
        /// User and system time of all that was waited for.
        cpu_ms: f64,
    },
}

impl Fate {
    /// How the program ended, where it did.
    pub(super) fn status(raw: i32) -> ExitStatus {
        ExitStatus::from_raw(raw)
    }
}

/// A command that supervises a program; its standard input is to be the supervisor's end of the socket.
pub(super) fn command(program: &str, arguments: &[String]) -> Result<Command, std::io::Error> {
    // This very program, even where its file was replaced meanwhile.
    let own = if cfg!(target_os = "linux") { "/proc/self/exe".into() } else { std::env::current_exe()? };
    let mut command = Command::new(own);
    // Away from the terminal's signals: it ends when `exec` says so, or ends.
    command.arg0("treewright").process_group(0).arg(MARK).arg(program).args(arguments);
    Ok(command)
}

/// Supervises, if that is what this process was started for.
pub(crate) fn run_if_asked() -> Option<ExitCode> {
    let mut arguments = std::env::args_os().skip(1);
    if arguments.next()? != MARK {
        return None;
    }
    let mut command = Command::new(arguments.next()?);
    command.args(arguments);
    Some(supervise(command).map_or(ExitCode::FAILURE, |()| ExitCode::SUCCESS))
}

fn supervise(mut command: Command) -> Result<(), std::io::Error> {
    // A copy that the program does not inherit.
    let mut socket = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    #[cfg(target_os = "linux")]
    nix::sys::prctl::set_child_subreaper(true)?;
    // Its children end with it.
    let started = command.stdin(Stdio::null()).process_group(0).spawn();
    let begin = Instant::now();
    let mut child = match started {
        Ok(child) => child,
        Err(problem) => return tell(&mut socket, &Fate::NotStarted(problem.raw_os_error())),
    };
    let group = Pid::from_raw(i32::try_from(child.id()).unwrap_or(i32::MAX));
    let cut = Arc::new(AtomicBool::new(false));
    let (hears, is_cut) = (socket.try_clone()?, Arc::clone(&cut));
    // Ends with the process.
    std::thread::spawn(move || end_when_closed(hears, group, &is_cut));
    until_ended(&mut child);
    let wall_ms = begin.elapsed().as_secs_f64() * 1e3;
    // Processes that it left running in its group would disturb the next run.
    let _ = killpg(group, Signal::SIGKILL);
    let status = child.wait()?;
    let cpu_ms = cpu_ms();
    if cut.load(Ordering::Relaxed) {
        end_all_below();
    }
    tell(&mut socket, &Fate::Ended { status: status.into_raw(), wall_ms, cpu_ms })
}

/// Waits until nothing can be read from `exec` any more, and ends the program then.
fn end_when_closed(mut socket: UnixStream, group: Pid, is_cut: &AtomicBool) {
    // Nothing is ever sent: the read returns when the other side closes.
    let _ = socket.read(&mut [0]);
    is_cut.store(true, Ordering::Relaxed);
    let _ = killpg(group, Signal::SIGKILL);
    // It may have gone over to another group.
    let _ = kill(group, Signal::SIGKILL);
}

/// Waits until the program has ended. It is not reaped yet, so that its number is still that of its group.
#[cfg(target_os = "linux")]
fn until_ended(child: &mut Child) {
    use nix::sys::wait::{Id, waitid};
    let own = i32::try_from(child.id()).ok();
    loop {
        match waitid(Id::All, WaitPidFlag::WEXITED | WaitPidFlag::WNOWAIT) {
            Ok(ended) if ended.pid().map(Pid::as_raw) == own => return,
            // One that lost its parent.
            Ok(ended) => {
                let _ = ended.pid().map(|pid| waitpid(pid, Some(WaitPidFlag::WNOHANG)));
            }
            Err(nix::errno::Errno::EINTR) => {}
            Err(_) => return,
        }
    }
}

/// Elsewhere it is reaped as well; its status is kept.
#[cfg(not(target_os = "linux"))]
fn until_ended(child: &mut Child) {
    let _ = child.wait();
}

/// User and system time of all children that have ended, in milliseconds.
fn cpu_ms() -> f64 {
    let Ok(usage) = getrusage(UsageWho::RUSAGE_CHILDREN) else { return 0.0 };
    let ms = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 * 1e3 + time.tv_usec() as f64 / 1e3;
    ms(usage.user_time()) + ms(usage.system_time())
}

/// Kills all children, and those that become ours by it, until none is left.
fn end_all_below() {
    let begin = Instant::now();
    loop {
        for child in children() {
            let _ = kill(child, Signal::SIGKILL);
        }
        while let Ok(status) = waitpid(None, Some(WaitPidFlag::WNOHANG)) {
            if status == WaitStatus::StillAlive {
                break;
            }
        }
        if begin.elapsed() > END_ALL || children().next().is_none() {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The processes whose parent this one is (`proc(5)`).
fn children() -> impl Iterator<Item = Pid> {
    let own = std::process::id().to_string();
    let is_ours = move |number: i32| {
        let stat = std::fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
        // The name, in brackets, may hold anything; state and parent follow it.
        stat.rsplit_once(')').is_some_and(|(_, rest)| rest.split_whitespace().nth(1) == Some(&own))
    };
    let numbers = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    numbers
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(move |&number| is_ours(number))
        .map(Pid::from_raw)
}

fn tell(socket: &mut UnixStream, fate: &Fate) -> Result<(), std::io::Error> {
    let mut line = serde_json::to_string(fate)?;
    line.push('\n');
    socket.write_all(line.as_bytes())
}
