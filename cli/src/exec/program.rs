//! One run of the program that is tuned: start it, wait, and say what it took and how it ended.

use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;
use treewright_client::{Configuration, Measurements};

/// What is kept of each stream that the program writes to; the beginning is dropped.
const KEPT_BYTES: usize = 64 << 10;
/// How often a running program is looked at for the limits it may reach. Its end is noticed at once.
const LOOK: Duration = Duration::from_millis(100);
/// What stands before a parameter's name in the program's environment.
const VARIABLE: &str = "TREEWRIGHT_PARAM_";

/// Which numbers count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum MetricSource {
    /// `wall_ms` and `cpu_ms`, which are always taken.
    Time,
    /// Also every number of the last JSON object that the program prints, each on a line of its own.
    Json,
}

/// How programs are run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Runner<'a> {
    pub(crate) metric: MetricSource,
    /// Pass on what the program writes.
    pub(crate) show_output: bool,
    /// A program that takes longer is ended, and cannot be used so.
    pub(crate) limit: Option<Duration>,
    /// Somebody wants everything to end.
    pub(crate) stop: &'a AtomicBool,
}

/// How a run ended.
#[derive(Debug, PartialEq)]
pub(crate) enum Run {
    /// It did its work.
    Done(Measurements),
    /// It said that it cannot, or ended badly.
    Bad {
        /// What it said last, or how it ended.
        reason: String,
        /// The end of what it wrote to standard error.
        said: String,
    },
    /// It took longer than was worth waiting for, so many milliseconds.
    TooSlow(f64),
    /// Somebody wants everything to end.
    Stopped,
}

impl Runner<'_> {
    /// Runs a command. `abort_after` ends it early; `alive` is called now and then while it runs.
    ///
    /// # Errors
    /// When it cannot be started at all.
    pub(crate) fn run(
        &self,
        command: &[String],
        configuration: &Configuration,
        abort_after: Option<Duration>,
        mut alive: impl FnMut(),
    ) -> Result<Run, std::io::Error> {
        let Some((program, arguments)) = command.split_first() else {
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "the command is empty"));
        };
        let cpu_before = cpu_ms();
        let mut child = self.start(program, arguments, configuration)?;
        let group = Pid::from_raw(i32::try_from(child.id()).unwrap_or(i32::MAX));
        let (out, err) = (child.stdout.take(), child.stderr.take());
        let show = self.show_output;
        std::thread::scope(|scope| {
            let out = scope.spawn(move || out.map(|out| drain(out, show)).unwrap_or_default());
            let err = scope.spawn(move || err.map(|err| drain(err, show)).unwrap_or_default());
            let (ended, end) = std::sync::mpsc::channel();
            let begin = Instant::now();
            scope.spawn(move || {
                let status = child.wait();
                // The receiver waits for this.
                let _ = ended.send((status, begin.elapsed()));
            });
            let mut cut = None;
            let (status, took) = loop {
                match end.recv_timeout(LOOK) {
                    Ok((status, took)) => break (status?, took),
                    Err(_) if cut.is_some() => {}
                    Err(_) => {
                        alive();
                        cut = self.reason_to_end(begin.elapsed(), abort_after);
                        if cut.is_some() {
                            // It may have ended by itself just now.
                            let _ = killpg(group, Signal::SIGKILL);
                        }
                    }
                }
            };
            // What it left running would hold its output open.
            let _ = killpg(group, Signal::SIGKILL);
            let out = out.join().unwrap_or_default();
            let said = err.join().unwrap_or_default();
            Ok(match cut {
                Some(Cut::Stop) => Run::Stopped,
                Some(Cut::Slow) => Run::TooSlow(took.as_secs_f64() * 1e3),
                Some(Cut::Limit(limit)) => Run::Bad {
                    reason: format!("it took longer than {}", humantime::format_duration(limit)),
                    said,
                },
                None if self.stop.load(Ordering::Relaxed) => Run::Stopped,
                None => self.result(status, took, cpu_ms() - cpu_before, &out, said),
            })
        })
    }

    fn start(
        &self,
        program: &str,
        arguments: &[String],
        configuration: &Configuration,
    ) -> Result<Child, std::io::Error> {
        use std::os::unix::process::CommandExt as _;
        let variables =
            configuration.iter().map(|(name, value)| (variable(VARIABLE, name), value.to_string()));
        Command::new(program)
            .args(arguments)
            .envs(variables)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // Its children end with it.
            .process_group(0)
            .spawn()
    }

    fn reason_to_end(&self, elapsed: Duration, abort_after: Option<Duration>) -> Option<Cut> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Cut::Stop);
        }
        match self.limit {
            Some(limit) if elapsed > limit => Some(Cut::Limit(limit)),
            _ if abort_after.is_some_and(|after| elapsed > after) => Some(Cut::Slow),
            _ => None,
        }
    }

    fn result(&self, status: ExitStatus, took: Duration, cpu_ms: f64, out: &str, said: String) -> Run {
        let found = match self.metric {
            MetricSource::Time => serde_json::Map::new(),
            MetricSource::Json => last_object(out),
        };
        if let Some(reason) = found.get("infeasible").and_then(serde_json::Value::as_str) {
            return Run::Bad { reason: reason.to_owned(), said };
        }
        if !status.success() {
            let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default();
            let reason = if last.is_empty() { status.to_string() } else { format!("{status}: {last}") };
            return Run::Bad { reason, said };
        }
        let mut measured =
            Measurements::new().with("wall_ms", took.as_secs_f64() * 1e3).with("cpu_ms", cpu_ms);
        for (name, value) in found {
            if let Some(number) = value.as_f64() {
                measured = measured.with(name, number);
            }
        }
        Run::Done(measured)
    }
}

