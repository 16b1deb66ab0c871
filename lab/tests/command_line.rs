//! The laboratory's program as a user meets it: its results, and wrong input with its message and exit code.

#[path = "command_line/evaluation.rs"]
mod evaluation;
#[path = "../../renderer/cli/tests/support/program.rs"]
mod program;

use program::{FAILED, USAGE, fails, folder, succeeds};

const PROGRAM: &str = env!("CARGO_BIN_EXE_treewright-lab");

#[test]
fn errors_are_compared_over_time() {
    let folder = folder();
    let path = folder.path();
    let tuned = r#"{"tuned": {"quality": 3, "branching_factor": 8}, "break_even": {"tuning_ms": 5e6}}"#;
    std::fs::write(path.join("tuned.json"), tuned).expect("it can be written");
    let arguments = "converge --scene builtin:quick --detail 0.1 --size 24x16 --seconds 60 --spp 40 --runs 3 \
                     --reference-spp 1024 --tuned tuned.json";
    let json = succeeds(path, &format!("{arguments} --json -"));
    let results: serde_json::Value = serde_json::from_str(&json).expect("nothing but JSON is printed");
    let contenders = results["contenders"].as_array().expect("there are contenders");
    let names: Vec<&str> = contenders.iter().filter_map(|contender| contender["name"].as_str()).collect();
    assert_eq!(names.len(), 7, "{names:?}");
    assert!(names.contains(&"native used well high") && names.contains(&"best fixed configuration"));
    assert_eq!(results["reference"]["samples"], 1024);
    let floor = results["reference"]["relative_mse"].as_f64().expect("it was estimated");
    for contender in contenders {
        assert_eq!(contender["runs"].as_array().map(Vec::len), Some(3));
        // The samples are equal, hence also the errors of all structures.
        let ends = |field: &str| contender[field]["estimate"].as_f64().expect("it was measured");
        assert_eq!(ends("samples"), 40.0);
        assert!(ends("relative_mse") > floor);
        let first = contenders[0]["relative_mse"]["estimate"].as_f64().expect("it was measured");
        assert!((ends("relative_mse") / first - 1.0).abs() < 0.1);
    }
    assert_eq!(contenders[6]["setup_ms"], 5e6);
    let last = results["equal_error"].as_array().and_then(|all| all.last()).expect("an error all reach");
    let rows = last["rows"].as_array().expect("everybody has one");
    let tuned = rows.iter().find(|row| row["name"] == "tuned").expect("it took part");
    let speedup = &tuned["speedups"][0];
    assert_eq!(speedup["over"], "native Embree default");
    let ratio = |field: &str| speedup[field]["estimate"].as_f64().expect("there is a ratio");
    assert!(ratio("ratio_with_setup") < ratio("ratio") * 0.1, "an hour of tuning does not pay off at once");

    let printed = succeeds(path, &format!("{arguments} --json c.json --config quality=1"));
    for words in ["sooner than native", "quality=1", "wrote c.json"] {
        assert!(printed.contains(words), "{words:?} is missing: {printed}");
    }
    let written = std::fs::read_to_string(path.join("c.json")).expect("it was written");
    let again: serde_json::Value = serde_json::from_str(&written).expect("it is JSON");
    assert_eq!(again["reference"], results["reference"], "it is an equal picture");
}

#[test]
fn comparisons_that_cannot_be_made_are_refused() {
    let small = "converge --scene builtin:quick --detail 0.1 --size 24x16";
    fails(&format!("{small} --json nowhere/a.json"), FAILED, &["nowhere", "does not exist"]);
    fails(&format!("{small} --tuned missing.json"), FAILED, &["missing.json"]);
    fails(&format!("{small} --seconds 0"), USAGE, &["above 0"]);
    fails(&format!("{small} --runs 0"), USAGE, &["--runs"]);
}

#[test]
fn a_fleet_is_reported_from_its_record() {
    let folder = folder();
    let path = folder.path();
    let machine = r#"{"isa":"sse2","threads":1,"size":[8,6]}"#;
    let ran = |name: &str, ms: u32| {
        format!(
            r#"{{"name":"{name}","configuration":null,"build_ms":[0],"render_ms":[{ms}],"failure":null}}"#
        )
    };
    let conditions = format!(
        r#"{{"conditions":{{"version":"1","processor":{{"cpu_model":"a","isa":"","threads":0,"software":{{}}}},"machines":[{machine}],"scenes":["hall=builtin:hall:1"],"frames":24,"first_frames":8,"rounds":1}}}}"#
    );
    let answers = format!(
        r#"{{"answers":{{"machine":{machine},"scene":"hall","measured":{{"contenders":[{},{}],"disturbed":true}}}}}}"#,
        ran("recommended", 8),
        ran("Node after 0", 4)
    );
    std::fs::write(path.join("f.jsonl"), format!("{conditions}\n{answers}\n")).expect("it can be written");
    let printed = succeeds(path, "fleet --report f.jsonl");
    for words in ["1 measurements beside", "group sse2", "over own search", "2.000"] {
        assert!(printed.contains(words), "{words:?} is missing: {printed}");
    }
    let json: serde_json::Value =
        serde_json::from_str(&succeeds(path, "fleet --report f.jsonl --json")).expect("it is JSON");
    assert_eq!(json["rows"].as_array().map(Vec::len), Some(2 * 9));
    assert_eq!(json["rows"][1]["over_recommended"]["estimate"], 2.0);
    fails("fleet --report missing.jsonl", FAILED, &["missing.jsonl"]);
    fails("fleet --record a.jsonl --only hall", USAGE, &["name two"]);
}
