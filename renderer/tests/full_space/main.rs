//! Every value of every parameter of the full space, with every grouping of rays, over scenes that stand,
//! move and are made of instances.
//!
//! Each scene's batch runs in a process of its own, so that a crash is a finding with the configuration's
//! name; the batch goes on behind it. All pairs of values are tried. `TREEWRIGHT_STRESS_STRENGTH=3` tries all
//! triples:
//!
//! `TREEWRIGHT_STRESS_STRENGTH=3 cargo test --release -p treewright-renderer --test full_space`

mod batch;
mod covering;
mod scenes;

use std::fs;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use batch::{Case, space};
use covering::covering;
use scenes::Kind;
use treewright_client::Configuration;

/// Names the folder of a batch for the process that works it off.
const FOLDER: &str = "TREEWRIGHT_STRESS_FOLDER";

/// The number of parameters whose values are tried together.
const STRENGTH: &str = "TREEWRIGHT_STRESS_STRENGTH";

/// Time without progress after which a process counts as hanging.
const PATIENCE: Duration = Duration::from_secs(120);

/// The files of a batch: the configurations, the number of the line that runs, and the findings.
const LINES: &str = "lines";
const AT: &str = "at";
const FOUND: &str = "found";

/// A line of a batch: kind of scene, whether robust, configuration.
fn line(kind: Kind, robust: bool, configuration: &str) -> String {
    format!("{}|{robust}|{configuration}", kind.name())
}

/// A configuration as it is read again.
fn written(configuration: &Configuration) -> String {
    let values: Vec<String> = configuration.iter().map(|(name, value)| format!("{name}={value}")).collect();
    values.join(",")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).expect("the batch's file is readable")
}

/// Works off the batch in a folder from a line on.
fn work_off(folder: &Path) {
    let first: usize = read(&folder.join(AT)).parse().expect("a number");
    let mut case: Option<(Kind, Case)> = None;
    let mut found = read(&folder.join(FOUND));
    for (number, line) in read(&folder.join(LINES)).lines().enumerate().skip(first) {
        fs::write(folder.join(AT), number.to_string()).expect("the folder is writable");
        let mut parts = line.splitn(3, '|');
        let mut next = || parts.next().expect("a line has three parts");
        let kind = Kind::named(next()).expect("a kind of scene");
        let robust = next() == "true";
        if case.as_ref().is_none_or(|(other, _)| *other != kind) {
            case = Some((kind, Case::new(kind)));
        }
        let (_, case) = case.as_mut().expect("it was just made");
        if let Err(problem) = case.run(robust, next()) {
            found += &format!("{line}: {problem}\n");
            fs::write(folder.join(FOUND), &found).expect("the folder is writable");
        }
    }
}

/// Waits for the process; says what happened if it did not end well.
fn wait(child: &mut Child, folder: &Path) -> Result<(), String> {
    let mut at = String::new();
    let mut since = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("the process is ours") {
            return if status.success() { Ok(()) } else { Err(ended(status)) };
        }
        let now = read(&folder.join(AT));
        if now != at {
            (at, since) = (now, Instant::now());
        } else if since.elapsed() > PATIENCE {
            child.kill().expect("the process is ours");
            child.wait().expect("the process is ours");
            return Err("hung".to_owned());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn ended(status: ExitStatus) -> String {
    format!("the process ended with {status}")
}

/// Runs a batch in processes of its own, a new one after each crash; everything that was found.
fn run(lines: &[String]) -> String {
    let folder = tempfile::tempdir().expect("there is room");
    let folder = folder.path();
    let write = |name: &str, text: &str| fs::write(folder.join(name), text).expect("the folder is writable");
    write(LINES, &lines.join("\n"));
    write(FOUND, "");
    let mut first = 0;
    while first < lines.len() {
        write(AT, &first.to_string());
        let mut child = Command::new(std::env::current_exe().expect("it has a path"))
            .args(["--exact", "the_starts_or_a_batch_agree_with_brute_force"])
            .env(FOLDER, folder)
            .stdout(Stdio::null())
            .spawn()
            .expect("a process starts");
        let Err(problem) = wait(&mut child, folder) else {
            break;
        };
        let at: usize = read(&folder.join(AT)).parse().expect("a number");
        write(FOUND, &format!("{}{}: {problem}\n", read(&folder.join(FOUND)), lines[at]));
        first = at + 1;
    }
    read(&folder.join(FOUND))
}

#[test]
fn the_starts_or_a_batch_agree_with_brute_force() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return work_off(Path::new(&folder));
    }
    for kind in Kind::all() {
        let mut case = Case::new(kind);
        for robust in [false, true] {
            for configuration in ["", "backend=native"] {
                assert_eq!(case.run(robust, configuration), Ok(()), "{}", line(kind, robust, configuration));
            }
        }
    }
}

#[test]
fn every_combination_of_values_agrees_with_brute_force() {
    if std::env::var_os(FOLDER).is_some() {
        return;
    }
    let strength = std::env::var(STRENGTH).map_or(2, |strength| strength.parse().expect("a whole number"));
    let configurations: Vec<(bool, String)> = [false, true]
        .into_iter()
        .flat_map(|robust| {
            covering(&space(robust), strength).into_iter().map(move |one| (robust, written(&one)))
        })
        .collect();
    let mut found = String::new();
    for kind in Kind::all() {
        let lines: Vec<String> =
            configurations.iter().map(|(robust, configuration)| line(kind, *robust, configuration)).collect();
        found += &run(&lines);
    }
    assert!(found.is_empty(), "of {} configurations:\n{found}", configurations.len());
}

#[test]
fn a_crash_is_a_finding_and_the_batch_goes_on_behind_it() {
    if std::env::var_os(FOLDER).is_some() {
        return;
    }
    let broken = line(Kind::Flat, false, "no such configuration");
    let lines = ["no such line".to_owned(), line(Kind::Flat, false, ""), broken.clone()];
    let found = run(&lines);
    let findings: Vec<&str> = found.lines().collect();
    assert_eq!(findings.len(), 2, "{found}");
    assert!(findings[0].starts_with("no such line: the process ended with"), "{found}");
    assert!(findings[1].starts_with(&broken), "{found}");
}
