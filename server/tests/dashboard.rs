//! The dashboard over a real socket: which study a page and a form mean, and where that is.

mod common;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use common::{Caller, START_MS, Server, ask, configuration, creation, done, report, study, suggest};
use sqlx::{Connection as _, Executor as _};
use tokio::net::TcpListener;
use tonic::Code;
use treewright_proto::v1::{self as wire};
use treewright_server::access::Access;
use treewright_server::clock::ManualClock;
use treewright_server::config::DashboardPeer;
use treewright_server::limits::DASHBOARD_ROWS;
use treewright_server::serve::Options;
use treewright_store::tokens::{Quota, Scope};
use treewright_store::{Faults, MemoryStore, MemoryTokens, SqliteStore, Store, TokenStore};
use treewright_test_postgres::Database;

/// A server with a dashboard that asks for tokens, and a token that may do everything.
struct Guarded {
    server: Server,
    pages: SocketAddr,
    token: String,
}

impl Guarded {
    async fn start(store: Arc<dyn Store>) -> Self {
        let clock = Arc::new(ManualClock::at(START_MS));
        let (options, pages, token) = options(&clock, Vec::new()).await;
        Self { server: Server::with_options(store, clock, options).await, pages, token }
    }

    /// One of several replicas on a database.
    async fn replica(database: &Database) -> Self {
        let clock = Arc::new(ManualClock::at(START_MS));
        let (options, pages, token) = options(&clock, Vec::new()).await;
        Self { server: Server::replica_with(database, clock, options).await, pages, token }
    }

    async fn caller(&self) -> Caller {
        self.server.caller(Some(format!("Bearer {}", self.token))).await
    }

    /// Asks for a page. Returns the status, and the whole answer.
    async fn get(&self, path: &str) -> (u16, String) {
        self.exchange("GET", path, "").await
    }

    async fn post(&self, path: &str, form: &str) -> (u16, String) {
        self.exchange("POST", path, form).await
    }

    async fn exchange(&self, method: &str, path: &str, form: &str) -> (u16, String) {
        let (pages, token, length) = (self.pages, &self.token, form.len());
        let head = format!("{method} {path} HTTP/1.1\r\nHost: {pages}\r\nConnection: close\r\n");
        let rest = format!("Authorization: Bearer {token}\r\nContent-Length: {length}\r\n\r\n{form}");
        let answer = common::exchange(pages, &(head + &rest)).await;
        let status = answer.split(' ').nth(1).and_then(|code| code.parse().ok()).expect("a status");
        (status, answer)
    }
}

/// Options with a dashboard; where it is, and a token for these studies, or for all.
async fn options(clock: &Arc<ManualClock>, studies: Vec<String>) -> (Options, SocketAddr, String) {
    let (token, record) = common::token(Scope::Admin, studies, Quota::default());
    let tokens = Arc::new(MemoryTokens::new());
    tokens.create(&record).await.expect("stored");
    let access = Access::open(Arc::clone(&tokens) as _, Arc::clone(clock) as _).await.expect("opened");
    let dashboard = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let pages = dashboard.local_addr().expect("an address");
    let (drain, access) = (Duration::from_secs(5), Some(Arc::new(access)));
    let options = Options { drain, access, dashboard: Some(dashboard), ..Options::default() };
    (options, pages, token.text())
}

/// Creates the study `hall`, and measures a trial of it.
async fn measured(caller: &mut Caller) -> wire::Study {
    let created = caller.create_study(creation("hall", study())).await.expect("created").into_inner();
    let trial = caller.suggest(ask("a", 10.0)).await.expect("a trial").into_inner();
    caller.report(report(&trial.name, 5.0)).await.expect("taken");
    created
}

