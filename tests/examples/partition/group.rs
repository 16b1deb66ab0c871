//! One group: daemons, their writing connections and a database, event by event.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use crate::farm::hash;

/// The part of a run that counts: after a second in which queues fill.
const WARM_UP_US: f64 = 1e6;
const END_US: f64 = 3e6;
const DEADLINE_US: f64 = 50_000.0;
/// Writing connections of a daemon, and how many commits share one transaction.
const WRITERS: usize = 2;
const WRITE_GROUP: usize = 256;

/// Times of one frame, in microseconds.
#[derive(Clone, Debug)]
pub(crate) struct Costs {
    /// Processor time in the daemon.
    pub(crate) daemon_us: f64,
    /// Processor time in the client.
    pub(crate) client_us: f64,
    /// Processor time in the database.
    pub(crate) database_us: f64,
    /// Time of a durable write, for any number of commands that share it.
    pub(crate) durable_us: f64,
}

/// A group's machines, and how often a renderer sends a frame.
pub(crate) struct Load {
    pub(crate) daemons: usize,
    pub(crate) cores: usize,
    /// `None`: the database and the clients share the cores of the one daemon.
    pub(crate) database_cores: Option<usize>,
    /// 0 for a renderer that never pauses.
    pub(crate) period_us: f64,
}

/// The frames of the renderers.
#[derive(Default)]
pub(crate) struct Seen {
    times_us: Vec<f64>,
}

impl Seen {
    pub(crate) fn all(each: &[Self]) -> Self {
        let mut times_us: Vec<f64> = each.iter().flat_map(|seen| seen.times_us.iter().copied()).collect();
        times_us.sort_by(f64::total_cmp);
        Self { times_us }
    }

    pub(crate) fn frames_per_s(&self) -> f64 {
        self.times_us.len() as f64 / ((END_US - WARM_UP_US) / 1e6)
    }

    pub(crate) fn late_share(&self) -> f64 {
        let late = self.times_us.iter().filter(|&&time| time > DEADLINE_US).count();
        late as f64 / self.times_us.len().max(1) as f64
    }

    pub(crate) fn row(&self) -> String {
        let at = |share: f64| match self.times_us.len() {
            0 => 0.0,
            count => self.times_us[((count - 1) as f64 * share).round() as usize] / 1e3,
        };
        format!("{:.0} | {:.2} | {:.2}", self.frames_per_s(), at(0.5), at(0.99))
    }
}

/// Cores that take one piece of work after the other, in the order in which they come.
struct Cores(BinaryHeap<Reverse<u64>>);

impl Cores {
    fn new(count: usize) -> Self {
        Self((0..count).map(|_| Reverse(0)).collect())
    }

    /// When work that comes `now` is done; to the nanosecond, which makes times orderable.
    fn serve(&mut self, now_ns: u64, work_us: f64) -> u64 {
        let Reverse(free_ns) = self.0.pop().expect("at least one core");
        let done_ns = free_ns.max(now_ns) + (work_us * 1e3) as u64;
        self.0.push(Reverse(done_ns));
        done_ns
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    /// A renderer's frame reaches its daemon.
    Frame { renderer: usize },
    /// The daemon has computed it.
    Computed { renderer: usize },
    /// A transaction of a connection is on the disk.
    Durable { writer: usize },
}

#[derive(Default)]
struct Writer {
    waiting: VecDeque<usize>,
    writing: Vec<usize>,
}

/// Runs a group with one renderer for each entry of `studies`.
pub(crate) fn run(studies: &[usize], load: &Load, costs: &Costs) -> Seen {
    let writer_of = |renderer: usize| {
        let place = hash(hash(studies[renderer] as u64));
        place as usize % (load.daemons * WRITERS)
    };
    let mut machines: Vec<Cores> = (0..load.daemons).map(|_| Cores::new(load.cores)).collect();
    let (database, daemon_us) = match load.database_cores {
        Some(cores) => {
            machines.push(Cores::new(cores));
            (load.daemons, costs.daemon_us)
        }
        None => (0, costs.daemon_us + costs.client_us),
    };
    let mut writers: Vec<Writer> = (0..load.daemons * WRITERS).map(|_| Writer::default()).collect();
    let mut sent_ns = vec![0; studies.len()];
    let mut events = BinaryHeap::new();
    let period_ns = (load.period_us * 1e3) as u64;
    for renderer in 0..studies.len() {
        let begin_ns = hash(renderer as u64) % period_ns.max(1_000_000);
        events.push(Reverse((begin_ns, Event::Frame { renderer })));
    }
    let mut seen = Seen::default();
    while let Some(Reverse((now_ns, event))) = events.pop() {
        if now_ns as f64 / 1e3 > END_US {
            break;
        }
        let to_start = match event {
            Event::Frame { renderer } => {
                sent_ns[renderer] = now_ns;
                let done_ns = machines[writer_of(renderer) / WRITERS].serve(now_ns, daemon_us);
                events.push(Reverse((done_ns, Event::Computed { renderer })));
                continue;
            }
            Event::Computed { renderer } => {
                let writer = writer_of(renderer);
                writers[writer].waiting.push_back(renderer);
                writer
            }
            Event::Durable { writer } => {
                for renderer in std::mem::take(&mut writers[writer].writing) {
                    let took_us = (now_ns - sent_ns[renderer]) as f64 / 1e3;
                    if now_ns as f64 / 1e3 > WARM_UP_US {
                        seen.times_us.push(took_us);
                    }
                    let next_ns = now_ns.max(sent_ns[renderer] + period_ns);
                    events.push(Reverse((next_ns, Event::Frame { renderer })));
                }
                writer
            }
        };
        let Writer { waiting, writing } = &mut writers[to_start];
        if writing.is_empty() && !waiting.is_empty() {
            writing.extend(waiting.drain(..waiting.len().min(WRITE_GROUP)));
            let computed_ns = machines[database].serve(now_ns, writing.len() as f64 * costs.database_us);
            let durable_ns = computed_ns + (costs.durable_us * 1e3) as u64;
            events.push(Reverse((durable_ns, Event::Durable { writer: to_start })));
        }
    }
    seen.times_us.sort_by(f64::total_cmp);
    seen
}
