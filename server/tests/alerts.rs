//! The alerting rules of `server/deploy`, played over a simulated week by `promtool test rules`
//! (<https://prometheus.io/docs/prometheus/latest/configuration/unit_testing_rules/>): each fires for its
//! event in time, and none fires for everyday events. Each evaluation takes promtool milliseconds, so all
//! rules together are evaluated every half hour of the week, and each alone every minute around its event.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Minutes of a week.
const WEEK: usize = 7 * DAY;
const DAY: usize = 24 * HOUR;
const HOUR: usize = 60;
const DAY_S: f64 = 86_400.0;
/// Figures of every minute.
type Figures = Vec<f64>;
/// Figures of a week by the name and labels of their series.
type Week = BTreeMap<String, Figures>;

fn rules() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/alerts.yaml")
}

fn level(value: f64) -> Figures {
    vec![value; WEEK + 1]
}

/// A counter that begins at 0 and rises by `per_minute`.
fn rising(per_minute: f64) -> Figures {
    (0..=WEEK).map(|minute| per_minute * minute as f64).collect()
}

/// Adds a rise of `per_minute` between two minutes.
fn more(mut figures: Figures, from: usize, to: usize, per_minute: f64) -> Figures {
    for (minute, figure) in figures.iter_mut().enumerate() {
        *figure += per_minute * minute.clamp(from, to).saturating_sub(from) as f64;
    }
    figures
}

/// Sets `value` from the minute `from` up to before `to`.
fn between(mut figures: Figures, from: usize, to: usize, value: f64) -> Figures {
    figures[from..to].fill(value);
    figures
}

/// A week of one daemon in which nothing is wrong, by the series' labels.
fn quiet_week() -> Week {
    let mut week = BTreeMap::new();
    let mut put = |name: &str, labels: &str, figures: Figures| {
        let labels =
            ["instance=\"a:9464\",job=\"treewright\"", labels].join(if labels.is_empty() { "" } else { "," });
        week.insert(format!("{name}{{{labels}}}"), figures);
    };
    put("up", "", level(1.0));
    // A poller of a study that is not there, studies that are made twice, clients that are too fast:
    // everyday.
    for (reason, per_minute) in
        [("not_found", 300.0), ("exists", 5.0), ("invalid", 10.0), ("nothing_measured", 20.0)]
    {
        put("treewright_refusals_total", &format!("reason=\"{reason}\""), rising(per_minute));
    }
    for reason in ["token", "scope", "quota", "busy", "draining", "deadline", "store", "defect", "tuner"] {
        put("treewright_refusals_total", &format!("reason=\"{reason}\""), rising(0.0));
    }
    for reason in ["limit", "address", "made_room", "tls", "overdue"] {
        put("treewright_connections_lost_total", &format!("reason=\"{reason}\""), rising(0.0));
    }
    for outcome in ["answered", "silent"] {
        put("treewright_forwarded_total", &format!("outcome=\"{outcome}\""), rising(0.0));
    }
    put("treewright_requests_total", "rpc=\"Tune.frame\",code=\"OK\"", rising(6000.0));
    put("treewright_expired_leases_total", "", rising(6.0));
    for (le, share) in [("0.05", 0.9), ("0.2", 1.0), ("1.6", 1.0), ("+Inf", 1.0)] {
        put("treewright_durable_seconds_bucket", &format!("le=\"{le}\""), rising(6000.0 * share));
    }
    for (le, share) in [("0.0", 0.95), ("100.0", 1.0), ("1000.0", 1.0), ("+Inf", 1.0)] {
        put("treewright_client_outbox_bucket", &format!("le=\"{le}\""), rising(6000.0 * share));
    }
    for (name, value) in [
        ("treewright_since_durable_seconds", 0.1),
        ("treewright_store_queue", 3.0),
        ("treewright_database_log_bytes", 60e6),
        ("treewright_descriptors", 4000.0),
        ("treewright_descriptors_limit", 70_000.0),
        ("treewright_unfinished_bytes", 200_000.0),
        ("treewright_certificate_expiry_seconds", 0.0),
        ("treewright_last_backup_seconds", 0.0),
    ] {
        put(name, "", level(value));
    }
    week
}