#[tokio::test]
async fn pages_are_found_by_the_identity_of_their_study() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    let uid = measured(&mut caller).await.uid;
    for page in ["", "/map", "/parameters", "/policy", "/trials", "/trials/1"] {
        let (status, answer) = guarded.get(&format!("/studies/hall@{uid}{page}")).await;
        assert_eq!(status, 200, "{page}: {answer}");
        assert!(answer.contains("<h1>hall</h1>") && answer.contains("href=\"/studies/hall\""), "{answer}");
    }
    let (status, answer) = guarded.get(&format!("/compare?study=hall@{uid}")).await;
    assert!(status == 200 && answer.contains("/studies/hall\""), "{status}: {answer}");
    let (status, answer) = guarded.get("/studies/hall@0000000000000abc").await;
    assert!(status == 404 && answer.contains("was deleted and created again"), "{status}: {answer}");

    // A form leads to the page of the id that the study has by now.
    let request =
        wire::RenameStudyRequest { name: "studies/hall".to_owned(), study_id: "gallery".to_owned() };
    caller.rename_study(request).await.expect("renamed");
    for (form, sent) in [("policy", "field=epsilon&value=0.5"), ("trials/1/pin", "")] {
        let (status, answer) = guarded.post(&format!("/studies/hall@{uid}/{form}"), sent).await;
        assert_eq!(status, 303, "{form}: {answer}");
        assert!(answer.to_lowercase().contains("location: /studies/gallery/policy\r\n"), "{answer}");
    }
    let (status, answer) = guarded.get(&format!("/studies/hall@{uid}/policy")).await;
    assert!(status == 200 && answer.contains("<h1>gallery</h1>") && answer.contains("Unpin: "), "{answer}");
}

/// Where the forms of a page lead that change something.
fn actions(page: &str) -> Vec<&str> {
    let all = page.split("method=\"post\" action=\"").skip(1).filter_map(|rest| rest.split('"').next());
    all.filter(|action| action.starts_with("/studies/")).collect()
}

#[tokio::test]
async fn a_form_changes_no_other_study_that_got_the_id_later() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    let before = measured(&mut caller).await;
    let pages = [guarded.get("/studies/hall/policy").await.1, guarded.get("/studies/hall/trials/1").await.1];
    let forms: Vec<&str> = pages.iter().flat_map(|page| actions(page)).collect();
    assert!(forms.len() >= 3 && forms.iter().any(|form| form.ends_with("/pin")), "{forms:?}");

    let name = || "studies/hall".to_owned();
    caller.delete_study(wire::DeleteStudyRequest { name: name() }).await.expect("deleted");
    let after = measured(&mut caller).await;
    assert_ne!(before.uid, after.uid);
    for form in forms {
        let (status, answer) = guarded.post(form, "field=operation&value=freeze").await;
        assert_eq!(status, 404, "{form}: {answer}");
        assert!(answer.contains("was deleted and created again"), "{form}: {answer}");
    }
    let now =
        caller.get_study(wire::GetStudyRequest { name: name() }).await.expect("it is there").into_inner();
    assert_eq!(now.policy, after.policy);

    // The new page's forms work.
    let page = guarded.get("/studies/hall/policy").await.1;
    let form = *actions(&page).first().expect("a form");
    assert_eq!(guarded.post(form, "field=operation&value=freeze").await.0, 303);
    assert!(guarded.get("/studies/hall/policy").await.1.contains("Thaw: "));
}

/// A study that loads longer than a request waits for it.
#[tokio::test]
async fn a_form_waits_for_its_study_to_be_loaded() {
    let load_takes = treewright_server::limits::LOADING_WAIT + Duration::from_millis(300);
    let guarded =
        Guarded::start(Arc::new(MemoryStore::with(Faults { load_takes, ..Faults::default() }))).await;
    let mut caller = guarded.caller().await;
    caller.create_study(creation("hall", study())).await.expect("created");
    let (status, answer) = guarded.post("/studies/hall/policy", "field=epsilon&value=0.5").await;
    assert_eq!(status, 303, "{answer}");
    let name = "studies/hall".to_owned();
    let now = caller.get_study(wire::GetStudyRequest { name }).await.expect("it is there").into_inner();
    assert_eq!(now.policy.expect("a policy").epsilon, Some(0.5));
}

