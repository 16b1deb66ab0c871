//! Measurements travel: databases of several sites are merged, studies are copied with their results, and no
//! trial is stored twice.

use std::path::Path;

use serde_json::Value;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::stderr;

use crate::site::{Site, ask, path_text, say, shell, trials};

/// Ten trials whose costs are known: the square of the level's distance from 13.
fn measure(daemon: &Daemon, levels: impl Iterator<Item = i64>, megabytes: i64) {
    for level in levels {
        let (wanted, indicator) = (format!("level={level}"), format!("megabytes={megabytes}"));
        let trial = ask(daemon.url(), &["suggest", "toy", "--wanted", &wanted, "--indicator", &indicator]);
        let cost = format!("loss={}", (level - 13) * (level - 13) + 5);
        ask(daemon.url(), &["report", trial["name"].as_str().expect("a name"), &cost]);
    }
}

fn study(folder: &Path, more: &str) -> String {
    let text = format!(
        "[[parameters]]\nname = \"level\"\ntype = \"integer\"\nmin = 1\nmax = 30\ndefault = 3\n{more}\n\
         [[indicators]]\nname = \"megabytes\"\nmin = 0\nmax = 1000\n[[objective]]\nmetric = \"loss\"\n"
    );
    let path = folder.join(if more.is_empty() { "toy.toml" } else { "more.toml" });
    std::fs::write(&path, text).expect("a file");
    path_text(&path).to_owned()
}

#[test]
fn two_sites_are_merged_in_both_directions_and_nothing_is_there_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (Daemon::start(&folder.path().join("a.db")), Daemon::start(&folder.path().join("b.db")));
    let file = study(folder.path(), "");
    for (daemon, levels) in [(&a, 1..6), (&b, 9..14)] {
        say(daemon.url(), &["study", "create", &file]);
        measure(daemon, levels, 10);
    }
    let path = |name: &str| path_text(&folder.path().join(name)).to_owned();
    say(a.url(), &["export", "toy", "--site", "a", "--out", &path("a.jsonl")]);
    assert_eq!(ask(b.url(), &["import", &path("a.jsonl"), "--site", "b"])["imported"], 5);
    assert_eq!(ask(b.url(), &["import", &path("a.jsonl"), "--site", "b"])["known"], 5, "it may be repeated");
    // The trials that B took from A come home with the rest, and are known there.
    say(b.url(), &["export", "toy", "--site", "b", "--out", &path("b.jsonl")]);
    let home = ask(a.url(), &["import", &path("b.jsonl"), "--site", "a"]);
    assert_eq!((&home["imported"], &home["known"]), (&Value::from(5), &Value::from(5)));
    for daemon in [&a, &b] {
        let best = ask(daemon.url(), &["best", "toy", "--indicator", "megabytes=10"]);
        assert_eq!((&best["configuration"]["level"], &best["cost"]), (&Value::from(13), &Value::from(5.0)));
        assert_eq!(best["default_cost"], 105.0);
        assert_eq!(ask(daemon.url(), &["trials", "toy", "--all"]).as_array().map(Vec::len), Some(10));
    }
    let carried = ask(a.url(), &["explain", "studies/toy/trials/6"]);
    let uid = ask(b.url(), &["study", "show", "toy"])["uid"].as_str().expect("an identity").to_owned();
    assert_eq!(carried["origin"], format!("b/studies/toy@{uid}/trials/1"));
    assert!(carried["fingerprint"]["cpu_model"].is_string(), "the machine is kept: {carried}");
    // A table does as well.
    say(b.url(), &["export", "toy", "--format", "csv", "--site", "b", "--out", &path("b.csv")]);
    let table = ask(a.url(), &["import", &path("b.csv"), "--study", "toy", "--site", "a"]);
    assert_eq!((&table["imported"], &table["known"]), (&Value::from(0), &Value::from(10)), "{table}");
}

