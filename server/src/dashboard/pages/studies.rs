//! The list of studies: of this daemon, and of the other daemons that the operator named.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::sync::Arc;

use askama::Template;
use serde_json::json;
use treewright_proto::v1;

use super::super::{Query, Visitor};
use super::index::{IndexRow, unite};
use super::others::{OtherDaemon, OtherDaemons};
use super::summaries::{STATES, StudySummary, Summaries};
use super::{PageFrame, id, render, seconds, tag_links, time};
use crate::config::DashboardPeer;
use crate::error::{Error, Result};
use crate::limits::{DASHBOARD_ROWS, DASHBOARD_STUDIES};
use crate::rpc;
use crate::tuning::Tuning;

/// A study that is not finished counts as paused if none of its trials is open and nothing has happened for
/// this time, in seconds.
const PAUSED_AFTER_S: f64 = 600.0;
/// Studies of one answer of the list.
const STUDIES: i32 = 500;

/// The columns by which the list can be ordered, the first by default.
const COLUMNS: [&str; 10] = [
    "Study",
    "Daemon",
    "Gain",
    "Status",
    "Trials",
    "Completed",
    "Open",
    "States",
    "Last activity",
    "Created",
];

#[derive(Template)]
#[template(path = "studies.html")]
struct Page {
    frame: PageFrame,
    columns: Vec<Column>,
    rows: Vec<ShownRow>,
    /// The row names its daemon.
    has_daemons: bool,
    /// The daemons that do not answer, each with its address and the reason.
    away: Vec<(String, String, String)>,
    /// The tag that all rows have; empty where all studies are listed.
    tag: String,
    is_cut: bool,
    states_most: i64,
    page: usize,
    pages: usize,
    previous: Option<String>,
    next: Option<String>,
}

struct Column {
    name: &'static str,
    /// The value of `aria-sort`, where the rows are ordered by it.
    sorted: Option<&'static str>,
    is_figure: bool,
    /// The query that orders by it, or the other way round.
    query: String,
}

struct ShownRow {
    row: IndexRow,
    /// The daemon's name; empty for this one.
    daemon: String,
    /// The address of the dashboard; empty for this one.
    url: String,
}

impl ShownRow {
    fn gain(&self) -> String {
        self.row.gain.map(|gain| gain.to_string()).unwrap_or_default()
    }

    fn place(&self) -> &str {
        if self.daemon.is_empty() { &self.row.holder } else { &self.daemon }
    }

    fn tags(&self) -> Vec<(String, String)> {
        tag_links(&self.row.tags)
    }
}

/// The rows that are listed, and their order.
#[derive(Clone, Copy)]
struct IndexOrder<'a> {
    column: &'static str,
    reverse: bool,
    /// The tag that they have; empty for all rows.
    tag: &'a str,
}

pub(in super::super) struct StudyIndex {
    tuning: Arc<Tuning>,
    summaries: Arc<Summaries>,
    others: OtherDaemons,
}

impl StudyIndex {
    /// The list of a daemon's studies and of those of other daemons.
    pub(in super::super) fn new(tuning: Arc<Tuning>, peers: Vec<DashboardPeer>) -> Self {
        Self { tuning, summaries: Arc::default(), others: OtherDaemons::new(peers) }
    }

    /// The number of changes of its texts beside counts.
    pub(in super::super) fn changes(&self) -> u64 {
        self.summaries.changes()
    }

