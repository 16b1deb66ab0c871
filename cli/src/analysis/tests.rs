//! Analyses of trials whose costs follow from their parameters in known ways.

use treewright_client::{
    Configuration, Indicators, Measurements, Mode, OpenEnum, Outcome, Scale, Space, SpaceBuilder, StudySpec,
    TrialRecord, TrialState, Value,
};
use treewright_figures::Colour;

use super::*;

fn space() -> Space {
    let space = SpaceBuilder::new().integer("steep", 0..=7).default(0).integer("bowl", 1..=64).default(1);
    let space = space.boolean("idle").default(false).categorical("kind", ["a", "b", "c"]).default("a");
    space.build().expect("a sound space")
}

fn spec() -> StudySpec {
    let spec = StudySpec::builder(space()).indicator("size", 0.0..=9.0, Scale::Linear).minimise("ms", 1.0);
    spec.build().expect("sound")
}

/// A trial as the service would tell it.
pub(crate) fn trial(
    number: u64,
    state: i64,
    values: [i64; 2],
    idle: bool,
    kind: &str,
    ms: f64,
) -> TrialRecord {
    let configuration = Configuration::new().with("steep", values[0]).with("bowl", values[1]);
    let configuration = configuration.with("idle", idle).with("kind", Value::from(kind));
    TrialRecord {
        name: format!("studies/toy/trials/{number}"),
        client_id: "test".into(),
        state_id: state,
        indicators: Indicators::new().with("size", state as f64),
        configuration,
        unreadable: Vec::new(),
        mode: OpenEnum::Known(Mode::Pinned),
        predicted_cost: None,
        reason: treewright_client::Reason::default(),
        lease_expire_time: None,
        state: OpenEnum::Known(TrialState::Completed),
        measurements: Measurements::new().with("ms", ms).with("sample", number as f64),
        standard_errors: Measurements::new(),
        cost: Some(ms),
        outcome: Some(OpenEnum::Known(Outcome::Ok)),
        late: false,
        create_time: None,
        complete_time: None,
        fingerprint: None,
        abort_above: None,
        origin: None,
        fidelity: None,
        exclusion: None,
    }
}

/// A thousand samples in two states, one of them ten times as dear: `steep` rises, `bowl` is least in the
/// middle, `idle` means nothing, and `kind` matters only together with `steep`.
fn trials() -> Vec<TrialRecord> {
    let mut seed = 1_u64;
    let mut random = |count: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) % count
    };
    (0..1000)
        .map(|number| {
            let (steep, bowl) = (random(8) as i64, 1 + random(64) as i64);
            let (idle, kind) = (random(2) == 1, ["a", "b", "c"][random(3) as usize]);
            let state = 1 + (number % 2) as i64;
            let level = if state == 1 { 1.0 } else { 10.0 };
            let distance = (bowl - 32) as f64 / 32.0;
            let noise = 1.0 + 0.02 * (random(1000) as f64 / 1000.0 - 0.5);
            let ms = level * (1.0 + 0.1 * steep as f64) * (1.0 + distance * distance) * noise;
            trial(number, state, [steep, bowl], idle, kind, ms)
        })
        .collect()
}

fn analysed(trials: &[TrialRecord]) -> Analysis {
    let request =
        Request { study: "toy".into(), metrics: Vec::new(), maps: vec![("steep".into(), "bowl".into())] };
    analyse(&spec(), &request, trials, &[])
}

/// Those trials in a study that maximises a rate, which is a thousand over their milliseconds.
fn rates() -> Analysis {
    let space = spec().space;
    let spec = StudySpec::builder(space).maximise("rate", 1.0).build().expect("sound");
    let mut trials = trials();
    for trial in &mut trials {
        let rate = 1000.0 / trial.cost.expect("it was measured");
        trial.measurements = Measurements::new().with("rate", rate).with("sample", 1.0);
        trial.cost = Some(1.0 / rate);
    }
    let maps = vec![("steep".into(), "bowl".into())];
    let request = Request { study: "toy".into(), metrics: vec!["cost".into()], maps };
    analyse(&spec, &request, &trials, &[])
}

