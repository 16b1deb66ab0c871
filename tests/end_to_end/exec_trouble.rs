//! Trouble while programs are tuned: bad numbers, crashes by chance, helpers that stay, daemons that go. No
//! single trouble ends a session, and every session shows its result.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use treewright_tests::daemon::Daemon;
use treewright_tests::ports::lasting_address;
use treewright_tests::programs::{program, stderr, stdout};

use crate::site::{Site, json, say, signal, trials, wait_until};

impl Site {
    /// Tunes a shell script that prints a loss.
    fn exec(&self, study: &str, more: &[&str], script: &str) -> Output {
        exec(self.url(), study, more, script).output().expect("the program starts")
    }

    /// The number of a study's trials that match.
    fn count(&self, study: &str, filter: &str) -> usize {
        trials(self.url(), study, filter).len()
    }
}

fn exec(url: &str, study: &str, more: &[&str], script: &str) -> Command {
    let mut command = Command::new(program("treewright"));
    command.env_remove("TREEWRIGHT_SERVER").current_dir(std::env::temp_dir());
    command.args(["--server", url, "--json", "exec", study, "--tune", "x=1..8:4", "--minimise", "loss"]);
    command.args(["--metric", "json"]).args(more).args(["--", "sh", "-c", script]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The numbers of processes that a script wrote into a file, a line each.
fn numbers(file: &str) -> Vec<String> {
    std::fs::read_to_string(file).unwrap_or_default().lines().map(str::to_owned).collect()
}

fn is_alive(number: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with(['Z', 'X']))
}

#[test]
fn values_without_a_number_do_not_end_the_search_and_are_told() {
    let bench = Site::new();
    // An exit code that is accepted makes no difference.
    let script = r#"l={x}.5; [ {x} -gt 5 ] && l=NaN; echo "{\"loss\": $l, \"Throughput\": 3}"; exit 3"#;
    let output = bench.exec("nan", &["--trials", "12", "--accept-exit", "1,3"], script);
    let (done, said) = (json(&output), stderr(&output));
    assert_eq!(done["trials"], 12, "{done}");
    assert!(done["failed"].as_u64() > Some(0), "{done}");
    assert_eq!(done["best"]["configuration"]["x"], 1, "{done}");
    assert_eq!(done["best"]["cost"], 1.5, "{done}");
    assert_eq!(bench.count("nan", "outcome = OK AND config.x > 5"), 0);
    assert!(said.contains("loss is NaN") && said.contains("Throughput"), "{said}");
    assert_eq!(said.matches("left out").count(), 1, "{said}");
}

#[test]
fn a_default_that_fails_by_chance_is_tried_again() {
    let bench = Site::new();
    let runs = bench.path("runs");
    let script = format!("echo >> {runs}; [ $(wc -l < {runs}) -gt 3 ] || exit 9; echo '{{\"loss\": {{x}}}}'");
    let output = bench.exec("late", &["--trials", "4"], &script);
    assert_eq!(json(&output)["trials"], 4);
    assert!(stderr(&output).contains("exit status: 9"), "{}", stderr(&output));
    // One that never works ends, with its own words, after a few runs.
    let never = bench.path("never");
    let output = bench.exec("never", &[], &format!("echo >> {never}; echo port in use >&2; exit 9; : {{x}}"));
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("port in use"), "{}", stderr(&output));
    assert_eq!(numbers(&never).len(), 5);
    assert_eq!(bench.count("never", "state = COMPLETED"), 0, "nothing is said against any configuration");
}

#[test]
fn who_crashes_by_chance_is_not_unusable() {
    let bench = Site::new();
    let runs = bench.path("runs");
    // Every fourth run is killed, whichever configuration it has.
    let script = format!(
        "echo >> {runs}; [ $(( $(wc -l < {runs}) % 4 )) = 0 ] && kill -SEGV $$; echo '{{\"loss\": {{x}}}}'"
    );
    let done = json(&bench.exec("flaky", &["--trials", "24"], &script));
    assert_eq!(done["failed"].as_u64().unwrap_or(0) + done["infeasible"].as_u64().unwrap_or(0), 6, "{done}");
    assert_eq!(done["best"]["configuration"]["x"], 1, "{done}");
    for trial in 1..=8 {
        let of_it =
            |outcome: &str| bench.count("flaky", &format!("config.x = {trial} AND outcome = {outcome}"));
        assert!(of_it("OK") == 0 || of_it("INFEASIBLE") == 0, "x = {trial} worked, and counts as unusable");
    }
    assert!(bench.count("flaky", "outcome = FAILED") > 0);
}