    pub(in super::super) async fn page(&self, visitor: &Visitor<'_>, query: &Query) -> Result<String> {
        query.only(&["order", "reverse", "page", "tag"])?;
        let (column, tag) = (query.word("order", &COLUMNS)?, query.text("tag"));
        let order = IndexOrder { column, reverse: query.word("reverse", &["0", "1"])? == "1", tag: &tag };
        let asked = query.number("page")?;
        let (studies, others) = tokio::join!(read_studies(visitor), self.read_others(visitor));
        let (studies, is_cut) = studies?;
        let shown = |rows: &[ShownRow]| {
            let pages = rows.len().div_ceil(DASHBOARD_ROWS).max(1);
            let page = usize::try_from(asked.unwrap_or(1)).unwrap_or(usize::MAX);
            if page > pages {
                return Err(Error::invalid(
                    "page",
                    format!("{page} is none of them; there are 1 to {pages}"),
                ));
            }
            let first = (page - 1) * DASHBOARD_ROWS;
            Ok((page, pages, first..rows.len().min(first + DASHBOARD_ROWS)))
        };
        // What the page will show is to be summarised first.
        let rows = self.rows(&studies, &others, order);
        let (_, _, range) = shown(&rows)?;
        let uids: BTreeSet<String> = rows[range].iter().map(|shown| shown.row.uid.clone()).collect();
        self.summaries.refresh(&self.tuning, &studies, &uids).await;
        let mut rows = self.rows(&studies, &others, order);
        let (page, pages, range) = shown(&rows)?;
        let has_daemons = !self.others.is_empty() || rows.iter().any(|shown| !shown.row.holder.is_empty());
        let away = others.iter().filter_map(|other| {
            let reason = other.studies.as_ref().err()?.clone();
            Some((other.peer.name.clone(), other.peer.url(), reason))
        });
        let at = |page: usize| order.query(Some(page));
        render(&Page {
            frame: visitor.frame,
            columns: order.columns(has_daemons),
            rows: rows.drain(range).collect(),
            has_daemons,
            away: away.collect(),
            tag: tag.clone(),
            is_cut,
            states_most: STATES,
            page,
            pages,
            previous: (page > 1).then(|| at(page - 1)),
            next: (page < pages).then(|| at(page + 1)),
        })
    }

    /// The list of this daemon's studies in JSON, for the dashboard of another daemon.
    pub(in super::super) async fn json(&self, visitor: &Visitor<'_>, query: &Query) -> Result<String> {
        query.only(&[])?;
        let (studies, is_cut) = read_studies(visitor).await?;
        let uids = studies.iter().take(DASHBOARD_ROWS).map(|study| study.uid.clone()).collect();
        self.summaries.refresh(&self.tuning, &studies, &uids).await;
        let rows: Vec<_> = studies.iter().map(|study| self.row(study).to_json()).collect();
        Ok(json!({ "studies": rows, "more": is_cut }).to_string())
    }

    /// The answers of the other daemons. A visitor who may not see all studies here does not see those of
    /// others.
    async fn read_others(&self, visitor: &Visitor<'_>) -> Arc<Vec<OtherDaemon>> {
        if self.others.is_empty() || visitor.caller.is_limited() {
            return Arc::default();
        }
        self.others.read().await
    }

    fn rows(&self, studies: &[v1::Study], others: &[OtherDaemon], order: IndexOrder<'_>) -> Vec<ShownRow> {
        let own = studies.iter().map(|study| ShownRow {
            row: self.row(study),
            daemon: String::new(),
            url: String::new(),
        });
        let theirs = others.iter().flat_map(|other| {
            other.studies.iter().flatten().map(move |row| ShownRow {
                row: row.clone(),
                daemon: other.peer.name.clone(),
                url: other.peer.url(),
            })
        });
        let mut rows: Vec<ShownRow> = own.chain(theirs).collect();
        unite(&mut rows, |shown| &shown.row);
        rows.retain(|shown| order.tag.is_empty() || shown.row.tags.iter().any(|tag| tag == order.tag));
        rows.sort_by(|a, b| order.compare(a, b));
        rows
    }

    fn row(&self, study: &v1::Study) -> IndexRow {
        let counts = study.statistics.unwrap_or_default();
        let summary = self.summaries.of(&study.uid).unwrap_or_default();
        IndexRow {
            id: id(&study.name).to_owned(),
            uid: study.uid.clone(),
            what: study.display_name.clone(),
            tags: study.tags.clone(),
            status: status(study, &summary, self.tuning.now_ms() as f64 / 1e3).to_owned(),
            gain: summary.gain,
            gain_note: summary.gain_note,
            states: counts.states,
            trials: counts.trials,
            completed: counts.completed_trials,
            open: counts.open_trials,
            last: time(summary.last),
            created: time(study.create_time),
            holder: summary.holder.unwrap_or_default(),
        }
    }
}