/// An event, and the alert that must fire for it.
struct Event {
    alert: &'static str,
    /// The figures of the series in place of a quiet week's; none where those of another event hold.
    series: Vec<(&'static str, Figures)>,
    /// The last minute before it.
    begins: usize,
    /// The minutes in which it must fire.
    fires: std::ops::Range<usize>,
    /// Minutes after that in which it may fire and need not.
    margin: usize,
}

const NOON: usize = DAY / 2;

/// One event for each alert: most on the first day at noon, and a certificate that is renewed too late.
fn events() -> Vec<Event> {
    // It must fire in these minutes after noon.
    let event = |alert, series, fires: std::ops::Range<usize>, margin| {
        let fires = NOON + fires.start..NOON + fires.end;
        Event { alert, series, begins: NOON, fires, margin }
    };
    let held = |series: &'static str, usual, minutes, value| {
        vec![(series, between(level(usual), NOON, NOON + minutes, value))]
    };
    let more_for = |series: &'static str, usual, minutes, per_minute| {
        (series, more(rising(usual), NOON, NOON + minutes, per_minute))
    };
    let refused = |reason, per_minute, minutes| vec![more_for(reason, 0.0, minutes, per_minute)];
    let slow = |bucket| more_for(bucket, 6000.0, 60, -5400.0);
    let waiting =
        vec![more_for("le=\"0.0\"", 5700.0, 60, -5700.0), more_for("le=\"100.0\"", 6000.0, 60, -5900.0)];
    let expired = vec![more_for("treewright_expired_leases_total", 6.0, 120, 3000.0)];
    let full = f64::from(u32::try_from(NOON * 60).expect("small"));
    // One that ends fourteen days after this noon; a day later another, that ends within a day; then a good
    // one.
    let first = level(full + 14.0 * DAY_S);
    let second = between(first, NOON + DAY, NOON + DAY + HOUR, full + 2.0 * DAY_S);
    let third = between(second, NOON + DAY + HOUR, WEEK + 1, full + 90.0 * DAY_S);
    let certificates = vec![("treewright_certificate_expiry_seconds", third)];
    // One in the first hour, and then none for three days.
    let later = between(level(3600.0), 3 * DAY, 5 * DAY, 3.0 * DAY_S);
    let backups = vec![("treewright_last_backup_seconds", between(later, 5 * DAY, WEEK + 1, 5.0 * DAY_S))];
    vec![
        event("TreewrightDown", held("up{", 1.0, 30, 0.0), 2..30, 1),
        event("TreewrightStoreSlow", vec![slow("le=\"0.05\""), slow("le=\"0.2\"")], 15..60, 10),
        event("TreewrightStoreFails", refused("reason=\"store\"", 3.0, 30), 7..30, 7),
        event("TreewrightConnectionsFull", refused("reason=\"made_room\"", 60.0, 60), 12..60, 7),
        event("TreewrightBusy", refused("reason=\"busy\"", 600.0, 60), 15..60, 7),
        event("TreewrightLeasesExpire", expired, 30..120, 16),
        // The first one of all.
        event("TreewrightDefect", refused("reason=\"defect\"", 1.0, 1), 2..60, 3),
        event("TreewrightDiskSilent", held("treewright_since_durable_seconds", 0.1, 20, 60.0), 1..20, 1),
        event("TreewrightLogGrows", held("treewright_database_log_bytes", 60e6, 90, 2e9), 30..90, 1),
        event("TreewrightReplicaSilent", refused("outcome=\"silent\"", 6.0, 30), 7..30, 7),
        event("TreewrightClientsWait", waiting, 30..60, 16),
        event("TreewrightDescriptorsFull", held("treewright_descriptors{", 4000.0, 60, 69_000.0), 10..60, 1),
        event("TreewrightUnfinished", held("treewright_unfinished_bytes", 2e5, 60, 120e6), 10..60, 1),
        event("TreewrightStrangers", refused("reason=\"token\"", 600.0, 60), 15..60, 7),
        event("TreewrightCertificateEnds", certificates, HOUR + 1..DAY + HOUR, 2),
        Event {
            begins: NOON + DAY - 1,
            ..event("TreewrightCertificateEndsNow", Vec::new(), DAY..DAY + HOUR, 1)
        },
        Event {
            alert: "TreewrightBackupOld",
            series: backups,
            begins: 2 * DAY + HOUR,
            fires: 2 * DAY + 2 * HOUR + 1..3 * DAY,
            margin: 2,
        },
    ]
}

/// As promtool reads figures: each piece that rises evenly is its begin, its step and how many steps follow.
fn notation(figures: &[f64]) -> String {
    let mut text = String::new();
    let mut rest = figures;
    while let [first, ..] = rest {
        let step = rest.get(1).map_or(0.0, |second| second - first);
        let steps = rest.windows(2).take_while(|pair| pair[1] - pair[0] == step).count();
        let sign = if step < 0.0 { "-" } else { "+" };
        let _ = write!(text, "{first}{sign}{}x{steps} ", step.abs());
        rest = &rest[steps + 1..];
    }
    text
}

/// A question about an alert at a minute.
fn asked(alert: &str, minute: usize, fires: bool, labels: &str) -> String {
    let expected = if fires { format!("[{{exp_labels: {{{labels}}}}}]") } else { "[]".to_owned() };
    // promtool compares annotations as well, and the rules here have none.
    format!("      - {{eval_time: {minute}m, alertname: {alert}, exp_alerts: {expected}}}\n")
}

