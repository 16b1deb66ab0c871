//! Processor times of threads: the time that they ran, and the time that they were ready to run but had to
//! wait.
//!
//! Beside other programs the waits are most of the difference between frames. Linux gives each thread's
//! run-queue delay (`/proc/PID/task/TID/schedstat`, the second number, in nanoseconds;
//! Documentation/scheduler/sched-stats.rst). The time of a frame without it: see [`undelayed_ms`].

use std::{fs::File, os::unix::fs::FileExt as _};

use rustix::time::{ClockId, clock_gettime};

/// The file with a thread's run-queue delay; a dead thread's cannot be read any more.
#[derive(Debug)]
pub(crate) struct RunQueueDelay(File);

impl RunQueueDelay {
    /// The file of the calling thread; `None` where the system has none.
    pub(crate) fn of_this_thread() -> Option<Self> {
        File::open("/proc/thread-self/schedstat").ok().map(Self).filter(|file| file.read_ms().is_some())
    }

    /// The delay so far, in milliseconds. The present wait of a thread is not part of it yet.
    pub(crate) fn read_ms(&self) -> Option<f64> {
        let mut text = [0; 96];
        let length = self.0.read_at(&mut text, 0).ok()?;
        delay_ms(std::str::from_utf8(&text[..length]).ok()?)
    }
}

/// Milliseconds that all living threads of this process waited in run queues, where that is known.
pub(crate) fn process_delay_ms() -> Option<f64> {
    let mut sum_ms = 0.0;
    for thread in std::fs::read_dir("/proc/self/task").ok()? {
        // One that has ended meanwhile cannot be read.
        if let Ok(text) = std::fs::read_to_string(thread.ok()?.path().join("schedstat")) {
            sum_ms += delay_ms(&text)?;
        }
    }
    Some(sum_ms)
}

fn delay_ms(schedstat: &str) -> Option<f64> {
    let delay_ns: u64 = schedstat.split_ascii_whitespace().nth(1)?.parse().ok()?;
    Some(delay_ns as f64 * 1e-6)
}

/// Processor time and waits of threads during some work.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThreadTimes {
    /// Processor time of all of them together, in milliseconds.
    pub cpu_ms: f64,
    /// Their run-queue delay together, in milliseconds; `None` where the system does not report it.
    pub delay_ms: Option<f64>,
}

impl ThreadTimes {
    /// The times of work that `threads` threads shared: within `wall_ms` they cannot have waited longer.
    #[must_use]
    pub fn shared_by(self, threads: usize, wall_ms: f64) -> Self {
        let most_ms = (threads.max(1) as f64 * wall_ms - self.cpu_ms).max(0.0);
        Self { delay_ms: self.delay_ms.map(|delay_ms| delay_ms.min(most_ms)), ..self }
    }
}

/// Does some work, and returns the times of all threads of this process meanwhile, Embree's own included.
pub fn of_process<R>(work: impl FnOnce() -> R) -> (R, ThreadTimes) {
    let (cpu_before_ms, delay_before_ms) = (process_cpu_ms(), process_delay_ms());
    let result = work();
    let delay_ms = delay_before_ms.zip(process_delay_ms()).map(|(before, after)| (after - before).max(0.0));
    (result, ThreadTimes { cpu_ms: process_cpu_ms() - cpu_before_ms, delay_ms })
}

/// Wall time of some work if none of its threads had waited: times the share of readiness in which they had a
/// processor. Exact for one thread, and where threads work and wait alike.
pub fn undelayed_ms(wall_ms: f64, cpu_ms: f64, delay_ms: f64) -> f64 {
    if cpu_ms > 0.0 && delay_ms > 0.0 { wall_ms * cpu_ms / (cpu_ms + delay_ms) } else { wall_ms }
}

/// Processor time that all threads of this process have used so far, in milliseconds.
fn process_cpu_ms() -> f64 {
    cpu_ms(ClockId::ProcessCPUTime)
}

pub(crate) fn thread_cpu_ms() -> f64 {
    cpu_ms(ClockId::ThreadCPUTime)
}

fn cpu_ms(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_number_is_the_delay() {
        assert_eq!(delay_ms("4001315069 2500000 8\n"), Some(2.5));
        assert_eq!(delay_ms("4001315069"), None);
        assert_eq!(delay_ms("1 x 3"), None);
    }

    #[test]
    fn waiting_is_taken_out() {
        assert_eq!(undelayed_ms(30.0, 40.0, 20.0), 20.0);
        assert_eq!(undelayed_ms(30.0, 40.0, 0.0), 30.0);
        assert_eq!(undelayed_ms(30.0, 0.0, 20.0), 30.0, "nothing ran, so nothing is known");
    }

    #[test]
    fn threads_wait_no_longer_than_the_work_lasts() {
        let times = |cpu_ms, delay_ms| ThreadTimes { cpu_ms, delay_ms };
        // Two threads on one processor, and a third one of this process that has no part in the work.
        assert_eq!(times(18.0, Some(28.0)).shared_by(2, 18.0), times(18.0, Some(18.0)));
        assert_eq!(times(18.0, Some(5.0)).shared_by(2, 18.0), times(18.0, Some(5.0)));
        assert_eq!(times(18.0, Some(5.0)).shared_by(1, 17.0), times(18.0, Some(0.0)));
        assert_eq!(times(18.0, None).shared_by(2, 18.0), times(18.0, None));
    }

    #[test]
    fn work_is_timed() {
        let (sum, times) = of_process(|| (0..3_000_000_u64).fold(0, |sum: u64, x| sum.rotate_left(1) ^ x));
        assert!(std::hint::black_box(sum) != 1 && times.cpu_ms > 0.0);
        if let (Some(delay_ms), Some(delay)) = (times.delay_ms, RunQueueDelay::of_this_thread()) {
            assert!(delay_ms >= 0.0 && delay.read_ms() >= Some(0.0));
        }
    }
}
