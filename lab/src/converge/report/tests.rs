//! The plot of a made-up comparison shows its results.

use treewright_client::Fingerprint;

use super::*;
use crate::converge::curve::{Curve, Run};
use crate::converge::equal_error::{BASELINES, equal_error};
use crate::converge::results::{ComparisonResults, ContenderResult, ReferenceFacts};
use crate::converge::testing;
use treewright_renderer::tuning::results::SceneFacts;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

const FLOOR: f64 = 1e-4;

fn curve(who: Who, setup_ms: f64, frame_ms: f64) -> Curve {
    let error = |number: f64| move |samples: f64| (0.2 + 0.01 * number) / samples + FLOOR;
    let run = |number: u32| Run {
        seed: u64::from(number),
        ..testing::run(10.0, frame_ms, 150, error(f64::from(number)))
    };
    testing::curve(who, setup_ms, (0..5).map(run).collect())
}

fn results() -> ComparisonResults {
    let mut broken = curve(Who::Named("broken <b>".into()), 0.0, 1.0);
    (broken.runs, broken.failure) = (Vec::new(), Some("too deep".into()));
    let curves = [
        curve(Who::PaperDefault, 0.0, 20.0),
        curve(NATIVE_DEFAULT, 0.0, 10.0),
        curve(Who::Tuned, 5000.0, 5.0),
        broken,
    ];
    ComparisonResults {
        scene: SceneFacts {
            name: "a & b".into(),
            triangles: 1_234_567,
            meshes: 3,
            left_out: Vec::new(),
            notes: vec!["a note".into()],
        },
        size: [16, 12],
        bounces: 3,
        machine: Fingerprint { cpu_model: "Test CPU".into(), ..Fingerprint::default() },
        embree: (4, 4, 0),
        budget_ms: 1500.0,
        reference: ReferenceFacts {
            samples: 4096,
            scene_hash: "00".into(),
            relative_mse: FLOOR,
            trusted_from: 2.0 * FLOOR,
        },
        equal_error: equal_error(&curves, &BASELINES),
        contenders: curves
            .into_iter()
            .map(|curve| ContenderResult::new(curve, None, "a file".to_owned(), FLOOR))
            .collect(),
    }
}

#[test]
fn the_plot_has_all_curves() {
    let results = results();
    let plot = svg_file(&results).expect("it is drawn");
    let names = ["paper default", "native Embree default", "tuned"];
    for words in names.into_iter().chain(["relative mean squared error", "a &amp; b"]) {
        assert!(plot.contains(words), "{words:?} is missing");
    }
    assert!(!plot.contains("NaN") && !plot.contains("inf"));
    // Five runs: 14 marks on each of three contenders.
    assert_eq!(plot.matches("<circle").count(), 3 * 14);
    let nothing = ComparisonResults { contenders: Vec::new(), ..results };
    assert!(svg_file(&nothing).is_err_and(|error| error.to_string().contains("rendered")));
}
