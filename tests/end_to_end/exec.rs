//! Any program is tuned from the command line, with the user's own daemon where there is no other.

use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, stderr, stdout, workspace};

use crate::local::at_home;
use crate::site::{Site, ask, json, say, shell, trials};

/// Costs 5 at level 13, and more elsewhere.
const TOY: &str = r#"l={level}; echo "{\"loss\": $(( (l-13)*(l-13) + 5 ))}""#;

fn exec(url: &str, more: &[&str], script: &str) -> Output {
    let mut all = vec!["--json", "exec", "toy", "--tune", "level=1..30:3"];
    all.extend(["--minimise", "loss", "--metric", "json"]);
    all.extend(more);
    all.extend(["--", "sh", "-c", script]);
    shell(url, &all)
}

#[test]
fn a_program_is_tuned_and_its_winner_confirmed() {
    let site = Site::new();
    let done = json(&exec(site.url(), &["--trials", "25", "--confirm=6"], TOY));
    let best = &done["best"];
    assert_eq!(best["default_cost"], 105.0, "{done}");
    assert!(best["cost"].as_f64().is_some_and(|cost| cost <= 9.0), "{done}");
    let level = best["configuration"]["level"].as_i64().expect("a level");
    assert_eq!(best["command"][2], TOY.replace("{level}", &level.to_string()));
    all_fields_are_documented(&done);
    let gain = &done["confirmation"];
    assert_eq!(gain["pairs"], 6);
    assert!(gain["low"].as_f64().is_some_and(|low| low > 0.9), "{done}");
    // The pairs are learnt like all else. The search measured the default once, and perhaps again to estimate
    // the machine's speed.
    let of_default = trials(site.url(), "toy", "config.level = 3").len();
    assert!((7..=9).contains(&of_default), "{of_default} trials of the default");
}

#[test]
fn few_configurations_are_counted_repeated_and_ended() {
    let site = Site::new();
    // Half the loss at level 2, but for a few percent of each run.
    let script = r#"l={level}; echo "{\"loss\": $(( (l == 2 ? 100 : 200) + $$ % 7 ))}""#;
    let call = ["--json", "exec", "few", "--tune", "level=1..3:1", "--minimise", "loss", "--metric", "json"];
    let output = shell(site.url(), &[&call[..], &["--trials", "60", "--", "sh", "-c", script]].concat());
    let done = json(&output);
    assert!(stderr(&output).contains("3 configurations; about "), "{}", stderr(&output));
    assert_eq!(done["best"]["configuration"]["level"], 2, "{done}");
    assert_eq!(done["end"], "the search has ended", "{done}");
    assert!(done["trials"].as_u64().is_some_and(|runs| (4..60).contains(&runs)), "{done}");
}

#[test]
fn a_program_that_prints_its_own_time_is_not_ended_by_the_clock() {
    let site = Site::new();
    let script = r#"l={level}; sleep 0.4; echo "{\"wall_ms\": $l}""#;
    let more = ["exec", "toy", "--tune", "level=1..9:2", "--metric", "json", "--trials", "6"];
    let done = ask(site.url(), &[&more[..], &["--", "sh", "-c", script]].concat());
    assert_eq!(trials(site.url(), "toy", "outcome = ABORTED").len(), 0, "{done}");
    assert_eq!(trials(site.url(), "toy", "outcome = OK").len(), 6, "{done}");
}