#[test]
fn a_parameter_and_an_indicator_are_added_and_what_was_learnt_stays() {
    let site = Site::new();
    let (daemon, folder) = (&site.daemon, &site.folder);
    say(daemon.url(), &["study", "create", &study(folder.path(), "")]);
    measure(daemon, 9..15, 10);
    measure(daemon, 9..12, 500);
    let more = "[[parameters]]\nname = \"fast\"\ntype = \"boolean\"\ndefault = false\n\
                [[indicators]]\nname = \"files\"\nmin = 0\nmax = 100\n";
    let more = study(folder.path(), more);
    let copied = ["study", "clone", "toy", "toy-2", "--spec", &more, "--indicator", "files=7"];
    assert_eq!(ask(daemon.url(), &copied)["imported"], 9);
    let state = ["--indicator", "megabytes=10", "--indicator", "files=7"];
    let best = ask(daemon.url(), &[&["best", "toy-2"][..], &state].concat());
    assert_eq!(best["configuration"], serde_json::json!({ "level": 13, "fast": false }));
    let other = ask(daemon.url(), &["best", "toy-2", "--state", "2"]);
    assert_eq!(other["configuration"]["level"], 11, "states stay apart");
    // Which of several states is meant has to be said, and people see all of them.
    assert!(stderr(&shell(daemon.url(), &["--json", "best", "toy-2"])).contains("2 states"));
    let shown = say(daemon.url(), &["best", "toy-2"]);
    assert!(shown.contains("level=13") && shown.contains("level=11"), "{shown}");
    // It is exploited at once, before anything is measured.
    let predicted = ask(daemon.url(), &[&["predict", "toy-2"][..], &state].concat());
    assert_eq!(predicted["configuration"]["level"], 13);
    say(daemon.url(), &["study", "rename", "toy-2", "toy-3"]);
    let names: Vec<_> = ask(daemon.url(), &["studies"])
        .as_array()
        .expect("a list")
        .iter()
        .map(|study| study["name"].as_str().unwrap_or_default().to_owned())
        .collect();
    assert_eq!(names, ["studies/toy", "studies/toy-3"]);
    assert_eq!(ask(daemon.url(), &["trials", "toy-3", "--all"]).as_array().map(Vec::len), Some(9));
    say(daemon.url(), &["pin", "toy", "level=20"]);
    let suggested = ask(daemon.url(), &["suggest", "toy", "--indicator", "megabytes=1"]);
    assert_eq!(suggested["configuration"]["level"], 20);
    say(daemon.url(), &["unpin", "toy"]);
    assert_eq!(ask(daemon.url(), &["freeze", "toy"])["operation"], "freeze");
    assert_eq!(ask(daemon.url(), &["thaw", "toy"])["operation"], "tune");
}

/// The lines of an export, without what an import says of itself: when it was.
fn exported(daemon: &Daemon, study: &str) -> Vec<Value> {
    let text = say(daemon.url(), &["export", study, "--site", "a"]);
    let mut lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    for line in &mut lines {
        line.as_object_mut().expect("an object").remove("complete_time");
    }
    lines
}