#[tokio::test]
async fn a_form_at_another_replica_says_which_one_holds_the_study() {
    let database = Database::create().await;
    let (holder, other) = (Guarded::replica(&database).await, Guarded::replica(&database).await);
    let mut caller = holder.caller().await;
    let uid = measured(&mut caller).await.uid;
    let held = format!("http://{}", holder.server.address);
    for (form, sent, command) in [
        ("policy", "field=operation&value=freeze", "treewright policy hall --operation freeze"),
        ("policy", "field=pinned&value=", "treewright policy hall --unpin"),
        ("texts", "note=cold&tags=gpu", "treewright study edit hall --note=cold --tag=gpu"),
        ("texts", "note=&tags=b", "--tag=b --untag=gpu"),
        ("trials/1/pin", "", "treewright pin hall max_leaf="),
        ("trials/1/exclude", "reason=cold", "treewright exclude hall/trials/1 cold"),
        ("trials/1/include", "", "treewright include hall/trials/1"),
    ] {
        let path = format!("/studies/hall@{uid}/{form}");
        let (status, answer) = other.post(&path, sent).await;
        assert_eq!(status, 503, "{path}: {answer}");
        assert!(answer.contains(&held) && answer.contains(command), "{path}: {answer}");
        assert_eq!(holder.post(&path, sent).await.0, 303, "{path}");
    }
    let mut list = String::new();
    for _ in 0..200 {
        list = other.get("/").await.1;
        if list.contains(&held) {
            break;
        }
        // Summaries are made in the background.
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert!(list.contains(&held) && list.contains(">Daemon</a>"), "{list}");
    assert!(!holder.get("/").await.1.contains(">Daemon</a>"), "it holds the study itself");
    holder.server.stop().await;
    other.server.stop().await;
}

#[tokio::test]
async fn a_note_and_tags_are_shown_and_changed_and_tags_lead_to_their_studies() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    measured(&mut caller).await;
    caller.create_study(creation("attic", study())).await.expect("created");
    let page = guarded.get("/studies/hall").await.1;
    let form = actions(&page)[0].to_owned();
    assert!(form.ends_with("/texts"), "{form}");
    let (status, answer) = guarded.post(&form, "note=%3Cb%3Eone%0D%0Atwo&tags=gpu%2C+b++gpu").await;
    assert!(status == 303 && answer.to_lowercase().contains("location: /studies/hall\r\n"), "{answer}");
    let name = "studies/hall".to_owned();
    let stored = caller.get_study(wire::GetStudyRequest { name }).await.expect("there").into_inner();
    assert_eq!((stored.note.as_str(), stored.tags.join(" ").as_str()), ("<b>one\ntwo", "b gpu"));
    let page = guarded.get("/studies/hall").await.1;
    for part in [
        "<p class=\"lines\">&#60;b&#62;one\ntwo</p>",
        "<a href=\"/?tag=gpu\">gpu</a>",
        "value=\"b gpu\"",
        "maxlength=\"4096\">\n&#60;b&#62;one\ntwo</textarea>",
        "name=\"note_shown\" value=\"&#60;b&#62;one\ntwo\"",
    ] {
        assert!(page.contains(part), "{part} is not in {page}");
    }
    // Of a page that is older than what is stored.
    let old = "note_shown=cold&tags_shown=gpu+b";
    let (status, answer) = guarded.post(&form, &format!("note=cold&tags=b+gpu&{old}")).await;
    assert_eq!(status, 303, "nothing was written: {answer}");
    let name = "studies/hall".to_owned();
    let now = caller.get_study(wire::GetStudyRequest { name }).await.expect("there").into_inner();
    assert_eq!((now.note, now.tags, now.policy), (stored.note, stored.tags, stored.policy));
    let (status, answer) = guarded.post(&form, &format!("note=colder&tags=gpu+b&{old}")).await;
    assert!(status == 409 && answer.contains("changed the note of study"), "{answer}");
    let page = guarded.get("/studies/hall").await.1;
    assert!(page.contains("one\ntwo</p>") && page.contains("value=\"b gpu\""), "{page}");
    let rows = |list: &str| list.matches("<th scope=\"row\">").count();
    let list = guarded.get("/?tag=gpu").await.1;
    assert!(rows(&list) == 1 && list.contains("<a href=\"/?tag=b\">b</a>"), "{list}");
    assert_eq!(rows(&guarded.get("/").await.1), 2);
    assert!(guarded.get("/?tag=g").await.1.contains("There are none."));
    assert_eq!(guarded.get("/?tags=gpu").await.0, 400, "a mistyped name");
    let (status, answer) = guarded.post(&form, "note=&tags=a%2Fb").await;
    assert!(status == 400 && answer.contains("must be 1 to 32 letters"), "{answer}");
}

