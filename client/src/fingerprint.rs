//! The machine and the software that a measurement holds for.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::limits;

/// What a measurement depends on besides the configuration.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Fingerprint {
    /// The processor's own name.
    pub cpu_model: String,
    /// Widest vector instructions of this machine, e.g. `avx512`.
    pub isa: String,
    /// Threads that the program may use.
    pub threads: u32,
    /// Names and versions of what matters, at most 32.
    pub software: BTreeMap<String, String>,
}

impl Fingerprint {
    /// Looks at this machine. What cannot be found out stays empty.
    #[must_use]
    pub fn detect() -> Self {
        let cpu_info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let threads = std::thread::available_parallelism()
            .map_or(0, |threads| threads.get().try_into().unwrap_or(u32::MAX));
        Self { cpu_model: cpu_model(&cpu_info), isa: isa().to_owned(), threads, software: BTreeMap::new() }
    }

    /// Adds a piece of software that matters; further ones than 32 are left out.
    #[must_use]
    pub fn software(mut self, name: impl Into<String>, version: impl Into<String>) -> Self {
        if self.software.len() < limits::SOFTWARE {
            self.software.insert(name.into(), version.into());
        }
        self
    }

    /// Says how many threads the program really uses.
    #[must_use]
    pub fn threads(mut self, threads: u32) -> Self {
        self.threads = threads;
        self
    }
}

/// The first `model name` (x86) of Linux's list of processors.
fn cpu_model(cpu_info: &str) -> String {
    cpu_info
        .lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(key, _)| matches!(key.trim(), "model name" | "Model"))
        .map_or_else(String::new, |(_, value)| value.trim().to_owned())
}

#[cfg(target_arch = "x86_64")]
fn isa() -> &'static str {
    if std::arch::is_x86_feature_detected!("avx512f") {
        "avx512"
    } else if std::arch::is_x86_feature_detected!("avx2") {
        "avx2"
    } else if std::arch::is_x86_feature_detected!("avx") {
        "avx"
    } else {
        "sse2"
    }
}

#[cfg(target_arch = "aarch64")]
fn isa() -> &'static str {
    "neon"
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn isa() -> &'static str {
    ""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_is_found_in_the_list() {
        let list = "processor\t: 0\nvendor_id\t: X\nmodel name\t: Fast One @ 3 GHz\nflags\t: avx2\n\nprocessor\t: 1\nmodel name\t: Other\n";
        assert_eq!(cpu_model(list), "Fast One @ 3 GHz");
        assert_eq!(cpu_model(""), "");
    }

    #[test]
    fn software_is_limited() {
        let fingerprint =
            (0..40).fold(Fingerprint::detect(), |so_far, index| so_far.software(format!("s{index}"), "1"));
        assert_eq!(fingerprint.software.len(), 32);
        assert!(fingerprint.threads >= 1);
    }
}
