//! The workers of a client. The service hands a client that holds an open trial for a state that trial again,
//! so a program that runs trials side by side (threads, tasks, processes) needs several names. They come by
//! themselves. Each suggestion takes a free worker of its client when it is asked for, and lets it go with
//! its result. So one loop is one worker, and four threads are four.
//!
//! The first worker has its client's name, the others are `NAME#2`, `NAME#3` and so on. A process takes the
//! lowest that no other process of its client has. So a client that starts again with as many threads finds
//! the trials that it left open. Among the free workers the one that was last in the asked state comes first,
//! so that loops in several states keep their workers.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use treewright_model::fnv;
use treewright_model::limits::CLIENT_ID_CHARACTERS_MAX;

use crate::limits::WORKERS;
use crate::locks::lock;
use crate::slot::Slot;
use crate::{ClientError, Indicators};

/// The workers of one client in one process.
#[derive(Debug)]
pub(crate) struct Workers {
    client_id: Arc<str>,
    /// Distinguishes daemons, whose clients may have equal ids.
    daemon: u64,
    process: u32,
    state: Mutex<WorkersState>,
}

#[derive(Debug, Default)]
struct WorkersState {
    /// Taken from other processes as they are needed, and kept until the client ends.
    owned: Vec<OwnedName>,
    /// The seats of the workers in each study, in the order of `owned`.
    studies: HashMap<Arc<str>, Vec<Seat>>,
}

#[derive(Debug)]
struct OwnedName {
    number: usize,
    name: Arc<str>,
    _slot: Slot,
}

#[derive(Debug, Default)]
struct Seat {
    busy: bool,
    last: Option<Indicators>,
}

/// A worker of a study, busy for as long as this lives.
#[derive(Debug)]
pub(crate) struct Worker {
    name: Arc<str>,
    study: Arc<str>,
    seat: usize,
    workers: Arc<Workers>,
}

impl Workers {
    pub(crate) fn new(client_id: &str, url: &str) -> Self {
        let (client_id, daemon) = (Arc::from(client_id), fnv::hash(url.bytes()));
        Self { client_id, daemon, process: std::process::id(), state: Mutex::default() }
    }

    /// A free worker for a trial in the state of `indicators`; `same` says whether two indicators are of one
    /// state.
    ///
    /// Errors: [`ClientError::Busy`] when all are busy.
    pub(crate) fn take(
        self: &Arc<Self>,
        study: &Arc<str>,
        indicators: &Indicators,
        same: impl Fn(&Indicators, &Indicators) -> bool,
    ) -> Result<Arc<Worker>, ClientError> {
        let mut state = lock(&self.state);
        let WorkersState { owned, studies } = &mut *state;
        let seats = studies.entry(Arc::clone(study)).or_default();
        let was_here = |seat: &Seat| seat.last.as_ref().is_some_and(|last| same(last, indicators));
        let free = || seats.iter().enumerate().filter(|(_, seat)| !seat.busy);
        let seat = free().find(|(_, seat)| was_here(seat)).or_else(|| free().next());
        let seat = match seat.map(|(number, _)| number) {
            Some(seat) => seat,
            None => {
                if seats.len() == owned.len() {
                    owned.push(self.claim(owned)?);
                }
                seats.push(Seat::default());
                seats.len() - 1
            }
        };
        seats[seat] = Seat { busy: true, last: Some(indicators.clone()) };
        let name = Arc::clone(&owned[seat].name);
        Ok(Arc::new(Worker { name, study: Arc::clone(study), seat, workers: Arc::clone(self) }))
    }

