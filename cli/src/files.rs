//! Files that people name, and the name of this machine.

use std::io::Read as _;
use std::path::Path;

use crate::failure::{Failure, Result};

/// Largest file that is read whole.
const TEXT_BYTES: u64 = 64 << 20;

/// Reads a text file; `-` is standard input.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    let problem = |error: std::io::Error| Failure::file(path, error.to_string());
    let mut text = String::new();
    if path == Path::new("-") {
        std::io::stdin().take(TEXT_BYTES).read_to_string(&mut text).map_err(problem)?;
        return Ok(text);
    }
    let file = std::fs::File::open(path).map_err(problem)?;
    if file.metadata().map_err(problem)?.len() > TEXT_BYTES {
        return Err(Failure::file(path, format!("it is larger than {} MB", TEXT_BYTES >> 20)));
    }
    file.take(TEXT_BYTES).read_to_string(&mut text).map_err(problem)?;
    Ok(text)
}

/// The name of this machine, as far as it is known.
pub(crate) fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name: String = name.trim().chars().filter(|each| !each.is_control()).take(50).collect();
    if name.is_empty() { "machine".to_owned() } else { name }
}
