//! The command line as a program, against a stand-in for the daemon: its output and its exit codes.

#[path = "../../../client/tests/support/mod.rs"]
mod support;

mod answers;
mod endings;
mod front;
mod printed;
mod shell;
mod study_files;

use std::process::{Command, Output};

use treewright_client::Outcome;
use treewright_client::blocking::Client;

use support::{Fake, measured, patient, spec, state};

/// The program, without the caller's environment.
fn treewright() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_treewright"));
    command.env_remove("TREEWRIGHT_SERVER").args(["--timeout", "20s"]);
    command
}

fn run(fake: &Fake, arguments: &[&str]) -> Output {
    treewright().args(["--server", &fake.url()]).args(arguments).output().expect("the program starts")
}

/// The output of a run that must succeed.
fn answer(fake: &Fake, arguments: &[&str]) -> String {
    let output = run(fake, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// A stand-in with one study, four measured trials and an infeasible one.
fn with_trials() -> Fake {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), patient()).expect("a good address");
    let study = client.study("sponza", spec()).expect("a good study");
    for render_ms in [10.0, 4.0, 6.5, 8.25] {
        study.suggest(&state(3)).report(measured(render_ms), Outcome::Ok).expect("a good result");
    }
    let bad = study.suggest(&state(3));
    bad.report(treewright_client::Measurements::new(), Outcome::infeasible("depth limit reached"))
        .expect("a good result");
    fake
}