#[test]
fn cheaper_levels_say_what_is_worth_a_full_run() {
    let site = Site::new();
    // At the level `small` a tenth of the loss. Where the level is in the environment, it is so, too.
    let script = r#"s={fidelity:10}; [ "$s" = small ] && s=1; [ "$TREEWRIGHT_FIDELITY" = {fidelity} ] || exit 9
        x={level}; y={depth}; echo "{\"loss\": $(( s * ((x-13)*(x-13) + (y-21)*(y-21) + 5) ))}""#;
    let more = ["--tune", "depth=1..30:3", "--fidelity", "small=0.1", "--trials", "30"];
    let done = json(&exec(site.url(), &more, script));
    all_fields_are_documented(&done);
    let cheaper = done["cheaper"].as_u64().expect("a count");
    assert!(cheaper > 6 && done["failed"] == 0, "{done}");
    assert!(done["trials"].as_u64().is_some_and(|trials| trials < 30), "{done}");
    let best = &done["best"];
    assert_eq!(best["default_cost"], 4290.0, "{done}");
    assert!(best["cost"].as_f64().is_some_and(|cost| (50.0..1000.0).contains(&cost)), "{done}");
    assert!(best["command"][2].as_str().is_some_and(|script| script.contains("s=10;")), "{done}");
    let completed = trials(site.url(), "toy", "state = COMPLETED");
    let small: Vec<&Value> = completed.iter().filter(|trial| trial["fidelity"] == "small").collect();
    assert_eq!(small.len() as u64, cheaper);
    assert!(small.iter().all(|trial| trial["cost"].is_null() && trial["measurements"]["loss"].is_number()));
    // A command that does not look at the level runs in full.
    let plain = ["exec", "toy", "--metric", "json", "--trials", "3", "--", "sh", "-c", TOY];
    let plain = ask(site.url(), &plain);
    assert!(plain["trials"] == 3 && plain["cheaper"].is_null(), "{plain}");
}

#[test]
fn a_front_holds_the_ends_and_what_lies_between() {
    let site = Site::new();
    // Up to level 24 time falls and memory rises; from there on both rise.
    let script =
        r#"l={level}; echo "{\"time_ms\": $(( 5 + (l-24)*(l-24) )), \"memory_mb\": $(( 10 + l )) }""#;
    let front = ["--front", "time_ms,memory_mb", "--tune", "level=1..30:28", "--metric", "json"];
    let call =
        |trials| [&["exec", "toy"][..], &front, &["--trials", trials, "--", "sh", "-c", script]].concat();
    let done = ask(site.url(), &call("60"));
    all_fields_are_documented(&done);
    let points = done["front"]["points"].as_array().expect("points");
    let level = |point: &Value| point["configuration"]["level"].as_i64().expect("a level");
    assert_eq!(points.iter().map(level).max(), Some(24), "{done}");
    assert_eq!(points.iter().map(level).min(), Some(1), "{done}");
    assert!(points.iter().any(|point| (8..=18).contains(&level(point))), "{done}");
    let volume = done["front"]["hypervolume"].as_f64().expect("the default was measured");
    // Of the whole front 0.1228.
    assert!(volume > 0.08 && volume < 0.1229, "{done}");
    // A trial that is carried over is no run, and every direction has one.
    let count = |filter: &str| trials(site.url(), "toy", filter).len() as u64;
    let runs = done["trials"].as_u64().expect("a count");
    assert!((10..=60).contains(&runs), "{done}");
    assert_eq!(done["front"]["runs"], runs);
    assert_eq!((count("state = COMPLETED AND mode != PINNED"), count("mode = PINNED")), (runs, 8 * runs));

    // A front of an earlier space keeps its default.
    assert_eq!(done["front"]["default"]["configuration"]["level"], 28, "{done}");
    let threads = "[[parameters]]\nname = \"threads\"\ntype = \"integer\"\nmin = 1\nmax = 4\ndefault = 2\n\n";
    let text = say(site.url(), &["study", "show", "toy", "--format", "toml"]);
    let text = text.replacen("[[objective]]", &format!("{threads}[[objective]]"), 1);
    say(site.url(), &["study", "edit", "toy", &site.write("toy.toml", &text), "--yes"]);
    let done = ask(site.url(), &call("1"));
    let default = &done["front"]["default"]["configuration"];
    assert!(default["level"] == 28 && default["threads"] == 2, "{default}");
}

