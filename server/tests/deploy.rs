//! The files in `server/deploy` fit the daemon: it knows each setting, starts with each combination, and
//! shows each figure on the dashboard and in the documentation.

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::CommandFactory as _;
use common::{START_MS, Server};
use serde_json::Value;
use tokio::net::TcpListener;
use treewright_proto::v1 as wire;
use treewright_server::clock::ManualClock;
use treewright_server::config::{Cli, Command, ServeConfig};
use treewright_server::serve::Options;
use treewright_store::MemoryStore;

fn path(below: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(below)
}

fn read(below: &str) -> String {
    let path = path(below);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn documents(below: &str) -> Vec<Value> {
    serde_saphyr::from_multiple(&read(below)).unwrap_or_else(|error| panic!("{below}: {error}"))
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_else(|| panic!("{value} is no text"))
}

/// The daemon's configuration from these arguments and variables. The variables are put as the options that
/// they stand for, since a test must not change its own environment.
fn understood(arguments: &[String], variables: &BTreeMap<String, String>) -> ServeConfig {
    let password = tempfile::NamedTempFile::new().expect("a scratch file");
    let command = Cli::command();
    let serve = command.find_subcommand("serve").expect("a command");
    let mut all: Vec<String> = [vec!["treewrightd".to_owned()], arguments.to_vec()].concat();
    for (variable, value) in variables.iter().filter(|(name, _)| name.starts_with("TREEWRIGHT_")) {
        let option = serve.get_arguments().find(|a| a.get_env().is_some_and(|env| env == variable.as_str()));
        let option = option.unwrap_or_else(|| panic!("the daemon knows no {variable}"));
        let long = format!("--{}", option.get_long().expect("a long form"));
        match value.as_str() {
            "true" if !option.get_action().takes_values() => all.push(long),
            // Read at once, and not here.
            _ if variable == "TREEWRIGHT_DATABASE_PASSWORD_FILE" => {
                all.extend([long, password.path().to_string_lossy().into_owned()]);
            }
            _ => all.extend([long, value.clone()]),
        }
    }
    match Cli::read(&all).unwrap_or_else(|error| panic!("{all:?}: {error}")).command {
        Command::Serve(config) => *config,
        _ => panic!("{all:?} does not serve"),
    }
}

#[test]
fn the_compose_file_starts_daemons() {
    let compose = documents("deploy/compose.yaml").remove(0);
    let secrets = compose["secrets"].as_object().expect("secrets");
    let mut advertised = BTreeSet::new();
    for (name, service) in compose["services"].as_object().expect("services") {
        if service["image"] != "treewrightd" {
            continue;
        }
        let build = &service["build"];
        let folder = path("deploy").join(text(&build["context"]));
        assert!(folder.join(text(&build["dockerfile"])).is_file(), "{build}");
        let variables = service["environment"].as_object().expect("variables").iter();
        let variables = variables.map(|(name, value)| (name.clone(), text(value).to_owned())).collect();
        let config = understood(&["serve".to_owned()], &variables);
        advertised.insert(config.peers.advertise.clone().expect("an address for the others"));
        assert_eq!(config.peers.advertise.as_deref(), Some(format!("http://{name}:50611").as_str()));
        let port = format!(":{}", config.listen.port());
        assert!(service["ports"].as_array().expect("ports").iter().all(|p| text(p).ends_with(&port)));
        assert!(text(&service["ports"][0]).starts_with("127.0.0.1:"), "plain text stays on this machine");
        let grace = humantime::parse_duration(text(&service["stop_grace_period"])).expect("a time");
        assert!(grace > config.drain(), "a stop would be a kill");
        for secret in service["secrets"].as_array().expect("secrets") {
            assert!(secrets.contains_key(text(secret)), "{secret}");
            let file = variables["TREEWRIGHT_DATABASE_PASSWORD_FILE"].clone();
            assert_eq!(file, format!("/run/secrets/{}", text(secret)));
        }
    }
    assert_eq!(advertised.len(), 3);
}

#[test]
fn the_kubernetes_manifest_starts_daemons_with_tls_and_tokens() {
    let documents = documents("deploy/kubernetes.yaml");
    let of = |kind: &str| documents.iter().find(|document| document["kind"] == kind).expect("it is there");
    let pod = &of("StatefulSet")["spec"]["template"]["spec"];
    let container = &pod["containers"][0];
    let list = |value: &Value| value.as_array().expect("a list").clone();
    let arguments: Vec<String> = list(&container["args"]).iter().map(|a| text(a).to_owned()).collect();
    let variables: BTreeMap<String, String> = list(&container["env"])
        .iter()
        .filter_map(|one| Some((text(&one["name"]).to_owned(), one["value"].as_str()?.to_owned())))
        .collect();
    let config = understood(&arguments, &variables);
    assert!(config.guard.asks_for_tokens(config.listen));
    assert!(config.peers.tls_files(&config.guard).is_some());
    assert!(config.peers.advertise.as_deref().is_some_and(|url| url.starts_with("https://$(POD_NAME).")));

    // Every file is in a volume that there is.
    let mounted: Vec<Value> = list(&container["volumeMounts"]);
    for file in variables.values().filter(|value| value.starts_with("/var/")) {
        let mount = mounted.iter().find(|mount| file.starts_with(&format!("{}/", text(&mount["mountPath"]))));
        let name = &mount.unwrap_or_else(|| panic!("{file} is in no volume"))["name"];
        assert!(list(&pod["volumes"]).iter().any(|volume| volume["name"] == *name), "{name}");
    }
    // The probes ask for served paths on the right port.
    let ports: BTreeMap<String, u64> = list(&container["ports"])
        .iter()
        .map(|port| (text(&port["name"]).to_owned(), port["containerPort"].as_u64().expect("a port")))
        .collect();
    assert_eq!(ports["grpc"], u64::from(config.listen.port()));
    assert_eq!(ports["metrics"], u64::from(config.metrics.expect("an address").port()));
    for (probe, path) in [("livenessProbe", "/livez"), ("readinessProbe", "/readyz")] {
        let asked = &container[probe]["httpGet"];
        assert_eq!((text(&asked["path"]), text(&asked["port"])), (path, "metrics"));
    }
    let grace = pod["terminationGracePeriodSeconds"].as_u64().expect("seconds");
    assert!(grace > config.drain_s, "a stop would be a kill");
    let allowed: BTreeSet<u64> = list(&of("NetworkPolicy")["spec"]["ingress"][0]["ports"])
        .iter()
        .filter_map(|p| p["port"].as_u64())
        .collect();
    assert_eq!(allowed, ports.values().copied().collect());
}

#[test]
fn the_image_is_built_from_what_there_is() {
    let dockerfile = read("deploy/Dockerfile");
    let has = |words: &str| assert!(dockerfile.contains(words), "{words:?} is not in the Dockerfile");
    has(&format!("cargo build --profile dist --locked -p {} --bin treewrightd", env!("CARGO_PKG_NAME")));
    let program = PathBuf::from(env!("CARGO_BIN_EXE_treewrightd"));
    assert_eq!(program.file_name().and_then(|name| name.to_str()), Some("treewrightd"));
    has("COPY --from=build /src/target/dist/treewrightd /usr/local/bin/treewrightd");
    has("ENTRYPOINT [\"treewrightd\"]\nCMD [\"serve\"]");
    has("EXPOSE 50611 9464");
    let version = |text: &str| -> Vec<u32> { text.split('.').map_while(|part| part.parse().ok()).collect() };
    let image = dockerfile.split("FROM rust:").nth(1).and_then(|rest| rest.split('-').next());
    let image = image.expect("an image with a compiler");
    // Else rustup would fetch what rust-toolchain.toml names.
    has(&format!("\nENV RUSTUP_TOOLCHAIN={image}\n"));
    let image = version(image);
    assert!(image >= version(env!("CARGO_PKG_RUST_VERSION")), "the image's compiler is too old");
    for ignored in read("deploy/Dockerfile.dockerignore").lines() {
        assert!(!["Cargo.lock", "migrations", "proto", "server"].contains(&ignored), "{ignored} is needed");
    }
}

/// The names of all samples that the daemon can show: a figure with labels is there once something has
/// happened.
async fn samples() -> BTreeSet<String> {
    let watch = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = watch.local_addr().expect("an address");
    let options =
        Options { drain: Duration::from_secs(5), watch: Some(watch), studies_shown: 1, ..Options::default() };
    let clock = Arc::new(ManualClock::at(START_MS));
    let server = Server::with_options(Arc::new(MemoryStore::new()), clock, options).await;
    let mut client = server.client().await;
    let mut study = common::study();
    study.policy.get_or_insert_default().predictor = wire::PredictorMethod::Auto as i32;
    // Figures of a maximised metric as well.
    study.objective.get_or_insert_default().maximised = vec!["render_ms".to_owned()];
    client.create_study(common::creation("hall", study)).await.expect("created");
    for cost in [3.0, 2.0, 1.0] {
        let trial = common::suggest(&mut client, "a", 10.0).await;
        common::done(&mut client, &trial.name, cost).await;
    }
    client.get_study(wire::GetStudyRequest::default()).await.expect_err("refused");
    let answer = common::exchange(address, "GET /metrics HTTP/1.1\r\nhost: here\r\n\r\n").await;
    server.stop().await;
    let kinds = answer.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split_once(' '));
    let samples = kinds.flat_map(|(name, kind)| {
        let ends: &[&str] = match kind {
            "counter" => &["_total"],
            "histogram" => &["_bucket", "_count", "_sum"],
            _ => &[""],
        };
        ends.iter().map(move |end| format!("{name}{end}"))
    });
    samples.collect()
}

