//! Whether a machine had other work while something was measured.
//!
//! Ratios of pairs survive a machine that changes its speed, but not every disturbance, and a search does not
//! measure in pairs. So each figure comes with the other load of the processors that this process may use, as
//! far as the system reports it (`/proc/stat` on Linux), and with the variation of one repeated frame.

use std::time::Instant;

use serde::Serialize;

use crate::statistics::Summary;

/// Others may use this much of a processor beside the render threads without being called a disturbance.
const TOLERATED_CORES: f64 = 0.25;
/// The middle half of the times of one frame may span this factor.
const TOLERATED_SPREAD: f64 = 1.2;
/// Ticks that a system counts a second; on Linux the unit of both files that are read here.
const TICKS_PER_S: f64 = 100.0;

/// The other work of the machine during a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Disturbance {
    /// Processors that other programs kept busy on average; `None` where the system does not say.
    pub other_cores: Option<f64>,
    /// Upper quartile over lower quartile of the times of one repeated frame.
    pub spread: f64,
    /// Whether that is too much for figures to be trusted.
    pub disturbed: bool,
}

impl Disturbance {
    /// In words, where there was one.
    pub fn description(&self) -> Option<String> {
        let others = self.other_cores.map_or_else(String::new, |cores| {
            format!("other programs kept {cores:.1} processors busy, and ")
        });
        self.disturbed.then(|| {
            format!(
                "the machine was disturbed: {others}the middle half of one frame's times spans a factor of {:.2}; \
                 measure again on a quiet machine before you rely on these figures",
                self.spread
            )
        })
    }
}

/// Watches from now on.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    begin: Instant,
    busy: Option<Busy>,
}

/// Ticks since some point in the past.
#[derive(Clone, Copy, Debug)]
struct Busy {
    everybody: f64,
    own: f64,
}

impl Watch {
    /// Begins.
    pub fn begin() -> Self {
        Self { begin: Instant::now(), busy: Busy::now() }
    }

    /// The other work since the begin, while `threads` render threads worked on frames of these times.
    pub fn end(&self, threads: usize, frame_ms: &[f64]) -> Disturbance {
        let elapsed_ticks = self.begin.elapsed().as_secs_f64() * TICKS_PER_S;
        let other_cores = self.busy.zip(Busy::now()).filter(|_| elapsed_ticks >= 1.0).map(|(before, now)| {
            let others = (now.everybody - before.everybody) - (now.own - before.own);
            (others / elapsed_ticks).max(0.0)
        });
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        judge(other_cores, cores.saturating_sub(threads) as f64, frame_ms)
    }
}

/// `free_cores` are those that have no render thread.
fn judge(other_cores: Option<f64>, free_cores: f64, frame_ms: &[f64]) -> Disturbance {
    let times = Summary::of(frame_ms);
    let spread = if times.lower_quartile > 0.0 { times.upper_quartile / times.lower_quartile } else { 1.0 };
    let crowded = other_cores.is_some_and(|others| others > free_cores + TOLERATED_CORES);
    Disturbance { other_cores, spread, disturbed: crowded || spread > TOLERATED_SPREAD }
}

impl Busy {
    fn now() -> Option<Self> {
        let read = |path| std::fs::read_to_string(path).ok();
        let allowed = allowed_processors(&read("/proc/self/status")?)?;
        Some(Self {
            everybody: of_everybody(&read("/proc/stat")?, &allowed)?,
            own: of_process(&read("/proc/self/stat")?)?,
        })
    }
}

/// The processors that this process may run on: a list such as `0-3,8`.
fn allowed_processors(status: &str) -> Option<Vec<usize>> {
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"))?;
    let mut allowed = Vec::new();
    for part in list.trim().split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        allowed.extend(first.parse::<usize>().ok()?..=last.parse().ok()?);
    }
    Some(allowed)
}

/// All that was not idle or waiting on these processors, with what a hypervisor gave away.
fn of_everybody(stat: &str, allowed: &[usize]) -> Option<f64> {
    let mut busy = 0.0;
    for line in stat.lines().filter_map(|line| line.strip_prefix("cpu")) {
        let mut columns = line.split(' ');
        // The line without a number is the sum of the others.
        let Some(processor) = columns.next().and_then(|number| number.parse().ok()) else { continue };
        if !allowed.contains(&processor) {
            continue;
        }
        let ticks: Vec<f64> = columns.take(8).map_while(|column| column.parse().ok()).collect();
        busy += ticks.iter().sum::<f64>() - ticks.get(3)? - ticks.get(4)?;
    }
    stat.starts_with("cpu").then_some(busy)
}

/// User and system time of a process: columns 14 and 15 after a name in brackets of any kind.
fn of_process(stat: &str) -> Option<f64> {
    let mut columns = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut next = || columns.next()?.parse::<f64>().ok();
    Some(next()? + next()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_read() {
        let stat = "cpu  103 7 20 1000 30 1 2 7 50 0\ncpu0 100 5 20 900 25 1 2 7 50 0\ncpu1 3 2 0 100 5 0 0 0 0 0\nintr 5\n";
        assert_eq!(of_everybody(stat, &[0, 1]), Some(140.0));
        assert_eq!(of_everybody(stat, &[1]), Some(5.0), "what others do elsewhere disturbs nobody here");
        assert_eq!(of_everybody("intr 5", &[0]), None);
        assert_eq!(allowed_processors("Name: x\nCpus_allowed_list:\t0-2,5\n"), Some(vec![0, 1, 2, 5]));
        assert_eq!(allowed_processors("Name: x\n"), None);
        let own = "42 (a ) b) S 1 1 1 0 -1 4194560 100 0 0 0 31 11 0 0 20 0 4 0 100 1000 10";
        assert_eq!(of_process(own), Some(42.0));
        assert_eq!(of_process("42 (x) S"), None);
    }

    #[test]
    fn a_disturbance_is_what_takes_cores_or_spreads_times() {
        let even = [10.0, 10.1, 10.2, 10.3];
        assert!(!judge(Some(0.1), 0.0, &even).disturbed);
        assert!(!judge(Some(2.0), 2.0, &even).disturbed, "cores without a render thread are anybody's");
        assert!(judge(Some(2.0), 1.0, &even).disturbed);
        assert!(!judge(None, 0.0, &even).disturbed);
        let uneven = judge(None, 0.0, &[10.0, 10.0, 20.0, 20.0]);
        assert!(
            uneven.disturbed
                && uneven.description().is_some_and(|description| description.contains("factor of"))
        );
        assert!(judge(None, 0.0, &[]).description().is_none());
    }

    #[test]
    fn a_watch_sees_its_own_work_as_its_own() {
        let watch = Watch::begin();
        let begin = Instant::now();
        while begin.elapsed().as_millis() < 30 {
            std::hint::spin_loop();
        }
        let seen = watch.end(1, &[1.0]);
        assert!(seen.other_cores.is_none_or(|cores| cores.is_finite() && cores >= 0.0), "{seen:?}");
    }
}
