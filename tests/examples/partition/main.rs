//! The limits of partitioning studies over several databases: a simulation of farms larger than any that can
//! be had on one machine.
//!
//! `cargo run --release -p treewright-tests --example partition -- [DAEMON_US DATABASE_US CLIENT_US DURABLE_US]`:
//! processor time of a frame in the daemon, the database and the client, and the time of a durable write, in
//! microseconds. Prints tables in Markdown. Equal arguments give equal tables on every machine.
//!
//! A group is one PostgreSQL with some daemons. Renderers send a frame every 20 ms, unless the last is still
//! out. A frame is computed by the daemon that has its study, then waits for one of that daemon's two writing
//! connections, which takes all that wait (at most 256), computes them in the database, and waits for the
//! disk. Studies share nothing, so groups meet nowhere. The question is how unequal groups become, and the
//! cost of that. Studies belong to shows; shows, and the studies of a show, are of very different sizes
//! (Zipf's law with exponent 1). Left out: networks, forwarding (clients ask the daemon that has their
//! study), searches that fit models, and the study's lock.

mod farm;
mod group;

use farm::{Farm, Rule};
use group::{Costs, Load, Seen};

/// Shares of what a group can carry at which farms are run.
const LOADS: [f64; 2] = [0.5, 0.7];
const GROUPS: [usize; 5] = [1, 2, 4, 8, 16];
const PERIOD_US: f64 = 20_000.0;

/// Processor and disk times, by default as measured with `scale_out`.
fn costs() -> Costs {
    let argument = |index: usize, default: f64| {
        std::env::args().nth(index).map_or(default, |text| text.parse().expect("a number of microseconds"))
    };
    Costs {
        daemon_us: argument(1, 95.0),
        database_us: argument(2, 85.0),
        client_us: argument(3, 30.0),
        durable_us: argument(4, 150.0),
    }
}

/// The capacity of one group, under clients that never pause.
fn without_pause(load: &Load, clients: usize, costs: &Costs) -> Seen {
    let studies: Vec<usize> = (0..clients).map(|client| client % (8 * load.daemons)).collect();
    let seen = group::run(&studies, load, costs);
    let database = load.database_cores.map_or("shared".to_owned(), |cores| cores.to_string());
    println!("| {} | {} | {database} | {clients} | {} |", load.daemons, load.cores, seen.row());
    seen
}

fn main() {
    let costs = costs();
    println!("{costs:?}\n");
    println!(
        "| daemons | cores each | cores of the database | clients without pause | frames/s | p50 ms | p99 ms |"
    );
    println!("|---|---|---|---|---|---|---|");
    let load = |daemons, cores, database_cores| Load { daemons, cores, database_cores, period_us: 0.0 };
    without_pause(&load(1, 2, None), 32, &costs);
    without_pause(&load(1, 2, Some(2)), 128, &costs);
    let group = load(3, 4, Some(8));
    let most = without_pause(&group, 768, &costs).frames_per_s();
    let group = Load { period_us: PERIOD_US, ..group };
    println!("\nGroups of the last shape; there are as many renderers as they can carry, times the load.\n");
    println!(
        "| load | rule | groups | renderers | busiest group | frames/s | p50 ms | p99 ms | later than 50 ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for share in LOADS {
        for rule in [Rule::HashOfStudy, Rule::HashOfShow, Rule::LargestFirst] {
            for groups in GROUPS {
                let renderers = (share * most * PERIOD_US / 1e6) as usize * groups;
                let farm = Farm::new(renderers, groups, rule);
                let seen: Vec<Seen> =
                    farm.groups.iter().map(|studies| group::run(studies, &group, &costs)).collect();
                let seen = Seen::all(&seen);
                let busiest = farm.groups.iter().map(Vec::len).max().unwrap_or(0) * groups;
                println!(
                    "| {share:.1} | {} | {groups} | {renderers} | {:.2} × mean | {} | {:.2} % |",
                    rule.name(),
                    busiest as f64 / renderers as f64,
                    seen.row(),
                    100.0 * seen.late_share()
                );
            }
        }
    }
}
