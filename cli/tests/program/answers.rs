//! The output of the commands, for people and for scripts.

use serde_json::Value;

use super::{answer, with_trials};

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("JSON")
}

#[test]
fn studies() {
    let fake = with_trials();
    let shown = answer(&fake, &["studies"]);
    for word in ["study", "sponza", "a scene", "2023-11-14"] {
        assert!(shown.contains(word), "no {word} in:\n{shown}");
    }
    let studies = json(&answer(&fake, &["studies", "--json"]));
    assert_eq!(studies[0]["name"], "studies/sponza");
    assert_eq!(studies[0]["spec"]["space"]["parameters"][0]["default"], 32);
}

#[test]
fn what_only_a_newer_daemon_knows_is_shown_as_such() {
    let fake = with_trials();
    {
        let mut book = fake.book();
        let study = book.studies.get_mut("studies/sponza").expect("the study");
        study.policy.get_or_insert_default().predictor = 8;
        let mut other = study.clone();
        other.name = "studies/tomorrow".to_owned();
        other.space.as_mut().expect("a space").parameters[0].domain = None;
        book.studies.insert(other.name.clone(), other);
        book.trials[0].mode = 17;
    }
    let shown = answer(&fake, &["studies"]);
    assert!(shown.contains("sponza") && shown.contains("tomorrow"), "{shown}");
    assert!(answer(&fake, &["study", "show", "sponza"]).contains("unrecognised (8)"));
    let unreadable = answer(&fake, &["study", "show", "tomorrow"]);
    assert!(unreadable.contains("cannot be read") && unreadable.contains("parameters[0].domain"));
    assert!(answer(&fake, &["trials", "sponza"]).contains("unrecognised"));
}

#[test]
fn one_study() {
    let fake = with_trials();
    let shown = answer(&fake, &["study", "show", "sponza"]);
    for words in [
        "a whole number from 9 to 1000, log scale",
        "true or false",
        "triangles",
        "minimises 1 × render_ms",
        "epsilon",
    ] {
        assert!(shown.contains(words), "no {words} in:\n{shown}");
    }
    assert_eq!(
        json(&answer(&fake, &["--json", "study", "show", "sponza"]))["spec"]["objective"][0]["metric"],
        "render_ms"
    );
}

#[test]
fn trials_are_read_to_the_limit() {
    let fake = with_trials();
    let shown = answer(&fake, &["trials", "sponza"]);
    let rows: Vec<_> = shown.lines().filter(|line| line.contains("max_depth=")).collect();
    assert_eq!(rows.len(), 5, "{shown}");
    assert!(shown.contains("DEFAULT") && shown.contains(" 10 "), "{shown}");
    assert!(rows[0].contains("max_depth=32"), "{shown}");
    assert!(shown.contains("6.5000"), "{shown}");
    assert!(shown.contains("INFEASIBLE: depth limit reached"), "whole words in a pipe: {shown}");
    let some = answer(&fake, &["trials", "sponza", "--limit", "3", "--order-by", "number desc"]);
    assert!(some.contains("the first 3"), "{some}");
    assert_eq!(some.lines().filter(|line| line.contains("max_depth=")).count(), 3);
    let table = answer(&fake, &["trials", "sponza", "--format", "csv"]);
    let lines: Vec<_> = table.lines().collect();
    assert_eq!(lines.len(), 6, "{table}");
    assert!(lines[0].ends_with("config.max_depth,config.compact,indicator.triangles,measurement.render_ms"));
    assert!(lines[1].contains("OK") && lines[1].ends_with("32,false,1000.0,10.0"), "{table}");
    assert!(lines[5].contains("INFEASIBLE,depth limit reached"), "{table}");
    let records = json(&answer(&fake, &["--json", "trials", "sponza", "--filter", "state = COMPLETED"]));
    assert_eq!(records.as_array().map(Vec::len), Some(5));
    assert_eq!((&records[1]["cost"], &records[1]["mode"]), (&Value::from(4.0), &Value::from("EXPLORE")));
    assert_eq!(records[4]["outcome"]["infeasible"]["reason"], "depth limit reached");
    let none = answer(&fake, &["--json", "trials", "sponza", "--limit", "0"]);
    assert_eq!(none, "[]\n");
}

#[test]
fn an_explanation() {
    let fake = with_trials();
    let shown = answer(&fake, &["explain", "sponza", "--indicator", "triangles=1000"]);
    for words in [
        "by nearest_neighbour: The nearest known state is 0.25 away.",
        "by the rule EXPLOIT",
        "state 1: 3 configurations tried",
        "repeated measurements differ by 4.0 %",
        "expected to gain 11.0 % in each of 20 frames",
        "it means nothing beside the best known value of builder",
    ] {
        assert!(shown.contains(words), "{words}\n{shown}");
    }
    let record = json(&answer(&fake, &["--json", "explain", "sponza", "--indicator", "triangles=1000"]));
    assert_eq!(record["state"]["omissions"][0]["reason"], "INACTIVE");
    assert_eq!(record["reason"]["explanation"]["rule"], "EXPLOIT");
}

