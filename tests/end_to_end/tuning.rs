//! The loop of Figure 1 over the wire: renderer, daemon and command line as three programs.

use std::process::{Command, Stdio};
use std::time::Duration;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, run, stderr, stdout};

fn tune(url: &str, json: &std::path::Path, iterations: &str) -> Command {
    let mut command = Command::new(program("treewright-render"));
    command.current_dir(std::env::temp_dir()).args(["tune", "--server", url, "--scene", "builtin:quick"]);
    command.args([
        "--size",
        "64x48",
        "--objective",
        "render",
        "--study",
        "quick",
        "--worth",
        "inf",
        "--iterations",
        iterations,
    ]);
    command.arg("--json").arg(json).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn read(json: &std::path::Path) -> serde_json::Value {
    let text = std::fs::read_to_string(json).expect("the renderer wrote its results");
    serde_json::from_str(&text).expect("the results are JSON")
}

fn trials(url: &str, filter: &str) -> Vec<serde_json::Value> {
    let output = run(
        "treewright",
        &["--server", url, "--json", "trials", "quick", "--filter", filter, "--limit", "1000"],
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let answer: serde_json::Value = serde_json::from_str(&stdout(&output)).expect("JSON");
    answer["trials"].as_array().or(answer.as_array()).expect("a list of trials").clone()
}

#[test]
fn a_renderer_is_tuned_and_the_command_line_shows_it() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let json = folder.path().join("run.json");
    let output = tune(daemon.url(), &json, "14").output().expect("the renderer runs");
    assert!(output.status.success(), "{}", stderr(&output));
    let shown = stdout(&output);
    for row in [
        "default",
        "native used well",
        "over best fixed",
        "verdict",
        "recommended",
        "prediction",
        "break-even",
    ] {
        assert!(shown.to_lowercase().contains(row), "no {row} in the table:\n{shown}");
    }
    let results = read(&json);
    let ran = results["trials"].as_array().expect("the trials are told");
    // None, where nothing that is left could still be better than the start.
    let confirming =
        results["confirmation"]["confirmation"]["measurements"].as_u64().expect("they are counted");
    assert!(ran.len() as u64 >= 14 + confirming, "{} trials, of which {confirming} confirm", ran.len());
    // The service has come to a verdict, or the race has had as many trials as it may.
    let last = ran.last().map(|trial| &trial["rule"]);
    let stage = &results["confirmation"]["confirmation"]["stage"];
    match last.is_some_and(|rule| rule == "FINISHED") {
        true => assert!(stage == "better" || stage == "nothing_better", "{stage}"),
        false => assert_eq!((ran.len(), stage.as_str()), (14 + 60, Some("racing")), "{last:?}"),
    }
    // It is measured again later, to follow the speed of the machine.
    let defaults = trials(daemon.url(), "state = COMPLETED AND mode = DEFAULT");
    let first =
        defaults.iter().any(|trial| trial["name"].as_str().is_some_and(|name| name.ends_with("/trials/1")));
    assert!(first, "the default is measured first");
    assert!(trials(daemon.url(), "state = COMPLETED").len() >= 14);
    assert!(trials(daemon.url(), "state = OPEN").is_empty(), "no lease is left behind");
    let best = run("treewright", &["--server", daemon.url(), "best", "quick"]);
    assert!(best.status.success() && stdout(&best).contains("quality"), "{}{}", stdout(&best), stderr(&best));
    let studies = run("treewright", &["--server", daemon.url(), "studies"]);
    assert!(stdout(&studies).contains("quick"), "{}", stdout(&studies));
    // Its recommendation is drawn from the file that it wrote.
    let (file, picture) = (json.to_str().expect("text"), folder.path().join("tuned.png"));
    let picture = picture.to_str().expect("text");
    let draw = ["image", "--scene", "builtin:quick", "--size", "24x16", "--config-file", file, "-o", picture];
    let drawn = run("treewright-render", &draw);
    assert!(drawn.status.success(), "{}", stderr(&drawn));
}

#[test]
fn ways_to_follow_are_tuned_by_episodes() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let json = folder.path().join("run.json");
    let file = json.to_str().expect("text");
    let scene =
        ["--server", daemon.url(), "--scene", "builtin:quick", "--detail", "0.2", "--motion", "swarm"];
    let view = ["--objective", "motion", "--episode", "6", "--size", "32x24"];
    let mut arguments = vec!["tune"];
    arguments.extend(scene.into_iter().chain(view));
    arguments.extend(["--iterations", "12", "--rounds", "2", "--study", "quick", "--json", file]);
    // A user who renders for a hundredth of a second has no use for a search.
    arguments.extend(["--worth", "0.01"]);
    let output = run("treewright-render", &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let results = read(&json);
    let notes = results["notes"].to_string();
    assert!(notes.contains("the search ended after 8 of 12 trials"), "{notes}");
    assert!(
        results["tuned"]["tree"].is_string() && results["tuned"]["period"].is_u64(),
        "{}",
        results["tuned"]
    );
    let state = &results["indicators"];
    assert!(state["cost_growth"].as_f64() >= Some(1.0) && state["episode_frames"] == 6.0, "{state}");
    let measured = trials(daemon.url(), "state = COMPLETED");
    assert!(measured.len() >= 8);
    for trial in &measured {
        // A mean frame, with the decaying part beside it.
        assert_eq!(trial["measurements"]["frames"], 6.0, "{trial}");
        assert!(trial["measurements"]["trend"].as_f64() > Some(0.0), "{trial}");
    }
    let mut best = vec!["best"];
    best.extend(scene.into_iter().chain(view).chain(["--study", "quick"]));
    let best = run("treewright-render", &best);
    let answer: serde_json::Value = serde_json::from_str(&stdout(&best)).expect("JSON");
    assert!(answer["cost"].as_f64() > Some(0.0), "it is the state that was tuned: {answer}");
    let mismatched = run(
        "treewright-render",
        &["tune", "--scene", "builtin:sea", "--space", "follow", "--objective", "total"],
    );
    assert!(stderr(&mismatched).contains("--objective motion"), "{}", stderr(&mismatched));
}

#[test]
fn who_asks_for_the_best_makes_no_study() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let ask = ["best", "--server", daemon.url(), "--scene", "builtin:quick", "--size", "24x16"];
    let asked = run("treewright-render", &ask);
    assert!(asked.status.success(), "{}", stderr(&asked));
    let answer: serde_json::Value = serde_json::from_str(&stdout(&asked)).expect("JSON");
    assert!(answer["reason"].as_str().is_some_and(|reason| reason.contains("no study")), "{answer}");
    assert!(answer["configuration"].as_object().is_some_and(|values| !values.is_empty()), "{answer}");
    // A part of the space is the study that `tune` makes of it, and what is fixed belongs to the answer.
    let fixed = ["--fix", "backend=tunable", "--fix", "max_depth=32"];
    let asked = run("treewright-render", &[&ask[..], &fixed].concat());
    assert!(asked.status.success(), "{}", stderr(&asked));
    let part: serde_json::Value = serde_json::from_str(&stdout(&asked)).expect("JSON");
    assert!(part["study"].as_str().is_some_and(|study| study.contains("-part-")), "{part}");
    let found = &part["configuration"];
    assert!(found["backend"] == "tunable" && found["max_depth"] == 32, "{part}");
    let studies = run("treewright", &["--server", daemon.url(), "--json", "studies"]);
    assert_eq!(stdout(&studies).trim(), "[]");
}

