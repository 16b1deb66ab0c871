//! Whether the gain that the service reports is true, and whether it never ends below the start: searches
//! through the real tuner in worlds whose costs are known.
//!
//! | world | question |
//! |---|---|
//! | flat | all costs are equal, 7 % noise: how large is the reported gain? does its interval hold zero? |
//! | bowl | the default is some 20 % above the best: these questions for the true gain |
//! | jump | the speed of the machine changes threefold in mid-search |
//! | wanders | the speed of the machine wanders by 13 %, half forgotten after 14 trials, with 4 % of noise from trial to trial |
//! | load | other programs come and go (wall time x 1, 1.6 and 2.2), with and without processor time as auxiliary metric |
//!
//! *before* is the gain and the configuration by the lowest mean of those measurements, uncorrected. On
//! machines that are not quiet the exploited configuration is compared, by its true cost, with the one that a
//! search of an equal seed exploits on a quiet machine.
//!
//! ```text
//! cargo run --release -p treewright-lab --example reported_gain [SEEDS [TRIALS]]
//! ```

mod world;

use treewright_lab::simulated::mean;
use world::{Machine, Search, World};

/// Searches that end no more than this above a quiet one count as good.
const NEAR: f64 = 1.03;
/// A cost of so much more than the default's is below the start.
const BELOW_START: f64 = 1.005;

/// The reported gains in a world on a machine, after the search and after its confirmation.
fn gains(name: &str, world: World, machine: Machine, seeds: u64, trials: usize) {
    let auxiliary = matches!(machine, Machine::Wander);
    for confirms in [false, true] {
        let runs: Vec<_> =
            (0..seeds).map(|seed| Search { world, machine, trials, confirms, auxiliary }.run(seed)).collect();
        let all = |of: &dyn Fn(&world::Run) -> f64| -> Vec<f64> { runs.iter().map(of).collect() };
        let covered = runs.iter().filter(|run| run.low <= run.truth + 1e-9 && run.truth <= run.high + 1e-9);
        println!(
            "{name:14} {:>9} | reported {:6.2} % true {:6.2} % | covered {:2} of {} | before: reported {:6.2} % true {:6.2} %",
            if confirms { "confirmed" } else { "searched" },
            100.0 * mean(&all(&|run| run.reported)),
            100.0 * mean(&all(&|run| run.truth)),
            covered.count(),
            runs.len(),
            100.0 * mean(&all(&|run| run.naive_reported)),
            100.0 * mean(&all(&|run| run.naive_truth)),
        );
    }
}

/// One line for a machine that is not quiet.
fn disturbed(name: &str, machine: Machine, auxiliary: bool, seeds: u64, trials: usize) {
    let search =
        |machine, auxiliary| Search { world: World::Bowl, machine, trials, confirms: true, auxiliary };
    let (mut near, mut naive_near, mut below, mut naive_below) = (0, 0, 0, 0);
    let (mut ratios, mut naive_ratios) = (Vec::new(), Vec::new());
    for seed in 0..seeds {
        let quiet = search(Machine::Quiet, false).run(seed);
        let run = search(machine, auxiliary).run(seed);
        let ratio = |truth: f64| (1.0 - truth) / (1.0 - quiet.truth);
        ratios.push(ratio(run.truth));
        naive_ratios.push(ratio(run.naive_truth));
        near += usize::from(ratio(run.truth) <= NEAR);
        naive_near += usize::from(ratio(run.naive_truth) <= NEAR);
        below += usize::from(1.0 - run.truth > BELOW_START);
        naive_below += usize::from(1.0 - run.naive_truth > BELOW_START);
    }
    println!(
        "{name:22} | within 3 % of quiet {near:2} of {seeds}, below the start {below} | mean ratio {:.3} \
         | before: {naive_near:2}, {naive_below}, {:.3}",
        mean(&ratios),
        mean(&naive_ratios),
    );
}

fn main() {
    let number = |place: usize, default: usize| {
        std::env::args().nth(place).and_then(|text| text.parse().ok()).unwrap_or(default)
    };
    let (seeds, trials) = (number(1, 20) as u64, number(2, 80));
    gains("flat", World::Flat, Machine::Quiet, seeds, trials);
    gains("bowl", World::Bowl, Machine::Quiet, seeds, trials);
    gains("flat, wanders", World::Flat, Machine::Wander, seeds, trials);
    gains("bowl, wanders", World::Bowl, Machine::Wander, seeds, trials);
    disturbed("quiet", Machine::Quiet, false, seeds, trials);
    disturbed("jump", Machine::Jump, false, seeds, trials);
    disturbed("wanders", Machine::Wander, true, seeds, trials);
    disturbed("load", Machine::Load, false, seeds, trials);
    disturbed("load, processor time", Machine::Load, true, seeds, trials);
}
