//! Ctrl-C: the first ends the session politely, the second at once. Both give the trial back whose program
//! runs: a lease that is lost counts against its configuration, and a person is no reason.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use treewright_client::blocking::Client;

use crate::failure::Failure;

/// The exit code of a program that is interrupted by SIGINT, as shells have it.
const INTERRUPTED: i32 = 130;
/// Longest time that the second signal waits for the daemon.
const GOODBYE: Duration = Duration::from_secs(1);

/// The name of the trial whose program ran last. One that was reported since cannot be given back.
pub(super) type LastRun = Arc<Mutex<Option<String>>>;

/// A flag that the first signal sets, and the trial that the second signal gives back.
pub(super) fn listen(client: &Client) -> Result<(Arc<AtomicBool>, LastRun), Failure> {
    let (stop, last_run) = (Arc::new(AtomicBool::new(false)), LastRun::default());
    let (set, open, client) = (Arc::clone(&stop), Arc::clone(&last_run), client.clone());
    let handler = move || {
        if set.swap(true, Ordering::Relaxed) {
            say_goodbye(&client, &open);
            std::process::exit(INTERRUPTED);
        }
    };
    ctrlc::set_handler(handler)
        .map_err(|error| Failure::Program(format!("signals cannot be caught: {error}")))?;
    Ok((stop, last_run))
}

/// Gives the trial back. A daemon that hangs is not waited for.
fn say_goodbye(client: &Client, last_run: &Mutex<Option<String>>) {
    let Some(trial) = last_run.lock().ok().and_then(|mut last| last.take()) else { return };
    let client = client.clone();
    let (done, is_done) = channel::<()>();
    std::thread::spawn(move || {
        drop(client.give_back(&trial));
        drop(done);
    });
    // It ends as soon as the other side is dropped.
    let _ = is_done.recv_timeout(GOODBYE);
}
