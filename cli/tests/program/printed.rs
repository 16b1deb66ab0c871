//! The measurements that are read from an output, for chosen lines and for arbitrary text.

use proptest::prelude::*;

use treewright_cli::printed::{LeftOut, Printed, Wanted, read};
use treewright_client::{MeasurementLimit, Measurements, ObjectiveTerm};

fn terms() -> Vec<ObjectiveTerm> {
    vec![ObjectiveTerm { metric: "loss".to_owned(), weight: 2.0 }]
}

fn wanted(terms: &[ObjectiveTerm]) -> Wanted<'_> {
    Wanted { terms, maximised: &[], limits: &[], most: Measurements::MOST }
}

fn read_loss(out: &str) -> Printed {
    read(out, wanted(&terms()), &Measurements::from([("wall_ms", 9.0), ("cpu_ms", 8.0)]))
}

fn measured(out: &str) -> (Measurements, Vec<LeftOut>) {
    match read_loss(out) {
        Printed::Measured { measurements, left_out } => (measurements, left_out),
        other => panic!("{out}: {other:?}"),
    }
}

fn loss(out: &str) -> f64 {
    measured(out).0.get("loss").expect("it is measured")
}

fn no_result(out: &str) -> String {
    match read_loss(out) {
        Printed::NoResult(reason) => reason,
        other => panic!("{out}: {other:?}"),
    }
}

#[test]
fn what_is_maximised_is_above_0_and_never_too_large() {
    let (terms, maximised) = (terms(), ["loss".to_owned()]);
    let at_most = |metric: &str, most| MeasurementLimit {
        metric: metric.to_owned(),
        at_least: None,
        at_most: Some(most),
    };
    let limits = [at_most("loss", 1e308)];
    let rate = Wanted { maximised: &maximised, limits: &limits, ..wanted(&terms) };
    let read_rate = |out: &str| read(out, rate, &Measurements::new());
    for good in ["{\"loss\": 1e308}", "{\"loss\": 1e-300}"] {
        assert!(matches!(read_rate(good), Printed::Measured { .. }), "{good}");
    }
    for bad in ["{\"loss\": 0}", "{\"loss\": -0.0}", "{\"loss\": -0.5}", "{\"loss\": 1e-309}"] {
        match read_rate(bad) {
            Printed::NoResult(reason) => {
                assert!(reason.contains("what is maximised must be above 0"), "{reason}")
            }
            other => panic!("{bad}: {other:?}"),
        }
    }
    // What is beyond a limit cannot be used, whatever its cost: it has a result.
    let terms = [&terms[..], &[ObjectiveTerm { metric: "memory_mb".to_owned(), weight: 0.0 }]].concat();
    let limits = [at_most("memory_mb", 2000.0)];
    let limited = Wanted { terms: &terms, limits: &limits, ..rate };
    let printed = |memory_mb: u32| {
        read(&format!("{{\"loss\": 0, \"memory_mb\": {memory_mb}}}"), limited, &Measurements::new())
    };
    assert!(matches!(printed(3000), Printed::Measured { .. }), "the study judges it");
    assert!(matches!(printed(2000), Printed::NoResult(_)), "within its limits it needs a cost");
}

