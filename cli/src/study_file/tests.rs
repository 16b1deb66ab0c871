//! Study files: a written study is read back as an equal one, and mistakes are named.

use proptest::prelude::*;
use testing::{cases, decided, studies};
use treewright_client::Policy;

use super::*;
use crate::carry::jsonl::{Header, write_line};

#[path = "../../../model/src/testing.rs"]
mod testing;

const FILE: &str = r#"
id = "zstd"
display_name = "a compressor"
note = """
of the nightly archive,
at 4 °C"""
tags = ["zstd", "archive", "zstd"]
state_tolerance = 0.02
seed = 7
episode_frames = 24
auxiliary = ["cpu_ms", "page_faults"]
fidelities = [{ name = "small", cost = 0.1 }, { name = "64", cost = 0.5 }]
limits = [{ metric = "memory_mb", at_most = 2000 }, { metric = "ratio", at_least = 1.5, at_most = 9 }]
constraints = ["level*2 <= 40", "strategy == 'fast' or ratio >= 2", { lesser = "level", greater = "ratio" }]

[[parameters]]
name = "level"
type = "integer"
min = 1
max = 19
default = 3
setup = true

[[parameters]]
name = "strategy"
type = "categorical"
values = ["fast", "lazy"]
default = "fast"

[[parameters]]
name = "ratio"
type = "float"
min = 1
max = 64.5
scale = "log"
default = 2
active_if = { parameter = "strategy", any_of = ["lazy"] }

[[parameters]]
name = "long"
type = "boolean"
default = false

[[parameters]]
name = "tile"
type = "categorical"
values = [16, 32, 64, 128]
default = 64

[[indicators]]
name = "megabytes"
min = 0
max = 1000
scale = "log"

[[objective]]
metric = "wall_ms"

[[objective]]
metric = "bytes"
weight = 0.001

[[objective]]
metric = "rate"
maximise = true

[policy]
epsilon = 0.5
search = "nelder_mead"
weigh_gain = true
pinned = { level = 1, strategy = "lazy", ratio = 4, long = true, tile = 128 }
"#;

fn read(text: &str) -> StudyFile {
    StudyFile::parse(text, Language::Toml).expect("a study file")
}

#[test]
fn a_file_is_read_as_people_write_it() {
    let file = read(FILE);
    let spec = file.spec().expect("a specification");
    assert_eq!(spec.space.parameters()[2].default, Value::Float(2.0), "whole numbers stand for floats");
    assert_eq!(spec.space.setup_parameters().map(|one| one.name.as_str()).collect::<Vec<_>>(), ["level"]);
    assert_eq!(spec.objective.terms()[0].weight, 1.0);
    assert_eq!((spec.objective.maximised()[0].as_str(), spec.objective.maximised().len()), ("rate", 1));
    let sizes = Domain::Categorical { values: [16, 32, 64, 128].map(Value::Integer).to_vec() };
    assert_eq!(spec.space.parameters()[4].domain, sizes, "numbers, not words");
    assert_eq!(spec.objective.auxiliary(), ["cpu_ms", "page_faults"]);
    assert_eq!(spec.objective.episode_frames(), 24);
    assert_eq!((spec.note.as_str(), spec.tags.len()), ("of the nightly archive,\nat 4 °C", 2));
    let limits: Vec<String> = spec.objective.limits().iter().map(ToString::to_string).collect();
    let levels: Vec<_> =
        spec.objective.fidelities().iter().map(|one| (one.name.as_str(), one.cost)).collect();
    assert_eq!(levels, [("small", 0.1), ("64", 0.5)]);
    assert_eq!(limits, ["memory_mb <= 2000", "1.5 <= ratio <= 9"]);
    let constraints: Vec<String> = spec.space.constraints().iter().map(ToString::to_string).collect();
    assert_eq!(constraints, ["level * 2 <= 40", "strategy == \"fast\" or ratio >= 2", "level <= ratio"]);
    let as_tables = "[[constraints]]\nlesser = \"level\"\ngreater = \"ratio\"\n\n[[indicators]]";
    let (start, end) = (FILE.find("constraints").expect("there"), FILE.find("\n\n[[par").expect("there"));
    let old = FILE.replacen("[[indicators]]", as_tables, 1).replace(&FILE[start..end], "");
    assert_eq!(read(&old).spec().expect("as before").space.constraints()[0], spec.space.constraints()[2]);
}

proptest! {
    #![proptest_config(cases(128))]

    #[test]
    fn every_specification_is_written_and_read_back(spec in studies()) {
        let policy = policy_entries(&spec.policy).expect("plain data");
        let file = StudyFile { id: Some("zstd".to_owned()), policy, ..StudyFile::of_spec(&spec) };
        for language in [Language::Toml, Language::Json] {
            let text = file.write(language).expect("text");
            prop_assert_eq!(StudyFile::parse(&text, language), Ok(file.clone()), "{}", text);
        }
        let mut line = Vec::new();
        write_line(&mut line, &Header::new("here", file.clone())).expect("written");
        let exported: Header = serde_json::from_slice(&line).expect("own output");
        prop_assert_eq!(&exported.study, &file);
        prop_assert_eq!(decided(file.spec().expect("a specification")), decided(spec));
    }
}

#[test]
fn a_policy_as_the_daemon_has_it_is_shortened_to_what_differs() {
    let entries = |policy: &Policy| policy_entries(policy).expect("plain data");
    assert!(entries(&Policy::new().epsilon(0.2).lease_s(60)).is_empty(), "the defaults");
    let changed = entries(&Policy::new().epsilon(0.25).lease_s(60));
    assert_eq!(changed.keys().collect::<Vec<_>>(), ["epsilon"]);
}