#[test]
fn the_renderer_survives_the_daemon() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let daemon = Daemon::start(&database);
    let (url, address) = (daemon.url().to_owned(), daemon.address().to_owned());
    let json = folder.path().join("run.json");
    let renderer = tune(&url, &json, "60").spawn().expect("the renderer runs");
    let begun = || stdout(&run("treewright", &["--server", &url, "studies"])).contains("quick");
    while !begun() || trials(&url, "state = COMPLETED").len() < 5 {
        std::thread::sleep(Duration::from_millis(50));
    }
    daemon.kill();
    std::thread::sleep(Duration::from_millis(300));
    let daemon = Daemon::start_at(&database, &address);
    let output = renderer.wait_with_output().expect("the renderer ends");
    assert!(output.status.success(), "{}", stderr(&output));
    let results = read(&json);
    let ran = results["trials"].as_array().map_or(0, Vec::len);
    assert!(ran >= 60, "every frame was rendered: {ran}");
    // The reports that were acknowledged to the renderer are in the database.
    let acknowledged = results["client"]["acknowledged"].as_u64().expect("the count of acknowledged reports");
    let stored = trials(daemon.url(), "state = COMPLETED").len() as u64;
    assert!(stored >= acknowledged, "{acknowledged} acknowledged, {stored} stored");
    assert!(acknowledged >= 5);
}

