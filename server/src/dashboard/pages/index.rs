//! A row of the list of studies, and its form in JSON, which one dashboard sends another.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use treewright_core::ids::StudyUid;
use treewright_core::limits::TAGS_MAX;
use treewright_core::standing::Gain;

use crate::convert::names;

/// Longest text that is taken from another dashboard, in characters.
const TEXT: usize = 200;

/// A study in the list of studies, of this daemon or of another. Times are text that sorts, in UTC.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct IndexRow {
    pub(super) id: String,
    pub(super) uid: String,
    pub(super) what: String,
    pub(super) tags: Vec<String>,
    pub(super) status: String,
    /// The gain over the default in the study's view; `None` where that is not known.
    pub(super) gain: Option<Gain>,
    pub(super) gain_note: String,
    pub(super) states: i64,
    pub(super) trials: i64,
    pub(super) completed: i64,
    pub(super) open: i64,
    pub(super) last: String,
    pub(super) created: String,
    /// The address of the replica that holds the study, where that is another than the daemon that answers.
    pub(super) holder: String,
}

impl IndexRow {
    pub(super) fn to_json(&self) -> Value {
        let gain = self.gain.map(|gain| json!({ "share": gain.share, "low": gain.low, "high": gain.high }));
        json!({
            "id": self.id,
            "uid": self.uid,
            "description": self.what,
            "tags": self.tags,
            "status": self.status,
            "gain": gain,
            "gain_note": self.gain_note,
            "states": self.states,
            "trials": self.trials,
            "completed": self.completed,
            "open": self.open,
            "last_activity": self.last,
            "created": self.created,
            "holder": self.holder,
        })
    }

    /// Reads a row from another dashboard; `None` where it names no study.
    pub(super) fn of_json(told: &Value) -> Option<Self> {
        let cut = |text: &str| text.chars().take(TEXT).collect::<String>();
        let text = |name: &str| cut(told[name].as_str().unwrap_or_default());
        let tags = told["tags"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let count = |name: &str| told[name].as_i64().unwrap_or_default().max(0);
        let end = |name: &str| told["gain"][name].as_f64();
        let gain = |share| Gain { share, low: end("low"), high: end("high"), probability_better: None };
        Some(Self {
            id: names::study_id("id", told["id"].as_str()?).ok()?,
            uid: told["uid"].as_str()?.parse::<StudyUid>().ok()?.to_string(),
            what: text("description"),
            tags: tags.take(TAGS_MAX).map(cut).collect(),
            status: text("status"),
            gain: end("share").map(gain),
            gain_note: text("gain_note"),
            states: count("states"),
            trials: count("trials"),
            completed: count("completed"),
            open: count("open"),
            last: text("last_activity"),
            created: text("created"),
            holder: text("holder"),
        })
    }
}

/// Keeps a study that is held elsewhere only where no row comes from its holder, and once.
pub(super) fn unite<T>(rows: &mut Vec<T>, row: impl Fn(&T) -> &IndexRow) {
    let held = rows.iter().map(&row).filter(|row| row.holder.is_empty());
    let mut seen: BTreeSet<String> = held.map(|row| row.uid.clone()).collect();
    rows.retain(|one| {
        let one = row(one);
        one.holder.is_empty() || seen.insert(one.uid.clone())
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> IndexRow {
        let (low, high) = (None, Some(0.3));
        IndexRow {
            id: "hall".to_owned(),
            uid: "0000000000000abc".to_owned(),
            what: "<b>".to_owned(),
            tags: vec!["gpu".to_owned(), "层".to_owned()],
            status: "searching".to_owned(),
            gain: Some(Gain { share: 0.1, low, high, probability_better: None }),
            gain_note: "below the default, proven better".to_owned(),
            states: 1,
            trials: 20_000,
            completed: 19_990,
            open: 3,
            last: "2026-01-31 10:00:00".to_owned(),
            created: "2026-01-30 10:00:00".to_owned(),
            holder: String::new(),
        }
    }

    #[test]
    fn what_one_dashboard_tells_another_reads() {
        for row in [row(), IndexRow { gain: None, holder: "http://10.0.0.7:50611".to_owned(), ..row() }] {
            let text = row.to_json().to_string();
            let told: Value = serde_json::from_str(&text).expect("JSON");
            assert_eq!(IndexRow::of_json(&told), Some(row), "{text}");
        }
    }

    #[test]
    fn what_is_no_study_is_not_read_and_long_texts_are_cut() {
        let with = |name: &str, value: Value| {
            let mut told = row().to_json();
            told[name] = value;
            IndexRow::of_json(&told)
        };
        assert!(with("id", json!("../login")).is_none() && with("uid", json!("x")).is_none());
        assert!(IndexRow::of_json(&json!({})).is_none() && IndexRow::of_json(&json!([1])).is_none());
        let long = with("description", json!("ä".repeat(500))).expect("a study");
        assert_eq!(long.what.chars().count(), TEXT);
        let many = with("tags", json!(vec!["x"; 500])).expect("a study");
        assert_eq!(many.tags.len(), TAGS_MAX);
        assert!(with("tags", json!(7)).expect("an older daemon's").tags.is_empty());
        assert_eq!(with("trials", json!(-4)).expect("a study").trials, 0);
    }

    #[test]
    fn a_study_of_a_shared_database_is_listed_once_and_by_its_holder() {
        let held = || IndexRow { holder: "http://10.0.0.7:50611".to_owned(), ..row() };
        let mut rows = vec![held(), row(), held()];
        unite(&mut rows, |row| row);
        assert_eq!(rows, [row()]);
        let mut away = vec![held(), held()];
        unite(&mut away, |row| row);
        assert_eq!(away, [held()]);
        // Copies of a database are different studies.
        let mut copies = vec![row(), row()];
        unite(&mut copies, |row| row);
        assert_eq!(copies.len(), 2);
    }
}