/// `docs/exec.md` describes every field of the JSON.
fn all_fields_are_documented(done: &Value) {
    let page = std::fs::read_to_string(workspace().join("docs/exec.md")).expect("the page");
    let assert_documented =
        |field: &str| assert!(page.contains(&format!("`{field}`")), "docs/exec.md does not tell of {field}");
    for (name, value) in done.as_object().expect("an object") {
        assert_documented(name);
        let inner = value.as_object().filter(|_| ["best", "confirmation", "front"].contains(&name.as_str()));
        inner
            .into_iter()
            .flat_map(serde_json::Map::keys)
            .for_each(|inner| assert_documented(&format!("{name}.{inner}")));
    }
    assert_eq!(done["format"], 1);
}

#[test]
fn where_nothing_is_proven_yet_the_best_run_is_confirmed() {
    let site = Site::new();
    // Three runs are too few for a proof.
    let done = json(&exec(site.url(), &["--trials", "3", "--confirm=8"], TOY));
    let confirmation = &done["confirmation"];
    assert_ne!(confirmation["configuration"]["level"], 3, "{done}");
    assert_eq!(confirmation["pairs"], 8, "{done}");
}

#[test]
fn what_is_maximised_is_found_and_told_in_its_own_unit() {
    let site = Site::new();
    // A rate of 90 at level 12, and less on either side.
    let script = r#"l={level}; d=$(( l > 12 ? l - 12 : 12 - l )); echo "{\"rate\": $(( 90 - 4 * d ))}""#;
    let call = |extra: &[&str]| {
        let mut arguments = vec!["exec", "rates", "--tune", "level=1..19:6"];
        arguments.extend(["--metric", "json", "--maximise", "rate"]);
        arguments.extend(extra.iter().chain(&["--", "sh", "-c", script]));
        shell(site.url(), &arguments)
    };
    let done = json(&call(&["--trials", "60", "--json"]));
    assert_eq!(done["best"]["configuration"]["level"], 12, "{done}");
    let told = (done["objective"].as_str(), done["best"]["value"].as_f64());
    assert_eq!(told, (Some("rate"), Some(90.0)), "{done}");
    assert_eq!(done["best"]["default_value"].as_f64(), Some(66.0), "{done}");
    let output = call(&["--trials", "1"]);
    assert!(stdout(&output).contains("rate 90, default 66"), "{}", stdout(&output));
    let file = say(site.url(), &["study", "show", "rates", "--format", "toml"]);
    assert!(file.contains("maximise = true"), "{file}");
}

