//! The dashboard over HTTP: pages, headers, tokens, escaping, and events of changes.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use treewright_tests::programs::token;

use crate::site::{Site, ask, say, wait_until};

pub(crate) struct Answer {
    status: u16,
    head: String,
    body: String,
}

fn request(address: &str, request: &str) -> Answer {
    let mut stream = TcpStream::connect(address).expect("the dashboard listens");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a time limit");
    stream.write_all(request.as_bytes()).expect("it is sent");
    let mut text = String::new();
    stream.read_to_string(&mut text).expect("an answer in text");
    let (head, body) = text.split_once("\r\n\r\n").expect("a head");
    let status = head.split(' ').nth(1).and_then(|code| code.parse().ok()).expect("a status");
    Answer { status, head: head.to_lowercase(), body: body.to_owned() }
}

pub(crate) fn get(address: &str, path: &str, more: &str) -> Answer {
    request(address, &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{more}\r\n"))
}

/// Sends a form, with further lines of the head.
fn post(address: &str, path: &str, more: &str, form: &str) -> Answer {
    let head = format!("POST {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{more}");
    request(address, &format!("{head}Content-Length: {}\r\n\r\n{form}", form.len()))
}

/// Where a daemon says in its log that it serves its metrics.
pub(crate) fn metrics(site: &Site) -> String {
    let text = site.log();
    let line = text.lines().find(|line| line.contains("metrics are served")).expect("it says where");
    let address = line.split("address=").nth(1).and_then(|rest| rest.split_whitespace().next());
    address.expect("an address").to_owned()
}

/// A daemon with a dashboard, and where that is.
pub(crate) fn start(more: &[&str]) -> (Site, String) {
    let site = Site::with(&[&["--dashboard", "127.0.0.1:0"], more].concat());
    let log = site.log();
    let url = log.split("url=http://").nth(1).expect("the log names the dashboard");
    let address = url.split('/').next().expect("an address").to_owned();
    (site, address)
}

pub(crate) fn measure(url: &str, reports: &[&str]) {
    for report in reports {
        let trial = ask(url, &["suggest", "toy"]);
        let mut all = vec!["report", trial["name"].as_str().expect("a name")];
        all.extend(report.split('|'));
        say(url, &all);
    }
}

pub(crate) fn create(site: &Site) {
    let study = "display_name = \"<script>alert(1)</script>\"\n\
                 [[parameters]]\nname = \"level\"\ntype = \"integer\"\nmin = 1\nmax = 30\ndefault = 3\n\
                 [[parameters]]\nname = \"kind\"\ntype = \"categorical\"\nvalues = [\"<b>\", \"plain\"]\ndefault = \"<b>\"\n\
                 [[objective]]\nmetric = \"loss\"\n[policy]\nepsilon = 1\n";
    create_of(site, "toy", study);
}

pub(crate) fn create_of(site: &Site, name: &str, study: &str) {
    let file = site.write(&format!("{name}.toml"), study);
    say(site.url(), &["study", "create", &file]);
}

#[test]
fn pages_show_what_is_known_and_nothing_that_is_written_there_becomes_markup() {
    let (site, address) = start(&[]);
    create(&site);
    let mut reports = vec!["loss=10", "loss=4", "loss=6", "--infeasible|<img src=x>"];
    reports.extend(["loss=5", "loss=7", "loss=8", "loss=9", "loss=3", "loss=5.5"]);
    measure(site.url(), &reports);
    // Summaries are made in the background.
    wait_until("a summary", || get(&address, "/", "").body.contains(">searching</td>"));
    for (path, words) in [
        ("/", &["<h1>Studies</h1>", "/studies/toy", "&#60;script&#62;"][..]),
        ("/?order=Gain&reverse=1", &["aria-sort=\"ascending\"><a href=\"/?order=Gain\">", ">searching</td>"]),
        (
            "/studies/toy",
            &[
                "Tuning curve",
                "<title>best so far</title>",
                "Below the default [95 %]",
                "roofline",
                "State 1: ",
                "by all measurements the answer is at ",
                "&#60;img src=x&#62;",
                "shell@",
            ],
        ),
        ("/studies/toy?state=1", &["of state 1"]),
        (
            "/studies/toy/parameters",
            &["Importances", "Parallel coordinates", "Contour", "9 measurements in state 1"],
        ),
        ("/studies/toy/trials", &["INFEASIBLE", "level=", "the default"]),
        ("/studies/toy/trials?filter=cost%20%3C%205&order=cost", &[">3<", ">4<"]),
        (
            "/studies/toy/trials/1",
            &["The baseline comes first", "<dt>Rule</dt>", "Measurements", "&#60;b&#62;"],
        ),
        ("/studies/toy/policy", &["epsilon", "1 × loss"]),
        ("/style.css", &["prefers-color-scheme: dark"]),
    ] {
        let answer = get(&address, path, "");
        assert_eq!(answer.status, 200, "{path}: {}", answer.body);
        for word in words {
            assert!(answer.body.contains(word), "{path} lacks {word}: {}", answer.body);
        }
        for bad in ["<script>alert", "<img", "<b>\"", "=<b>"] {
            assert!(!answer.body.contains(bad), "{path} holds {bad}");
        }
        for header in [
            "content-security-policy: default-src 'none'",
            "x-content-type-options: nosniff",
            "referrer-policy: same-origin",
        ] {
            assert!(answer.head.contains(header), "{path} lacks {header}: {}", answer.head);
        }
        // Nothing that the policy would have the browser refuse.
        assert!(!answer.body.contains(" style=\"") && !answer.body.contains("onclick"), "{path}");
    }
    let wrong = get(&address, "/studies/toy/trials?filter=rubbish", "");
    assert_eq!(wrong.status, 400);
    assert!(wrong.body.contains("character 1") && wrong.body.contains("role=\"alert\""), "{}", wrong.body);
    for (path, words) in [
        ("/studies/toy?state=x", &["state: ", "leave it out"][..]),
        ("/studies/toy?state=99", &["1 states", "leave it out"]),
        ("/studies/toy?from=0", &["from: ", "leave it out"]),
        ("/studies/toy?stat=1", &["stat: ", "use state, from"]),
        ("/studies/toy/map?show=nonsense", &["config.NAME"]),
        ("/studies/toy/parameters?x=colour", &["colour", "leave it out"]),
        ("/studies/toy/parameters?state=99", &["leave it out"]),
        ("/studies/toy/trials?sort=cost", &["use filter, order, page"]),
        ("/compare?studies=toy", &["use study"]),
        ("/?order=gain", &["Study, Daemon, Gain"]),
        ("/?page=2", &["1 to 1"]),
    ] {
        let answer = get(&address, path, "");
        assert_eq!(answer.status, 400, "{path}: {}", answer.body);
        assert!(words.iter().all(|word| answer.body.contains(word)), "{path}: {}", answer.body);
    }
    let few = get(&address, "/studies/toy/trials?filter=cost%20%3C%205", "").body;
    assert_eq!(few.matches("<tr><th scope=\"row\">").count(), 2, "{few}");
    assert_eq!(get(&address, "/studies/atlantis", "").status, 404);
    assert_eq!(get(&address, "/compare?study=atlantis", "").status, 404);
    assert_eq!(get(&address, "/studies/atlantis/map", "").status, 404);
    assert_eq!(get(&address, "/studies/toy/trials/99", "").status, 404);
    assert_eq!(get(&address, "/nowhere", "").status, 404);
    assert_eq!(post(&address, "/studies/toy", "", "").status, 405);
    let foreign = "GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert_eq!(request(&address, foreign).status, 421, "a name of the Internet that leads here");
}

#[test]
fn one_list_holds_the_studies_of_other_daemons() {
    let (one, first) = start(&[]);
    create(&one);
    measure(one.url(), &["loss=10", "loss=4"]);
    let (two, second) = start(&["--tokens"]);
    let shown = token(&two.database(), &["--scope", "read"]);
    let peers = format!("farm=http://{first},guarded=http://{second},gone=http://127.0.0.1:1");
    let named = format!("guarded={}", two.write("token", &shown));
    let (third, address) = start(&["--dashboard-peers", &peers, "--dashboard-token-files", &named]);
    // The second daemon follows its database, where the token was just made.
    let mut list = String::new();
    wait_until("a summary of one, and the token of the other", || {
        list = get(&address, "/", "").body;
        list.contains(">searching</td>") && !list.contains("guarded</a> is away")
    });
    for word in [
        &format!("href=\"http://{first}/studies/toy\"")[..],
        "<td>farm</td>",
        "below the default",
        "&#60;script&#62;",
        "gone</a> is away: ",
    ] {
        assert!(list.contains(word), "{word} is not in {list}");
    }
    assert!(!list.contains("type=\"checkbox\""), "only own studies can be compared: {list}");
    assert!(!list.contains("tw1_"), "no page holds a token");
    assert!(!third.log().contains(&shown), "nor does the log");
    // A request cannot name another address.
    assert_eq!(get(&address, &format!("/?dashboard-peers=x=http://{first}"), "").status, 400);
}

#[test]
fn what_is_maximised_is_shown_in_its_own_unit() {
    let (site, address) = start(&[]);
    let study = "[[parameters]]\nname = \"level\"\ntype = \"integer\"\nmin = 1\nmax = 30\ndefault = 3\n\
                 [[objective]]\nmetric = \"fps\"\nmaximise = true\n[policy]\nepsilon = 1\n";
    create_of(&site, "toy", study);
    measure(site.url(), &["fps=50", "fps=80", "fps=40"]);
    for (path, words) in [
        (
            "/studies/toy",
            &[
                "fps (higher is better) in state 1",
                "Above the default [95 %]",
                "fps (higher is better)</text>",
            ][..],
        ),
        ("/studies/toy/trials", &["fps (higher is better)</th>", ">80<", "measurement.fps desc"]),
        ("/studies/toy/trials/2", &["<dt>fps (higher is better)</dt><dd>80</dd>"]),
        ("/studies/toy/parameters", &["fps (higher is better)</text>"]),
        ("/studies/toy/policy", &["The study maximises fps"]),
        (
            "/compare?study=toy",
            &["toy: 0.625 (fps 1.600 times the default’s)", "Answers beside the default", " above</td>"],
        ),
    ] {
        let answer = get(&address, path, "");
        assert_eq!(answer.status, 200, "{path}: {}", answer.body);
        for word in words {
            assert!(answer.body.contains(word), "{path} lacks {word}: {}", answer.body);
        }
        assert!(!answer.body.contains("0.0125"), "{path} tells a cost: {}", answer.body);
    }
    let printed = |command: &[&str]| say(site.url(), command);
    assert!(printed(&["trials", "toy"]).contains("fps (higher is better)"));
    let table = printed(&["trials", "toy", "--format", "csv"]);
    assert!(table.lines().next().is_some_and(|head| head.contains("value")));
    assert!(printed(&["best", "toy"]).starts_with("fps (higher is better)"));
    assert!(printed(&["explain", "toy/trials/2"]).contains("fps 80"));
    let best = ask(site.url(), &["best", "toy"]);
    assert_eq!(best["default_value"], 50.0, "{best}");
}

#[test]
fn what_changes_is_told() {
    let (site, address) = start(&[]);
    create(&site);
    let mut stream = TcpStream::connect(&address).expect("the dashboard listens");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a time limit");
    let request = format!("GET /studies/toy/events HTTP/1.1\r\nHost: {address}\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("it is sent");
    let mut lines = BufReader::new(stream).lines().map(|line| line.expect("a line"));
    assert!(lines.any(|line| line == ":"), "it is looked at");
    measure(site.url(), &["loss=10"]);
    assert!(lines.any(|line| line == "event: change"));
}

#[test]
fn who_shows_no_token_sees_nothing_and_who_shows_one_uses_up_its_quota() {
    let (site, address) = start(&["--tokens", "--metrics", "127.0.0.1:0"]);
    let token = |more: &[&str]| token(&site.database(), &[&["--scope", "read"], more].concat());
    // The one that is waited for below is the last, so that the daemon knows all then.
    let (narrow, slow) = (token(&["--study", "other"]), token(&["--requests-per-s", "2"]));
    let good = token(&[]);
    for path in ["/", "/studies/toy", "/events", "/studies/toy/trials/1"] {
        let answer = get(&address, path, "");
        assert_eq!(answer.status, 303, "{path}");
        assert!(answer.head.contains("location: /login") && answer.body.is_empty());
    }
    let log_in = |token: &str| post(&address, "/login", "", &format!("token={token}"));
    // A form of another site logs nobody in, and nobody out.
    for path in ["/login", "/logout"] {
        let answer = post(&address, path, "Origin: http://evil.example\r\n", &format!("token={good}"));
        assert_eq!((answer.status, answer.head.contains("set-cookie")), (403, false), "{path}");
    }
    // The daemon follows the database, where the token was just made.
    wait_until("the token comes into force", || log_in(&good).status != 401);
    let right = log_in(&good);
    assert_eq!(right.status, 303);
    assert!(right.head.contains("httponly; samesite=strict"), "{}", right.head);
    let cookie = |token: &str| format!("Cookie: treewright_token={token}\r\n");
    let seen = |token: &str, path: &str| get(&address, path, &cookie(token)).status;
    assert_eq!(seen(&good, "/"), 200);
    assert_eq!((seen(&narrow, "/"), seen(&narrow, "/studies/toy")), (200, 403));
    let bearer = get(&address, "/", &format!("Authorization: Bearer {good}\r\n"));
    assert_eq!(bearer.status, 200);

    let metrics = metrics(&site);
    let counted = |reason: &str| {
        let text = get(&metrics, "/metrics", "").body;
        let name = format!("treewright_refusals_total{{reason=\"{reason}\"}} ");
        let line = text.lines().find_map(|line| line.strip_prefix(&name)).expect("it is counted");
        line.parse::<u64>().expect("a number")
    };
    let before = counted("token");
    for _ in 0..3 {
        let wrong = log_in("tw1_wrong");
        assert_eq!((wrong.status, wrong.head.contains("set-cookie")), (401, false));
    }
    assert_eq!(seen("tw1_wrong", "/"), 303);
    assert_eq!(counted("token"), before + 4);
    assert!(site.log().contains("request refused"), "{}", site.log());
    let answers: Vec<Answer> = (0..12).map(|_| get(&address, "/", &cookie(&slow))).collect();
    let refused: Vec<&Answer> = answers.iter().filter(|answer| answer.status == 429).collect();
    assert_eq!(answers[0].status, 200);
    assert!(!refused.is_empty() && refused[0].head.contains("retry-after: 1"), "{}", answers[11].head);
    assert!(counted("quota") >= refused.len() as u64);
    assert!(site.daemon.terminate().success());
}

#[test]
fn a_token_that_may_change_a_study_steers_it_from_its_pages() {
    let (site, address) = start(&["--tokens"]);
    let database = site.database();
    let reads = token(&database, &["--scope", "read"]);
    let admin = token(&database, &["--scope", "admin"]);
    let file = site.write("token", &admin);
    let shell = |given: &[&str]| say(site.url(), &[&["--token-file", file.as_str()], given].concat());
    // The daemon follows the database, where the tokens were just made.
    let cookie = |token: &str| format!("Cookie: treewright_token={token}\r\n");
    wait_until("the token comes into force", || get(&address, "/", &cookie(&admin)).status == 200);
    let study = "[[parameters]]\nname = \"level\"\ntype = \"integer\"\nmin = 1\nmax = 30\ndefault = 3\n\
                 [[objective]]\nmetric = \"loss\"\n";
    shell(&["study", "create", &site.write("toy.toml", study)]);
    shell(&["--json", "suggest", "toy"]);
    shell(&["report", "studies/toy/trials/1", "loss=10"]);
    let send = |token: &str, path: &str, form: &str, origin: &str| {
        post(&address, path, &format!("{}Origin: {origin}\r\n", cookie(token)), form)
    };
    let own = format!("http://{address}");
    let page = |token: &str, path: &str| get(&address, path, &cookie(token)).body;
    let policy = "/studies/toy/policy";
    assert!(page(&admin, policy).contains("Freeze: ") && !page(&reads, policy).contains("Freeze: "));
    // Neither a token that only reads, nor a page of another site, nor a mistake changes anything.
    let freeze = "field=operation&value=freeze";
    assert_eq!(send(&reads, policy, freeze, &own).status, 403);
    assert_eq!(send(&admin, policy, freeze, "http://evil.example").status, 403);
    assert_eq!(send(&admin, policy, freeze, "null").status, 403);
    assert_eq!(send("tw1_wrong", policy, freeze, &own).status, 303);
    assert_eq!(send(&admin, policy, "field=epsilon&value=2", &own).status, 400);
    assert_eq!(send(&admin, policy, "field=colour&value=", &own).status, 400);
    assert_eq!(send(&admin, "/studies/toy/trials/99/pin", "", &own).status, 404);
    assert_eq!(send(&admin, "/studies/toy", "", &own).status, 405);
    let shown = || shell(&["--json", "policy", "toy"]);
    let is_frozen = || shown().contains("\"operation\": \"freeze\"");
    assert!(!is_frozen(), "{}", shown());
    let frozen = send(&admin, policy, freeze, &own);
    assert!(frozen.status == 303 && frozen.head.contains("location: /studies/toy/policy"), "{}", frozen.head);
    assert!(is_frozen() && page(&admin, policy).contains("Thaw: "), "{}", shown());
    assert_eq!(send(&admin, policy, "field=operation&value=", &own).status, 303);
    assert_eq!(send(&admin, policy, "field=epsilon&value=0.5", &own).status, 303);
    assert_eq!(send(&admin, "/studies/toy/trials/1/pin", "", &own).status, 303);
    assert!(!is_frozen() && shown().contains("0.5"), "{}", shown());
    assert!(page(&admin, policy).contains("Unpin: "));
    assert!(page(&admin, "/?order=Trials").contains("descending"));
    assert_eq!(send(&admin, policy, "field=pinned&value=", &own).status, 303);
    assert!(!page(&admin, policy).contains("Unpin: "));
}
