//! The last rounds of `tune`: half of them run in a second process, this program once more.
//!
//! The second process is started as `rounds` with the arguments of `tune`, so that scene, view and objective
//! are equal. It reads what to measure from its standard input, in one line, and writes the times as JSON.
//! Its input stays open as long as the first process wants an answer, and it ends when that closes.

use std::io::Write;
use std::process::{Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::tune_arguments::Arguments;
use crate::{error::CliError, error::Result, interrupt::Interrupt, output};
use treewright_renderer::limits::{ROUNDS_MAX, SECOND_PROCESS_S_MAX};
use treewright_renderer::measure::{Conditions, Contender, Measured, interleaved};
use treewright_renderer::{disturbance::Watch, frame::Renderer, space::Choice, tuning::who::Who};

const COMMAND: &str = "rounds";
/// Fewest rounds that have an interval, and the time after which no further ones begin.
const ROUNDS_LEAST: u32 = 6;
const ROUNDS_TIME: Duration = Duration::from_secs(120);
/// Longest time until Ctrl-C is noticed while the second process runs.
const POLL: Duration = Duration::from_millis(100);
/// Longest wait for its end once it is not wanted any more.
const GOODBYE: Duration = Duration::from_secs(5);

/// The order of rounds that the second process measures.
#[derive(Debug, Serialize, Deserialize)]
struct RoundsOrder {
    rounds: u32,
    choices: Vec<Choice>,
}

/// Measures what standard input says; ends when that is closed.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let arguments = &arguments.with_space()?;
    let mut line = String::new();
    let read = std::io::stdin().read_line(&mut line).map_err(|error| error.to_string());
    let order = read.and_then(|_| serde_json::from_str(&line).map_err(|error| error.to_string()));
    let order: RoundsOrder = order.map_err(|error| {
        CliError::Usage(format!("{COMMAND} is what `tune` starts, which says what to measure: {error}"))
    })?;
    std::thread::spawn(end_when_closed);
    let scene = arguments.view.scene.load()?;
    let space = arguments.space.of(&scene, arguments.objective)?;
    let camera = arguments.view.camera.find(&scene)?;
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    arguments.episode.prepare(arguments.objective, &arguments.view.scene, &space, &mut renderer)?;
    let contenders: Vec<Contender> =
        order.choices.into_iter().map(|choice| Contender { who: Who::Nobody, choice }).collect();
    let conditions = Conditions { rounds: order.rounds.min(ROUNDS_MAX), ..arguments.conditions(camera) };
    output::json(&measure(&mut renderer, &contenders, &conditions, 2, || false))
}

/// Ends the program once nothing can be read any more.
fn end_when_closed() {
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
    std::process::exit(130);
}

/// Rounds as far as there is time, where this is one of a number of `processes` that share it.
pub(super) fn measure(
    renderer: &mut Renderer,
    contenders: &[Contender],
    conditions: &Conditions,
    processes: u32,
    is_stopped: impl Fn() -> bool,
) -> Vec<Measured> {
    let (begin, mut rounds) = (Instant::now(), 0);
    // The first one is forgotten.
    let least = 1 + ROUNDS_LEAST.div_ceil(processes);
    interleaved(renderer, contenders, conditions, || {
        rounds += 1;
        let has_time = rounds <= least || begin.elapsed() < ROUNDS_TIME / processes;
        has_time && !is_stopped()
    })
}

/// All contenders in rounds, half of them by a second process where there is one; and a watch here.
pub(super) fn in_two_processes(
    renderer: &mut Renderer,
    contenders: &[Contender],
    conditions: &Conditions,
    interrupt: Interrupt,
    notes: &mut Vec<String>,
) -> (Vec<Measured>, Watch) {
    // Fewer rounds show nothing anyway.
    let is_worth_it = conditions.rounds >= ROUNDS_LEAST && !interrupt.requested();
    let second = is_worth_it.then(|| in_second_process(contenders, conditions.rounds.div_ceil(2), interrupt));
    let second = second.transpose().unwrap_or_else(|cause| {
        notes.push(format!(
            "the final rounds ran in one process, so that no interval holds what differs between processes; the second one: {cause}"
        ));
        None
    });
    // Before, the second process would have counted as another program.
    let watch = Watch::begin();
    let rounds = second.as_deref().map_or(conditions.rounds, rounds_of);
    let (own, processes) = (Conditions { rounds, ..*conditions }, 1 + u32::from(second.is_some()));
    let measured = measure(renderer, contenders, &own, processes, || interrupt.requested());
    let Some(second) = second else { return (measured, watch) };
    (measured.into_iter().zip(second).map(|(one, second)| one.joined(second)).collect(), watch)
}

/// The rounds of a second process, or why there are none.
fn in_second_process(
    contenders: &[Contender],
    rounds: u32,
    interrupt: Interrupt,
) -> Result<Vec<Measured>, String> {
    let choices = contenders.iter().map(|contender| contender.choice).collect();
    let order = serde_json::to_string(&RoundsOrder { rounds, choices }).map_err(|error| error.to_string())?;
    let program = std::env::current_exe().map_err(|error| error.to_string())?;
    // What stands behind the name of this command.
    let arguments = std::env::args_os().skip(2);
    let mut command = Command::new(program);
    command.arg(COMMAND).args(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|error| format!("it does not start: {error}"))?;
    let mut input = child.stdin.take().ok_or("it has no input")?;
    let (tell, told) = channel();
    std::thread::spawn(move || drop(tell.send(child.wait_with_output())));
    // Where it has ended already, its own words say why.
    let _ = writeln!(input, "{order}");
    let (begin, limit) = (Instant::now(), Duration::from_secs(SECOND_PROCESS_S_MAX));
    let output = loop {
        match told.recv_timeout(POLL) {
            Ok(output) => break output.map_err(|error| error.to_string())?,
            Err(RecvTimeoutError::Timeout) if !interrupt.requested() && begin.elapsed() < limit => {}
            Err(_) => {
                drop(input);
                // It would disturb the rounds of this process.
                let _ = told.recv_timeout(GOODBYE);
                return Err(format!("it was ended after {:.0} s", begin.elapsed().as_secs_f64()));
            }
        }
    };
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{}, {}", output.status, words.lines().last().unwrap_or("without a word")));
    }
    let second: Vec<Measured> = serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())?;
    let is_complete = second.len() == contenders.len() && rounds_of(&second) > 0;
    is_complete.then_some(second).ok_or_else(|| "it measured nothing".to_owned())
}

fn rounds_of(measured: &[Measured]) -> u32 {
    let rounds = measured.iter().map(|one| one.frames.len()).max();
    rounds.map_or(0, |rounds| u32::try_from(rounds).unwrap_or(u32::MAX))
}