/// The studies that the visitor may see, by id, and whether there are more than are read.
async fn read_studies(visitor: &Visitor<'_>) -> Result<(Vec<v1::Study>, bool)> {
    let mut studies = Vec::new();
    let mut page_token = String::new();
    loop {
        let request = v1::ListStudiesRequest { page_size: STUDIES, page_token };
        let answer = rpc::studies::list(visitor.call(), request).await?;
        studies.extend(answer.studies);
        page_token = answer.next_page_token;
        if page_token.is_empty() || studies.len() >= DASHBOARD_STUDIES {
            break;
        }
    }
    let is_cut = !page_token.is_empty() || studies.len() > DASHBOARD_STUDIES;
    studies.truncate(DASHBOARD_STUDIES);
    Ok((studies, is_cut))
}

/// The activity of a study: by its policy, else by its states.
fn status(study: &v1::Study, summary: &StudySummary, now_s: f64) -> &'static str {
    let counts = study.statistics.unwrap_or_default();
    let policy = study.policy.as_ref();
    let is_idle = || seconds(summary.last).is_some_and(|last_s| now_s - last_s > PAUSED_AFTER_S);
    match policy.map(v1::Policy::operation) {
        Some(v1::Operation::Freeze) => "frozen",
        Some(v1::Operation::Shadow) => "shadow",
        _ if policy.is_some_and(|policy| policy.pinned.is_some()) => "pinned",
        _ if counts.trials == 0 => "new",
        _ if ["", "finished"].contains(&summary.progress) => summary.progress,
        _ if counts.open_trials == 0 && is_idle() => "paused",
        _ => summary.progress,
    }
}

impl IndexOrder<'_> {
    /// Rows without a gain come last in both directions.
    fn compare(self, a: &ShownRow, b: &ShownRow) -> Ordering {
        let by = |ordering: Ordering| if self.reverse { ordering.reverse() } else { ordering };
        let share = |shown: &ShownRow| shown.row.gain.map(|gain| gain.share);
        let (one, other) = (&a.row, &b.row);
        let ordering = match self.column {
            "Daemon" => by(a.place().cmp(b.place())),
            "Gain" => match (share(a), share(b)) {
                (Some(a), Some(b)) => by(b.total_cmp(&a)),
                (a, b) => b.is_some().cmp(&a.is_some()),
            },
            "Status" => by(one.status.cmp(&other.status)),
            "Trials" => by(other.trials.cmp(&one.trials)),
            "Completed" => by(other.completed.cmp(&one.completed)),
            "Open" => by(other.open.cmp(&one.open)),
            "States" => by(other.states.cmp(&one.states)),
            "Last activity" => by(other.last.cmp(&one.last)),
            "Created" => by(other.created.cmp(&one.created)),
            _ => by(one.id.cmp(&other.id)),
        };
        ordering.then_with(|| one.id.cmp(&other.id)).then_with(|| a.daemon.cmp(&b.daemon))
    }

    fn columns(self, has_daemons: bool) -> Vec<Column> {
        let column = |name: &'static str| {
            let is_order = name == self.column;
            let rises = ["Study", "Daemon", "Status"].contains(&name) != self.reverse;
            let other = Self { column: name, reverse: is_order && !self.reverse, tag: self.tag };
            Column {
                name,
                sorted: is_order.then_some(if rises { "ascending" } else { "descending" }),
                is_figure: ["Trials", "Completed", "Open", "States"].contains(&name),
                query: other.query(None),
            }
        };
        COLUMNS.into_iter().filter(|name| has_daemons || *name != "Daemon").map(column).collect()
    }

    fn query(self, page: Option<usize>) -> String {
        let reverse = if self.reverse { "1" } else { "" };
        let page = page.map(|page| page.to_string()).unwrap_or_default();
        Query::written(&[
            ("order", &self.column.to_owned()),
            ("reverse", &reverse.to_owned()),
            ("tag", &self.tag.to_owned()),
            ("page", &page),
        ])
    }
}