#[test]
fn an_export_brings_its_study_back_after_it_was_deleted_and_into_another_database() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (Daemon::start(&folder.path().join("a.db")), Daemon::start(&folder.path().join("b.db")));
    let more = "[[parameters]]\nname = \"mode\"\ntype = \"categorical\"\nvalues = [\"7\", \"fast\"]\n\
                default = \"7\"\n[[parameters]]\nname = \"share\"\ntype = \"float\"\nmin = 0.1\nmax = 1.0\n\
                default = 0.3\nactive_if = { parameter = \"mode\", any_of = [\"fast\"] }\n";
    let path = study(folder.path(), more);
    let text = std::fs::read_to_string(&path).expect("a file");
    // What could be lost on the way: auxiliary metrics, limits, a maximised metric, a warm-up that would
    // swallow the first trials, a freeze, and trials with other results than costs.
    let head = "auxiliary = [\"cpu_ms\", \"faults\"]\nlimits = [{ metric = \"loss\", at_most = 1e6 }]\nseed = \"18446744073709551615\"\n";
    let tail = "[[objective]]\nmetric = \"rate\"\nmaximise = true\n[policy]\nwarm_up = 3\n";
    std::fs::write(&path, format!("{head}{text}{tail}")).expect("a file");
    let create = || say(a.url(), &["study", "create", &path, "--id", "toy"]);
    create();
    let results: [(&str, &[&str]); 6] = [
        ("level=9", &["loss=21", "rate=0.30000000000000004"]),
        ("level=10 mode=fast share=0.7", &["loss=2e6", "rate=50"]),
        ("level=11", &["--infeasible", "no, \"memory\""]),
        ("level=12 mode=fast share=0.7", &["--aborted", "900.5"]),
        ("level=13", &["loss=5", "rate=50", "cpu_ms=4.5", "faults=0"]),
        ("level=14", &["--abandon"]),
    ];
    for (wanted, result) in results {
        let wanted = wanted.split(' ').flat_map(|one| ["--wanted", one]);
        let question = ["suggest", "toy", "--indicator", "megabytes=10"].into_iter().chain(wanted);
        let trial = ask(a.url(), &question.collect::<Vec<_>>());
        say(a.url(), &[&["report", trial["name"].as_str().expect("a name")], result].concat());
    }
    say(a.url(), &["freeze", "toy"]);
    let [lines, table] = ["toy.jsonl", "toy.parquet"].map(|name| folder.path().join(name));
    let (lines, table, before) = (path_text(&lines), path_text(&table), exported(&a, "toy"));
    let outcomes: Vec<&Value> = before[1..].iter().map(|line| &line["outcome"]).collect();
    assert_eq!(
        outcomes[1]["infeasible"]["reason"],
        "loss is 2000000, and the study asks for loss <= 1000000"
    );
    assert_eq!((outcomes.len(), &outcomes[3]["aborted"]["lower_bound"]), (5, &Value::from(900.5)));
    assert_eq!(before[0]["study"]["auxiliary"], serde_json::json!(["cpu_ms", "faults"]));
    assert_eq!(before[0]["study"]["limits"], serde_json::json!([{ "metric": "loss", "at_most": 1e6 }]));
    say(a.url(), &["export", "toy", "--out", lines]);
    say(a.url(), &["export", "toy", "--format", "parquet", "--out", table]);
    assert_eq!(ask(a.url(), &["import", lines])["known"], 5, "they are there");
    say(a.url(), &["study", "delete", "toy", "--yes"]);
    // As JSON Lines and as Parquet.
    for (daemon, out) in [(&a, lines), (&b, table)] {
        let tally = ask(daemon.url(), &["import", out]);
        assert_eq!((&tally["imported"], &tally["known"]), (&Value::from(5), &Value::from(0)), "{tally}");
        assert_eq!(ask(daemon.url(), &["import", out])["known"], 5, "it may be repeated");
        let mut after = exported(daemon, "toy");
        for (line, before) in after.iter_mut().zip(&before).skip(1) {
            // The first export named the site.
            let origin = |line: &Value| {
                line["origin"].as_str().expect("an origin").split_once('/').map(|(_, rest)| rest.to_owned())
            };
            assert_eq!(origin(line), origin(before));
            line["origin"] = before["origin"].clone();
        }
        assert_eq!(after, before);
        let best = ask(daemon.url(), &["best", "toy", "--indicator", "megabytes=10"]);
        assert_eq!(best["configuration"]["level"], 13, "what was carried is learnt");
    }
    // A program that made the study finds it again.
    create();
}

#[test]
fn a_study_of_the_same_name_and_machine_knows_nothing_of_another_ones_trials() {
    let site = Site::new();
    let (a, file) = (&site.daemon, study(site.folder.path(), ""));
    say(a.url(), &["study", "create", &file]);
    measure(a, 9..14, 10);
    let out = &site.path("toy.csv");
    say(a.url(), &["export", "toy", "--format", "csv", "--out", out]);
    say(a.url(), &["study", "delete", "toy", "--yes"]);
    say(a.url(), &["study", "create", &file]);
    measure(a, 20..22, 10);
    let tally = ask(a.url(), &["import", out, "--study", "toy"]);
    assert_eq!((&tally["imported"], &tally["known"]), (&Value::from(5), &Value::from(0)), "{tally}");
}

#[test]
fn a_row_that_the_service_does_not_take_does_not_hold_up_the_others() {
    let site = Site::new();
    let daemon = &site.daemon;
    say(daemon.url(), &["study", "create", &study(site.folder.path(), "")]);
    let table = "config.level,indicator.megabytes,measurement.loss,measurement.Rays\n\
                 1,10,3.5,\n2,10,3.25,7\n3,10,NaN,\n4,10,-1,\n5,10,3,\n";
    let rows = site.write("rows.csv", table);
    let answer = ask(daemon.url(), &["import", &rows, "--study", "toy"]);
    assert_eq!((&answer["imported"], &answer["misfits"]), (&Value::from(2), &Value::from(3)), "{answer}");
    let open = trials(daemon.url(), "toy", "state = OPEN");
    assert_eq!(open, Vec::<Value>::new(), "what was refused is given back");
}
