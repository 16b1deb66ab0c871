//! The system's counters of this process.

use nix::sys::resource::{Resource, getrlimit};

/// The value of `sysconf(_SC_CLK_TCK)` on every Linux that Rust runs on: user space sees ticks of 10 ms, for
/// any tick of the kernel.
const TICKS_PER_S: f64 = 100.0;

pub(super) fn processor_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name before may hold anything, and ends with the last bracket (proc_pid_stat(5)).
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_S)
}

pub(super) fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes * 1024)
}

/// Open files and sockets of this process, and their limit.
pub(super) fn descriptors() -> Option<(u64, u64)> {
    // The descriptor of the listing is among them.
    let open = std::fs::read_dir("/proc/self/fd").ok()?.count().saturating_sub(1);
    let (most, _) = getrlimit(Resource::RLIMIT_NOFILE).ok()?;
    Some((open as u64, most))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_is_counted() {
        let before = processor_seconds().expect("Linux");
        let mut sum = 0.0_f64;
        // Other tests of this process may count a tick before this loop has begun: work comes first.
        loop {
            (0..1_000_000).for_each(|number| sum += std::hint::black_box(f64::from(number)).sqrt());
            if processor_seconds().expect("Linux") > before {
                break;
            }
        }
        assert!(sum > 0.0);
    }

    #[test]
    fn memory_and_descriptors_are_counted() {
        assert!(resident_bytes().is_some_and(|bytes| bytes > 1 << 20));
        let files: Vec<_> = (0..50).map(|_| std::fs::File::open("/dev/null").expect("a file")).collect();
        let (open, most) = descriptors().expect("Linux");
        assert!(open > 50 && most > open, "{open} of {most}");
        drop(files);
    }
}