/// The study keeps the operator's policy when another user's run is killed in the middle.
#[test]
fn a_run_that_is_killed_leaves_the_policy_alone() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let url = daemon.url().to_owned();
    let json = folder.path().join("run.json");
    let first = tune(&url, &json, "3").output().expect("the renderer runs");
    assert!(first.status.success(), "{}", stderr(&first));
    let policy = || {
        let shown = run("treewright", &["--server", &url, "--json", "studies"]);
        let shown: serde_json::Value = serde_json::from_str(&stdout(&shown)).expect("JSON");
        let study = shown.as_array().and_then(|all| all.first()).unwrap_or(&shown).clone();
        study["spec"]["policy"].clone()
    };
    let set = run("treewright", &["--server", &url, "policy", "quick", "--epsilon", "0"]);
    assert!(set.status.success(), "{}", stderr(&set));
    let before = policy();
    assert_eq!(before["epsilon"].as_f64(), Some(0.0), "{before}");

    let mut second = tune(&url, &json, "60").spawn().expect("the renderer runs");
    let explored = || trials(&url, "state = COMPLETED AND mode = EXPLORE").len();
    let already = explored();
    while explored() < already + 3 {
        std::thread::sleep(Duration::from_millis(20));
    }
    second.kill().expect("it was alive");
    second.wait().expect("it is gone");
    assert_eq!(policy(), before, "whatever the run wanted for itself went with it");

    // Its last report may have been on its way.
    let mut explored_by_then = explored();
    loop {
        std::thread::sleep(Duration::from_millis(500));
        let now = explored();
        if now == explored_by_then {
            break;
        }
        explored_by_then = now;
    }
    let mut play = Command::new(program("treewright-render"));
    play.current_dir(std::env::temp_dir());
    play.args(["play", "--server", &url, "--scene", "builtin:quick", "--size", "64x48", "--study", "quick"]);
    let calm = play.args(["--frames", "8"]).output().expect("the renderer runs");
    assert!(calm.status.success(), "{}", stderr(&calm));
    // The next run of the program is the same client, and ends the trial that the killed one held.
    let all = trials(&url, "state = COMPLETED AND mode = EXPLORE");
    let of_others = all.iter().filter(|trial| trial["reason"]["explanation"]["epsilon"] == 1.0).count();
    assert_eq!(of_others, all.len(), "another run explores nothing: the study's epsilon is 0");
    assert!(all.len() <= explored_by_then + 1, "{} after {explored_by_then}", all.len());
    play.args(["--epsilon", "1"]);
    // Eight frames may be over before a busy daemon has answered once.
    let explores = (0..20).any(|_| {
        let eager = play.output().expect("the renderer runs");
        assert!(eager.status.success(), "{}", stderr(&eager));
        explored() > all.len()
    });
    assert!(explores, "its own epsilon is 1");
    assert_eq!(policy(), before);
}

#[test]
fn a_tuning_that_is_stopped_keeps_its_trials_and_tells_no_figures() {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let json = folder.path().join("stopped.json");
    let stopped = tune(daemon.url(), &json, "4000").spawn().expect("treewright-render starts");
    let count = || {
        let there = run("treewright", &["--server", daemon.url(), "--json", "study", "show", "quick"]);
        if there.status.success() { trials(daemon.url(), "state = COMPLETED").len() } else { 0 }
    };
    let patience = std::time::Instant::now() + Duration::from_secs(180);
    while count() < 3 {
        assert!(std::time::Instant::now() < patience, "no three trials in three minutes");
        std::thread::sleep(Duration::from_millis(50));
    }
    let killed = Command::new("kill").args(["-INT", &stopped.id().to_string()]).status();
    assert!(killed.expect("kill starts").success());
    let output = stopped.wait_with_output().expect("it can be waited for");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    let text = stdout(&output);
    assert!(text.contains("there are no results yet") && text.contains("the study quick holds"), "{text}");
    for made_up in ["break-even", "gain", "0.00"] {
        assert!(!text.contains(made_up), "{made_up}: {text}");
    }
    assert!(!json.exists(), "what was not measured is not written either");
    assert!(count() >= 3);
}