#[test]
fn helpers_that_stay_hold_nobody_up() {
    let bench = Site::new();
    let begin = Instant::now();
    let cut = bench.exec(
        "limit",
        &["--run-timeout", "2s", "--trials", "1"],
        "setsid sleep 30 & echo started; sleep 30; : {x}",
    );
    assert!(begin.elapsed() < Duration::from_secs(8), "{:?}", begin.elapsed());
    assert!(stderr(&cut).contains("longer than 2s"), "{}", stderr(&cut));

    // A program that has ended has its result, even if another process holds its output open and writes on
    // and on.
    let (begin, pids) = (Instant::now(), bench.path("pids"));
    for (study, helper) in [("quiet", "sleep 30"), ("loud", "sh -c 'while :; do echo x || exit; done'")] {
        let script = format!("setsid {helper} & echo $! >> {pids}; echo '{{\"loss\": {{x}}}}'");
        assert_eq!(json(&bench.exec(study, &["--trials", "3"], &script))["trials"], 3);
    }
    assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
    for number in numbers(&pids) {
        let _ = Command::new("kill").args(["-9", &number]).stderr(Stdio::null()).status();
    }
}

#[test]
fn who_is_interrupted_shows_what_was_found() {
    let bench = Site::new();
    // After three trials, and after five with two pairs, comes a run that does not end.
    let in_pairs: &[&str] = &["--trials", "5", "--confirm=20"];
    let sessions = [("stopped", &[][..], 3, 3_u64, None), ("paired", in_pairs, 5 + 2 * 2, 5, Some(2_u64))];
    for (study, more, ended, trials, pairs) in sessions {
        let runs = bench.path(study);
        let script = format!(
            "echo >> {runs}; [ $(wc -l < {runs}) -le {ended} ] || {{ setsid sleep 30 & sleep 30; }}; echo '{{\"loss\": {{x}}}}'"
        );
        let child = exec(bench.url(), study, more, &script).spawn().expect("the program starts");
        wait_until("the last run begins", || numbers(&runs).len() == ended + 1);
        std::thread::sleep(Duration::from_millis(200));
        let begin = Instant::now();
        signal(&child, "INT");
        let output = child.wait_with_output().expect("it ends");
        assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
        let done = json(&output);
        assert_eq!((&done["trials"], &done["end"]), (&Value::from(trials), &Value::from("interrupted")));
        assert!(done["best"]["cost"].as_f64().is_some(), "{done}");
        assert_eq!(done["confirmation"]["pairs"].as_u64(), pairs, "{done}");
        assert_eq!(bench.count(study, "state = OPEN"), 0, "the trial is given back");
    }
}

#[test]
fn who_is_interrupted_twice_gives_the_trial_back() {
    let bench = Site::new();
    let runs = bench.path("runs");
    let script = format!("echo >> {runs}; sleep 30; echo '{{\"loss\": {{x}}}}'");
    let child = exec(bench.url(), "twice", &[], &script).spawn().expect("the program starts");
    wait_until("the run begins", || numbers(&runs).len() == 1);
    let begin = Instant::now();
    signal(&child, "INT");
    signal(&child, "INT");
    let _ = child.wait_with_output().expect("it ends");
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    assert_eq!(bench.count("twice", "state = OPEN"), 0, "a person's Ctrl-C loses no lease");
}

#[test]
fn programs_end_with_who_runs_them() {
    let bench = Site::new();
    let pids = bench.path("pids");
    let script = format!(
        "echo $$ >> {pids}; sleep 60 & echo $! >> {pids}; setsid sh -c 'echo $$ >> {pids}; sleep 60; :' & \
         sleep 60; : {{x}}"
    );
    let mut child = exec(bench.url(), "killed", &[], &script).spawn().expect("the program starts");
    wait_until("all three run", || numbers(&pids).len() == 3);
    assert!(numbers(&pids).iter().all(|number| is_alive(number)));
    child.kill().expect("it can be killed");
    child.wait().expect("it ends");
    wait_until("everything below it ends", || !numbers(&pids).iter().any(|number| is_alive(number)));
}

