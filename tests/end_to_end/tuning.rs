//! The loop of Figure 1 over the wire: renderer, daemon and command line as three programs.

use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, run, stderr, stdout};

use crate::site::{self, Site, ask, json, path_text, say, shell, signal, wait_until};

fn tune(url: &str, json: &std::path::Path, iterations: &str) -> Command {
    let mut command = Command::new(program("treewright-render"));
    command.current_dir(std::env::temp_dir()).args(["tune", "--server", url, "--scene", "builtin:quick"]);
    command.args(["--size", "64x48", "--objective", "render", "--study", "quick", "--worth", "inf"]);
    command.args(["--iterations", iterations, "--json"]).arg(json);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn read(json: &std::path::Path) -> Value {
    let text = std::fs::read_to_string(json).expect("the renderer wrote its results");
    serde_json::from_str(&text).expect("the results are JSON")
}

/// The trials of the one study that match.
fn trials(url: &str, filter: &str) -> Vec<Value> {
    site::trials(url, "quick", filter)
}

/// The number of completed trials; none before the study is there.
fn completed(url: &str) -> usize {
    let is_there = shell(url, &["study", "show", "quick"]).status.success();
    if is_there { trials(url, "state = COMPLETED").len() } else { 0 }
}

#[test]
fn a_renderer_is_tuned_and_the_command_line_shows_it() {
    let site = Site::new();
    let file = site.file("run.json");
    let output = tune(site.url(), &file, "14").output().expect("the renderer runs");
    assert!(output.status.success(), "{}", stderr(&output));
    let shown = stdout(&output);
    let rows = "default|native used well|over best fixed|verdict|recommended|prediction|break-even";
    for row in rows.split('|') {
        assert!(shown.to_lowercase().contains(row), "no {row} in the table:\n{shown}");
    }
    let results = read(&file);
    let rounds = &results["standings"][0]["processes"]["rounds"];
    assert_eq!(*rounds, serde_json::json!([11, 11]), "{}", results["notes"]);
    assert!(shown.contains("gain in two processes"), "{shown}");
    let ran = results["trials"].as_array().expect("the trials are listed");
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
    let defaults = trials(site.url(), "state = COMPLETED AND mode = DEFAULT");
    let first =
        defaults.iter().any(|trial| trial["name"].as_str().is_some_and(|name| name.ends_with("/trials/1")));
    assert!(first, "the default is measured first");
    assert!(trials(site.url(), "state = COMPLETED").len() >= 14);
    assert!(trials(site.url(), "state = OPEN").is_empty(), "no lease is left behind");
    let best = say(site.url(), &["best", "quick"]);
    assert!(best.contains("quality"), "{best}");
    assert!(say(site.url(), &["studies"]).contains("quick"));
    // Memory is no part of the objective, and still has a front with it.
    let front = ask(site.url(), &["front", "quick", "--metrics", "render_ms,structure_bytes"]);
    assert!(front["runs"].as_u64() > Some(3), "{front}");
    assert!(front["points"][0]["metrics"]["structure_bytes"].as_f64() > Some(0.0), "{front}");
    // Its recommendation is drawn from the file that it wrote.
    let (file, picture) = (path_text(&file), &site.path("tuned.png"));
    let draw = ["image", "--scene", "builtin:quick", "--size", "24x16", "--config-file", file, "-o", picture];
    let drawn = run("treewright-render", &draw);
    assert!(drawn.status.success(), "{}", stderr(&drawn));
}

#[test]
fn ways_to_follow_are_tuned_by_episodes() {
    let site = Site::new();
    let path = site.file("run.json");
    let file = path_text(&path);
    let scene = ["--server", site.url(), "--scene", "builtin:quick", "--detail", "0.2", "--motion", "swarm"];
    let view = ["--objective", "motion", "--episode", "6", "--size", "32x24"];
    let mut arguments = vec!["tune"];
    arguments.extend(scene.into_iter().chain(view));
    arguments.extend(["--iterations", "12", "--rounds", "2", "--study", "quick", "--json", file]);
    // A user who renders for a hundredth of a second has no use for a search.
    arguments.extend(["--worth", "0.01"]);
    let output = run("treewright-render", &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let results = read(&path);
    let notes = results["notes"].to_string();
    assert!(notes.contains("the search ended after 8 of 12 trials"), "{notes}");
    let tuned = &results["tuned"];
    assert!(tuned["tree"].is_string() && tuned["period"].is_u64(), "{tuned}");
    let state = &results["indicators"];
    assert!(state["cost_growth"].as_f64() >= Some(1.0) && state["episode_frames"] == 6.0, "{state}");
    let measured = trials(site.url(), "state = COMPLETED");
    assert!(measured.len() >= 8);
    // One that is stopped, as on a busy machine, has neither.
    for trial in measured.iter().filter(|trial| trial["outcome"]["aborted"].is_null()) {
        // A mean frame, with the decaying part beside it.
        assert_eq!(trial["measurements"]["frames"], 6.0, "{trial}");
        assert!(trial["measurements"]["trend"].as_f64() > Some(0.0), "{trial}");
    }
    let mut best = vec!["best"];
    best.extend(scene.into_iter().chain(view).chain(["--study", "quick"]));
    let answer = json(&run("treewright-render", &best));
    assert!(answer["cost"].as_f64() > Some(0.0), "it is the state that was tuned: {answer}");
    let mismatched = run(
        "treewright-render",
        &["tune", "--scene", "builtin:sea", "--space", "follow", "--objective", "total"],
    );
    assert!(stderr(&mismatched).contains("--objective motion"), "{}", stderr(&mismatched));
}

#[test]
fn who_asks_for_the_best_makes_no_study() {
    let site = Site::new();
    let best = ["best", "--server", site.url(), "--scene", "builtin:quick", "--size", "24x16"];
    let answer = json(&run("treewright-render", &best));
    assert!(answer["reason"].as_str().is_some_and(|reason| reason.contains("no study")), "{answer}");
    assert!(answer["configuration"].as_object().is_some_and(|values| !values.is_empty()), "{answer}");
    // A part of the space is the study that `tune` makes of it, and what is fixed belongs to the answer.
    let fixed = ["--fix", "backend=tunable", "--fix", "max_depth=32"];
    let part = json(&run("treewright-render", &[&best[..], &fixed].concat()));
    assert!(part["study"].as_str().is_some_and(|study| study.contains("-part-")), "{part}");
    let found = &part["configuration"];
    assert!(found["backend"] == "tunable" && found["max_depth"] == 32, "{part}");
    assert_eq!(ask(site.url(), &["studies"]), Value::Array(Vec::new()));
}

#[test]
fn the_renderer_survives_the_daemon() {
    let site = Site::new();
    let (url, address) = (site.url().to_owned(), site.daemon.address().to_owned());
    let (file, database) = (site.file("run.json"), site.database());
    let renderer = tune(&url, &file, "60").spawn().expect("the renderer runs");
    wait_until("five trials", || completed(&url) >= 5);
    site.daemon.kill();
    std::thread::sleep(Duration::from_millis(300));
    let daemon = Daemon::start_at(&database, &address);
    let output = renderer.wait_with_output().expect("the renderer ends");
    assert!(output.status.success(), "{}", stderr(&output));
    let results = read(&file);
    let ran = results["trials"].as_array().map_or(0, Vec::len);
    assert!(ran >= 60, "every frame was rendered: {ran}");
    // The reports that were acknowledged to the renderer are in the database.
    let acknowledged = results["client"]["acknowledged"].as_u64().expect("the count of acknowledged reports");
    let stored = trials(daemon.url(), "state = COMPLETED").len() as u64;
    assert!(stored >= acknowledged, "{acknowledged} acknowledged, {stored} stored");
    assert!(acknowledged >= 5);
}

#[test]
fn a_search_waits_for_a_daemon_that_is_slow() {
    let site = Site::new();
    let file = site.file("run.json");
    let renderer = tune(site.url(), &file, "60").spawn().expect("the renderer runs");
    wait_until("five trials", || completed(site.url()) >= 5);
    // Longer than a program waits for its frame, or a command for its answer.
    site.daemon.signal("STOP");
    std::thread::sleep(Duration::from_secs(6));
    site.daemon.signal("CONT");
    let output = renderer.wait_with_output().expect("the renderer ends");
    assert!(output.status.success(), "{}", stderr(&output));
    let results = read(&file);
    assert_eq!(results["client"]["fallbacks"], 0, "every frame had its trial: {}", results["client"]);
    assert!(results["trials"].as_array().is_some_and(|ran| ran.len() >= 60), "none was given up");
}

/// The study keeps the operator's policy when another user's run is killed in the middle.
#[test]
fn a_run_that_is_killed_leaves_the_policy_alone() {
    let site = Site::new();
    let (url, file) = (site.url(), site.file("run.json"));
    let first = tune(url, &file, "3").output().expect("the renderer runs");
    assert!(first.status.success(), "{}", stderr(&first));
    let policy = || {
        let shown = ask(url, &["studies"]);
        let study = shown.as_array().and_then(|all| all.first()).unwrap_or(&shown).clone();
        study["spec"]["policy"].clone()
    };
    say(url, &["policy", "quick", "--epsilon", "0"]);
    let before = policy();
    assert_eq!(before["epsilon"].as_f64(), Some(0.0), "{before}");

    let mut second = tune(url, &file, "60").spawn().expect("the renderer runs");
    let explored = || trials(url, "state = COMPLETED AND mode = EXPLORE").len();
    let already = explored();
    wait_until("three more trials explore", || explored() >= already + 3);
    second.kill().expect("it was alive");
    second.wait().expect("it is gone");
    assert_eq!(policy(), before, "whatever the run wanted for itself went with it");

    let mut play = Command::new(program("treewright-render"));
    play.current_dir(std::env::temp_dir());
    play.args(["play", "--server", url, "--scene", "builtin:quick", "--size", "64x48", "--study", "quick"]);
    let calm = play.args(["--frames", "8"]).output().expect("the renderer runs");
    assert!(calm.status.success(), "{}", stderr(&calm));
    let all = trials(url, "state = COMPLETED AND mode = EXPLORE");
    let of_others = all.iter().filter(|trial| trial["reason"]["explanation"]["epsilon"] == 1.0).count();
    assert_eq!(of_others, all.len(), "another run explores nothing: the study's epsilon is 0");
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
    let site = Site::new();
    let file = site.file("stopped.json");
    let stopped = tune(site.url(), &file, "4000").spawn().expect("treewright-render starts");
    wait_until("three trials", || completed(site.url()) >= 3);
    signal(&stopped, "INT");
    let output = stopped.wait_with_output().expect("it can be waited for");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    let text = stdout(&output);
    assert!(text.contains("there are no results yet") && text.contains("the study quick holds"), "{text}");
    for made_up in ["break-even", "gain", "0.00"] {
        assert!(!text.contains(made_up), "{made_up}: {text}");
    }
    assert!(!file.exists(), "what was not measured is not written either");
    assert!(completed(site.url()) >= 3);
}