#[tokio::test]
async fn a_list_of_studies_tells_gains_that_change_with_their_trials() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    let (status, answer) = guarded.get("/").await;
    assert!(status == 200 && answer.contains("No studies yet"), "{answer}");
    measured(&mut caller).await;
    let mut list = String::new();
    for _ in 0..200 {
        list = guarded.get("/?order=Gain").await.1;
        if list.contains("below the default, ") {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert!(list.contains("below the default, "), "the default is the answer: {list}");
    assert!(list.contains("0.0 %"), "{list}");
    assert_eq!(guarded.post("/studies/hall/policy", "field=operation&value=freeze").await.0, 303);
    assert!(guarded.get("/").await.1.contains(">frozen</td>"), "at once");
}

#[tokio::test]
async fn a_long_list_is_paged_and_told_in_json() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    for number in 0..=DASHBOARD_ROWS {
        let id = format!("hall-{number:03}");
        caller.create_study(creation(&id, study())).await.expect("created");
    }
    let rows = |answer: &str| answer.matches("<th scope=\"row\">").count();
    let (status, answer) = guarded.get("/").await;
    assert!(status == 200 && rows(&answer) == DASHBOARD_ROWS, "{status}, {} rows", rows(&answer));
    assert!(answer.contains("Page 1 of 2") && answer.contains("rel=\"next\""), "{answer}");
    let (status, answer) = guarded.get("/?order=Study&reverse=1&page=2").await;
    assert!(status == 200 && rows(&answer) == 1 && answer.contains(">hall-000</a>"), "{answer}");
    assert_eq!(guarded.get("/?page=3").await.0, 400);
    for path in ["/studies.json", "/studies/hall/policy", "/studies/hall/trials/1"] {
        let (status, answer) = guarded.get(&format!("{path}?page=1")).await;
        assert_eq!(status, 400, "{path}: {answer}");
        assert!(answer.contains("this page does not know it; leave it out"), "{path}: {answer}");
    }
    let (status, answer) = guarded.get("/studies.json").await;
    let body = answer.split("\r\n\r\n").nth(1).expect("a body");
    let told: serde_json::Value = serde_json::from_str(body).expect("JSON");
    assert_eq!((status, told["studies"].as_array().map(Vec::len)), (200, Some(DASHBOARD_ROWS + 1)));
    assert_eq!(told["studies"][0]["id"], "hall-000");
    assert_eq!(told["studies"][0]["status"], "new");
}

#[tokio::test]
async fn who_may_see_some_studies_sees_none_of_other_daemons() {
    let clock = Arc::new(ManualClock::at(START_MS));
    for (studies, is_told) in [(Vec::new(), true), (vec!["hall".to_owned()], false)] {
        let (options, pages, token) = options(&clock, studies).await;
        let gone =
            DashboardPeer { name: "gone".to_owned(), authority: "127.0.0.1:1".to_owned(), token: None };
        let options = Options { dashboard_peers: vec![gone], ..options };
        let server = Server::with_options(Arc::new(MemoryStore::new()), Arc::clone(&clock), options).await;
        let guarded = Guarded { server, pages, token };
        let (status, answer) = guarded.get("/").await;
        assert_eq!((status, answer.contains("gone</a> is away: ")), (200, is_told), "{answer}");
    }
}

#[tokio::test]
async fn a_metric_called_gain_hides_no_map() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    let objective = wire::Objective {
        terms: vec![wire::ObjectiveTerm { metric: "gain".to_owned(), weight: 1.0 }],
        maximised: vec!["gain".to_owned()],
        ..wire::Objective::default()
    };
    let maximising = wire::Study { objective: Some(objective), ..study() };
    caller.create_study(creation("hall", maximising)).await.expect("created");
    let trial = caller.suggest(ask("a", 10.0)).await.expect("a trial").into_inner().name;
    let measurements = BTreeMap::from([("gain".to_owned(), 50.0)]);
    let outcome = common::ok();
    let measured = wire::ReportRequest { trial, measurements, outcome, ..Default::default() };
    caller.report(measured).await.expect("taken");
    for (asked, selected, shown) in [
        ("", "value=\"gain\" selected>gain over the default<", "coloured by its gain over the default"),
        ("gain", "value=\"gain\" selected>", "coloured by its gain over the default"),
        ("cost", "value=\"cost\" selected>gain<", "state 1: gain (higher is better) "),
        ("max_leaf", "value=\"config.max_leaf\" selected>max_leaf<", "the value of max_leaf in its best"),
        ("config.max_leaf", "value=\"config.max_leaf\" selected>", "state 1: max_leaf="),
    ] {
        let (status, answer) = guarded.get(&format!("/studies/hall/map?show={asked}")).await;
        assert_eq!(status, 200, "{asked}: {answer}");
        assert!(answer.contains(selected) && answer.contains(shown), "{asked}: {answer}");
        let colours = answer.split("<select name=\"show\"").nth(1).expect("a list to choose from");
        assert_eq!(colours.matches(" selected").count(), 1, "{asked}: {answer}");
    }
}

