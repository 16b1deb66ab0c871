//! Finds faults of the machine, the programs and the daemon. Each finding names its remedy.

use std::process::Command;
use std::time::Duration;

use serde::Serialize;
use treewright_client::blocking::Client;
use treewright_client::{Options, detect_fingerprint};

use super::USUAL;
use crate::arguments::Arguments;
use crate::failure::Result;
use crate::output::either;
use treewright_client::local::{self, LocalDaemon};

/// A round trip on one machine is well below this.
const SLOW_MS: f64 = 20.0;

/// One thing that was looked at.
#[derive(Debug, Serialize)]
struct Finding {
    what: &'static str,
    is_good: bool,
    found: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<String> {
    let mut findings = vec![processor(), load(), governor(), clock()];
    findings.extend(["treewrightd", "treewright-render"].map(program));
    findings.push(local_database());
    findings.extend(daemon(arguments));
    either(arguments.json, &findings, || {
        let mark = |good: bool| if good { "ok  " } else { "LOOK" };
        let line = |one: &Finding| format!("{} {:<18} {}", mark(one.is_good), one.what, one.found);
        findings.iter().map(line).collect::<Vec<_>>().join("\n")
    })
}

fn good(what: &'static str, found: impl Into<String>) -> Finding {
    Finding { what, is_good: true, found: found.into() }
}

fn bad(what: &'static str, found: impl Into<String>) -> Finding {
    Finding { what, is_good: false, found: found.into() }
}

fn read(path: &str) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn processor() -> Finding {
    let machine = detect_fingerprint();
    let found = format!("{}, {}, {} threads", machine.cpu_model, machine.isa, machine.threads);
    match machine.isa.as_str() {
        "sse2" => bad("processor", found + "; the renderer's own kernels are slower without avx2"),
        _ => good("processor", found),
    }
}

fn load() -> Finding {
    let threads = f64::from(detect_fingerprint().threads.max(1));
    let text = read("/proc/loadavg").unwrap_or_default();
    match text.split(' ').next().and_then(|first| first.parse::<f64>().ok()) {
        Some(load) if load > 0.5 * threads => {
            bad("load", format!("{load}: other programs are running, so timings will be noisy"))
        }
        Some(load) => good("load", load.to_string()),
        None => good("load", "unknown"),
    }
}

fn governor() -> Finding {
    match read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").as_deref() {
        Some(word @ ("powersave" | "ondemand" | "schedutil")) => bad(
            "frequency",
            format!("the governor is {word}, so timings vary; use `performance` for measurements"),
        ),
        Some(word) => good("frequency", word),
        None => good("frequency", "not controlled by this system"),
    }
}

fn clock() -> Finding {
    match read("/sys/devices/system/clocksource/clocksource0/current_clocksource").as_deref() {
        Some("tsc") => good("clock", "tsc"),
        Some(other) => good("clock", format!("{other}; slower to read than tsc")),
        None => good("clock", "unknown"),
    }
}

fn program(name: &'static str) -> Finding {
    let Some(path) = local::program(name) else {
        return bad(name, "found neither next to this program nor in PATH");
    };
    let ours = env!("CARGO_PKG_VERSION");
    match Command::new(&path).arg("--version").output() {
        Ok(output) => {
            let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
            let found = format!("{version} ({})", path.display());
            if version.ends_with(ours) {
                good(name, found)
            } else {
                bad(name, format!("{found}, but this program is {ours}: install both from the same place"))
            }
        }
        Err(error) => bad(name, format!("{} cannot be started: {error}", path.display())),
    }
}

fn local_database() -> Finding {
    match LocalDaemon::of_user() {
        Err(failure) => bad("local daemon", failure.to_string()),
        Ok(local) => {
            let database = local.database();
            let size = std::fs::metadata(&database).map(|metadata| metadata.len() >> 10);
            let size = size.map_or_else(|_| "none yet".to_owned(), |kb| format!("{kb} kB"));
            let running =
                local.running().map_or_else(|| "not running".to_owned(), |url| format!("running at {url}"));
            good("local daemon", format!("{running}; database {} ({size})", database.display()))
        }
    }
}

fn daemon(arguments: &Arguments) -> Vec<Finding> {
    let url = match arguments.server.as_deref() {
        None | Some("local") => match LocalDaemon::of_user().ok().and_then(|local| local.running()) {
            Some(url) if arguments.server.is_some() => url,
            _ => USUAL.to_owned(),
        },
        Some(url) => url.to_owned(),
    };
    let credentials = match arguments.credentials.credentials() {
        Ok(credentials) => credentials,
        Err(problem) => return vec![bad("credentials", problem.to_string())],
    };
    let options = Options::new().call_deadline(arguments.timeout).credentials(credentials);
    let client = match Client::connect(&url, options) {
        Ok(client) => client,
        Err(problem) => return vec![bad("daemon", problem.to_string())],
    };
    // The first answer includes connecting.
    match client.ping().and_then(|_| client.ping()) {
        Err(problem) if arguments.server.is_none() => {
            vec![good("daemon", format!("none at {url}; commands start a local one when needed ({problem})"))]
        }
        Err(problem) => vec![bad("daemon", problem.to_string())],
        Ok(round_trip) => vec![answered(&url, round_trip), studies(&client), encryption(&url)],
    }
}

fn answered(url: &str, round_trip: Duration) -> Finding {
    let ms = round_trip.as_secs_f64() * 1e3;
    let found = format!("{url} answers in {ms:.2} ms");
    if ms > SLOW_MS {
        bad("daemon", found + ": a frame's deadline must be longer")
    } else {
        good("daemon", found)
    }
}

fn studies(client: &Client) -> Finding {
    match client.list_studies() {
        Ok(studies) => good("studies", studies.len().to_string()),
        Err(problem) => bad("studies", problem.to_string()),
    }
}

fn encryption(urls: &str) -> Finding {
    let has_tls = |url: &str| url.starts_with("https://");
    let is_here = |url: &str| {
        let host = url.split_once("://").map_or("", |(_, rest)| rest);
        url.starts_with("unix:") || ["127.", "localhost", "[::1]"].iter().any(|name| host.starts_with(name))
    };
    let urls = || urls.split(',').map(str::trim);
    if urls().all(has_tls) {
        good("encryption", "TLS")
    } else if urls().all(|url| has_tls(url) || is_here(url)) {
        good("encryption", "none, on this machine")
    } else {
        bad("encryption", "none: anyone on the network can read and change everything")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_text_is_a_fault_where_one_address_leads_to_another_machine() {
        for (urls, is_good, found) in [
            ("https://farm:1,https://other:1", true, "TLS"),
            ("http://127.0.0.1:1", true, "none, on this machine"),
            ("unix:/run/a.sock, http://localhost:1", true, "none, on this machine"),
            ("http://localhost:1,http://farm:1", false, "none: anyone"),
            ("https://farm:1,http://other:1", false, "none: anyone"),
        ] {
            let finding = encryption(urls);
            assert_eq!(finding.is_good, is_good, "{urls}");
            assert!(finding.found.starts_with(found), "{urls}: {}", finding.found);
        }
    }
}
