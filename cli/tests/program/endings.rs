//! Exit codes and messages when something is wrong. Never a panic.

use std::io::Read as _;
use std::process::{Output, Stdio};

use super::{Fake, run, treewright, with_trials};

fn expect(output: &Output, code: i32, said: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    for phrase in said {
        assert!(text.contains(phrase), "{phrase:?} is not in: {text}");
    }
    assert!(output.stdout.is_empty());
}

#[test]
fn an_unreachable_daemon_is_three() {
    let fake = Fake::absent();
    for arguments in [&["studies"][..], &["--json", "studies"], &["best", "x"], &["trials", "x"], &["ping"]] {
        expect(&run(&fake, arguments), 3, &[&fake.url(), "treewrightd serve"]);
    }
    let by_environment = treewright().env("TREEWRIGHT_SERVER", fake.url()).arg("ping").output().unwrap();
    expect(&by_environment, 3, &[&fake.url()]);
}

#[test]
fn a_hanging_daemon_is_three() {
    let fake = Fake::start();
    fake.hold(super::support::Hold::Everything);
    let output = run(&fake, &["studies", "--timeout", "300ms"]);
    expect(&output, 3, &["did not answer", "300 ms"]);
}

#[test]
fn a_refusal_is_one() {
    let fake = with_trials();
    expect(&run(&fake, &["study", "show", "atlantis"]), 1, &["studies/atlantis does not exist"]);
    expect(&run(&fake, &["trials", "sponza", "--filter", "rubbish"]), 1, &["column 1"]);
    expect(&run(&fake, &["predict", "sponza"]), 1, &["triangles"]);
    expect(&run(&fake, &["study", "delete", "atlantis", "--yes"]), 1, &["atlantis"]);
}

#[test]
fn a_senseless_command_line_is_two() {
    let fake = with_trials();
    expect(&run(&fake, &[]), 2, &["Usage"]);
    expect(&run(&fake, &["dance"]), 2, &["dance"]);
    expect(&treewright().args(["--server", "here", "studies"]).output().unwrap(), 2, &["here"]);
    expect(&run(&fake, &["predict", "sponza", "--indicator", "triangles=many"]), 2, &["many"]);
    expect(
        &treewright().args(["--server", "localhost:50611", "studies"]).output().unwrap(),
        2,
        &["http://localhost:50611"],
    );
    expect(&run(&fake, &["policy", "sponza", "--epsilon", "2"]), 2, &["epsilon", "between 0 and 1"]);
    expect(&run(&fake, &["policy", "sponza", "--pin", "max_depth=8"]), 2, &["max_depth", "from 9 to 1000"]);
    expect(&run(&fake, &["policy", "sponza", "--pin", "colour=blue"]), 2, &["colour", "max_depth, compact"]);
    expect(&run(&fake, &["policy", "sponza", "--pin", "max_depth=9", "--unpin"]), 2, &["--unpin"]);
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let fake = with_trials();
    let mut child = treewright()
        .args(["--server", &fake.url(), "--json", "trials", "sponza"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let status = child.wait().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!((status.code(), said.as_str()), (Some(0), ""));
}

#[test]
fn help_has_examples_and_exit_codes() {
    let output = treewright().arg("--help").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    for words in ["Examples:", "treewright best sponza", "Exit codes:", "TREEWRIGHT_SERVER"] {
        assert!(text.contains(words), "no {words} in:\n{text}");
    }
}