/// A run of the study `lists`, which was made for a front.
async fn list(caller: &mut Caller, direction: f64, max_leaf: i64, metrics: [f64; 2], origin: &str) {
    let request = wire::SuggestRequest {
        study: "studies/lists".to_owned(),
        indicators: BTreeMap::from([("direction".to_owned(), direction)]),
        wanted: Some(configuration(max_leaf, "low")),
        origin: origin.to_owned(),
        ..ask("a", 0.0)
    };
    let trial = caller.suggest(request).await.expect("a trial").into_inner().name;
    let [time_ms, memory_mb] = metrics;
    let measurements = [("time_ms", time_ms), ("memory_mb", memory_mb), ("front_cost", time_ms)];
    let measurements = measurements.map(|(name, value)| (name.to_owned(), value)).into();
    let outcome = common::ok();
    let report = wire::ReportRequest { trial, measurements, outcome, ..Default::default() };
    caller.report(report).await.expect("taken");
}

#[tokio::test]
async fn a_front_is_shown_where_one_was_looked_for() {
    let guarded = Guarded::start(Arc::new(MemoryStore::new())).await;
    let mut caller = guarded.caller().await;
    let objective = wire::Objective {
        terms: vec![wire::ObjectiveTerm { metric: "front_cost".to_owned(), weight: 1.0 }],
        ..wire::Objective::default()
    };
    let made = wire::Study {
        display_name: "front of time_ms, memory_mb".to_owned(),
        indicators: vec![wire::Indicator { name: "direction".to_owned(), min: 0.0, max: 8.0, scale: 0 }],
        objective: Some(objective),
        ..study()
    };
    caller.create_study(creation("lists", made)).await.expect("created");
    let (status, answer) = guarded.get("/studies/lists/front").await;
    assert!(status == 200 && answer.contains("No run measured all of time_ms, memory_mb."), "{answer}");
    list(&mut caller, 0.0, 8, [8.0, 9.0], "").await;
    list(&mut caller, 0.0, 1, [4.0, 4.5], "").await;
    list(&mut caller, 1.0, 16, [9.0, 3.0], "").await;
    list(&mut caller, 1.0, 1, [4.0, 4.5], "studies/lists/trials/2").await;
    let (_, overview) = guarded.get("/studies/lists").await;
    assert!(overview.contains("href=\"/studies/lists/front\""), "{overview}");
    let (status, answer) = guarded.get("/studies/lists/front").await;
    assert_eq!(status, 200, "{answer}");
    for words in [
        "2 of 3 configurations are on the front, by the medians of 3 runs on a fast one, 2 threads.",
        "They leave behind 0.250 of the box",
        "<title>max_leaf=1: time_ms 4, memory_mb 4.500</title>",
        "time_ms (lower is better)",
        "<td class=\"figure\">0.500</td><td class=\"figure\">1</td><td class=\"values\">max_leaf=1</td>",
        "<td class=\"values\">the default</td>",
    ] {
        assert!(answer.contains(words), "{words} is not in {answer}");
    }
    // The default is dominated, and marked; the legend has three names.
    assert_eq!((answer.matches("<circle").count(), answer.matches("<tr><td").count()), (7, 3), "{answer}");

    // The states of other studies are different inputs; these are shown on request.
    measured(&mut caller).await;
    let (_, overview) = guarded.get("/studies/hall").await;
    assert!(!overview.contains("/studies/hall/front"), "{overview}");
    let (status, answer) = guarded.get("/studies/hall/front?metrics=render_ms,build_ms").await;
    assert!(status == 200 && answer.contains("1 of 1 configurations"), "{answer}");
    assert!(answer.contains("1 runs of state 1 (a fast one, 2 threads)"), "{answer}");
    for (asked, words) in [
        ("metrics=render_ms", "name two or three"),
        ("metrics=render_ms,build_ms&state=9", "leave it out"),
        ("metric=render_ms", "use metrics, state"),
    ] {
        let (status, answer) = guarded.get(&format!("/studies/hall/front?{asked}")).await;
        assert!(status == 400 && answer.contains(words), "{asked}: {answer}");
    }
}