#[test]
fn who_adds_a_measurement_keeps_a_place_for_it() {
    let numbers: String = (0..70).map(|number| format!(", \"n{number}\": 1")).collect();
    let out = format!("{{\"loss\": 1{numbers}}}");
    for most in [Measurements::MOST, Measurements::MOST - 1] {
        let taken = Measurements::from([("wall_ms", 9.0)]);
        match read(&out, Wanted { most, ..wanted(&terms()) }, &taken) {
            Printed::Measured { measurements, left_out } => {
                assert_eq!((measurements.len(), left_out.len()), (most, 72 - most));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn the_last_object_counts_and_no_earlier_one() {
    assert_eq!(loss("{\"loss\": 1}\n{\"loss\": 7.5}\nbye\n"), 7.5);
    let earlier = "{\"loss\": 0.25}\n";
    for (last, said) in [
        ("{\"loss\": NaN}", "loss is NaN"),
        ("{\"epoch\": 2, \"loss\": NaN}", "loss is NaN"),
        ("{\"loss\": nan}", "loss is nan"),
        ("{\"loss\": -nan}", "loss is -nan"),
        ("{\"loss\": Infinity}", "loss is Infinity"),
        ("{\"loss\": -inf}", "loss is -inf"),
        ("{\"loss\": 1e400}", "loss is 1e400"),
        ("{\"loss\": None}", "loss is None"),
        ("{\"loss\": undefined}", "loss is undefined"),
        ("{\"loss\": null}", "loss is null"),
        ("{\"loss\": \"0.5\"}", "\"0.5\""),
        ("{\"loss\": true}", "true"),
        ("{\"loss\": [0.5]}", "a list"),
        ("{\"loss\": {\"mean\": 0.5}}", "an object"),
        ("{\"loss\": -0.5}", "at least 0"),
        ("{\"loss\": 1e308}", "too large"),
        ("{}", "holds nothing"),
        ("{\"Loss\": 1, \"acc\": 2}", "holds Loss, acc"),
        ("{\"loss\": 0.2", "cannot be read"),
        ("{\"loss\": 0.2,}", "cannot be read"),
        ("{'loss': 0.2}", "cannot be read"),
        ("{\"loss\": }", "cannot be read"),
        ("{\n  \"loss\": NaN\n}", "loss is NaN"),
        ("{\n  \"acc\": 1\n}", "holds acc"),
        ("{\n  \"loss\": 1,\n}", "cannot be read"),
    ] {
        for end in ["", "\n", "\r\n", "\nbye\n"] {
            let reason = no_result(&format!("{earlier}{last}{end}"));
            assert!(reason.contains(said), "{last}: {reason}");
        }
    }
}

#[test]
fn objects_are_read_as_programs_print_them() {
    for out in [
        "{\"loss\": 0.5}",
        "  {\"loss\": 0.5}  \r\n",
        "\u{feff}{\"loss\": 0.5}\n",
        "10 %\r20 %\r{\"loss\": 0.5}\n",
        "{\n  \"loss\": 0.5,\n  \"of\": {\n    \"a\": 1\n  }\n}\n",
        "{\"loss\": 9}\n{\n\"loss\": 0.5\n}\n",
        "{\"loss\": 0.5, \"a\": \"{ NaN \\\" }\", \"b\": NaN}",
        "{ loss: 0.5 }",
        "{\"loss\": 5e-1}\n{worker 3} ends\n",
        "{\"loss\": 0.1, \"loss\": 0.5}",
    ] {
        assert_eq!(loss(out), 0.5, "{out}");
    }
    for out in ["", "0.5", "[{\"loss\": 0.5}]", "loss: 0.5"] {
        assert!(no_result(out).contains("no JSON object"), "{out}");
    }
}

#[test]
fn a_program_says_that_its_configuration_cannot_be_used() {
    let infeasible = |out: &str| match read_loss(out) {
        Printed::Infeasible(reason) => reason,
        other => panic!("{out}: {other:?}"),
    };
    assert_eq!(infeasible("{\"infeasible\": \"too deep\", \"loss\": 1}"), "too deep");
    assert_eq!(infeasible("{\"infeasible\": \"\"}"), "no reason given");
    assert_eq!(infeasible("{\"infeasible\": true}"), "no reason given");
    assert_eq!(loss("{\"infeasible\": false, \"loss\": 1}"), 1.0);
    assert_eq!(loss("{\"infeasible\": null, \"loss\": 1}"), 1.0);
}

#[test]
fn what_cannot_be_reported_is_left_out() {
    let out = "{\"loss\": 1, \"Throughput\": 3, \"cpu.user\": 1, \"p99-ms\": 2, \"temperature\": -4, \"ratio\": NaN, \
               \"best\": null, \"name\": \"x\", \"ok\": true, \"list\": [1], \"latency_ms\": 7}";
    let (measurements, mut left_out) = measured(out);
    let names: Vec<_> = measurements.iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["cpu_ms", "latency_ms", "loss", "wall_ms"]);
    left_out.sort();
    let words: Vec<_> = left_out.iter().map(ToString::to_string).collect();
    let all = words.join("; ");
    assert_eq!(words.len(), 6, "{all}");
    for said in
        ["Throughput (names", "cpu.user", "p99-ms", "temperature (below 0)", "ratio (not a finite", "best ("]
    {
        assert!(all.contains(said), "{said}: {all}");
    }
}

#[test]
fn a_run_has_a_limited_number_of_measurements_and_the_objective_is_among_them() {
    let many: Vec<_> = (0..200).map(|number| format!("\"a{number}\": {number}")).collect();
    let (measurements, left_out) = measured(&format!("{{{}, \"loss\": 3}}", many.join(", ")));
    assert_eq!((measurements.len(), measurements.get("loss")), (Measurements::MOST, Some(3.0)));
    assert_eq!(left_out.len(), 200 + 3 - Measurements::MOST);
    assert!(left_out.iter().all(|one| one.why.ends_with("at most")));
}

#[test]
fn what_the_program_says_of_a_time_counts_in_place_of_what_was_taken() {
    let taken = Measurements::from([("wall_ms", 9.0), ("cpu_ms", 8.0)]);
    let time = [ObjectiveTerm { metric: "wall_ms".to_owned(), weight: 1.0 }];
    let wall_ms = |out: &str| match read(out, wanted(&time), &taken) {
        Printed::Measured { measurements, .. } => Ok(measurements.get("wall_ms").expect("it is measured")),
        other => Err(format!("{other:?}")),
    };
    assert_eq!(wall_ms("{\"loss\": 1}"), Ok(9.0));
    assert_eq!(wall_ms("{\"wall_ms\": 1}"), Ok(1.0));
    assert!(wall_ms("{\"wall_ms\": NaN}").is_err_and(|message| message.contains("NaN")));
    let (measurements, left_out) = measured("{\"loss\": 1, \"wall_ms\": NaN, \"cpu_ms\": 2}");
    assert_eq!((measurements.get("wall_ms"), measurements.get("cpu_ms")), (Some(9.0), Some(2.0)));
    assert_eq!(left_out.len(), 1);
}

/// A line of an output: objects with odd numbers, pieces of objects, and anything.
fn line() -> impl Strategy<Value = String> {
    let number = prop::sample::select(vec![
        "1", "0.25", "-3", "1e400", "-1e400", "NaN", "-inf", "null", "true", "\"x\"", "[1]", "{}", "0x1",
        "1_0", "", "\"",
    ]);
    let name = prop::sample::select(vec!["loss", "wall_ms", "Throughput", "cpu.user", "infeasible", "ü", ""]);
    let object = prop::collection::vec((name, number), 0..6).prop_map(|pairs| {
        let pairs: Vec<_> = pairs.iter().map(|(name, number)| format!("\"{name}\": {number}")).collect();
        format!("{{{}}}", pairs.join(", "))
    });
    let braces = prop::sample::select(vec![
        "{",
        "}",
        "{\"loss\": 1",
        "{'loss': 1}",
        "  \"loss\": 3,",
        "{{",
        "{}",
        "\u{feff}{",
    ]);
    prop_oneof![3 => object, 1 => braces.prop_map(str::to_owned), 1 => ".*"]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn whatever_is_printed_only_what_the_service_takes_is_reported(lines in prop::collection::vec(line(), 0..8)) {
        if let Printed::Measured { measurements, .. } = read_loss(&lines.join("\n")) {
            prop_assert!(measurements.len() <= Measurements::MOST);
            prop_assert!(measurements.get("loss").is_some());
            for (name, value) in measurements.iter() {
                prop_assert!(Measurements::is_name(name) && value.is_finite() && value >= 0.0, "{name} {value}");
            }
        }
    }

    #[test]
    fn what_was_printed_before_the_last_object_changes_nothing(
        lines in prop::collection::vec(line(), 0..8),
        last in line().prop_filter("an object", |line| line.starts_with("{\"")),
    ) {
        prop_assume!(!last.contains(['\n', '\r']));
        let alone = read_loss(&last);
        prop_assert_eq!(read_loss(&format!("{}\n{last}\n", lines.join("\n"))), alone);
    }
}
