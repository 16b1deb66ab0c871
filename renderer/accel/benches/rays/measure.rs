//! Interleaved rounds of tracing, on one thread or on all.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use clap::ValueEnum;
use rayon::ThreadPool;
use rayon::prelude::*;
use treewright_accel::recording::{RaySet, Recording};
use treewright_accel::{Hit, Intersector, Packets, set_flush_denormals};

use crate::contenders::Built;
use crate::summary::{Cell, Row, Spread};

/// Rays handed to a structure at once: the pixels of a tile of 16 × 16.
const BATCH: usize = 256;

/// Rounds in which a packing is chosen.
const CHOOSING_ROUNDS: usize = 3;

/// On how many threads is traced.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum Threads {
    One,
    All,
    Both,
}

impl Threads {
    /// The numbers, one after another.
    pub(crate) fn counts(self) -> Vec<usize> {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        match self {
            Self::One => vec![1],
            Self::All => vec![all],
            Self::Both if all == 1 => vec![1],
            Self::Both => vec![1, all],
        }
    }
}

/// A structure in one way of packing each set's rays.
struct Entrant<'a> {
    built: &'a Built,
    packed: bool,
    /// By set.
    packets: Vec<Packets>,
}

/// Measures every structure with single rays, and those with packets of their own also with the best packing
/// of each set.
pub(crate) fn measure(
    recording: &Recording,
    contenders: &[Built],
    threads: usize,
    rounds: u32,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(|_| set_flush_denormals())
        .build()
        .map_err(|error| format!("{threads} threads cannot be started: {error}"))?;
    let longest = recording.sets.iter().map(|set| set.rays.len()).max().unwrap_or(0);
    let mut room = Room { hits: vec![None; longest], any: vec![false; longest] };
    let mut entrants = Vec::new();
    for built in contenders {
        let single = vec![Packets::Single; recording.sets.len()];
        entrants.push(Entrant { built, packed: false, packets: single });
    }
    for built in contenders.iter().filter(|built| built.packets) {
        let best = |set| best_packing(&pool, built.intersector.as_ref(), set, &mut room);
        let packets = recording.sets.iter().map(best).collect();
        entrants.push(Entrant { built, packed: true, packets });
    }
    // Million rays a second by set, entrant and round.
    let mut speeds = vec![vec![Vec::new(); entrants.len()]; recording.sets.len()];
    for _ in 0..rounds {
        for (set, (rays, speeds)) in recording.sets.iter().zip(&mut speeds).enumerate() {
            for (entrant, speeds) in entrants.iter().zip(speeds) {
                speeds.push(room.trace(
                    &pool,
                    entrant.built.intersector.as_ref(),
                    entrant.packets[set],
                    rays,
                ));
            }
        }
    }
    let rows = entrants.iter().enumerate().map(|(row, entrant)| Row {
        name: if entrant.packed {
            format!("{}, packets", entrant.built.name)
        } else {
            entrant.built.name.into()
        },
        maker: entrant.built.maker,
        robust: entrant.built.robust,
        packed: entrant.packed,
        build_ms: Spread::of(&entrant.built.build_ms),
        cells: recording
            .sets
            .iter()
            .enumerate()
            .map(|(set, rays)| {
                let ratios: Vec<f64> =
                    speeds[set][row].iter().zip(&speeds[set][0]).map(|(a, b)| a / b).collect();
                Cell {
                    class: rays.class,
                    packets: entrant.packets[set],
                    million_rays_per_s: Spread::of(&speeds[set][row]),
                    over_native_medium: Spread::of(&ratios),
                }
            })
            .collect(),
    });
    Ok(rows.collect())
}

fn best_packing(pool: &ThreadPool, intersector: &dyn Intersector, set: &RaySet, room: &mut Room) -> Packets {
    let mut speeds = Packets::ALL.map(|packets| (packets, Vec::new()));
    for _ in 0..CHOOSING_ROUNDS {
        for (packets, speeds) in &mut speeds {
            speeds.push(room.trace(pool, intersector, *packets, set));
        }
    }
    let median = |speeds: &[f64]| Spread::of(speeds).median;
    let best = speeds.iter().max_by(|a, b| median(&a.1).total_cmp(&median(&b.1)));
    best.map_or(Packets::Single, |(packets, _)| *packets)
}

/// Room for answers, taken once.
struct Room {
    hits: Vec<Option<Hit>>,
    any: Vec<bool>,
}

impl Room {
    /// Traces a set once; million rays a second.
    fn trace(
        &mut self,
        pool: &ThreadPool,
        intersector: &dyn Intersector,
        packets: Packets,
        set: &RaySet,
    ) -> f64 {
        let (hits, any) = (&mut self.hits[..set.rays.len()], &mut self.any[..set.rays.len()]);
        let seconds = pool.install(|| {
            let begin = Instant::now();
            let batches = set.rays.par_chunks(BATCH);
            if set.class.is_shadow() {
                let trace = |(rays, any): (&[_], &mut [_])| intersector.occluded_each(packets, rays, any);
                batches.zip(any.par_chunks_mut(BATCH)).for_each(trace);
            } else {
                let trace = |(rays, hits): (&[_], &mut [_])| intersector.closest_each(packets, rays, hits);
                batches.zip(hits.par_chunks_mut(BATCH)).for_each(trace);
            }
            begin.elapsed().as_secs_f64()
        });
        black_box((hits, any));
        set.rays.len() as f64 / seconds / 1e6
    }
}
