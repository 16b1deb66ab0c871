//! The dashboard in a browser: headless Chromium through its WebDriver. Where either is missing, the test
//! says so and is skipped. `TREEWRIGHT_SCREENSHOTS=FOLDER` keeps a picture of every page, wide and narrow,
//! light and dark, and as it looks under deuteranopia.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use treewright_tests::programs::token;
use treewright_tests::sandbox::skip;

use crate::dashboard;
use crate::site::{Site, ask, say};

/// Longest wait for something that should happen by itself.
const PATIENCE: Duration = Duration::from_secs(30);
/// Keys of the WebDriver protocol (17.4.2, "Keyboard actions").
const TAB: &str = "\u{E004}";
const ENTER: &str = "\u{E007}";
/// The name of an element's reference, by the protocol.
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";

/// Headless Chromium behind its driver, both ended when dropped. The protocol is that of the W3C (WebDriver,
/// 2018): JSON over HTTP, of which a handful of commands is needed.
struct Browser {
    driver: Child,
    address: String,
    session: String,
}

impl Drop for Browser {
    fn drop(&mut self) {
        if !self.session.is_empty() {
            let _ = self.call("DELETE", "", None);
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

impl Browser {
    /// Starts one; else why there is none.
    fn start() -> Result<Self, String> {
        let mut start = Command::new("chromedriver");
        let started = start.arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut driver = started.map_err(|_| "chromedriver is not installed (Debian: chromium-driver)")?;
        let lines = BufReader::new(driver.stdout.take().expect("it is piped")).lines();
        let port = lines.map_while(Result::ok).find_map(|line| {
            let rest = line.split("successfully on port ").nth(1)?;
            rest.trim_end_matches('.').parse::<u16>().ok()
        });
        let address = format!("127.0.0.1:{}", port.unwrap_or_default());
        let mut browser = Self { driver, address, session: String::new() };
        if port.is_none() {
            return Err("chromedriver did not start".to_owned());
        }
        let options = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"];
        let wish = json!({ "capabilities": { "alwaysMatch": {
            "goog:chromeOptions": { "args": options }, "goog:loggingPrefs": { "browser": "ALL" },
        } } });
        let made =
            browser.call("POST", "", Some(&wish)).map_err(|why| format!("Chromium does not start: {why}"))?;
        browser.session = format!("/{}", made["sessionId"].as_str().ok_or("there is no session")?);
        Ok(browser)
    }

    /// A command of the session; else what the driver says against it.
    fn call(&self, method: &str, command: &str, body: Option<&Value>) -> Result<Value, String> {
        let (session, address) = (&self.session, &self.address);
        let body = body.map(Value::to_string).unwrap_or_default();
        let length = body.len();
        let request = format!(
            "{method} /session{session}{command} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Type: \
             application/json\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        let (status, body) = exchange(address, &request).map_err(|problem| problem.to_string())?;
        let mut said: Value = serde_json::from_slice(&body).map_err(|problem| problem.to_string())?;
        match status {
            200 => Ok(said["value"].take()),
            _ => Err(said["value"]["message"].to_string()),
        }
    }

    fn post(&self, command: &str, body: &Value) -> Value {
        self.call("POST", command, Some(body)).unwrap_or_else(|problem| panic!("{command}: {problem}"))
    }

    fn goto(&self, url: String) {
        self.post("/url", &json!({ "url": url }));
    }

    fn evaluate(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": script, "args": [] }))
    }

    fn says(&self, script: &str) -> String {
        self.evaluate(script).as_str().unwrap_or_default().to_owned()
    }

    /// Evaluates a script until it says true. A page that is just being left says nothing.
    fn becomes(&self, script: &str) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            let said = self.call("POST", "/execute/sync", Some(&json!({ "script": script, "args": [] })));
            if said.is_ok_and(|said| said == Value::Bool(true)) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        false
    }

    /// A command of Chromium's own protocol.
    fn tool(&self, command: &str, parameters: &Value) -> Value {
        self.post("/goog/cdp/execute", &json!({ "cmd": command, "params": parameters }))
    }

    fn find_all(&self, css: &str) -> Vec<String> {
        let found = self.post("/elements", &json!({ "using": "css selector", "value": css }));
        let list = found.as_array().expect("a list").iter();
        list.map(|one| one[ELEMENT].as_str().expect("an element").to_owned()).collect()
    }

    fn find(&self, css: &str) -> String {
        self.find_all(css).into_iter().next().unwrap_or_else(|| panic!("{css} is not there"))
    }

    fn click(&self, element: &str) {
        self.post(&format!("/element/{element}/click"), &json!({}));
    }

    fn type_into(&self, css: &str, text: &str) {
        let element = self.find(css);
        self.post(&format!("/element/{element}/clear"), &json!({}));
        self.post(&format!("/element/{element}/value"), &json!({ "text": text }));
    }

    /// A key for the element that has the focus.
    fn press(&self, key: &str) {
        let strokes = json!([{ "type": "keyDown", "value": key }, { "type": "keyUp", "value": key }]);
        self.post(
            "/actions",
            &json!({ "actions": [{ "type": "key", "id": "keyboard", "actions": strokes }] }),
        );
    }

    /// The complaints of the browser since the last call.
    fn complaints(&self) -> Vec<String> {
        let log = self.post("/se/log", &json!({ "type": "browser" }));
        let bad = |entry: &&Value| matches!(entry["level"].as_str(), Some("SEVERE" | "WARNING"));
        log.as_array().expect("a list").iter().filter(bad).map(|entry| entry["message"].to_string()).collect()
    }

    fn is_content(&self) {
        assert_eq!(self.complaints(), Vec::<String>::new());
    }
}

/// One request and its answer. The answer's head gives its length, because the driver keeps connections open.
fn exchange(address: &str, request: &str) -> std::io::Result<(u16, Vec<u8>)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(2 * PATIENCE))?;
    stream.write_all(request.as_bytes())?;
    let mut answer = BufReader::new(stream);
    let (mut line, mut status, mut length) = (String::new(), 0, 0);
    while answer.read_line(&mut line)? > 2 {
        let lower = line.trim().to_lowercase();
        if let Some(rest) = lower.strip_prefix("http/1.1 ") {
            status = rest.split(' ').next().and_then(|code| code.parse().ok()).unwrap_or(0);
        }
        if let Some(rest) = lower.strip_prefix("content-length:") {
            length = rest.trim().parse().unwrap_or(0);
        }
        line.clear();
    }
    let mut body = vec![0; length];
    answer.read_exact(&mut body)?;
    Ok((status, body))
}

/// A study of several states, in which some trials were measured.
fn scenes(site: &Site) {
    let study = "display_name = \"Two scenes, four sizes\"\n\
                 [[parameters]]\nname = \"min_leaf_size\"\ntype = \"integer\"\nmin = 1\nmax = 16\ndefault = 1\n\
                 [[parameters]]\nname = \"max_leaf_size\"\ntype = \"integer\"\nmin = 1\nmax = 32\ndefault = 32\n\
                 [[indicators]]\nname = \"triangles\"\nmin = 0\nmax = 1000000\nscale = \"log\"\n\
                 [[indicators]]\nname = \"occlusion\"\nmin = 0\nmax = 1\n\
                 [[objective]]\nmetric = \"render_ms\"\n[policy]\nepsilon = 1\nconfirm_rounds = 4\ntrials_per_state = 12\n";
    dashboard::create_of(site, "scenes", study);
    for (triangles, occlusion) in [("1000", "0.1"), ("200000", "0.1"), ("1000", "0.8"), ("900000", "0.7")] {
        let indicators = [format!("triangles={triangles}"), format!("occlusion={occlusion}")];
        let best = 4.0 + triangles.len() as f64 * 3.0;
        for step in 0..20 {
            let [triangles, occlusion] = &indicators;
            let place = ["--indicator", triangles, "--indicator", occlusion];
            let trial = ask(site.url(), &[&["suggest", "scenes"], &place[..]].concat());
            let leaf = trial["configuration"]["max_leaf_size"].as_f64().expect("a number");
            let cost = 20.0 + (leaf - best).powi(2) / 20.0 + 0.1 * f64::from(step % 3);
            let name = trial["name"].as_str().expect("a name");
            say(site.url(), &["report", name, &format!("render_ms={cost}"), &format!("mb={leaf}")]);
        }
    }
}

/// Every page: no complaint, nothing wider than the window. Keeps pictures where that is wished.
fn look_at_pages(browser: &Browser, address: &str) {
    let pictures = std::env::var_os("TREEWRIGHT_SCREENSHOTS").map(PathBuf::from);
    for (name, path) in [
        ("studies", "/"),
        ("study", "/studies/scenes?state=1"),
        ("parameters", "/studies/scenes/parameters?state=1"),
        ("front", "/studies/scenes/front?metrics=render_ms,mb&state=1"),
        ("map", "/studies/scenes/map"),
        ("map-leaf", "/studies/scenes/map?show=max_leaf_size"),
        ("trials", "/studies/scenes/trials"),
        ("trial", "/studies/scenes/trials/5"),
        ("policy", "/studies/scenes/policy"),
        ("compare", "/compare?study=scenes&study=toy"),
        ("login", "/login"),
    ] {
        let sights = ["none", "deuteranopia"];
        let looks = [("light", 1280), ("dark", 1280), ("light", 390), ("dark", 390)];
        let looks = looks.into_iter().flat_map(|(scheme, width)| sights.map(|sight| (scheme, width, sight)));
        // Of other sights there is nothing to check, only to look at.
        for (scheme, width, sight) in looks.filter(|look| look.2 == "none" || pictures.is_some()) {
            browser.tool("Emulation.setEmulatedVisionDeficiency", &json!({ "type": sight }));
            let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
            browser.tool("Emulation.setEmulatedMedia", &media);
            let size =
                json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500 });
            browser.tool("Emulation.setDeviceMetricsOverride", &size);
            browser.goto(format!("http://{address}{path}"));
            let wide = browser.evaluate("return document.documentElement.scrollWidth");
            assert!(wide.as_u64().is_some_and(|wide| wide <= width), "{name} is {wide} wide in {width}");
            assert_eq!(browser.complaints(), Vec::<String>::new(), "{name} at {width}, {scheme}");
            if let Some(folder) = &pictures {
                let whole = json!({ "captureBeyondViewport": true, "format": "png" });
                let shot = browser.tool("Page.captureScreenshot", &whole);
                let text = shot["data"].as_str().expect("base64");
                let file = format!("{name}-{width}-{scheme}-{sight}.png.base64");
                std::fs::write(folder.join(file), text).expect("a file");
            }
        }
    }
    browser.tool("Emulation.clearDeviceMetricsOverride", &json!({}));
    browser.tool("Emulation.setEmulatedVisionDeficiency", &json!({ "type": "none" }));
}