#[test]
fn endless_output_takes_bounded_memory() {
    let bench = Site::new();
    let ready = bench.path("ready");
    let script = format!(
        "head -c 200000000 /dev/zero | tr '\\000' x; echo > {ready}; sleep 2; echo; echo '{{\"loss\": {{x}}}}'"
    );
    let child = exec(bench.url(), "long", &["--trials", "1"], &script).spawn().expect("it starts");
    wait_until("all is written", || Path::new(&ready).exists());
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).expect("it runs");
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("Linux says it");
    let peak_kb: u64 = peak.trim().trim_end_matches(" kB").parse().expect("a number");
    assert_eq!(json(&child.wait_with_output().expect("it ends"))["trials"], 1);
    assert!(peak_kb < 100_000, "{peak_kb} kB");
}

#[test]
fn a_daemon_that_is_away_for_seconds_loses_no_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let (database, address) = (folder.path().join("tuning.db"), lasting_address());
    for (study, is_killed) in [("killed", true), ("stopped", false)] {
        let daemon = Daemon::start_at(&database, &address);
        let runs = folder.path().join(study);
        let script = format!("echo {{x}} >> {}; sleep 0.4; echo '{{\"loss\": {{x}}}}'", runs.display());
        let more = ["--trials", "6", "--timeout", "60s"];
        let child = exec(daemon.url(), study, &more, &script).spawn().expect("the program starts");
        wait_until("the second run begins", || numbers(runs.to_str().expect("text")).len() == 2);
        if is_killed {
            daemon.kill();
        } else {
            assert!(daemon.terminate().success());
        }
        std::thread::sleep(Duration::from_secs(2));
        let daemon = Daemon::start_at(&database, &address);
        let output = child.wait_with_output().expect("it ends");
        assert_eq!(json(&output)["trials"], 6, "{}", stderr(&output));
        assert_eq!(numbers(runs.to_str().expect("text")).len(), 6, "no run is done twice");
        assert_eq!(trials(daemon.url(), study, "outcome = OK").len(), 6);
        assert!(daemon.terminate().success());
    }
}

#[test]
fn a_daemon_that_stays_away_takes_nothing_with_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (database, address) = (folder.path().join("tuning.db"), lasting_address());
    let daemon = Daemon::start_at(&database, &address);
    let runs = folder.path().join("runs");
    let script = format!("echo {{x}} >> {}; sleep 0.4; echo '{{\"loss\": {{x}}}}'", runs.display());
    let mut command = exec(daemon.url(), "left", &["--timeout", "1s"], &script);
    let child = command.spawn().expect("the program starts");
    wait_until("the fourth run begins", || numbers(runs.to_str().expect("text")).len() == 4);
    daemon.kill();
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let found: Value = serde_json::from_str(&stdout(&output)).expect("JSON");
    assert!(found["trials"] == 3 && found["best"]["source"] == "runs", "{found}");
    assert!(found["error"].as_str().is_some_and(|error| error.contains(&address)), "{found}");
    // The finished run is shown, and can be handed in.
    let message = stderr(&output);
    let command = message.split("treewright report ").nth(1).and_then(|rest| rest.lines().next());
    let words: Vec<_> = command.expect("it says how").split(' ').collect();
    let daemon = Daemon::start_at(&database, &address);
    let printed = say(daemon.url(), &[&["report"][..], &words].concat());
    assert!(printed.starts_with("reported studies/left"), "{words:?}: {printed}");
    assert!(printed.contains("/trials/4"), "{words:?}: {printed}");
}

#[test]
fn the_last_words_name_one_configuration() {
    let bench = Site::new();
    let words = |study: &str, script: &str| {
        let mut command = exec(bench.url(), study, &["--trials", "12", "--confirm=8"], script);
        let all: Vec<_> =
            command.get_args().filter(|word| *word != "--json").map(ToOwned::to_owned).collect();
        command = Command::new(program("treewright"));
        let output = command.args(all).output().expect("the program starts");
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output)
    };
    let better = words("better", "echo '{\"loss\": {x}}'");
    let lines: Vec<_> = better.lines().collect();
    assert_eq!(lines[1], "best: x=1", "{better}");
    assert!(lines[2].contains("\"loss\": 1}"), "{better}");
    assert_eq!(lines[3], "loss 1, default 4", "{better}");
    assert!(lines[4].starts_with("confirmed in 8 interleaved pairs: 75.0 % below the default"), "{better}");
    let even = words("even", "echo '{\"loss\": 7}'; : {x}");
    assert_eq!(even.matches("x=").count(), 1, "{even}");
    assert!(even.contains("best: the default, x=4") && even.contains(": 4'"), "{even}");
}
