//! The report of a made-up run: it shows the results, and needs no other file.

use glam::Vec3;
use treewright_client::{
    Configuration, Confirmation, ConfirmationStage, Fingerprint, Indicators, Mode, Outcome, Source, Stats,
};
use treewright_figures::Colour;

use super::*;
use treewright_renderer::measure::{Measured, standings};
use treewright_renderer::space::{Preset, TuningSpace};
use treewright_renderer::statistics::{BreakEven, Ratio};
use treewright_renderer::tuning::results::{Milestone, Overhead, Prediction, SceneFacts};
use treewright_renderer::tuning::verdict::{Gains, crown};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::{
    disturbance::Disturbance, frame::FrameTimes, processes::Processes, tuning::objective::Objective,
    tuning::search::Iteration,
};

fn iteration(number: u32, render_ms: Option<f64>) -> Iteration {
    Iteration {
        number,
        trial: Some(format!("studies/test/trials/{number}")),
        mode: Mode::Explore.into(),
        source: Source::Daemon,
        reason: "the search goes on".into(),
        step: "reflect".into(),
        rule: None,
        configuration: Configuration::new().with("quality", 3),
        predicted_cost: None,
        outcome: if render_ms.is_some() { Outcome::Ok } else { Outcome::infeasible("depth limit") },
        times: render_ms.map(|render_ms| FrameTimes::of(20.0, render_ms)),
        cost: render_ms,
        waiting_ms: 0.5,
        total_ms: render_ms.unwrap_or(0.0) + 21.0,
    }
}

fn results(tuned_ms: f64, scene: &str) -> TuningResults {
    let measured = |who: Who, render_ms: f64| Measured {
        who,
        frames: vec![FrameTimes::of(20.0, render_ms); 9],
        ..Measured::default()
    };
    let side_by_side = [
        measured(Who::PaperDefault, 100.0),
        measured(NATIVE_DEFAULT, 55.0),
        measured(Who::UsedWell, 54.0),
        measured(Who::BestFixed, 52.0),
        measured(Who::Found, tuned_ms),
    ];
    let mut standings = standings(&side_by_side, 1000);
    let best = crown(&mut standings, &Who::BestFixed, false, |_| true);
    let space = TuningSpace::paper();
    let trials = vec![
        iteration(1, Some(100.0)),
        iteration(2, None),
        iteration(3, Some(900.0)),
        iteration(4, Some(tuned_ms)),
    ];
    let break_even = BreakEven {
        tuning_ms: 2500.0,
        frames_while_tuning: 3,
        tuned_setup_ms: 20.0,
        tuned_frame_ms: tuned_ms,
        default_setup_ms: 20.0,
        default_frame_ms: 100.0,
    };
    TuningResults {
        scene: SceneFacts {
            name: scene.into(),
            triangles: 1_234_567,
            meshes: 3,
            left_out: Vec::new(),
            notes: vec!["a texture was left out".into()],
        },
        size: [320, 240],
        frames_per_trial: 1,
        objective: Objective::Render,
        space: Preset::Paper,
        parameters: space.explained().collect(),
        start: space.default_configuration(),
        began_at: Who::BestFixed,
        milestones: vec![],
        baseline: Who::PaperDefault,
        server: "http://127.0.0.1:1".into(),
        study: "test-render".into(),
        machine: Fingerprint {
            cpu_model: "Test One".into(),
            isa: "avx2".into(),
            threads: 2,
            ..Fingerprint::default()
        },
        indicators: Indicators::new(),
        safety: None,
        overhead: Overhead::of(&trials),
        trials,
        confirmation: None,
        reference_ms: 100.0,
        found: Configuration::new().with("quality", 3),
        gains: Gains::of(&standings, &best, &Who::BestFixed),
        best,
        disturbance: Disturbance::default(),
        tuned: Configuration::new().with("quality", 3).with("branching_factor", 8).with("compact", false),
        standings,
        prediction: Some(Prediction {
            camera_at: 0.2,
            mode: Mode::Exploit.into(),
            reason: "nearest state".into(),
            configuration: Configuration::new().with("quality", 1),
            answer_ms: 0.8,
            standings: treewright_renderer::measure::standings(
                &[measured(Who::PaperDefault, 100.0), measured(Who::Predicted, 60.0)],
                1000,
            ),
        }),
        break_even,
        break_even_frame: break_even.frame(),
        client: Stats::default(),
        notes: vec![],
    }
}

fn grey() -> Picture {
    Picture { width: 4, height: 3, pixels: vec![Vec3::splat(0.3); 12] }
}