/// Trials of the long study that are measured, an even number for each of its four states.
const MEASURED: u32 = 160;
/// How often their number is doubled.
const DOUBLINGS: u32 = 7;
/// The longest that a page of it may take, in a development build beside other work. The goal is 200 ms, in a
/// release build on a machine of its own.
const PAGE_LIMIT: Duration = Duration::from_secs(2);

/// Gives each trial of a database that no server uses a copy under a new number, several times.
async fn double_trials(path: &Path, times: u32) {
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(path);
    let mut database = sqlx::SqliteConnection::connect_with(&options).await.expect("a database");
    for _ in 0..times {
        for statement in [
            "CREATE TEMP TABLE copies AS SELECT * FROM trials",
            "UPDATE copies SET number = number + (SELECT max(number) FROM trials), \
             completion = completion + (SELECT max(completion) FROM trials)",
            "INSERT INTO trials SELECT * FROM copies ORDER BY number",
            "DROP TABLE copies",
        ] {
            database.execute(statement).await.expect("the rows are taken");
        }
    }
    database.close().await.expect("it is closed");
}

#[tokio::test]
async fn pages_of_twenty_thousand_trials_are_answered_soon() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tuning.db");
    let server = Server::on_disk(&path, START_MS).await;
    let mut client = server.client().await;
    let search = wire::SearchMethod::Random as i32;
    let policy = wire::Policy { epsilon: Some(1.0), search, ..wire::Policy::default() };
    let made = wire::Study { policy: Some(policy), ..study() };
    client.create_study(creation("hall", made)).await.expect("created");
    for step in 0..MEASURED {
        let triangles = 10.0 + 25.0 * f64::from(step % 4);
        let trial = suggest(&mut client, "a", triangles).await;
        done(&mut client, &trial.name, 5.0 + f64::from(step * 7919 % 101) / 50.0).await;
    }
    drop(client);
    server.stop().await;
    double_trials(&path, DOUBLINGS).await;

    let guarded = Guarded::start(Arc::new(SqliteStore::open(&path).await.expect("a database"))).await;
    let mut caller = guarded.caller().await;
    let begun = Instant::now();
    let asked = || wire::GetBestRequest { study: "studies/hall".to_owned(), ..Default::default() };
    while let Err(refused) = caller.get_best(asked()).await {
        assert_eq!(refused.code(), Code::Unavailable, "{refused}");
        assert!(begun.elapsed() < Duration::from_secs(180), "the study is not read: {refused}");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let newest = format!("/studies/hall/trials/{}", MEASURED << DOUBLINGS);
    for (page, words) in [
        ("/", "hall"),
        ("/studies/hall", "Tuning curve"),
        ("/studies/hall?state=1", "Tuning curve"),
        ("/studies/hall/parameters?state=1", "Importances"),
        ("/studies/hall/map", "triangles"),
        ("/studies/hall/front?metrics=render_ms,build_ms", "on the front"),
        ("/studies/hall/trials", newest.as_str()),
        ("/studies/hall/trials?filter=cost%20%3C%205.5&order=cost", "Next page"),
        (newest.as_str(), "Measurements"),
        ("/studies/hall/policy", "epsilon"),
        ("/compare?study=hall", "hall"),
    ] {
        let mut least = Duration::MAX;
        for _ in 0..3 {
            let begun = Instant::now();
            let (status, answer) = guarded.get(page).await;
            least = least.min(begun.elapsed());
            assert!(status == 200 && answer.contains(words), "{page}: {answer}");
        }
        assert!(least < PAGE_LIMIT, "{page} took {least:?}");
    }
    drop(caller);
    guarded.server.stop().await;
}
