//! The page and the plot of a made-up comparison: they show its results, and need no other file.

use glam::Vec3;
use treewright_client::Fingerprint;

use super::*;
use crate::converge::bootstrap::Interval;
use crate::converge::curve::{Curve, Pictures, Run};
use crate::converge::equal_error::{BASELINES, equal_error};
use crate::converge::results::{ContenderResult, ReferenceFacts};
use crate::converge::testing;
use treewright_renderer::film::Picture;
use treewright_renderer::tuning::results::SceneFacts;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

const FLOOR: f64 = 1e-4;

fn picture(level: f32) -> Picture {
    Picture { width: 16, height: 12, pixels: vec![Vec3::splat(level); 16 * 12] }
}

fn curve(who: Who, setup_ms: f64, frame_ms: f64, plateau: f64) -> Curve {
    let error = |number: f64| move |samples: f64| (0.2 + 0.01 * number) / samples + plateau;
    let run = |number: u32| Run {
        seed: u64::from(number),
        ..testing::run(10.0, frame_ms, 150, error(f64::from(number)))
    };
    let mut curve = testing::curve(who, setup_ms, (0..5).map(run).collect());
    let shot = Shot { picture: picture(1.1), point: curve.runs[0].end };
    curve.pictures.at_budget = Some(shot);
    curve
}

fn results(squared_bias: f64) -> ComparisonResults {
    let mut broken = curve(Who::Named("broken <b>".into()), 0.0, 1.0, FLOOR);
    (broken.runs, broken.pictures, broken.failure) =
        (Vec::new(), Pictures::default(), Some("too deep".into()));
    let curves = [
        curve(Who::PaperDefault, 0.0, 20.0, FLOOR),
        curve(NATIVE_DEFAULT, 0.0, 10.0, FLOOR),
        curve(Who::Tuned, 5000.0, 5.0, FLOOR + squared_bias),
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
            .map(|curve| {
                let estimate = if curve.who == Who::Tuned { squared_bias } else { 0.0 };
                let range = Some([estimate - 0.1 * FLOOR, estimate + 0.1 * FLOOR]);
                ContenderResult::new(
                    curve,
                    None,
                    "a file".to_owned(),
                    FLOOR,
                    Some(Interval { estimate, range }),
                )
            })
            .collect(),
        notes: vec!["something was left out".into()],
    }
}

#[test]
fn the_page_says_what_was_measured_and_stands_alone() {
    let page = html(&results(0.0), &Yardstick::new(picture(1.0))).expect("it is put together");
    for words in [
        "tuned configuration reaches the same picture 1.99× sooner than native Embree default",
        "a &#38; b",
        "broken &#60;b&#62;",
        "too deep",
        "still being sought",
        "−1",
        "no bias is seen",
        "4\u{2009}096 samples",
        "something was left out",
        "a note",
        "Test CPU",
    ] {
        assert!(page.contains(words), "{words:?} is missing");
    }
    assert!(page.matches("data:image/png;base64,").count() == 2 * 3 + 1);
    let mut outside =
        page.match_indices("http").filter(|(at, _)| !page[*at..].starts_with("http://www.w3.org"));
    assert_eq!(outside.next(), None, "nothing is loaded from elsewhere");
}

#[test]
fn no_gain_is_told_where_its_interval_holds_none() {
    let mut results = results(0.0);
    for row in results.equal_error.iter_mut().flat_map(|error| &mut error.rows) {
        for speedup in &mut row.speedups {
            speedup.ratio.range = Some([0.9, 2.5]);
        }
    }
    let page = html(&results, &Yardstick::new(picture(1.0))).expect("it is put together");
    assert!(page.contains("Whether the tuned configuration reaches the same picture sooner"));
    assert!(page.contains("is not shown: 1.99 [0.90, 2.50]×"));
}

#[test]
fn bias_is_reported() {
    let page = html(&results(1e-2), &Yardstick::new(picture(1.0))).expect("it is put together");
    assert!(page.contains("BIASED") && page.contains("which no time will remove: tuned."));
}

#[test]
fn the_plot_has_all_curves() {
    let results = results(0.0);
    let plot = svg_file(&results).expect("it is drawn");
    let names = ["paper default", "native Embree default", "tuned"];
    for words in names.into_iter().chain(["relative mean squared error", "a &amp; b"]) {
        assert!(plot.contains(words), "{words:?} is missing");
    }
    assert!(!plot.contains("NaN") && !plot.contains("inf"));
    // Five runs: 14 marks on each of three contenders.
    assert_eq!(plot.matches("<circle").count(), 3 * 14);
    let nothing = ComparisonResults { contenders: Vec::new(), ..results };
    assert!(svg(&nothing).is_err_and(|error| error.to_string().contains("rendered")));
}

#[test]
fn the_table_of_points_can_be_read_back() {
    let csv = results(0.0).csv();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 1 + 3 * 5 * 15);
    assert!(lines[1].starts_with("\"paper default\",1,0,1,0.000,10.000,20.000,30.000,"), "{}", lines[1]);
    assert!(lines.iter().all(|line| line.split(',').count() == 11));
    assert!(lines.iter().any(|line| line.starts_with("\"tuned\"") && line.contains(",5000.000,")));
}
