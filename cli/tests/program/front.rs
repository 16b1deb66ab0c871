//! Several metrics at once: a session's reports, its next questions, and its output.

use serde_json::Value;
use treewright_proto::v1::Mode;

use super::{Fake, answer, run};

/// The time falls and the memory rises with the level; odd levels but the first take more of both.
const TOY: &str = r#"l={level}; o=$(( l > 1 ? l % 2 : 0 ))
echo "{\"time_ms\": $(( 6000 / l + 9000 * o )), \"memory_mb\": $(( 10 * l + 900 * o ))}""#;

const METRICS: &str = "time_ms,memory_mb";

fn exec<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["exec", "toy", "--tune", "level=1..500:1", "--metric", "json", "--front", METRICS];
    all.extend(more.iter().chain(&["--", "sh", "-c", TOY]));
    all
}

fn levels(front: &Value) -> Vec<i64> {
    let points = front["points"].as_array().expect("points");
    points.iter().map(|point| point["configuration"]["level"].as_i64().expect("a level")).collect()
}

#[test]
fn a_front_is_tuned_and_every_direction_knows_every_run() {
    let fake = Fake::start();
    let done = answer(&fake, &[&["--json"][..], &exec(&["--trials", "8"])].concat());
    let done: Value = serde_json::from_str(&done).expect("JSON");
    let front = &done["front"];
    assert_eq!((&done["trials"], &done["objective"]), (&Value::from(8), &Value::from("time_ms, memory_mb")));
    assert_eq!((&front["runs"], &front["configurations"]), (&Value::from(8), &Value::from(8)), "{done}");
    assert_eq!(done.get("best"), None);
    let trials = fake.book().trials.clone();
    assert_eq!(trials.len(), 9 * 8, "each run is reported to the eight other directions");
    let carried: Vec<_> = trials.iter().filter(|trial| trial.mode() == Mode::Pinned).collect();
    assert_eq!(carried.len(), 8 * 8);
    assert!(carried.iter().all(|trial| trial.origin.starts_with("studies/toy/trials/")));
    for trial in &trials {
        let metric = ["time_ms", "memory_mb"].get(trial.indicators["direction"] as usize);
        assert!(metric.is_none_or(|metric| trial.cost == Some(trial.measurements[*metric])), "{trial:?}");
        assert!(trial.cost.is_some_and(|cost| cost > 0.0));
    }
    // The quickest first; the default takes the least memory.
    let best = levels(front);
    let is_on_it = |level: &i64| *level == 1 || level % 2 == 0;
    assert!(best.len() > 2 && best.last() == Some(&1) && best.iter().all(is_on_it), "{front}");
    assert_eq!(front["points"][0]["ratios"]["memory_mb"], best[0] as f64);

    // Another call goes on where this one ended.
    let again = answer(&fake, &exec(&["--trials", "4"]));
    assert!(again.contains("by the medians of 12 runs") && again.contains("(default)"), "{again}");
    assert_eq!(fake.book().trials.len(), 9 * 12);
    let file = std::env::temp_dir().join(format!("front-{}.svg", std::process::id()));
    let svg = file.to_str().expect("a name");
    // Those that it was made for.
    let shown = answer(&fake, &["front", "toy", "--svg", svg]);
    assert!(again.contains(shown.trim_end()), "{shown}\n{again}");
    let drawn = std::fs::read_to_string(&file).expect("a figure");
    std::fs::remove_file(&file).expect("it is there");
    assert_eq!(drawn.matches("<title>").count(), 1 + 12 + 1, "its own, all configurations, the default");
    assert!(drawn.contains("time_ms (lower is better), logarithmic"), "{drawn}");
    assert!(drawn.contains(">default<"), "{drawn}");
}

#[test]
fn runs_are_carried_once_and_machines_are_told_apart() {
    let fake = Fake::start();
    answer(&fake, &exec(&["--trials", "6"]));
    let exported = answer(&fake, &["export", "toy"]);
    assert_eq!(exported.lines().count(), 1 + 6, "what repeats a run is made again where it is needed");
    let file = std::env::temp_dir().join(format!("front-{}.jsonl", std::process::id()));
    let elsewhere = exported.replace("\"cpu_model\":\"", "\"cpu_model\":\"slower ");
    std::fs::write(&file, elsewhere.replace("/studies/toy", "/studies/there")).expect("written");
    let tally = answer(&fake, &["import", file.to_str().expect("a name")]);
    std::fs::remove_file(&file).expect("it is there");
    assert!(tally.contains("6 trial(s) added"), "{tally}");
    let front = run(&fake, &["front", "toy", "--metrics", METRICS]);
    let said = String::from_utf8_lossy(&front.stderr);
    assert!(!front.status.success() && said.contains("on 2 machine(s)"), "{said}");
    // This machine goes on with its own six runs.
    let again = answer(&fake, &exec(&["--trials", "1"]));
    assert!(again.contains("by the medians of 7 runs"), "{again}");
}

#[test]
fn excluded_runs_and_those_at_a_cheaper_level_are_on_no_front() {
    let fake = Fake::start();
    answer(&fake, &exec(&["--trials", "4"]));
    {
        let mut book = fake.book();
        let mut runs = book.trials.iter_mut().filter(|trial| trial.origin.is_empty());
        runs.next().expect("a run").exclusion = "the machine was busy".into();
        runs.next().expect("a run").fidelity = "small".into();
    }
    let shown = answer(&fake, &["front", "toy", "--metrics", METRICS]);
    assert!(shown.contains("by the medians of 2 runs"), "{shown}");
    let again = answer(&fake, &exec(&["--trials", "1"]));
    assert!(again.contains("by the medians of 3 runs"), "{again}");
}

#[test]
fn what_makes_no_front_is_refused() {
    let fake = Fake::start();
    let refused = |arguments: &[&str], words: &str| {
        let output = run(&fake, arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(words), "{said}");
    };
    refused(&exec(&["--confirm"]), "cannot be used with");
    refused(&exec(&["--indicator", "size=3"]), "cannot be used with");
    let one = ["exec", "one", "--tune", "level=1..5:1", "--front", "wall_ms", "--", "true"];
    refused(&one, "name two or three");
    let nothing = ["exec", "none", "--tune", "level=1..5:1", "--front", "wall_ms,loss", "--", "true"];
    refused(&nothing, "minimises loss");
    let rate = ["exec", "rate", "--tune", "level=1..5:1", "--front", "wall_ms,1/rate", "--", "true"];
    refused(&rate, "maximises rate");
    let json = ["exec", "zero", "--tune", "level=1..5:1", "--metric", "json", "--front", "wall_ms,loss"];
    let zero = [&json[..], &["--trials", "2", "--", "echo", "{\"loss\": 0}"]].concat();
    refused(&zero, "a front needs it in every run, finite and above 0");
    answer(&fake, &exec(&["--trials", "1"]));
    let mut other = exec(&["--trials", "1"]);
    other[7] = "memory_mb,time_ms";
    refused(&other, "is no front of memory_mb, time_ms, but `front of time_ms, memory_mb`");
    refused(&["front", "toy", "--metrics", METRICS, "--reference", "3"], "one number above 0");
    let none = answer(&fake, &["front", "toy", "--metrics", "a,b"]);
    assert_eq!(none, "no run measured all of a, b\n");
}
