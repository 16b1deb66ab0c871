//! Any bytes as the output of a tuned program: the measurements read from it can be reported, and nothing
//! before the last object is ever taken for the result.

use treewright_cli::printed::{Printed, Wanted, read};
use treewright_client::{Measurements, ObjectiveTerm};

/// Reads the bytes as they are, and once more with a result behind them.
pub fn run(bytes: &[u8]) {
    let out = String::from_utf8_lossy(bytes);
    let read = |out: &str| {
        let terms = [ObjectiveTerm { metric: "loss".to_owned(), weight: 2.0 }];
        let wanted = Wanted { terms: &terms, maximised: &[], limits: &[], most: Measurements::MOST };
        read(out, wanted, &Measurements::from([("wall_ms", 9.0), ("cpu_ms", 8.0)]))
    };
    match read(&out) {
        Printed::Measured { measurements, .. } => {
            assert!(measurements.len() <= Measurements::MOST, "too many");
            assert!(measurements.get("loss").is_some(), "the objective is missing");
            for (name, value) in measurements.iter() {
                assert!(Measurements::is_name(name), "{name:?} is no name");
                assert!(value.is_finite() && value >= 0.0, "{name} is {value}");
            }
        }
        Printed::Infeasible(reason) | Printed::NoResult(reason) => assert!(!reason.is_empty(), "no reason"),
    }
    let then = |line: &str| read(&format!("{out}\n{line}\n"));
    let measured = then("{\"loss\": 1.5}");
    assert!(
        matches!(&measured, Printed::Measured { measurements, .. } if measurements.get("loss") == Some(1.5)),
        "{measured:?}"
    );
    for line in ["{\"loss\": NaN}", "{\"loss\": null}", "{\"acc\": 1}", "{}", "{\"loss\": 0."] {
        assert!(matches!(then(line), Printed::NoResult(_)), "{line}");
    }
}