#[cfg(test)]
mod tests {
    use treewright_core::standing::Gain;

    use super::*;

    fn shown(id: &str, trials: i64, share: Option<f64>) -> ShownRow {
        let gain = share.map(|share| Gain { share, low: None, high: None, probability_better: None });
        let row = IndexRow { id: id.to_owned(), trials, gain, ..IndexRow::default() };
        ShownRow { row, daemon: String::new(), url: String::new() }
    }

    fn ordered(column: &'static str, reverse: bool) -> String {
        let mut rows = [shown("b", 3, Some(0.1)), shown("c", 2, None), shown("a", 1, Some(0.3))];
        rows.sort_by(|a, b| IndexOrder { column, reverse, tag: "" }.compare(a, b));
        rows.iter().map(|shown| shown.row.id.as_str()).collect()
    }

    #[test]
    fn each_column_orders_in_both_directions_and_unknown_gains_come_last() {
        assert_eq!([ordered("Study", false), ordered("Study", true)], ["abc", "cba"]);
        assert_eq!([ordered("Trials", false), ordered("Trials", true)], ["bca", "acb"]);
        assert_eq!([ordered("Gain", false), ordered("Gain", true)], ["abc", "bac"]);
        assert_eq!(ordered("Open", false), "abc", "equal ones by name");
        for column in COLUMNS {
            ordered(column, true);
        }
    }

    #[test]
    fn heads_lead_to_their_order_and_back() {
        let order = IndexOrder { column: "Trials", reverse: false, tag: "" };
        let columns = order.columns(false);
        let of = |name: &str| columns.iter().find(|column| column.name == name).expect("a column");
        assert!(columns.iter().all(|column| column.name != "Daemon"));
        assert_eq!(
            (of("Trials").sorted, of("Trials").query.as_str()),
            (Some("descending"), "order=Trials&reverse=1")
        );
        assert_eq!((of("Gain").sorted, of("Last activity").query.as_str()), (None, "order=Last+activity"));
        let back = IndexOrder { column: "Study", reverse: true, tag: "gpu" };
        let study = &back.columns(true)[0];
        assert_eq!((study.sorted, study.query.as_str()), (Some("descending"), "order=Study&tag=gpu"));
        assert_eq!(back.query(Some(2)), "order=Study&reverse=1&tag=gpu&page=2");
    }

    #[test]
    fn a_status_is_that_of_the_policy_or_of_the_search() {
        let counts = |trials, open_trials| {
            Some(v1::StudyStatistics { trials, open_trials, ..v1::StudyStatistics::default() })
        };
        let with = |policy: v1::Policy, trials, open| v1::Study {
            policy: Some(policy),
            statistics: counts(trials, open),
            ..v1::Study::default()
        };
        let last = Some(prost_types::Timestamp { seconds: 1000, nanos: 0 });
        let at = |progress| StudySummary { progress, last, ..StudySummary::default() };
        let plain = v1::Policy::default;
        let frozen = v1::Policy { operation: v1::Operation::Freeze as i32, ..plain() };
        let pinned = v1::Policy { pinned: Some(v1::Configuration::default()), ..plain() };
        let (soon, late) = (1100.0, 1000.0 + 2.0 * PAUSED_AFTER_S);
        for (study, progress, now_s, said) in [
            (with(frozen, 9, 1), "searching", soon, "frozen"),
            (with(pinned, 9, 1), "searching", soon, "pinned"),
            (with(plain(), 0, 0), "", soon, "new"),
            (with(plain(), 9, 0), "", late, ""),
            (with(plain(), 9, 0), "searching", soon, "searching"),
            (with(plain(), 9, 0), "confirming", late, "paused"),
            (with(plain(), 9, 1), "confirming", late, "confirming"),
            (with(plain(), 9, 0), "finished", late, "finished"),
        ] {
            assert_eq!(status(&study, &at(progress), now_s), said, "{progress} at {now_s}");
        }
    }
}