/// The names of figures in a text; their common beginning and the daemon's own module are none.
fn named(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    words
        .filter(|word| {
            word.starts_with("treewright_") && !["treewright_", "treewright_server"].contains(word)
        })
        .map(str::to_owned)
        .collect()
}

#[tokio::test]
async fn dashboard_and_documentation_name_figures_that_there_are() {
    let samples = samples().await;
    let dashboard: Value = serde_json::from_str(&read("deploy/grafana.json")).expect("JSON");
    let panels = dashboard["panels"].as_array().expect("panels");
    let ids: BTreeSet<u64> = panels.iter().filter_map(|panel| panel["id"].as_u64()).collect();
    assert_eq!(ids.len(), panels.len(), "each panel has an id of its own");
    let mut shown = BTreeSet::new();
    for target in panels.iter().flat_map(|panel| panel["targets"].as_array().into_iter().flatten()) {
        let names = named(text(&target["expr"]));
        assert!(!names.is_empty(), "{target}");
        shown.extend(names);
    }
    for variable in dashboard["templating"]["list"].as_array().expect("variables") {
        shown.extend(named(variable["definition"].as_str().unwrap_or_default()));
    }
    let unknown: Vec<_> = shown.difference(&samples).collect();
    assert!(unknown.is_empty(), "the dashboard asks for {unknown:?}");
    // Of a histogram its sum and count need no panel of their own.
    let whole = |name: &&String| !(name.ends_with("_sum") || name.ends_with("_count"));
    let hidden: Vec<_> = samples.difference(&shown).filter(whole).collect();
    assert!(hidden.is_empty(), "the dashboard does not show {hidden:?}");

    let alerts = read("deploy/alerts.yaml");
    let rules = documents("deploy/alerts.yaml");
    let rules = rules[0]["groups"][0]["rules"].as_array().expect("rules").clone();
    assert!(rules.iter().all(|rule| rule["expr"].is_string() && rule["annotations"]["summary"].is_string()));
    let unknown: Vec<_> = named(&alerts).difference(&samples).cloned().collect();
    assert!(unknown.is_empty(), "the alerts ask for {unknown:?}");

    let documentation = read("../docs/observability.md");
    let unknown: Vec<_> = named(&documentation).difference(&samples).cloned().collect();
    assert!(unknown.is_empty(), "the documentation names {unknown:?}");
    let short = |name: &str| name.trim_start_matches("treewright_").trim_end_matches("_bucket").to_owned();
    let missing: Vec<_> = samples
        .iter()
        .filter(whole)
        .filter(|name| !documentation.contains(&format!("`{}`", short(name))))
        .collect();
    assert!(missing.is_empty(), "the documentation lacks {missing:?}");
}