#[test]
fn what_is_maximised_is_told_by_its_value_and_held_to_where_it_is_high() {
    let (times, rates) = (analysed(&trials()), rates());
    let metric = &rates.conditions[0].metrics[0];
    assert_eq!((metric.name.as_str(), metric.higher_is_better), ("rate", true));
    assert!((25.0..1000.0).contains(&metric.median), "{} is no rate of 1 to 40 ms", metric.median);
    assert!(influence(&rates, "steep").correlation.expect("it has an order").r < -0.5);
    let narrowed = &rates.objectives[0];
    assert_eq!(narrowed.arguments, times.objectives[0].arguments, "equal trials are the best");
    assert!(narrowed.whole.best > narrowed.whole.median && narrowed.whole.median > narrowed.whole.dear);
    assert!(narrowed.part.worst > narrowed.whole.worst && narrowed.part.median > narrowed.whole.median);
    let words = rates.words();
    assert!(words.contains("rate (higher is better)") && words.contains("for more rate"), "{words}");
    let page = html(&rates);
    assert!(page.contains("1 in 10 below") && !page.contains("1 in 10 above"));
    let map = &rates.maps[0];
    let high = map.cells.iter().map(|cell| cell.relative).fold(0.0, f64::max);
    assert!(page.contains(&format!("from blue: {high:.2}, to orange: 0.")), "the best is blue");
}

fn influence<'a>(analysis: &'a Analysis, name: &str) -> &'a Influence {
    let all = &analysis.conditions[0].metrics[0].parameters;
    all.iter().find(|one| one.parameter == name).expect("it varies")
}

#[test]
fn each_measure_sees_what_it_should() {
    let analysis = analysed(&trials());
    assert_eq!((analysis.trials, analysis.states, analysis.random), (1000, 2, true));
    let [steep, bowl, idle] = ["steep", "bowl", "idle"].map(|name| influence(&analysis, name));
    let r = [steep, bowl, idle].map(|one| one.correlation.expect("it has an order").r);
    assert!(r[0] > 0.5 && r[1].abs() < 0.15 && r[2].abs() < 0.1, "{r:?}");
    let share = |one: &Influence| one.first_order.expect("enough configurations");
    assert!(share(bowl) > 0.3, "variance sees the bowl that no line fits: {}", share(bowl));
    assert!(bowl.mutual_information_bits > 0.1 && idle.mutual_information_bits < 0.02);
    assert!(share(idle) < 0.01 && share(steep) + share(bowl) > 0.85);
    assert_eq!(influence(&analysis, "kind").correlation, None, "it has no order");
    let interval = steep.correlation.expect("it has an order").interval;
    assert!(interval[0] < r[0] && r[0] < interval[1] && interval[1] - interval[0] < 0.1);
}

#[test]
fn what_matters_only_together_is_a_pair() {
    let mut trials = trials();
    for (number, trial) in trials.iter_mut().enumerate() {
        // Alone neither says anything.
        let steep = trial.configuration.integer("steep").expect("there is one") >= 4;
        let idle = trial.configuration.get("idle") == Some(&Value::Boolean(true));
        let ms = if steep == idle { 2.0 } else { 1.0 } + 0.001 * (number % 7) as f64;
        trial.measurements = Measurements::new().with("ms", ms);
    }
    let analysis = analysed(&trials);
    assert!(!analysis.random, "without a number they are not known to be drawn at random");
    let pair = &analysis.conditions[0].metrics[0].pairs[0];
    let mut names = pair.parameters.clone();
    names.sort();
    assert_eq!(names, ["idle", "steep"]);
    assert!(pair.interaction > 0.8, "{}", pair.interaction);
}