#[test]
fn a_gain_whose_interval_holds_none_is_not_told_as_one() {
    let page_of = |results: &TuningResults| page(results, &grey(), &grey()).expect("the page is made");
    for baseline in [NATIVE_DEFAULT, Who::PaperDefault] {
        let mut results = results(50.0, "hall");
        results.baseline = baseline;
        assert!(page_of(&results).contains("The tuned structure renders this scene "));
        // In three rounds of nine it was slow.
        let tuned = results.standings.iter_mut().find(|one| one.who == Who::Tuned).expect("it won");
        tuned.undelayed_ms[..3].fill(200.0);
        assert!(page_of(&results).contains("Too noisy to tell whether the tuned structure is faster than "));
    }
}

#[test]
fn the_page_says_what_was_measured() {
    let html = page(&results(50.0, "hall"), &grey(), &grey()).expect("the page is made");
    assert!(html.contains(
        "The tuned structure renders this scene 2.00× [2.00, 2.00] faster than the default of the paper."
    ));
    assert!(html.contains("1\u{2009}234\u{2009}567 triangles") && html.contains("Test One, 2 threads"));
    assert!(html.contains("1.10 times that of native Embree, 1.08 times that of native Embree used well"));
    assert!(html.contains("1.04 × [1.04, 1.04]"), "the gain over the best fixed configuration");
    for row in ["native used well", "best fixed configuration", "over best fixed"] {
        assert!(html.contains(row), "{row}");
    }
    assert!(html.contains("<mark>8</mark>"), "a changed parameter is marked");
    assert!(html.contains("1.67× faster"), "the prediction's speed-up");
    assert!(
        html.contains("a texture was left out") && html.contains("cannot")
            || html.contains("could not be built")
    );
    assert_eq!(html.matches("data:image/png;base64,").count(), 2);
    assert_eq!(html.matches("<svg").count(), 2);
    assert!(html.contains("4 trials ran 1 different configurations"));
}

#[test]
fn two_processes_are_told() {
    let page_of = |results: &TuningResults| page(results, &grey(), &grey()).expect("the page is made");
    let mut results = results(50.0, "hall");
    assert!(page_of(&results).contains("measured again after the search."));
    for one in &mut results.standings {
        one.processes = Some(Processes { rounds: [5, 4], spread: 0.01 });
    }
    assert!(page_of(&results).contains("measured again after the search in two processes."));
    assert!(page_of(&results).contains("renders this scene 2.00× [1.97, 2.03] faster"));
}

#[test]
fn a_stopped_trial_is_neither_measured_nor_failed() {
    let mut results = results(50.0, "hall");
    results.trials[1].outcome = Outcome::aborted(180.0);
    let html = page(&results, &grey(), &grey()).expect("the page is made");
    assert!(html.contains("One was stopped once it had cost too much."));
    assert!(
        html.contains("stopped: it would have cost more than this") && !html.contains("could not be built")
    );
}

#[test]
fn nothing_is_loaded_from_elsewhere() {
    let html = page(&results(50.0, "hall"), &grey(), &grey()).expect("the page is made");
    let links = html.replace("http://www.w3.org/2000/svg", "");
    assert!(!links.contains("http://") && !links.contains("https://") && !links.contains("<script"));
}

#[test]
fn names_from_files_cannot_become_markup() {
    let html = page(&results(50.0, "<img src=x>"), &grey(), &grey()).expect("the page is made");
    assert!(!html.contains("<img src=x>"));
}

#[test]
fn no_gain_is_told_as_none() {
    let mut none = results(101.0, "hall");
    none.prediction = None;
    none.break_even_frame = None;
    none.confirmation = Some(treewright_client::Standing {
        cost: 52.0,
        cost_low: 51.0,
        cost_high: 53.0,
        gain: None,
        nothing_better: true,
        confirmation: Confirmation {
            stage: ConfirmationStage::NothingBetter,
            rounds: 7,
            rounds_max: 10,
            measurements: 20,
            gain: None,
        },
        disturbances: 0,
        gain_at_most: Some(0.02),
    });
    let html = page(&none, &grey(), &grey()).expect("the page is made");
    assert!(
        html.contains("Nothing the search found is shown to be faster than the best fixed configuration")
    );
    assert!(html.contains("After: best fixed configuration") && !html.contains(">tuned<"));
    assert!(html.contains("does not pay for itself"));
    assert!(!html.contains("predicted for the other camera"));
    assert!(html.contains("The service says of its answer: ") && html.contains("at most 2.0 % with 95 %"));
}

