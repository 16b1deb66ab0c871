//! A study live in the terminal: the best, gains, trials per second, clients and leases. Only reads.

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant, SystemTime};

use treewright_client::TrialQuery;
use treewright_client::blocking::Client;

use crate::arguments::data::Watch;
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::progress;
use crate::show::{self, Glance};

/// Most states that are shown, and most open trials.
const ROWS: i64 = 12;

pub(super) fn run(client: &Client, watch: &Watch, json: bool) -> Result<String> {
    let Some(study) = &watch.study else { return all(client, watch, json) };
    let (mut name, mut last) = (study.clone(), None);
    repeat(watch, || {
        let glance = look(client, &name, &mut last)?;
        // From now on no study that is created under that id counts as this one.
        name = glance.study.identified_name();
        either(json, &glance, || show::glance(&glance, SystemTime::now()))
    })
}

fn all(client: &Client, watch: &Watch, json: bool) -> Result<String> {
    repeat(watch, || super::studies::list(client, &[], json))
}

/// Draws until it is ended. A daemon that was there once and is away, because it is started again, is waited
/// for.
fn repeat(watch: &Watch, mut picture: impl FnMut() -> Result<String>) -> Result<String> {
    let (mut drawn, mut away) = (false, false);
    loop {
        match picture() {
            Ok(text) if watch.once => return Ok(text),
            Ok(text) => {
                redraw(&text)?;
                (drawn, away) = (true, false);
            }
            Err(Failure::Client(problem)) if drawn && problem.may_pass() => {
                if !std::mem::replace(&mut away, true) {
                    progress::note(&format!("{problem}; waiting for it"));
                }
            }
            Err(problem) => return Err(problem),
        }
        std::thread::sleep(watch.every.max(Duration::from_millis(100)));
    }
}

fn look(client: &Client, study: &str, last: &mut Option<(Instant, i64)>) -> Result<Glance> {
    let study = client.get_study(study)?;
    let (now, completed) = (Instant::now(), study.statistics.completed_trials);
    let since = last.replace((now, completed));
    let trials_per_s = since
        .map(|(then, before)| (completed - before) as f64 / now.duration_since(then).as_secs_f64().max(1e-3));
    let best = super::studies::best_of_states(client, &study, ROWS)?;
    let open = TrialQuery::all().filter("state = OPEN");
    let open = client.trials(&study.identified_name(), open).take(ROWS as usize).collect::<Result<_, _>>()?;
    Ok(Glance { study, best, open, trials_per_s })
}

/// Overwrites the previous picture, on a terminal.
fn redraw(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let clear = if out.is_terminal() { "\x1b[H\x1b[2J" } else { "" };
    out.write_all(clear.as_bytes())
        .and_then(|()| out.write_all(text.as_bytes()))
        .and_then(|()| out.flush())
        .map_err(Failure::Output)
}

#[cfg(test)]
mod tests {
    use treewright_client::ClientError;

    use super::*;

    #[test]
    fn a_daemon_that_is_started_again_does_not_end_it() {
        let away = || {
            let late = ClientError::Late {
                url: "http://127.0.0.1:9".to_owned(),
                call: "GetStudy",
                deadline: Duration::from_secs(1),
            };
            Err(late.into())
        };
        let watch = |once| Watch { study: None, every: Duration::ZERO, once };
        let mut looks = 0;
        let end = repeat(&watch(false), || {
            looks += 1;
            match looks {
                1 | 4 => Ok(String::new()),
                2 | 3 => away(),
                _ => Err(Failure::Data("the study is gone".to_owned())),
            }
        });
        assert!(matches!(end, Err(Failure::Data(_))), "{end:?}");
        assert_eq!(looks, 5);
        // One that was never there is missed at once, and a single look is not repeated.
        for once in [false, true] {
            assert!(matches!(repeat(&watch(once), away), Err(Failure::Client(_))));
        }
    }
}
