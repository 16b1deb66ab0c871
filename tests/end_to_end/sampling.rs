//! Random samples are neither lost nor doubled: not when the renderer is killed, not when the daemon is, and
//! not when several renderers work on one study. An analysis of their results gives equal bytes each time.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use treewright_tests::programs::{program, stderr, stdout};

use crate::site::{Site, path_text, say, shell, signal, trials, wait_until};

const SAMPLES: usize = 60;
const CAMERAS: usize = 2;

/// A renderer that samples, with further arguments.
fn sampler(url: &str, name: &str, more: &[&str]) -> Child {
    let mut command = Command::new(program("treewright-render"));
    command.args(["sample", "--server", url, "--scene", "builtin:quick", "--detail", "0.05"]);
    command.args(["--size", "16x12"]);
    command.args(["--space", "paper", "--threads", "1", "--name", name, "--deadline-ms", "5000"]);
    command.args(["--cameras", &CAMERAS.to_string(), "--samples", &SAMPLES.to_string()]).args(more);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("treewright-render starts")
}

fn ends_well(child: Child) -> String {
    let output = child.wait_with_output().expect("it can be waited for");
    assert!(output.status.success(), "{}", stderr(&output));
    stdout(&output)
}

/// Number of trials of each sample in the database.
fn counts(url: &str) -> BTreeMap<(u64, u64), usize> {
    let mut counts = BTreeMap::new();
    for trial in trials(url, "sample-paper", "state = COMPLETED") {
        let of = |name: &str| trial["measurements"][name].as_f64().map(|number| number as u64);
        if let (Some(sequence), Some(sample)) = (of("sequence"), of("sample")) {
            *counts.entry((sequence, sample)).or_default() += 1;
        }
    }
    counts
}

/// Waits until `count` samples are there; before the study is there, there are none.
fn wait_for(url: &str, count: usize) {
    let is_there = || shell(url, &["study", "show", "sample-paper"]).status.success();
    wait_until(&format!("{count} samples"), || is_there() && counts(url).len() >= count);
}

fn assert_each_once(url: &str, expected: usize) {
    let counts = counts(url);
    let doubled: Vec<_> = counts.iter().filter(|(_, count)| **count > 1).collect();
    assert!(doubled.is_empty(), "doubled: {doubled:?}");
    assert_eq!(counts.len(), expected, "lost or too many");
}

#[test]
fn a_killed_renderer_goes_on_and_a_killed_daemon_is_waited_for() {
    let site = Site::new();
    let url = site.url().to_owned();
    let mut first = sampler(&url, "a", &[]);
    wait_for(&url, 15);
    first.kill().expect("it can be killed");
    first.wait().expect("it can be waited for");
    let before = counts(&url).len();
    assert!(before < CAMERAS * SAMPLES, "it was killed too late to show anything");
    let second = sampler(&url, "a", &[]);
    wait_for(&url, before + 15);
    let site = site.killed();
    let output = ends_well(second);
    assert!(output.contains("of them there already"), "{output}");
    assert_each_once(&url, CAMERAS * SAMPLES);
    // Once more there is nothing to do; further samples are added to those that are there.
    assert!(ends_well(sampler(&url, "a", &[])).contains("0 by this run"));
    assert_each_once(&url, CAMERAS * SAMPLES);
    analyses_are_repeatable(&site);
}

#[test]
fn a_renderer_that_waits_for_a_daemon_can_be_interrupted() {
    let site = Site::new();
    let mut waiting = sampler(site.url(), "a", &[]);
    wait_for(site.url(), 5);
    site.daemon.kill();
    let mut errors = BufReader::new(waiting.stderr.take().expect("it is piped"));
    let mut line = String::new();
    while !line.contains("waiting for it") {
        line.clear();
        assert!(errors.read_line(&mut line).expect("text") > 0, "it ended before");
    }
    signal(&waiting, "INT");
    let end = waiting.wait().expect("it can be waited for");
    assert_eq!(end.code(), Some(130), "it is no error of the daemon");
}

#[test]
fn renderers_on_one_study_share_the_samples() {
    let site = Site::new();
    // Few values, so that different samples are often of one configuration.
    let few = ["--parameters", "quality,branching_factor"];
    let all: Vec<Child> = ["a", "b", "c"].iter().map(|name| sampler(site.url(), name, &few)).collect();
    for one in all {
        ends_well(one);
    }
    assert_each_once(site.url(), CAMERAS * SAMPLES);
}

fn analyses_are_repeatable(site: &Site) {
    let mut written = Vec::new();
    for name in ["once", "again"] {
        let out = site.file(name);
        say(site.url(), &["analyze", "sample-paper", "--out", path_text(&out)]);
        let read = |file: &str| std::fs::read_to_string(out.join(file)).expect(file);
        written.push(["analysis.json", "analysis.html"].map(read));
    }
    assert_eq!(written[0], written[1], "equal trials give equal bytes");
    let analysis: Value = serde_json::from_str(&written[0][0]).expect("JSON");
    assert_eq!(analysis["trials"], CAMERAS * SAMPLES);
    let parameters = analysis["conditions"][0]["metrics"][0]["parameters"].as_array().expect("influences");
    assert!(parameters.len() >= 10, "{analysis}");
}