#[test]
fn a_preset_sets_what_is_not_named_beside_it() {
    let text = FILE.replace("[policy]", "[policy]\npreset = \"paper\"").replace("nelder_mead", "random");
    let policy = read(&text).policy_settings().expect("a policy");
    assert_eq!((policy.dice_once, policy.confirm_rounds, policy.epsilon), (Some(true), Some(0), Some(0.5)));
    assert_eq!(policy.show("search").as_deref(), Some("random"));
    let wrong = read(&text.replace("\"paper\"", "\"papers\"")).policy_settings().expect_err("a mistake");
    assert!(wrong.to_string().contains("`papers` is none of paper"), "{wrong}");
}

#[test]
fn a_field_of_an_earlier_version_is_ignored() {
    let old = FILE.replace("epsilon = 0.5", "epsilon = 0.5\nfreeze_risk = 0.05");
    let policy = |text: &str| read(text).policy_settings().expect("a policy");
    assert_eq!(policy(&old), policy(FILE));
}

#[test]
fn mistakes_are_named() {
    let parse = |text: &str| StudyFile::parse(text, Language::Toml).expect_err("a mistake");
    assert!(parse(&FILE.replace("display_name", "colour")).contains("colour"));
    assert!(parse(&FILE.replace("seed = 7", "seed = -7")).contains("line 9"));
    let spec = |text: &str| read(text).spec().expect_err("a mistake").to_string();
    assert!(spec(&FILE.replace("seed = 7", "seed = \"x\"")).contains("seed"));
    assert!(spec(&FILE.replace("level*2 <= 40", "level*2 <=")).contains("at character 11: a name, a value"));
    assert!(spec(&FILE.replace("level*2 <= 40", "levle < 9")).contains("did you mean \"level\""));
    assert!(spec(&FILE.replace("cost = 0.5", "cost = 0.05")).contains("the cheapest first"));
    assert!(spec(&FILE.replace("max = 19", "max = 19.5")).contains("19.5 is no whole number"));
    assert!(spec(&FILE.replace("default = 3", "default = 20")).contains("level"));
    assert!(spec(&FILE.replace("search = \"nelder_mead\"", "search = \"best\"")).contains("nelder_mead"));
    assert!(spec(&FILE.replace("epsilon = 0.5", "epsilon = 5")).contains("between 0 and 1"));
    assert!(spec(&FILE.replace("frames = 24", "frames = 65")).contains("give 1 to 64"));
    assert!(spec(&FILE.replace("epsilon", "patience")).contains("patience"));
    let with_bounds = FILE.replace("default = false", "default = false\nmin = 1");
    assert!(spec(&with_bounds).contains("only numbers have"));
}

#[test]
fn parameters_are_written_in_one_word() {
    let domain = |text: &str| {
        let entry = ParameterEntry::inline(text).expect("a parameter");
        let parameter = entry.parameter(&[]).expect("a parameter");
        (parameter.name, parameter.domain, parameter.default)
    };
    let integer = Domain::Integer { min: 1, max: 19, scale: Scale::Linear };
    assert_eq!(domain("level=1..19:3"), ("level".into(), integer, Value::Integer(3)));
    let float = Domain::Float { min: 1.0, max: 64.0, scale: Scale::Log };
    assert_eq!(domain("ratio=1..64.0:2:log"), ("ratio".into(), float, Value::Float(2.0)));
    let words = Domain::Categorical { values: vec!["off".into(), "wal".into()] };
    assert_eq!(domain("journal=off|wal:wal"), ("journal".into(), words, Value::from("wal")));
    let sizes = Domain::Categorical { values: [16, 32, 64, 128].map(Value::Integer).to_vec() };
    assert_eq!(domain("tile=16|32|64|128:64"), ("tile".into(), sizes, Value::Integer(64)));
    assert_eq!(domain("long=bool:false"), ("long".into(), Domain::Boolean, Value::from(false)));
    let steps = ParameterEntry::inline("block=16..256/16:64").expect("a parameter");
    let terms = vec![TermEntry { metric: "ms".into(), weight: 1.0, maximise: false }];
    let file = StudyFile { parameters: vec![steps.clone()], objective: terms, ..StudyFile::default() };
    let space = file.spec().expect("a study").space;
    assert_eq!(space.constraints()[0].to_string(), "block % 16 == 0");
    assert_eq!(space.enumerate().map(|all| all.len()), Some(16));
    let of_words =
        ParameterEntry { step: Some(2), ..ParameterEntry::inline("a=b|c:b").expect("a parameter") };
    assert!(of_words.parameter(&[]).expect_err("words").contains("only a whole number has a `step`"));
    let level = FidelityEntry { name: "16".into(), cost: 0.06 };
    assert_eq!(FidelityEntry::inline("16 = 0.06"), Ok(level));
    assert!(["16", "16=", "16=a"].iter().all(|wrong| FidelityEntry::inline(wrong).is_err()));
    for wrong in ["level", "level=3", "level=a..b:3", "level=1..9/x:3"] {
        assert!(ParameterEntry::inline(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn the_schema_knows_every_field() {
    let schema = schema();
    assert!(schema["$schema"].as_str().is_some_and(|version| version.contains("2020-12")));
    let file: serde_json::Value = serde_json::to_value(read(FILE)).expect("plain data");
    for key in file.as_object().expect("an object").keys() {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
    for field in Policy::FIELDS {
        assert!(schema["properties"]["policy"]["properties"][field.name].is_object(), "{}", field.name);
    }
}