/// Why a program is ended before its time.
enum Cut {
    Stop,
    Slow,
    Limit(Duration),
}

/// The name of an environment variable for a parameter.
pub(crate) fn variable(prefix: &str, parameter: &str) -> String {
    format!("{prefix}{}", parameter.to_uppercase())
}

/// User and system time of all children that have ended, in milliseconds.
fn cpu_ms() -> f64 {
    let Ok(usage) = getrusage(UsageWho::RUSAGE_CHILDREN) else { return 0.0 };
    let ms = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 * 1e3 + time.tv_usec() as f64 / 1e3;
    ms(usage.user_time()) + ms(usage.system_time())
}

/// Reads to the end and keeps the last of it.
fn drain(stream: impl Read, show: bool) -> String {
    let mut kept: Vec<u8> = Vec::new();
    let mut reader = BufReader::new(stream);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|bytes| bytes > 0) {
        if show {
            // Nobody may be looking.
            let _ = std::io::stderr().write_all(&line);
        }
        kept.append(&mut line);
        if kept.len() > 2 * KEPT_BYTES {
            kept.drain(..kept.len() - KEPT_BYTES);
        }
    }
    String::from_utf8_lossy(&kept).into_owned()
}

/// The last line that is a JSON object; empty where there is none.
fn last_object(out: &str) -> serde_json::Map<String, serde_json::Value> {
    let objects = out.lines().rev().filter_map(|line| serde_json::from_str(line.trim()).ok());
    objects.into_iter().next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    static GO_ON: AtomicBool = AtomicBool::new(false);

    fn run(script: &str, metric: MetricSource, abort_after: Option<Duration>) -> Run {
        let runner = Runner { metric, show_output: false, limit: None, stop: &GO_ON };
        let command = ["sh", "-c", script].map(str::to_owned);
        let configuration = Configuration::new().with("level", 7);
        runner.run(&command, &configuration, abort_after, || {}).expect("sh runs")
    }

    #[test]
    fn times_and_printed_numbers_are_taken() {
        let Run::Done(times) = run("true", MetricSource::Time, None) else { panic!("it ends well") };
        assert!(times.get("wall_ms").is_some_and(|wall| wall > 0.0) && times.get("cpu_ms").is_some());
        let script = r#"echo '{"loss": 1}'; echo "{\"loss\": $TREEWRIGHT_PARAM_LEVEL.5}"; echo bye"#;
        let Run::Done(printed) = run(script, MetricSource::Json, None) else { panic!("it ends well") };
        assert_eq!(printed.get("loss"), Some(7.5), "the last object counts");
        let Run::Done(plain) = run(script, MetricSource::Time, None) else { panic!("it ends well") };
        assert_eq!(plain.get("loss"), None);
    }

    #[test]
    fn failures_are_told_in_the_programs_own_words() {
        let Run::Bad { reason, said } = run("echo no >&2; echo memory >&2; exit 3", MetricSource::Time, None)
        else {
            panic!("it fails")
        };
        assert!(reason.contains("3") && reason.ends_with("memory"), "{reason}");
        assert_eq!(said, "no\nmemory\n");
        let infeasible = run(r#"echo '{"infeasible": "too deep"}'"#, MetricSource::Json, None);
        assert!(matches!(infeasible, Run::Bad { reason, .. } if reason == "too deep"));
    }

    #[test]
    fn what_takes_too_long_is_ended_with_its_children() {
        let slow = run("sleep 60 & wait", MetricSource::Time, Some(Duration::from_millis(150)));
        assert!(matches!(slow, Run::TooSlow(ms) if ms >= 150.0), "{slow:?}");
    }

    #[test]
    fn a_program_that_is_not_there_is_an_error() {
        let runner = Runner { metric: MetricSource::Time, show_output: false, limit: None, stop: &GO_ON };
        assert!(runner.run(&["/no/such".to_owned()], &Configuration::new(), None, || {}).is_err());
        assert!(runner.run(&[], &Configuration::new(), None, || {}).is_err());
    }
}