/// The variables of the unit are ones that the daemon understands; systemd itself looks at the rest, where it
/// is.
#[test]
fn the_systemd_unit_starts_a_daemon() {
    let unit = read("deploy/treewrightd.service");
    let of = |key: &str| unit.lines().filter_map(|line| line.strip_prefix(key)).collect::<Vec<_>>();
    let variables: BTreeMap<String, String> = of("Environment=")
        .into_iter()
        .filter_map(|pair| pair.split_once('='))
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .collect();
    let start = of("ExecStart=treewrightd ");
    let arguments: Vec<String> = start[0].split_whitespace().map(str::to_owned).collect();
    let config = understood(&arguments, &variables);
    assert!(config.listen.ip().is_loopback());
    assert!(variables["TREEWRIGHT_DATABASE"].starts_with("/var/lib/treewright/"), "in its StateDirectory");
    let files: u64 = of("LimitNOFILE=")[0].parse().expect("a number");
    assert!(files > treewright_server::limits::CONNECTIONS_MAX as u64);

    let socket = read("deploy/treewrightd.socket");
    let streams: Vec<_> = socket.lines().filter_map(|line| line.strip_prefix("ListenStream=")).collect();
    assert_eq!(streams, [config.listen.to_string()], "one without the other would not start");

    let verify = std::process::Command::new("systemd-analyze")
        .args(["verify", "--man=no"])
        .args([path("deploy/treewrightd.service"), path("deploy/treewrightd.socket")])
        .output();
    match verify {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let line = "skipped: what systemd says of the units: there is no systemd-analyze here\n";
            eprint!("{line}");
            if let Some(file) = std::env::var_os("TREEWRIGHT_SKIPPED") {
                let opened = std::fs::OpenOptions::new().append(true).open(file);
                opened.and_then(|mut file| file.write_all(line.as_bytes())).expect("written");
            }
        }
        verified => {
            let said = String::from_utf8_lossy(&verified.expect("it runs").stderr).into_owned();
            // The program need not be installed where this runs.
            let serious = said.lines().filter(|line| {
                !line.contains("treewrightd is not executable") && !line.contains("Command treewrightd")
            });
            let serious: Vec<_> = serious.filter(|line| line.contains("treewrightd.service")).collect();
            assert!(serious.is_empty(), "{serious:?}");
        }
    }
}
