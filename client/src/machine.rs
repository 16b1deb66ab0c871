//! Detection of the machine that a measurement holds for.

use treewright_model::trial::Fingerprint;

/// Looks at this machine. What cannot be found out stays empty.
pub fn detect_fingerprint() -> Fingerprint {
    let cpu_info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let threads = std::thread::available_parallelism()
        .map_or(0, |threads| threads.get().try_into().unwrap_or(u32::MAX));
    Fingerprint { cpu_model: cpu_model(&cpu_info), isa: isa().to_owned(), threads, ..Fingerprint::default() }
}

/// The first `model name` (x86) of Linux's list of processors, or what ARM has there: the numbers of maker
/// and core.
fn cpu_model(cpu_info: &str) -> String {
    let said = |wanted: [&str; 2]| {
        let mut pairs = cpu_info.lines().filter_map(|line| line.split_once(':'));
        pairs.find(|(key, _)| wanted.contains(&key.trim())).map(|(_, value)| value.trim())
    };
    let arm = || Some(format!("{} {}", said(["CPU implementer"; 2])?, said(["CPU part"; 2])?));
    said(["model name", "Model"]).map(str::to_owned).or_else(arm).unwrap_or_default()
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
        let arm = "processor\t: 0\nCPU implementer\t: 0x41\nCPU architecture: 8\nCPU part\t: 0xd40\nprocessor\t: 1\n";
        assert_eq!(cpu_model(arm), "0x41 0xd40");
        assert_eq!(cpu_model(""), "");
        assert!(detect_fingerprint().threads >= 1);
    }
}
