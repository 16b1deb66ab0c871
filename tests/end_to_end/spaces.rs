//! The space of a running study changes: a program that knows the space before and one that knows the new one
//! share it, across a kill of the daemon.

use std::time::{Duration, Instant};

use treewright_client::blocking::{Client, Study};
use treewright_client::{
    Configuration, Indicators, Measurements, Options, Outcome, Source, Space, StudySpec,
};

use crate::site::{Site, say};

const PATIENCE: Duration = Duration::from_secs(20);

fn program(url: &str, name: &str) -> Client {
    let options = Options::new().client_id(name).deadline(PATIENCE);
    Client::connect(url, options).expect("a good address")
}

fn spec(is_new: bool) -> StudySpec {
    let space = match is_new {
        false => Space::builder().integer("level", 1..=9).default(5).build(),
        true => {
            Space::builder().integer("level", 1..=12).default(5).integer("threads", 1..=4).default(2).build()
        }
    };
    StudySpec::builder(space.expect("a space")).minimise("wall_ms", 1.0).build().expect("a study")
}

/// A frame, answered by the daemon, which may just be coming back.
fn frame(study: &Study) -> Configuration {
    let begun = Instant::now();
    loop {
        let suggestion = study.suggest(&Indicators::new());
        if suggestion.source() != Source::Daemon {
            assert!(begun.elapsed() < PATIENCE, "{:?}", suggestion.problem());
            std::thread::sleep(Duration::from_millis(50));
            continue;
        }
        let configuration = suggestion.configuration().clone();
        let level = configuration.integer("level").expect("it has one");
        let threads = configuration.integer("threads").unwrap_or(2);
        let wall_ms = 50.0 - level as f64 - 3.0 * threads as f64;
        suggestion.report(Measurements::from([("wall_ms", wall_ms)]), Outcome::Ok).expect("a result");
        return configuration;
    }
}

fn both_go_on(old: &Study, new: &Study) {
    for _ in 0..12 {
        let known = frame(old);
        assert_eq!(known.len(), 1, "{known}");
        assert!((1..=9).contains(&known.integer("level").expect("it has one")), "{known}");
        assert_eq!(frame(new).len(), 2);
    }
}

#[test]
fn an_old_and_a_new_program_share_a_study_whose_space_changed() {
    let site = Site::new();
    let before = program(site.url(), "old");
    let old = before.study("toy", spec(false)).expect("created");
    for _ in 0..8 {
        frame(&old);
    }
    before.flush(PATIENCE).expect("all are reported");

    let threads = "[[parameters]]\nname = \"threads\"\ntype = \"integer\"\nmin = 1\nmax = 4\ndefault = 2\n\n";
    let text = say(site.url(), &["study", "show", "toy", "--format", "toml"]).replace("max = 9", "max = 12");
    let text = text.replacen("[[objective]]", &format!("{threads}[[objective]]"), 1);
    let file = &site.write("toy.toml", &text);
    let shown = say(site.url(), &["study", "edit", "toy", file]);
    assert!(shown.contains("8 completed trial(s) stay, 0 are left out"), "{shown}");
    let done = say(site.url(), &["study", "edit", "toy", file, "--yes"]);
    assert!(done.contains("revision 2"), "{done}");

    let after = program(site.url(), "new");
    let new = after.study("toy", spec(true)).expect("found");
    both_go_on(&old, &new);
    let site = site.killed();
    both_go_on(&old, &new);
    for client in [&before, &after] {
        client.flush(PATIENCE).expect("all are reported");
    }
    // A program of before that starts now is served, too.
    let again = program(site.url(), "again").study("toy", spec(false)).expect("found");
    assert_eq!(frame(&again).len(), 1);
    let exported = say(site.url(), &["export", "toy"]);
    assert!(exported.lines().skip(1).all(|line| line.contains("\"threads\"")), "{exported}");
}