#[test]
fn the_best_and_a_prediction() {
    let fake = with_trials();
    let shown = answer(&fake, &["best", "sponza"]);
    assert!(
        shown.starts_with(
            "cost 4 over 1 measurement(s) in state 1\ndefault 10, so the best is 60.0 % below it\n"
        ),
        "{shown}"
    );
    assert!(shown.lines().any(|line| line.split_whitespace().eq(["max_depth", "33", "32"])), "{shown}");
    assert_eq!(json(&answer(&fake, &["best", "sponza", "--json"]))["configuration"]["max_depth"], 33);
    let shown = answer(&fake, &["predict", "sponza", "--indicator", "triangles=1000"]);
    for words in ["mode EXPLOIT, predicted cost 4", "The nearest known state is 0.25 away.", "max_depth"] {
        assert!(shown.contains(words), "no {words} in:\n{shown}");
    }
    let record = json(&answer(&fake, &["--json", "predict", "sponza", "--indicator", "triangles=1000"]));
    assert_eq!(record["reason"]["neighbours"][0]["distance"], 0.25);
}

#[test]
fn what_is_proven_is_told_wherever_the_best_is() {
    use treewright_proto::v1;

    let fake = with_trials();
    let gain = v1::Gain { share: 0.5, low: Some(0.412), high: Some(0.57), probability_better: Some(0.996) };
    fake.book().standing = Some(v1::Standing {
        cost: 5.0,
        cost_low: 4.5,
        cost_high: 5.5,
        gain: Some(gain),
        nothing_better: false,
        confirmation: Some(v1::Confirmation {
            stage: v1::ConfirmationStage::Racing as i32,
            rounds: 3,
            rounds_max: 10,
            measurements: 9,
            gain: None,
        }),
        disturbances: 1,
        gain_at_most: None,
    });
    let shown = answer(&fake, &["best", "sponza"]);
    for words in [
        "cost 5 [4.5000, 5.5000] in state 1",
        "50.0 % [41.2, 57.0] below the default (95 % interval), better with probability 1.00",
        "confirmation goes on, 3 of at most 10 rounds",
        "the speed of a machine jumped once",
    ] {
        assert!(shown.contains(words), "{words}\n{shown}");
    }
    fake.book().studies.get_mut("studies/sponza").expect("it").statistics =
        Some(v1::StudyStatistics { states: 1, trials: 5, completed_trials: 5, open_trials: 0 });
    for arguments in [&["study", "show", "sponza"][..], &["watch", "sponza", "--once"]] {
        let shown = answer(&fake, arguments);
        assert!(shown.contains("confirming") && shown.contains("50.0 % [41.2, 57.0]"), "{shown}");
        assert!(shown.contains("jumped 1 time(s)"), "{shown}");
    }
    let shown = answer(&fake, &["studies", "--standing"]);
    let row = |shown: &str| {
        let row = shown.lines().find(|line| line.contains("sponza")).expect("its row");
        row.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(row(&shown), ["sponza", "1", "0", "0", "0", "1", "50.0"], "{shown}");
    let record = json(&answer(&fake, &["studies", "--standing", "--json"]));
    assert_eq!(record[0]["best"][0]["standing"]["gain"]["low"], 0.412);
    let mut book = fake.book();
    let confirmation = book.standing.as_mut().and_then(|standing| standing.confirmation.as_mut());
    confirmation.expect("it is given").stage = v1::ConfirmationStage::Better as i32;
    drop(book);
    let shown = answer(&fake, &["studies", "--standing"]);
    assert!(shown.contains("likely better"), "{shown}");
    assert_eq!(row(&shown), ["sponza", "1", "0", "1", "0", "0", "50.0"], "{shown}");
}

#[test]
fn the_policy_is_changed_field_by_field() {
    let fake = with_trials();
    let shown = answer(&fake, &["policy", "sponza", "--epsilon", "0.5", "--search", "random"]);
    let row = |name: &str| shown.lines().find(|line| line.trim_start().starts_with(name)).unwrap_or_default();
    assert!(row("epsilon").trim().ends_with("0.5") && row("search").contains("random"), "{shown}");
    let pinned = json(&answer(&fake, &["--json", "policy", "sponza", "--pin", "max_depth=40,compact=true"]));
    assert_eq!(pinned["pinned"], serde_json::json!({ "compact": true, "max_depth": 40 }));
    assert_eq!(pinned["epsilon"], 0.5);
    let shown = answer(&fake, &["policy", "sponza"]);
    assert!(shown.contains("max_depth=40"), "it is shown without a change: {shown}");
    let shown = answer(&fake, &["policy", "sponza", "--unpin"]);
    assert!(shown.contains("nothing"), "{shown}");
    assert_eq!(
        fake.book().studies["studies/sponza"].policy.as_ref().and_then(|policy| policy.pinned.clone()),
        None
    );
}

#[test]
fn deleting_wants_a_yes() {
    let fake = with_trials();
    let output = super::run(&fake, &["study", "delete", "sponza"]);
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.contains("--yes") && words.contains("sponza"), "{words}");
    assert_eq!(fake.book().studies.len(), 1);
    assert_eq!(answer(&fake, &["study", "delete", "sponza", "--yes"]), "deleted sponza\n");
    assert!(fake.book().studies.is_empty());
    assert_eq!(answer(&fake, &["studies"]), "no studies yet\n");
}

#[test]
fn ping() {
    let fake = with_trials();
    assert!(answer(&fake, &["ping"]).contains("is serving; a round trip takes"));
    assert_eq!(json(&answer(&fake, &["--json", "ping"]))["serving"], true);
}
