//! Tests of objectives: their limits, their stored forms, and costs as weighted sums.

use super::*;

fn term(metric: &str, weight: f64) -> ObjectiveTerm {
    ObjectiveTerm { metric: metric.into(), weight }
}

#[test]
fn the_cost_is_the_weighted_sum() {
    let objective = Objective::new(vec![term("build_ms", 1.0 / 4.0), term("render_ms", 1.0)]).expect("valid");
    let mut measurements = BTreeMap::from([("build_ms".to_owned(), 8.0), ("render_ms".to_owned(), 3.0)]);
    assert_eq!(objective.cost(&measurements), Ok(5.0));
    measurements.insert("render_ms".into(), f64::NAN);
    let problem =
        |measurements: &BTreeMap<String, f64>| objective.cost(measurements).expect_err("no cost").to_string();
    assert!(problem(&measurements).contains("\"render_ms\" is NaN; it must be finite"));
    measurements.insert("render_ms".into(), f64::MAX);
    measurements.insert("build_ms".into(), f64::MAX);
    assert!(problem(&measurements).contains("sum of the measurements is not finite"));
    measurements.remove("build_ms");
    assert!(problem(&measurements).contains("\"build_ms\" is missing"));
}

#[test]
fn what_is_maximised_costs_its_reciprocal() {
    let plain = Objective::new(vec![term("build_ms", 0.5), term("fps", 1000.0)]).expect("valid");
    for wrong in [vec!["frames"], vec!["fps", "fps"]] {
        let wrong = wrong.into_iter().map(str::to_owned).collect();
        let refused = plain.clone().with_maximised(wrong).expect_err("no such term").to_string();
        assert!(refused.contains("is to be maximised; name it once"), "{refused}");
    }
    let both = plain.clone().with_maximised(vec!["fps".to_owned()]).expect("valid");
    let measured = |fps: f64| BTreeMap::from([("build_ms".to_owned(), 8.0), ("fps".to_owned(), fps)]);
    assert_eq!(both.cost(&measured(50.0)), Ok(24.0));
    assert_eq!(both.cost(&measured(100.0)), Ok(14.0), "more is better");
    for wrong in [0.0, 1e-320] {
        let refused = both.cost(&measured(wrong)).expect_err("no reciprocal").to_string();
        assert!(refused.contains("what is maximised must be above 0"), "{wrong}: {refused}");
    }
    assert_eq!(both.view(), CostView::default(), "it is not alone");
    assert_eq!(both.to_string(), "minimises 0.5 × build_ms + 1000 / fps");
    let one = Objective::new(vec![term("fps", 1000.0)]).expect("valid");
    assert_eq!(one.view(), CostView::default(), "it is minimised");
    let one = one.with_maximised(vec!["fps".to_owned()]).expect("valid");
    assert_eq!((one.to_string().as_str(), one.view().value(20.0)), ("maximises fps", 50.0));
    let text = serde_json::to_string(&one).expect("plain data");
    assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), one);
    // A version without maximised metrics finds no terms, and so cannot minimise them.
    assert!(!text.contains("\"terms\""), "{text}");
    let older = text.replace("directed_terms", "terms");
    assert_eq!(serde_json::from_str::<Objective>(&older).expect("an earlier form"), one);
}

