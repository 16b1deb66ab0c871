//! What was measured travels: databases of several sites are merged, studies are copied with what they know, and
//! nothing is there twice.

use std::path::Path;

use serde_json::Value;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr, stdout};

/// Runs the command line, which must succeed.
fn say(daemon: &Daemon, arguments: &[&str]) -> String {
    let mut all = vec!["--server", daemon.url()];
    all.extend(arguments);
    let output = run("treewright", &all);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    stdout(&output)
}

fn ask(daemon: &Daemon, arguments: &[&str]) -> Value {
    let mut all = vec!["--json"];
    all.extend(arguments);
    serde_json::from_str(&say(daemon, &all)).expect("JSON")
}

/// Ten trials whose costs are known: the square of the level's distance from 13.
fn measure(daemon: &Daemon, levels: impl Iterator<Item = i64>, megabytes: i64) {
    for level in levels {
        let (wanted, indicator) = (format!("level={level}"), format!("megabytes={megabytes}"));
        let trial = ask(daemon, &["suggest", "toy", "--wanted", &wanted, "--indicator", &indicator]);
        let cost = format!("loss={}", (level - 13) * (level - 13) + 5);
        ask(daemon, &["report", trial["name"].as_str().expect("a name"), &cost]);
    }
}

fn study(folder: &Path, more: &str) -> String {
    let text = format!(
        "[[parameters]]\nname = \"level\"\ntype = \"integer\"\nmin = 1\nmax = 30\ndefault = 3\n{more}\n\
         [[indicators]]\nname = \"megabytes\"\nmin = 0\nmax = 1000\n[[objective]]\nmetric = \"loss\"\n"
    );
    let path = folder.join(if more.is_empty() { "toy.toml" } else { "more.toml" });
    std::fs::write(&path, text).expect("a file");
    path.to_str().expect("a path of text").to_owned()
}

#[test]
fn two_sites_are_merged_in_both_directions_and_nothing_is_there_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (Daemon::start(&folder.path().join("a.db")), Daemon::start(&folder.path().join("b.db")));
    let file = study(folder.path(), "");
    for (daemon, levels) in [(&a, 1..6), (&b, 9..14)] {
        say(daemon, &["study", "create", &file]);
        measure(daemon, levels, 10);
    }
    let path = |name: &str| folder.path().join(name).to_str().expect("text").to_owned();
    say(&a, &["export", "toy", "--site", "a", "--out", &path("a.jsonl")]);
    assert_eq!(ask(&b, &["import", &path("a.jsonl"), "--site", "b"])["imported"], 5);
    assert_eq!(ask(&b, &["import", &path("a.jsonl"), "--site", "b"])["known"], 5, "it may be repeated");
    // What B took from A comes home with the rest, and is known there.
    say(&b, &["export", "toy", "--site", "b", "--out", &path("b.jsonl")]);
    let home = ask(&a, &["import", &path("b.jsonl"), "--site", "a"]);
    assert_eq!((&home["imported"], &home["known"]), (&Value::from(5), &Value::from(5)));
    for daemon in [&a, &b] {
        let best = ask(daemon, &["best", "toy", "--indicator", "megabytes=10"]);
        assert_eq!((&best["configuration"]["level"], &best["cost"]), (&Value::from(13), &Value::from(5.0)));
        assert_eq!(best["default_cost"], 105.0);
        assert_eq!(ask(daemon, &["trials", "toy", "--all"]).as_array().map(Vec::len), Some(10));
    }
    let carried = ask(&a, &["explain", "studies/toy/trials/6"]);
    assert_eq!(carried["origin"], "b/studies/toy/trials/1");
    assert!(carried["fingerprint"]["cpu_model"].is_string(), "the machine is kept: {carried}");
    // A table does as well.
    say(&b, &["export", "toy", "--format", "csv", "--site", "b", "--out", &path("b.csv")]);
    let table = ask(&a, &["import", &path("b.csv"), "--study", "toy", "--site", "a"]);
    assert_eq!((&table["imported"], &table["known"]), (&Value::from(0), &Value::from(10)), "{table}");
}