#[test]
fn the_curve_names_its_lines() {
    let svg = chart::svg(&results(50.0, "hall"));
    for label in [
        "each trial of the search",
        "best answer (roofline)",
        "native Embree used well",
        "best fixed configuration",
        "first prediction, for the other camera",
        "could not be built",
    ] {
        assert!(svg.contains(label), "{label}");
    }
    let mut from_fixed = results(50.0, "hall");
    from_fixed.baseline = Who::BestFixed;
    let level = format!("stroke=\"{}\"><title>best fixed configuration</title>", Colour::Blue);
    assert!(svg.contains(&level) && !chart::svg(&from_fixed).contains(&level), "it is the baseline");
    let mut short = results(50.0, "hall");
    short.trials.clear();
    assert!(chart::svg(&short).contains("<svg"), "an interrupted search has a curve, too");
}

#[test]
fn the_way_and_the_whole_session_are_told_from_where_the_search_began() {
    let mut results = results(40.0, "hall");
    results.began_at = NATIVE_DEFAULT;
    results.baseline = NATIVE_DEFAULT;
    results.gains = Gains::of(&results.standings, &results.best, &NATIVE_DEFAULT);
    let configuration = |quality: i64| Configuration::new().with("quality", quality);
    let way = |trials, quality, low| Milestone {
        trials,
        configuration: configuration(quality),
        over_start: Some(Ratio { median: low + 0.02, interval: Some([low, low + 0.04]), count: 21 }),
    };
    results.milestones = vec![way(1, 1, 0.98), way(2, 2, 1.12), way(4, 2, 1.12), way(8, 3, 1.33)];
    let until: Vec<_> = [1.0, 1.1, 1.3, 1.4].map(|factor| results.trials_until(factor)).into();
    assert_eq!(until, [Some(2), Some(2), Some(8), None]);
    let spent = "1.1 × after frame 1 (0.1 s), 1.2 × after frame 3 (1.1 s), 1.3 × after frame 3 (1.1 s)";
    assert_eq!(parts::until(&results).as_deref(), Some(spent));
    assert!(page(&results, &grey(), &grey()).is_ok_and(|html| html.contains(spent)));
    // A gain that is lost again was not reached.
    results.milestones.push(way(16, 4, 1.05));
    assert_eq!(results.trials_until(1.1), None);
    assert_eq!(parts::on_the_way(&results).iter().map(|row| row.trials).collect::<Vec<_>>(), [1, 2, 8, 16]);
    let html = page(&results, &grey(), &grey()).expect("the page is made");
    for text in [
        "The best over native Embree, where the search began: 1.37 ×",
        "How soon it was better",
        "1.35 × [1.33, 1.37]",
    ] {
        assert!(html.contains(text), "{text}");
    }
    // Three trials that showed a frame and one that could not be built took 121 + 21 + 921 + 61 ms.
    let curve = session::curve(&results);
    assert_eq!(curve[0], (1.0, 121.0 / 120.0));
    assert_eq!(curve[2], (3.0, 1124.0 / 320.0));
    let last = curve.last().expect("it goes on");
    assert!(last.1 < 1.0, "past break-even the session costs less than its start: {last:?}");
    assert_eq!(session::ratio_at(&results, 1.0), Some(curve[0].1));
    let between = session::ratio_at(&results, 2.5).expect("it is on the curve");
    assert!((between - (curve[1].1 + curve[2].1) / 2.0).abs() < 1e-9, "{between}");
    assert_eq!(session::ratio_at(&results, last.0 + 1.0), None, "the curve ends");
}

#[test]
fn frames_that_cost_more_than_the_start_are_told() {
    let mut results = results(50.0, "hall");
    // By the rounds the start takes 52 of the baseline's 100 ms, and no trial ran it.
    assert!(results.start_ms().is_some_and(|start_ms| (start_ms - 52.0).abs() < 0.1));
    results.trials[1].outcome = Outcome::aborted(60.0);
    results.trials[2].times = Some(FrameTimes { frames: Some(0), ..FrameTimes::of(20.0, 900.0) });
    let results = results.judged();
    let safety = results.safety.expect("four frames ran");
    assert_eq!((safety.frames, safety.dear), (4, 3), "the stopped one and the known one, too");
    assert!((safety.worst - 900.0 / 52.0).abs() < 0.1, "{safety:?}");
    let html = page(&results, &grey(), &grey()).expect("the page is made");
    assert!(html.contains(
        "In the search 3 of 4 frames (75 %) cost more than 1.1 times the best fixed configuration"
    ));
    // Where trials ran the start often enough, its cost is theirs.
    let start = results.start.clone();
    let ran = results.trials.iter().map(|trial| Iteration { configuration: start.clone(), ..trial.clone() });
    let ran = TuningResults { trials: ran.collect(), ..results }.judged();
    assert_eq!(ran.start_ms(), Some(100.0));
    assert_eq!(ran.safety.map(|safety| safety.dear), Some(1));
}