/// The rules by the name of their alert, without annotations, which would have to be repeated.
fn rules_by_alert() -> BTreeMap<String, Value> {
    let text = std::fs::read_to_string(rules()).expect("the rules");
    let all: Value = serde_saphyr::from_str(&text).expect("YAML");
    let rules = all["groups"][0]["rules"].as_array().expect("rules");
    let named = |rule: &Value| {
        let mut rule = rule.clone();
        rule.as_object_mut().expect("a rule").remove("annotations");
        (rule["alert"].as_str().expect("a name").to_owned(), rule)
    };
    rules.iter().map(named).collect()
}

/// The labels that an alert fires with.
fn labels(rule: &Value) -> String {
    let severity = rule["labels"]["severity"].as_str().expect("a severity");
    // A sum by instance has no other label.
    let is_summed = rule["expr"].as_str().expect("an expression").contains("by (instance");
    let job = if is_summed { "" } else { ", job: treewright" };
    format!("severity: {severity}, instance: 'a:9464'{job}")
}

/// Writes a test of these rules, evaluated every `every` minutes up to the minute `last`. Returns its file.
fn test(name: &Path, rules: &[&Value], every: usize, last: usize, week: &Week, asked: &str) -> PathBuf {
    // JSON is YAML.
    let group = serde_json::json!({"groups": [{"name": "treewright", "rules": rules}]});
    let rules_file = name.with_extension("rules.yaml");
    std::fs::write(&rules_file, group.to_string()).expect("written");
    let expressions: Vec<&str> = rules.iter().filter_map(|rule| rule["expr"].as_str()).collect();
    let mut text = format!(
        "rule_files: ['{}']\nevaluation_interval: {every}m\ntests:\n  - interval: 1m\n    input_series:\n",
        rules_file.display()
    );
    for (series, figures) in week {
        let metric = series.split('{').next().unwrap_or_default();
        if expressions.iter().any(|expression| expression.contains(metric)) {
            let values = notation(&figures[..=last]);
            let _ = writeln!(text, "      - series: '{series}'\n        values: '{values}'");
        }
    }
    let _ = write!(text, "    alert_rule_test:\n{asked}");
    let path = name.with_extension("yaml");
    std::fs::write(&path, text).expect("written");
    path
}

fn skip() {
    let line = "skipped: the alerting rules in a simulated week: there is no promtool here\n";
    eprint!("{line}");
    if let Some(file) = std::env::var_os("TREEWRIGHT_SKIPPED") {
        let opened = std::fs::OpenOptions::new().append(true).open(file);
        opened.and_then(|mut file| file.write_all(line.as_bytes())).expect("written");
    }
}

fn promtool(command: &[&str], files: &[PathBuf]) {
    match Command::new("promtool").args(command).args(files).output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => skip(),
        output => {
            let output = output.expect("it runs");
            let said = [output.stdout, output.stderr].concat();
            let said: String = String::from_utf8_lossy(&said).chars().take(4000).collect();
            assert!(output.status.success(), "{said}");
        }
    }
}

#[test]
fn the_rules_are_well_formed() {
    promtool(&["check", "rules"], &[rules()]);
}

#[test]
fn each_alert_fires_when_it_should_in_a_simulated_week_and_at_no_other_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let rules = rules_by_alert();
    let events = events();
    let watched: Vec<&str> = events.iter().map(|event| event.alert).collect();
    for alert in rules.keys() {
        assert!(watched.contains(&alert.as_str()), "nothing happens for which {alert} is to fire");
    }
    let mut week = quiet_week();
    for (part, figures) in events.iter().flat_map(|event| &event.series) {
        let found: Vec<String> = week.keys().filter(|name| name.contains(part)).cloned().collect();
        assert_eq!(found.len(), 1, "{part} names {found:?}");
        week.insert(found[0].clone(), figures.clone());
    }
    let (mut tests, mut silent) = (Vec::new(), String::new());
    for event in &events {
        let rule = &rules[event.alert];
        let (from, to) = (event.fires.start, event.fires.end);
        let loud = event.begins + 1..to + event.margin;
        let firing = (from..to).step_by((to - from).div_ceil(6)).chain([to - 1]);
        let mut closely: String =
            firing.map(|minute| asked(event.alert, minute, true, &labels(rule))).collect();
        for minute in [event.begins, loud.end] {
            closely += &asked(event.alert, minute, false, "");
        }
        let name = folder.path().join(event.alert);
        tests.push(test(&name, &[rule], 1, loud.end, &week, &closely));
        // Before and after its event it is silent.
        for minute in (HOUR..WEEK).step_by(3 * HOUR).filter(|minute| !loud.contains(minute)) {
            silent += &asked(event.alert, minute, false, "");
        }
    }
    let all: Vec<&Value> = rules.values().collect();
    tests.push(test(&folder.path().join("week"), &all, HOUR / 2, WEEK, &week, &silent));
    promtool(&["test", "rules"], &tests);
}