#[test]
fn narrowing_keeps_what_is_good_and_says_so_by_other_trials() {
    let analysis = analysed(&trials());
    let narrowed = &analysis.objectives[0];
    let names: Vec<&str> = narrowed.narrowed.iter().map(|held| held.parameter.as_str()).collect();
    assert!(names.contains(&"steep") && names.contains(&"bowl"), "{names:?}");
    assert!(!names.contains(&"idle") && !names.contains(&"kind"), "{names:?}");
    assert!(narrowed.arguments.contains("--range steep=0.."), "{}", narrowed.arguments);
    assert!(narrowed.part.trials > 20 && narrowed.part.worst < 0.8 * narrowed.whole.worst);
    assert!(narrowed.part.median < narrowed.whole.median && narrowed.part.best < 1.05 * narrowed.whole.best);
}

#[test]
fn the_same_trials_give_the_same_bytes_and_a_page() {
    let (once, again) = (analysed(&trials()), analysed(&trials()));
    assert_eq!(serde_json::to_string(&once).expect("JSON"), serde_json::to_string(&again).expect("JSON"));
    let page = html(&once);
    assert_eq!(page, html(&again));
    assert!(page.contains("prefers-color-scheme:dark") && page.contains("<svg") && !page.contains("NaN"));
    assert!(page.contains("--range steep=0.."));
    let map = &once.maps[0];
    assert_eq!((map.edges[0].len(), map.edges[1].len()), (9, 17));
    assert_eq!(map.cells.iter().map(|cell| cell.trials).sum::<usize>(), 1000);
}

#[test]
fn a_single_bad_cell_does_not_make_all_others_alike() {
    let mut analysis = analysed(&trials());
    analysis.maps[0].cells[5].relative = 1e6;
    let (page, blue) = (html(&analysis), Colour::Scale(0.0).to_string());
    let alike = page.split("<rect").filter(|cell| cell.contains(" trials: ") && cell.contains(&blue)).count();
    assert!((1..20).contains(&alike), "{alike} of {} cells", analysis.maps[0].cells.len());
}

#[test]
fn few_or_equal_trials_say_nothing_and_break_nothing() {
    for count in [0, 1, 3] {
        let analysis = analysed(&trials()[..count]);
        let text = serde_json::to_string(&analysis).expect("JSON");
        assert!(!text.contains("null,null"), "{text}");
        html(&analysis);
    }
    let equal: Vec<TrialRecord> = (0..50).map(|number| trial(number, 1, [1, 1], false, "a", 2.0)).collect();
    let analysis = analysed(&equal);
    assert!(analysis.conditions[0].metrics[0].parameters.is_empty());
    assert!(analysis.objectives[0].narrowed.is_empty());
}

#[test]
fn few_trials_of_one_state_do_not_explain_each_other() {
    // Costs that depend on nothing, but for one configuration that is run again and again and always dear.
    let few: Vec<TrialRecord> = trials().into_iter().filter(|trial| trial.state_id == 1).take(24).collect();
    let mut all: Vec<TrialRecord> = Vec::new();
    for (index, mut one) in few.into_iter().enumerate() {
        let repeats = if index == 5 { 12 } else { 1 };
        let ms = if index == 5 { 900.0 } else { 1.0 + 0.01 * ((index * 7) % 5) as f64 };
        one.measurements = Measurements::new().with("ms", ms);
        one.cost = Some(ms);
        all.extend(std::iter::repeat_n(one, repeats));
    }
    let analysis = analysed(&all);
    assert_eq!((analysis.trials, analysis.configurations), (35, 24));
    for one in &analysis.conditions[0].metrics[0].parameters {
        assert!(one.first_order.is_some_and(|share| share < 0.2), "{one:?}");
    }
    assert!(analysis.words().contains("Too few trials: 24 different"), "{}", analysis.words());
    let fewer = analysed(&all[..19]);
    let parameters = &fewer.conditions[0].metrics[0].parameters;
    assert!(parameters.iter().all(|one| one.first_order.is_none()), "{parameters:?}");
}