/// The steps of a user without a mouse.
fn use_the_keyboard(browser: &Browser, address: &str) {
    browser.goto(format!("http://{address}/studies/scenes"));
    let focus = "const e = document.activeElement; return e.className + '|' + e.textContent.trim()";
    browser.press(TAB);
    assert_eq!(browser.says(focus), "skip|Skip to the content");
    browser.press(ENTER);
    assert!(browser.becomes("return location.hash === '#content'"));
    let mut seen = Vec::new();
    for _ in 0..8 {
        browser.press(TAB);
        seen.push(browser.says(focus));
        let ring = browser.says("return getComputedStyle(document.activeElement).outlineStyle");
        assert_ne!(ring, "none", "{seen:?} shows no focus");
        if seen.last().is_some_and(|last| last == "|Trials") {
            break;
        }
    }
    assert_eq!(seen.last().map(String::as_str), Some("|Trials"), "{seen:?}");
    browser.press(ENTER);
    assert!(browser.becomes("return location.pathname === '/studies/scenes/trials'"));
    browser.is_content();
}

fn filter(browser: &Browser, address: &str) {
    browser.goto(format!("http://{address}/studies/toy/trials"));
    browser.type_into("[name=filter]", &format!("cost < 5{ENTER}"));
    assert!(browser.becomes("return document.querySelectorAll('tbody tr').length === 1"));
    browser.type_into("[name=filter]", &format!("rubbish{ENTER}"));
    assert!(browser.becomes("return !!document.querySelector('[role=alert]')"));
    let refused = browser.complaints();
    assert!(refused.iter().all(|words| words.contains("status of 400")), "{refused:?}");
}

