//! The paper's evaluation as a user runs it: recorded in pieces, judged twice to equal bytes, and its page.

use std::{collections::BTreeMap, path::Path};

use crate::program::{FAILED, USAGE, fails, folder, run, succeeds};

/// Two scenes, tiny frames, short searches.
const UNDER: &str = "--record r.jsonl --scene hill=builtin:quick:0.05:3 --scene city=builtin:city:0.02:5 --only hill,city --threads 1 \
                     --size 24x16 --cameras 5 --iterations 6";

fn files(folder: &Path) -> BTreeMap<String, String> {
    let entries = std::fs::read_dir(folder).expect("it was written");
    let read = |entry: std::io::Result<std::fs::DirEntry>| {
        let entry = entry.expect("it can be listed");
        let text = std::fs::read_to_string(entry.path()).expect("it is text");
        (entry.file_name().to_string_lossy().into_owned(), text)
    };
    entries.map(read).collect()
}

#[test]
fn an_evaluation_is_recorded_in_pieces_and_judged_to_the_same_bytes() {
    let folder = folder();
    let path = folder.path();
    let record = format!("evaluate record {UNDER} --rounds 2");
    succeeds(path, &format!("{record} --first 2"));
    let lines = || std::fs::read_to_string(path.join("r.jsonl")).expect("it is there").lines().count();
    // The conditions; two scenes, two cameras, two searches and the fixed configurations.
    assert_eq!(lines(), 1 + 2 * 2 * 3);
    let unverified = run(path, "report --record r.jsonl --out j");
    assert_eq!(unverified.status.code(), Some(FAILED));
    assert!(String::from_utf8_lossy(&unverified.stderr).contains("evaluate verify"));
    succeeds(path, &record);
    assert_eq!(lines(), 1 + 2 * 5 * 3, "the rest alone was measured");
    let parameters = format!("evaluate parameters {UNDER} --runs 2 --rounds 3 --heights 24,48 --angles 4");
    succeeds(path, &parameters);
    // Of each scene two heights, two runs of three parts, their results, and four angles.
    assert_eq!(lines(), 1 + 2 * 5 * 3 + 2 * (2 + 2 * 3 + 1 + 4));
    succeeds(path, &parameters);
    assert_eq!(lines(), 1 + 2 * 5 * 3 + 2 * (2 + 2 * 3 + 1 + 4), "nothing is measured twice");
    let scenes = "--scene hill=builtin:quick:0.05:3 --scene city=builtin:city:0.02:5";
    succeeds(path, &format!("evaluate verify --record r.jsonl {scenes} --rounds 2 --folds 3"));
    for out in ["a", "b"] {
        succeeds(path, &format!("report --record r.jsonl --folds 3 --out {out}"));
    }
    let (first, second) = (files(&path.join("a")), files(&path.join("b")));
    assert_eq!(first, second, "equal records give equal bytes");
    let named = [
        "answers-render.csv",
        "answers-total.csv",
        "evaluation.json",
        "progress-render.csv",
        "progress-total.csv",
        "report.html",
    ];
    assert!(first.keys().map(String::as_str).eq(named), "{:?}", first.keys());
    let page = &first["report.html"];
    for figure in ["2", "6", "7", "8", "9", "11", "12, 15", "13, 16"] {
        assert!(
            page.contains(&format!("Figure {figure})")) || page.contains(&format!("Figures {figure})")),
            "{figure}"
        );
    }
    assert!(page.contains("section 4.1"));
    for wrong in ["NaN", "http"] {
        let place =
            page.find(wrong).map(|at| page[at.saturating_sub(60)..].chars().take(120).collect::<String>());
        assert_eq!(place, None, "every number is one, and nothing is loaded");
    }
    for warning in ["Left out for", "Measured in shared rounds at", "Gains are left out"] {
        assert!(!page.contains(warning), "{warning}");
    }
    assert_eq!(first["progress-render.csv"].matches("\"search\",").count(), 2, "after five trials and six");
    assert!(!first["progress-render.csv"].contains(",,"), "every cost was measured again");
}

#[test]
fn a_record_of_other_conditions_or_without_a_camera_is_refused() {
    let folder = folder();
    let path = folder.path();
    let begin = format!("evaluate record {UNDER} --seconds 0");
    succeeds(path, &begin);
    let empty = run(path, "report --record r.jsonl --out a");
    assert_eq!(empty.status.code(), Some(FAILED));
    assert!(String::from_utf8_lossy(&empty.stderr).contains("no camera yet"), "no page of zeros is written");
    assert!(!path.join("a/report.html").exists());
    let other = run(path, &begin.replace("--size 24x16", "--size 24x18"));
    assert_eq!(other.status.code(), Some(USAGE));
    assert!(String::from_utf8_lossy(&other.stderr).contains("begun under other conditions"));
    fails("evaluate parameters --record a.jsonl --only nowhere", USAGE, &["no scene is called nowhere"]);
    fails("evaluate parameters --record a.jsonl --rounds 2", USAGE, &["--rounds"]);
}
