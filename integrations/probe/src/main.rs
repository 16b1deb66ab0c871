//! `treewright-probe -- PROGRAM ARGUMENTS…`: runs a program with the preloaded library before Embree, and
//! estimates the gain of better trees and builds.
//!
//! The program runs as it is and with its own results; its exit status is handed on.

mod advice;
mod findings;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use clap::Parser;

use findings::Findings;

/// Measures what a program spends in Embree 4 or 3, and says what tuning could bring at most.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The measurements as JSON instead of a table.
    #[arg(long)]
    json: bool,
    /// Sets this in place of what the program asks for, and so may change its results:
    /// quality=low|medium|high, robust=on|off, compact=on|off, device=TEXT (added to the text of
    /// rtcNewDevice). May be given several times.
    #[arg(long, value_name = "WORD", value_parser = word)]
    set: Vec<String>,
    /// The preloaded library. Default: `libtreewright_probe.so` beside this program, or in `../lib`.
    #[arg(long = "library", value_name = "LIBRARY")]
    preloaded: Option<PathBuf>,
    /// The program and its arguments.
    #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
    program: Vec<OsString>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match probe(&arguments) {
        Ok(status) => ExitCode::from(u8::try_from(status).unwrap_or(1)),
        Err(problem) => {
            eprintln!("treewright-probe: {problem}");
            ExitCode::from(2)
        }
    }
}

fn probe(arguments: &Arguments) -> Result<i32, Box<dyn std::error::Error>> {
    let library = match &arguments.preloaded {
        Some(path) => path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?,
        None => beside()?,
    };
    let folder = tempfile::tempdir()?;
    let mut preload = library.into_os_string();
    if let Some(more) = std::env::var_os("LD_PRELOAD").filter(|more| !more.is_empty()) {
        preload.push(":");
        preload.push(more);
    }
    let (program, rest) = arguments.program.split_first().ok_or("no program")?;
    let status = Command::new(program)
        .args(rest)
        .env("LD_PRELOAD", preload)
        .env("TREEWRIGHT_PROBE", folder.path().join("found"))
        .env("TREEWRIGHT_PROBE_SET", arguments.set.join(";"))
        .status()
        .map_err(|error| format!("{} does not start: {error}", program.display()))?;
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder.path())? {
        // The half-written file of a killed program does not count.
        if let Ok(found) = serde_json::from_slice::<Findings>(&std::fs::read(entry?.path())?) {
            all.push(found);
        }
    }
    if all.is_empty() {
        eprintln!(
            "treewright-probe: no Embree was met: the program has none, has it built in (statically), or did not make a device"
        );
    }
    for found in &all {
        if arguments.json {
            println!("{}", serde_json::to_string(found)?);
        } else {
            print!("{}", found.report());
        }
    }
    Ok(status.code().unwrap_or(1))
}

/// A word that the preloaded library knows.
fn word(text: &str) -> Result<String, String> {
    let known = match text.split_once('=') {
        Some(("quality", value)) => ["low", "medium", "high"].contains(&value),
        Some(("robust" | "compact", value)) => ["on", "off"].contains(&value),
        Some(("device", value)) => !value.contains(';'),
        _ => false,
    };
    let words = "quality=low|medium|high, robust=on|off, compact=on|off or device=TEXT";
    known.then(|| text.to_owned()).ok_or_else(|| format!("it takes {words}"))
}

/// The library that was built or installed with this program.
fn beside() -> Result<PathBuf, String> {
    let program = std::env::current_exe().map_err(|error| error.to_string())?;
    let folder = program.parent().map(PathBuf::from).unwrap_or_default();
    let name = "libtreewright_probe.so";
    let places = [folder.join(name), folder.join("../lib").join(name)];
    places.iter().find(|path| path.exists()).cloned().ok_or_else(|| {
        format!("{name} is not beside {}: build it with `cargo build -p treewright-probe`, or name it by --library", program.display())
    })
}