#[test]
fn a_limit_keeps_the_answer_within_it() {
    let site = Site::new();
    // Higher levels lose less and take more memory; 12 is the last that may be used.
    let script = r#"l={level}; echo "{\"loss\": $(( 100 - l )), \"memory_mb\": $(( l * 10 ))}""#;
    let limits = ["--limit", "memory_mb<=125", "--limit", "memory_mb>=10", "--trials", "30"];
    let refused = exec(site.url(), &limits, script);
    assert!(stderr(&refused).contains("once"), "one limit for one measurement: {}", stderr(&refused));
    let done = json(&exec(site.url(), &["--limit", "memory_mb<=125", "--trials", "30"], script));
    assert_eq!(done["best"]["configuration"]["level"], 12, "{done}");
    assert!(done["infeasible"].as_u64().is_some_and(|count| count > 0), "{done}");
    let first = &trials(site.url(), "toy", "outcome = INFEASIBLE")[0];
    let reason = first["outcome"]["infeasible"]["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("memory_mb <= 125"), "{reason}");
    assert!(first["measurements"]["memory_mb"].as_f64().is_some_and(|memory| memory > 125.0), "{first}");
    // A metric with a limit has to be measured.
    let without = r#"echo "{\"loss\": {level}}""#;
    let missing = exec(site.url(), &["--limit", "memory_mb<=125", "--trials", "2"], without);
    assert!(stderr(&missing).contains("memory_mb"), "{}", stderr(&missing));
}

#[test]
fn what_fails_is_infeasible_and_what_cannot_work_at_all_is_an_error() {
    let site = Site::new();
    let script = format!("if [ {{level}} -gt 9 ]; then echo out of memory >&2; exit 7; fi; {TOY}");
    let done = json(&exec(site.url(), &["--trials", "12"], &script));
    assert!(done["infeasible"].as_u64().is_some_and(|count| count > 0), "{done}");
    assert!(done["best"]["configuration"]["level"].as_i64().is_some_and(|level| level <= 9), "{done}");
    let failed = trials(site.url(), "toy", "outcome = INFEASIBLE");
    let reason = failed[0]["outcome"]["infeasible"]["reason"].as_str().unwrap_or_default();
    assert!(reason.contains('7') && reason.contains("out of memory"), "{reason}");

    let refused = |study: &str, command: &[&str], said: &str| {
        let output =
            shell(site.url(), &[&["exec", study, "--tune", "level=1..30:3", "--"], command].concat());
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
    };
    refused("never", &["sh", "-c", "echo no such file >&2; exit 2"], "no such file");
    refused("nobody", &["/no/such/program"], "/no/such/program cannot be started");
    let unknown = shell(site.url(), &["exec", "toy", "--", "echo", "{depth}"]);
    assert!(stderr(&unknown).contains("{depth}") && stderr(&unknown).contains("level"));
    let metric = shell(site.url(), &["exec", "toy", "--", "true"]);
    assert!(stderr(&metric).contains("the study minimises loss"));
}

#[test]
fn a_local_daemon_is_started_once_and_ends_by_itself() {
    let home = tempfile::tempdir().expect("a folder");
    // A job of cron has no session.
    let session = home.path().join("run");
    let program = |number: usize| at_home(home.path(), number.is_multiple_of(2).then_some(&*session));
    let begin = |number: usize| {
        let mut command = program(number);
        command.args(["--server", "local", "--json", "ping"]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
    };
    let all: Vec<_> = (0..6).map(begin).collect();
    let all: Vec<Output> = all.into_iter().map(|one| one.wait_with_output().expect("it ends")).collect();
    let servers: Vec<_> = all.iter().map(|output| json(output)["server"].clone()).collect();
    assert!(servers.windows(2).all(|pair| pair[0] == pair[1]), "{servers:?}");
    let started = all.iter().filter(|output| stderr(output).contains("started a local daemon")).count();
    assert_eq!(started, 1, "only one of them starts it");

    // Another call in that home finds it; its studies stay for the next daemon.
    let toy = ["exec", "toy", "--tune", "level=1..30:3", "--trials", "3", "--", "true", "{level}"];
    let done = program(1).arg("--json").args(toy).output().expect("the program starts");
    assert_eq!(json(&done)["trials"], 3);
    let url = servers[0].as_str().expect("text").to_owned();
    let patience = Instant::now() + Duration::from_secs(60);
    while shell(&url, &["ping"]).status.success() {
        assert!(Instant::now() < patience, "it does not end");
        // Each question puts its end off.
        std::thread::sleep(Duration::from_secs(8));
    }
    let studies = program(0).args(["--json", "studies"]).output().expect("the program starts");
    assert_eq!(json(&studies)[0]["statistics"]["completed_trials"], 3);
}

#[test]
fn a_daemon_that_is_started_for_a_user_keeps_nothing_open_that_its_starter_left_open() {
    let folder = tempfile::tempdir().expect("a folder");
    let left_open = folder.path().join("left-open");
    let keeps_it = |idle_exit_s: Option<&str>| {
        let mut command = Command::new("sh");
        command.args(["-c", "exec 7>\"$LEFT_OPEN\"; exec \"$0\" \"$@\""]).arg(program("treewrightd"));
        command.env("LEFT_OPEN", &left_open);
        if let Some(seconds) = idle_exit_s {
            command.env("TREEWRIGHT_IDLE_EXIT_S", seconds);
        }
        let daemon = Daemon::start_by(command, &folder.path().join("tuning.db"));
        let keeps_it = daemon.open_files().contains(&left_open);
        assert!(daemon.terminate().success());
        keeps_it
    };
    assert!(!keeps_it(Some("600")));
    assert!(keeps_it(None), "a service passes on what its supervisor means to pass on");
}
