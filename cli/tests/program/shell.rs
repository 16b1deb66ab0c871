//! Ask and tell in a shell, and other needs of scripts: exports, completions, manual pages.

use serde_json::Value;
use treewright_proto::v1;

use super::{answer, run, with_trials};

#[test]
fn a_trial_is_asked_for_and_told() {
    let fake = with_trials();
    let asked = answer(&fake, &["suggest", "sponza", "--indicator", "triangles=1000"]);
    let lines: Vec<_> = asked.lines().collect();
    assert_eq!(lines[0], "export TREEWRIGHT_TRIAL=studies/sponza/trials/6", "{asked}");
    assert!(lines.contains(&"export TREEWRIGHT_PARAM_COMPACT=false"), "{asked}");
    let again = answer(&fake, &["suggest", "sponza", "--indicator", "triangles=1000", "--format", "args"]);
    assert!(again.contains("--compact=false --max-depth="), "{again}");
    let reported = answer(&fake, &["report", "studies/sponza/trials/6", "render_ms=3.5"]);
    assert_eq!(reported, "reported studies/sponza/trials/6, cost 3.5000\n");
    let twice = answer(&fake, &["report", "studies/sponza/trials/6", "render_ms=9"]);
    assert!(twice.contains("already") && twice.contains("3.5000"), "{twice}");
    let wrong = run(&fake, &["report", "studies/sponza/trials/7", "render_ms=9"]);
    assert_eq!(wrong.status.code(), Some(1));
}

#[test]
fn an_export_is_read_again_and_nothing_is_there_twice() {
    let fake = with_trials();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sponza.jsonl");
    let file = file.to_str().expect("a path of text");
    answer(&fake, &["export", "sponza", "--site", "here", "--out", file]);
    let text = std::fs::read_to_string(file).expect("the export");
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), 6);
    assert_eq!(lines[0]["study"]["id"], "sponza");
    assert_eq!(lines[1]["origin"], "here/studies/sponza/trials/1");
    let again = run(&fake, &["export", "sponza", "--out", file]);
    assert_eq!(again.status.code(), Some(1), "a file is not replaced unasked");
    assert!(String::from_utf8_lossy(&again.stderr).contains("--overwrite"));
    answer(&fake, &["export", "sponza", "--site", "here", "--out", file, "--overwrite"]);
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1, "nothing is left beside it");
    let own = answer(&fake, &["import", file, "--site", "here"]);
    assert_eq!(own, "sponza: 0 trial(s) added, 5 already known\n", "they came from there");
    let other = answer(&fake, &["import", file, "--site", "there", "--dry-run"]);
    assert_eq!(other, "sponza: 5 trial(s) would be added, 0 already known\n");
    assert_eq!(fake.book().trials.len(), 5, "nothing was written");
    let problem = run(&fake, &["import", "/no/such.jsonl"]);
    assert!(String::from_utf8_lossy(&problem.stderr).contains("/no/such.jsonl"));
}

#[test]
fn another_study_that_takes_the_name_does_not_answer() {
    let fake = with_trials();
    let uid = "0123456789abcdef";
    fake.book().studies.get_mut("studies/sponza").expect("it is there").uid = uid.to_owned();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sponza.jsonl");
    let file = file.to_str().expect("a path of text");
    answer(&fake, &["export", "sponza", "--site", "here", "--out", file]);
    answer(&fake, &["import", file, "--site", "there", "--dry-run"]);
    let script = r#"echo '{"render_ms": 5}'"#;
    let more = ["--indicator", "triangles=1000", "--metric", "json", "--trials", "2"];
    let best = answer(&fake, &[&["exec", "sponza"][..], &more, &["--", "sh", "-c", script]].concat());
    let asked = fake.book().asked.clone();
    let name = format!("studies/sponza@{uid}");
    assert!(asked.len() > 2 && asked.iter().all(|study| *study == name), "{asked:?}\n{best}");
    assert!(fake.book().count("GetBest") > 0, "{best}");

    let statistics = Some(v1::StudyStatistics { states: 1, ..Default::default() });
    fake.book().studies.get_mut("studies/sponza").expect("it is there").statistics = statistics;
    fake.book().asked.clear();
    answer(&fake, &["watch", "sponza", "--once"]);
    let few = run(&fake, &["analyze", "sponza"]);
    assert!(String::from_utf8_lossy(&few.stderr).contains("the analysis needs"), "{few:?}");
    answer(&fake, &["pin", "sponza", "--state", "1"]);
    for command in ["best", "predict", "explain"] {
        answer(&fake, &[command, "sponza", "--state", "1"]);
    }
    answer(&fake, &["best", "sponza", "--indicator", "triangles=1000"]);
    answer(&fake, &["trials", "sponza"]);
    let asked = fake.book().asked.clone();
    assert!(asked.len() > 5 && asked.iter().all(|study| *study == name), "{asked:?}");
}

#[test]
fn a_study_that_is_created_again_ends_a_watch() {
    let fake = with_trials();
    let identify = |uid: &str| {
        fake.book().studies.get_mut("studies/sponza").expect("it is there").uid = uid.to_owned();
    };
    identify("0123456789abcdef");
    let url = fake.url();
    let watch = std::thread::spawn(move || {
        let arguments = ["--server", &url, "watch", "sponza", "--every", "100ms"];
        super::treewright().args(arguments).output().expect("the program starts")
    });
    while fake.book().count("GetStudy") == 0 {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    identify("fedcba9876543210");
    let ended = watch.join().expect("it ends");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("studies/sponza@0123456789abcdef does not exist"), "{said}");
}

#[test]
fn a_report_waits_for_a_daemon_that_comes_back() {
    let mut fake = with_trials();
    answer(&fake, &["suggest", "sponza", "--indicator", "triangles=1000"]);
    fake.go_away();
    let url = fake.url();
    let report = std::thread::spawn(move || {
        let arguments = ["--server", &url, "report", "studies/sponza/trials/6", "render_ms=3.5"];
        super::treewright().args(arguments).output().expect("the program starts")
    });
    std::thread::sleep(std::time::Duration::from_secs(1));
    assert!(!report.is_finished(), "it waits");
    fake.come_back();
    let output = report.join().expect("it ends");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "reported studies/sponza/trials/6, cost 3.5000\n");
}

#[test]
fn tables_in_pipes_keep_words_whole() {
    let fake = with_trials();
    let client =
        treewright_client::blocking::Client::connect(&fake.url(), super::patient()).expect("an address");
    let long = "a-study-whose-id-is-far-longer-than-a-column-of-a-table-that-has-to-fit-into-eighty-ones";
    client.create_study(long, &super::spec()).expect("a good study");
    let shown = answer(&fake, &["studies"]);
    assert!(shown.lines().any(|line| line.contains(long)), "{shown}");
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    let fake = with_trials();
    for shell in ["bash", "zsh", "fish"] {
        assert!(answer(&fake, &["completions", shell]).contains("suggest"), "{shell}");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_str().expect("a path of text");
    assert!(answer(&fake, &["man", path]).contains("treewright.1"));
    assert!(std::fs::read_dir(folder.path()).expect("the folder").count() > 20);
}

#[test]
fn a_look_at_a_study_shows_leases_and_the_best() {
    let fake = with_trials();
    let shown = answer(&fake, &["watch", "sponza", "--once"]);
    assert!(shown.contains("studies/sponza") && shown.contains("0 states"), "{shown}");
    let json: Value =
        serde_json::from_str(&answer(&fake, &["watch", "sponza", "--once", "--json"])).expect("JSON");
    assert_eq!(json["study"]["name"], "studies/sponza");
}
