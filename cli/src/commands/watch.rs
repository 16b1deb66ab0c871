//! A study live in the terminal: the best, gains, trials per second, clients and leases. Only reads.

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant, SystemTime};

use treewright_client::TrialQuery;
use treewright_client::blocking::Client;

use crate::arguments::data::Watch;
use crate::failure::Failure;
use crate::output::either;
use crate::show::{self, Glance};

/// Most states that are shown, and most open trials.
const ROWS: i64 = 12;

pub(super) fn run(client: &Client, watch: &Watch, json: bool) -> Result<String, Failure> {
    let Some(study) = &watch.study else { return all(client, watch, json) };
    let mut last: Option<(Instant, i64)> = None;
    loop {
        let glance = look(client, study, &mut last)?;
        let text = either(json, &glance, || show::glance(&glance, SystemTime::now()))?;
        if watch.once {
            return Ok(text);
        }
        redraw(&text)?;
        std::thread::sleep(watch.every.max(Duration::from_millis(100)));
    }
}

fn all(client: &Client, watch: &Watch, json: bool) -> Result<String, Failure> {
    loop {
        let text = super::studies::list(client, json)?;
        if watch.once {
            return Ok(text);
        }
        redraw(&text)?;
        std::thread::sleep(watch.every.max(Duration::from_millis(100)));
    }
}

fn look(client: &Client, study: &str, last: &mut Option<(Instant, i64)>) -> Result<Glance, Failure> {
    let study = client.get_study(study)?;
    let (now, completed) = (Instant::now(), study.statistics.completed_trials);
    let since = last.replace((now, completed));
    let trials_per_s = since
        .map(|(then, before)| (completed - before) as f64 / now.duration_since(then).as_secs_f64().max(1e-3));
    let best = super::studies::best_of_states(client, &study, ROWS)?;
    let open = TrialQuery::all().filter("state = OPEN");
    let open = client.trials(study.id(), open).take(ROWS as usize).collect::<Result<_, _>>()?;
    Ok(Glance { study, best, open, trials_per_s })
}

/// Overwrites the previous picture, on a terminal.
fn redraw(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    let clear = if out.is_terminal() { "\x1b[H\x1b[2J" } else { "" };
    out.write_all(clear.as_bytes())
        .and_then(|()| out.write_all(text.as_bytes()))
        .and_then(|()| out.flush())
        .map_err(Failure::Output)
}