    /// The lowest number that is free.
    fn claim(&self, owned: &[OwnedName]) -> Result<OwnedName, ClientError> {
        let is_new = |number: &usize| owned.iter().all(|other| other.number != *number);
        for number in (1..=WORKERS).filter(is_new) {
            let name = format!("treewright-worker-{number}-{:016x}-{}", self.daemon, self.client_id);
            match Slot::take(&name) {
                Slot::Taken => {}
                slot => {
                    let name = Arc::from(worker_name(&self.client_id, number));
                    return Ok(OwnedName { number, name, _slot: slot });
                }
            }
        }
        let what = "trials of this client that are neither reported nor given back";
        Err(ClientError::Busy { what, limit: WORKERS })
    }
}

impl Worker {
    pub(crate) fn is_of(&self, study: &str) -> bool {
        *self.study == *study
    }

    /// Its name for the service.
    pub(crate) fn name(&self) -> &Arc<str> {
        &self.name
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // In the child of a fork it is the parent's.
        if self.workers.process == std::process::id()
            && let Some(seat) = lock(&self.workers.state)
                .studies
                .get_mut(&self.study)
                .and_then(|seats| seats.get_mut(self.seat))
        {
            seat.busy = false;
        }
    }
}

/// The id of a client's worker. Where there is no room behind the client's id, the id's end becomes a number
/// that stands for it.
fn worker_name(client_id: &str, number: usize) -> String {
    if number == 1 {
        return client_id.to_owned();
    }
    let name = format!("{client_id}#{number}");
    if name.chars().count() <= CLIENT_ID_CHARACTERS_MAX {
        return name;
    }
    let end = format!("~{:016x}#{number}", fnv::hash(client_id.bytes()));
    let begin = client_id.chars().take(CLIENT_ID_CHARACTERS_MAX - end.len());
    begin.chain(end.chars()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(test: &str) -> (Arc<Workers>, Arc<str>) {
        (
            Arc::new(Workers::new(&format!("{test} {}", std::process::id()), "http://here")),
            Arc::from("studies/s"),
        )
    }

    fn at(place: f64) -> Indicators {
        Indicators::from([("place", place)])
    }

    fn same(a: &Indicators, b: &Indicators) -> bool {
        a == b
    }

    #[test]
    fn loops_in_several_states_stay_who_they_are() {
        let (workers, study) = of("states");
        let take = |place| workers.take(&study, &at(place), same).unwrap();
        let (first, second) = (take(1.0), take(2.0));
        let (one, two) = (Arc::clone(first.name()), Arc::clone(second.name()));
        drop((first, second));
        assert_eq!(*take(2.0).name(), two);
        assert_eq!(*take(1.0).name(), one);
    }

    #[test]
    fn studies_have_workers_of_their_own_and_processes_of_one_client_share_none() {
        let (workers, study) = of("processes");
        let other_study = Arc::from("studies/t");
        let one = workers.take(&study, &at(1.0), same).unwrap();
        assert_eq!(workers.take(&other_study, &at(1.0), same).unwrap().name(), one.name());
        // A second client of this id is to the system what another process is.
        let (others, _) = of("processes");
        let beside = others.take(&study, &at(1.0), same).unwrap();
        assert_eq!(**beside.name(), *format!("{}#2", workers.client_id));
        drop((one, workers));
        let (again, _) = of("processes");
        assert_eq!(again.take(&study, &at(1.0), same).unwrap().name(), &again.client_id);
    }

    #[test]
    fn there_is_a_limit_and_names_fit() {
        let (workers, study) = of("limit");
        let take = || workers.take(&study, &at(1.0), same);
        let all: Vec<_> = (0..WORKERS).map(|_| take().unwrap()).collect();
        let problem = take().unwrap_err().to_string();
        assert!(problem.contains(&WORKERS.to_string()), "{problem}");
        drop(all);
        assert!(take().is_ok());
        let (one, other) = ("x".repeat(127) + "1", "x".repeat(127) + "2");
        assert_eq!(worker_name(&one, WORKERS).chars().count(), CLIENT_ID_CHARACTERS_MAX);
        assert_ne!(worker_name(&one, 2), worker_name(&other, 2));
        assert_eq!(worker_name(&one, 1), one);
    }
}