fn follow(browser: &Browser, address: &str, url: &str) {
    browser.goto(format!("http://{address}/studies/toy"));
    let trials = "document.querySelectorAll('.card b')[1].textContent";
    assert_eq!(browser.says(&format!("return {trials}")), "4");
    // Reports from now on have to appear by themselves, once the page listens.
    std::thread::sleep(Duration::from_millis(1500));
    dashboard::measure(url, &["loss=2.5"]);
    assert!(browser.becomes(&format!("return {trials} === '5'")), "the page did not follow");
    assert!(
        browser.becomes("return document.querySelectorAll('[data-live=curve] svg > circle').length === 4")
    );
    browser.is_content();
}

fn choose_studies(browser: &Browser, address: &str) {
    browser.goto(format!("http://{address}/"));
    for tick in browser.find_all("input[name=study]") {
        browser.click(&tick);
    }
    browser.click(&browser.find("main button"));
    assert!(browser.becomes("return document.querySelectorAll('main svg path > title').length > 1"));
    browser.is_content();
}

fn log_in(browser: &Browser) {
    let (site, address) = dashboard::start(&["--tokens"]);
    let good = token(&site.database(), &["--scope", "read"]);
    browser.goto(format!("http://{address}/studies/toy"));
    assert!(browser.becomes("return location.pathname === '/login'"));
    browser.type_into("[name=token]", &format!("tw1_wrong{ENTER}"));
    assert!(browser.becomes("return !!document.querySelector('[role=alert]')"), "a wrong token is refused");
    // The daemon follows the database, where the token was just made.
    let begun = Instant::now();
    while browser.says("return location.pathname") != "/" {
        assert!(begun.elapsed() < PATIENCE, "a good token is refused");
        browser.type_into("[name=token]", &format!("{good}{ENTER}"));
        std::thread::sleep(Duration::from_millis(500));
    }
    assert_eq!(browser.says("return document.querySelector('h1').textContent"), "Studies");
    assert_eq!(browser.says("return document.cookie"), "", "no script sees the token");
    browser.click(&browser.find("header button"));
    assert!(browser.becomes("return location.pathname === '/login'"));
    let refused = browser.complaints();
    assert!(refused.iter().all(|words| words.contains("401")), "{refused:?}");
}

#[test]
fn the_dashboard_works_in_a_browser() {
    let browser = match Browser::start() {
        Ok(browser) => browser,
        Err(why) => return skip("the dashboard in a browser", &why),
    };
    let (site, address) = dashboard::start(&[]);
    dashboard::create(&site);
    dashboard::measure(site.url(), &["loss=10", "loss=4", "loss=6", "--infeasible|no room"]);
    scenes(&site);
    look_at_pages(&browser, &address);
    use_the_keyboard(&browser, &address);
    filter(&browser, &address);
    follow(&browser, &address, site.url());
    choose_studies(&browser, &address);
    log_in(&browser);
}