#[test]
fn trials_of_several_frames_are_checked_stored_and_told() {
    let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
    let text = |objective: &Objective| serde_json::to_string(objective).expect("plain data");
    for wrong in [0, EPISODE_FRAMES_MAX + 1] {
        let refused = plain.clone().with_episode_frames(wrong).expect_err("out of range").to_string();
        assert_eq!(refused, format!("episode_frames is {wrong}; give 1 to 64"));
    }
    let one = plain.clone().with_episode_frames(1).expect("valid");
    assert_eq!(text(&one), r#"[{"metric":"render_ms","weight":1.0}]"#, "as ever");
    let many = plain.with_episode_frames(EPISODE_FRAMES_MAX).expect("valid");
    assert_eq!(many.to_string(), "minimises 1 × render_ms, the mean of 64 frames");
    assert_eq!(serde_json::from_str::<Objective>(&text(&many)).expect("its own form"), many);
    // A version that knows no episodes finds no terms, and so cannot take a frame for a trial.
    assert!(!text(&many).contains("\"terms\""), "{}", text(&many));
    assert!(serde_json::from_str::<Objective>(&text(&many).replace("64", "65")).is_err());
}

#[test]
fn bad_terms_are_refused() {
    for terms in [
        vec![],
        vec![term("a", 1.0); 2],
        vec![term("A", 1.0)],
        vec![term("a", 0.0)],
        vec![term("a", f64::INFINITY)],
        (0..17).map(|i| term(&format!("m{i}"), 1.0)).collect(),
    ] {
        assert!(Objective::new(terms).is_err());
    }
    assert!(serde_json::from_str::<Objective>(r#"[{"metric":"a","weight":-1.0}]"#).is_err());
}

#[test]
fn limits_are_checked_stored_and_told() {
    let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
    let limit =
        |metric: &str, at_least, at_most| MeasurementLimit { metric: metric.into(), at_least, at_most };
    for wrong in [
        vec![limit("no name", None, Some(1.0))],
        vec![limit("a", None, None)],
        vec![limit("a", Some(2.0), Some(1.0))],
        vec![limit("a", None, Some(f64::NAN))],
        vec![limit("a", None, Some(1.0)), limit("a", Some(0.0), None)],
        (0..17).map(|i| limit(&format!("m{i}"), Some(0.0), None)).collect(),
    ] {
        assert!(plain.clone().with_limits(wrong.clone()).is_err(), "{wrong:?}");
    }
    let limits = vec![limit("memory_mb", None, Some(2000.0)), limit("psnr_db", Some(30.0), Some(90.0))];
    let both = plain.clone().with_limits(limits).expect("valid");
    let beyond = |memory_mb: f64, psnr_db: f64| {
        let measured = [("memory_mb", memory_mb), ("psnr_db", psnr_db)];
        both.beyond(&measured.map(|(name, value)| (name.to_owned(), value)).into())
    };
    assert_eq!(beyond(2000.0, 30.0), Ok(None));
    let message = beyond(2300.0, 31.0).expect("it is there").expect("too much");
    assert_eq!(message, "memory_mb is 2300, and the study asks for memory_mb <= 2000");
    let message = beyond(1.0, 91.0).expect("it is there").expect("too much");
    assert!(message.contains("30 <= psnr_db <= 90"), "{message}");
    let missing = both.beyond(&BTreeMap::from([("memory_mb".to_owned(), 1.0)])).expect_err("no psnr");
    assert!(missing.to_string().contains("\"psnr_db\" is missing"), "{missing}");
    assert_eq!(plain.beyond(&BTreeMap::new()), Ok(None));
    let text = serde_json::to_string(&both).expect("plain data");
    assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), both);
    let before = r#"{"terms":[{"metric":"render_ms","weight":1.0}],"auxiliary":["nodes"]}"#;
    assert!(serde_json::from_str::<Objective>(before).expect("an earlier form").limits().is_empty());
}

#[test]
fn fidelities_are_stored_only_where_there_are_some() {
    let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
    let none = plain.clone().with_fidelities(Vec::new()).expect("none is fine");
    assert_eq!(serde_json::to_string(&none).ok(), serde_json::to_string(&plain).ok());
    let level = |name: &str, cost| Fidelity { name: name.to_owned(), cost };
    assert!(plain.clone().with_fidelities(vec![level("16", 1.5)]).is_err());
    let fidelities = vec![level("16", 0.125), level("64", 0.5)];
    let some = plain.with_fidelities(fidelities.clone()).expect("valid");
    let long = some.clone().with_episode_frames(24).expect("valid");
    let maximised = some.clone().with_maximised(vec!["render_ms".to_owned()]).expect("valid");
    for objective in [some, long, maximised] {
        let text = serde_json::to_string(&objective).expect("plain data");
        // A version that knows no levels finds no terms, and so cannot take a cheaper trial for a full one.
        assert!(!text.contains("\"terms\""), "{text}");
        let again: Objective = serde_json::from_str(&text).expect("its own form");
        assert_eq!((again.fidelities(), &again), (&fidelities[..], &objective));
    }
}

#[test]
fn auxiliary_metrics_are_checked_and_stored() {
    let plain = Objective::new(vec![term("render_ms", 1.0)]).expect("valid");
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let with = |given: &[&str]| plain.clone().with_auxiliary(names(given));
    assert!(with(&["render_ms"]).is_err() && with(&["cpu", "cpu"]).is_err() && with(&["no name"]).is_err());
    assert!(with(&["a", "b", "c", "d", "e", "f", "g", "h", "i"]).is_err());
    let both = with(&["render_cpu_ms", "nodes"]).expect("valid");
    let measured = |pairs: &[(&str, f64)]| -> BTreeMap<String, f64> {
        pairs.iter().map(|&(name, value)| (name.to_owned(), value)).collect()
    };
    let whole = measured(&[("render_ms", 3.0), ("nodes", 7.0), ("render_cpu_ms", 5.0)]);
    assert_eq!(both.auxiliary_of(&whole), Some(vec![5.0, 7.0]));
    assert_eq!(both.cost(&whole), Ok(3.0));
    assert_eq!(both.auxiliary_of(&measured(&[("nodes", 7.0)])), None);
    assert_eq!(both.auxiliary_of(&measured(&[("nodes", 7.0), ("render_cpu_ms", 0.0)])), None);
    assert_eq!(plain.auxiliary_of(&whole), None);
    for objective in [plain.clone(), both] {
        let text = serde_json::to_string(&objective).expect("plain data");
        assert_eq!(serde_json::from_str::<Objective>(&text).expect("its own form"), objective);
    }
    let old = r#"[{"metric":"render_ms","weight":1.0}]"#;
    assert_eq!(serde_json::from_str::<Objective>(old).expect("an earlier form"), plain);
}

#[test]
fn standard_errors_of_measurements_are_propagated_to_the_cost() {
    let plain = Objective::new(vec![term("build_ms", 0.5), term("render_ms", 2.0)]).expect("valid");
    let mixed = plain.clone().with_maximised(vec!["render_ms".to_owned()]).expect("valid");
    let named = |build: f64, render: f64| -> BTreeMap<String, f64> {
        [("build_ms".to_owned(), build), ("render_ms".to_owned(), render)].into()
    };
    // 0.5 x 8 + 2 x 3 = 10, whose errors are 3 and 4.
    assert_eq!(plain.relative_error(&named(8.0, 3.0), &named(6.0, 2.0)), 0.5);
    // 0.5 x 8 + 2 / 0.5 = 8, whose errors are 0 and a quarter of 4.
    assert_eq!(mixed.relative_error(&named(8.0, 0.5), &named(0.0, 0.125)), 0.125);
    assert_eq!(plain.relative_error(&named(8.0, 3.0), &BTreeMap::new()), 0.0);
    assert_eq!(plain.relative_error(&named(8.0, 3.0), &[("other".to_owned(), 1.0)].into()), 0.0);
    assert_eq!(plain.relative_error(&named(0.0, 0.0), &named(1.0, 1.0)), 0.0, "there is no share of nothing");
    assert_eq!(plain.relative_error(&BTreeMap::new(), &named(1.0, 1.0)), 0.0, "there is no cost");
    assert_eq!(plain.relative_error(&named(8.0, 1e-300), &named(f64::MAX, f64::MAX)), f64::MAX);
}
