//! The code that follows from the table is complete and fits together.

use super::*;
use crate::assignment::Assignment;
use crate::words::OpenEnum;

#[test]
fn what_holds_where_nothing_is_said_is_what_the_table_says() {
    let decided = PolicySettings::new().decide().expect("defaults");
    assert_eq!(decided, RawPolicy::default());
    let said = PolicySettings::from(decided.clone());
    for field in PolicySettings::FIELDS {
        let mut read = PolicySettings::new();
        match said.show(field.name) {
            Some(shown) => {
                assert_eq!(shown, field.unset, "{}", field.name);
                read.set_text(field.name, &shown).expect("what is shown can be read");
                assert_eq!(read.show(field.name), Some(shown), "{}", field.name);
            }
            // The default then turns a feature off, and only words describe it.
            None => assert!(read.set_text(field.name, field.unset).is_err(), "{}", field.name),
        }
    }
    assert!(said.check().is_ok(), "defaults lie within their ranges");
    assert_eq!(PolicySettings::from(said.decide().expect("known words")), PolicySettings::from(decided));
}

#[test]
fn every_field_is_set_replaced_and_unset_by_its_name() {
    let other = |field: &PolicyField| match field.name {
        "pinned" => "a=1".to_owned(),
        _ => match (field.range, (field.words)().last()) {
            (_, Some(word)) => (*word).to_owned(),
            (Range::Within(_, most) | Range::Above(_, most), _) => most.to_string(),
            (Range::Any, None) => (field.unset != "true").to_string(),
        },
    };
    for field in PolicySettings::FIELDS {
        let mut said = PolicySettings::new();
        said.set_text(field.name, &other(field)).expect("a value of the field");
        assert!(said.check().is_ok(), "{}", field.name);
        assert_eq!(PolicyChange::set(said.clone()).paths(), [format!("policy.{}", field.name)]);
        let given = said.clone().decide().expect("known words");
        assert_ne!(given, RawPolicy::default(), "{}", field.name);
        let mut policy = RawPolicy::default();
        policy.replace_field(field.name, &given).expect("a field");
        assert_eq!(policy, given, "{}", field.name);
        said.unset(field.name);
        assert_eq!(said, PolicySettings::new());
        assert!(!field.about.trim().is_empty());
    }
    let error = RawPolicy::default().replace_field("colour", &RawPolicy::default());
    assert!(error.expect_err("no field").to_string().contains("there are epsilon, search"));
}

#[test]
fn what_is_pinned_is_read_as_it_is_shown() {
    let pinned = Assignment::new().with("level", 3).with("rate", 2.0).with("long", true);
    let texts =
        ["plain", "a,b=1", "12", "true", "1e3", " wide ", "", "\"", "\"12\"", r"c:\d", r"\", r#"a\",b"#];
    for text in texts {
        let said = PolicySettings::new().pinned(pinned.clone().with("mode", text));
        let shown = said.show("pinned").expect("it is set");
        let mut read = PolicySettings::new();
        read.set_text("pinned", &shown).expect("what is shown can be read");
        assert_eq!(read, said, "{shown}");
    }
    let said = PolicySettings::new().pinned(Assignment::new().with("mode", "fast").with("name", "a,b"));
    assert_eq!(said.show("pinned").as_deref(), Some(r#"mode=fast,name="a,b""#));
    assert!(PolicySettings::new().set_text("pinned", "level=3,4").is_err(), "a part has no name");
}

#[test]
fn a_change_names_only_what_changes() {
    let new = PolicySettings::new;
    let change = PolicyChange::set(new().epsilon(0.0).lease_s(5));
    assert_eq!(change.paths(), ["policy.epsilon", "policy.lease_s"]);
    assert_eq!(PolicyChange::unpin().paths(), ["policy.pinned"]);
    let set = new().epsilon(0.5).regret_budget(0.05);
    let change = PolicyChange { clear: vec!["regret_budget".into()], set };
    assert_eq!(change.paths(), ["policy.epsilon", "policy.regret_budget"]);
    assert_eq!((change.values().epsilon, change.values().regret_budget), (Some(0.5), None));
    assert!(PolicyChange::default().paths().is_empty());
}

#[test]
fn numbers_out_of_range_are_named_with_it() {
    let new = PolicySettings::new;
    for bad in [
        new().epsilon(f64::NAN),
        new().regret_budget(1.5),
        new().abort_above(1.0),
        new().worst_factor(f64::INFINITY),
        new().warm_up(10_001),
        new().trials_per_state(0),
    ] {
        assert!(bad.check().is_err(), "{bad:?}");
        assert!(bad.decide().expect("known words").check_ranges().is_err());
    }
    let error = new().lease_s(0).check().expect_err("0 seconds").to_string();
    assert_eq!(error, "policy.lease_s is 0; it must be between 1 and 86400");
    let error = new().abort_above(1.0).check().expect_err("not above").to_string();
    assert_eq!(error, "policy.abort_above is 1; it must be above 1 and at most 1000000");
}

#[test]
fn what_another_version_says_is_carried_and_not_decided_by() {
    let newer = PolicySettings { predictor: Some(OpenEnum::Unrecognised(8)), ..PolicySettings::new() };
    assert!(newer.check().is_ok());
    assert_eq!(newer.show("predictor").as_deref(), Some("unrecognised (8)"));
    let error = newer.decide().expect_err("nobody knows it").to_string();
    assert!(error.starts_with("policy.predictor: 8 is not a known value; known are auto, "), "{error}");
}