#[test]
fn a_parquet_file_holds_the_study_its_trials_and_where_they_were_measured() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (Daemon::start(&folder.path().join("a.db")), Daemon::start(&folder.path().join("b.db")));
    let more = "[[parameters]]\nname = \"mode\"\ntype = \"categorical\"\nvalues = [\"7\", \"fast\"]\n\
                default = \"7\"\n[[parameters]]\nname = \"rate\"\ntype = \"float\"\nmin = 0.1\nmax = 1.0\n\
                default = 0.3\nactive_if = { parameter = \"mode\", any_of = [\"fast\"] }\n";
    say(&a, &["study", "create", &study(folder.path(), more), "--id", "toy"]);
    measure(&a, 9..14, 10);
    let fast = ["--wanted", "mode=fast", "--wanted", "rate=0.7", "--indicator", "megabytes=0.1"];
    for ending in
        [["loss=0.30000000000000004"].as_slice(), &["--infeasible", "no, \"memory\""], &["--abandon"]]
    {
        let trial = ask(&a, &[["suggest", "toy"].as_slice(), &fast].concat());
        say(&a, &[&["report", trial["name"].as_str().expect("a name")], ending].concat());
    }
    let path = folder.path().join("a.parquet").to_str().expect("text").to_owned();
    say(&a, &["export", "toy", "--format", "parquet", "--site", "a", "--out", &path]);
    let said = ask(&b, &["import", &path, "--site", "b"]);
    assert_eq!((&said["imported"], &said["misfits"]), (&Value::from(7), &Value::from(0)), "{said}");
    assert_eq!(ask(&b, &["import", &path, "--site", "b"])["known"], 7, "it may be repeated");
    // The study and every trial are the same as after the way over JSON Lines.
    let lines = |daemon: &Daemon| -> Vec<Value> {
        let text = say(daemon, &["export", "toy", "--site", "a"]);
        let mut lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        for line in &mut lines {
            let line = line.as_object_mut().expect("an object");
            // Who imported it, and when, is said as well.
            line.remove("complete_time");
            line.remove("client_id");
        }
        lines
    };
    assert_eq!(lines(&a), lines(&b));
    // Cut short, it is refused with its name.
    let whole = std::fs::read(&path).expect("a file");
    std::fs::write(&path, &whole[..whole.len() / 2]).expect("a file");
    let refused = run("treewright", &["--server", b.url(), "import", &path]);
    assert!(!refused.status.success() && stderr(&refused).contains("a.parquet"), "{}", stderr(&refused));
}

#[test]
fn a_parameter_and_an_indicator_are_added_and_what_was_learnt_stays() {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&folder.path().join("a.db"));
    say(&daemon, &["study", "create", &study(folder.path(), "")]);
    measure(&daemon, 9..15, 10);
    measure(&daemon, 9..12, 500);
    let more = "[[parameters]]\nname = \"fast\"\ntype = \"boolean\"\ndefault = false\n\
                [[indicators]]\nname = \"files\"\nmin = 0\nmax = 100\n";
    let more = study(folder.path(), more);
    let copied = ["study", "clone", "toy", "toy-2", "--spec", &more, "--indicator", "files=7"];
    assert_eq!(ask(&daemon, &copied)["imported"], 9);
    let state = ["--indicator", "megabytes=10", "--indicator", "files=7"];
    let best = ask(&daemon, &[&["best", "toy-2"][..], &state].concat());
    assert_eq!(best["configuration"], serde_json::json!({ "level": 13, "fast": false }));
    let other = ask(&daemon, &["best", "toy-2", "--state", "2"]);
    assert_eq!(other["configuration"]["level"], 11, "states stay apart");
    // Which of several states is meant has to be said, and people see all of them.
    let mut all = vec!["--server", daemon.url(), "--json", "best", "toy-2"];
    assert!(stderr(&run("treewright", &all)).contains("2 states"));
    all.remove(2);
    let shown = stdout(&run("treewright", &all));
    assert!(shown.contains("level=13") && shown.contains("level=11"), "{shown}");
    // It is exploited at once, before anything is measured.
    let predicted = ask(&daemon, &[&["predict", "toy-2"][..], &state].concat());
    assert_eq!(predicted["configuration"]["level"], 13);
    say(&daemon, &["study", "rename", "toy-2", "toy-3"]);
    let names: Vec<_> = ask(&daemon, &["studies"])
        .as_array()
        .expect("a list")
        .iter()
        .map(|study| study["name"].as_str().unwrap_or_default().to_owned())
        .collect();
    assert_eq!(names, ["studies/toy", "studies/toy-3"]);
    assert_eq!(ask(&daemon, &["trials", "toy-3", "--all"]).as_array().map(Vec::len), Some(9));
    say(&daemon, &["pin", "toy", "level=20"]);
    assert_eq!(ask(&daemon, &["suggest", "toy", "--indicator", "megabytes=1"])["configuration"]["level"], 20);
    say(&daemon, &["unpin", "toy"]);
    assert_eq!(ask(&daemon, &["freeze", "toy"])["operation"], "freeze");
    assert_eq!(ask(&daemon, &["thaw", "toy"])["operation"], "tune");
}
