//! Interleaved rounds of tracing, on a number of threads.

use std::{error::Error, hint::black_box, time::Instant};

use rayon::ThreadPool;
use rayon::prelude::*;
use treewright_accel::recording::{RayClass, RaySet, Recording};
use treewright_accel::{Hit, Intersector, Packets, set_flush_denormals};

use crate::contenders::{Built, Maker};

/// Rays handed to a structure at once: the pixels of a tile of 16 × 16.
const BATCH: usize = 256;
/// Rounds in which a packing is chosen.
const CHOOSING_ROUNDS: usize = 3;

pub(crate) struct Speed {
    pub(crate) name: &'static str,
    pub(crate) maker: Maker,
    pub(crate) robust: bool,
    /// Whether the best packing was chosen; otherwise every ray goes alone.
    pub(crate) packed: bool,
    pub(crate) class: RayClass,
    /// Median over the rounds.
    pub(crate) million_rays_per_s: f64,
}

/// Measures every structure with single rays, and those with own packets also with the best packing.
pub(crate) fn measure(
    recording: &Recording,
    contenders: &[Built],
    threads: usize,
    rounds: u32,
) -> Result<Vec<Speed>, Box<dyn Error>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(|_| set_flush_denormals())
        .build()
        .map_err(|error| format!("{threads} threads cannot be started: {error}"))?;
    let mut all = Vec::new();
    for set in &recording.sets {
        let mut room = Room { hits: vec![None; set.rays.len()], any: vec![false; set.rays.len()] };
        let mut entrants: Vec<(&Built, bool, Packets)> =
            contenders.iter().map(|built| (built, false, Packets::Single)).collect();
        for built in contenders.iter().filter(|built| built.packets) {
            let best = best_packing(&pool, built.intersector.as_ref(), set, &mut room);
            entrants.push((built, true, best));
        }
        let mut speeds = vec![Vec::new(); entrants.len()];
        for _ in 0..rounds {
            for ((built, _, packets), speeds) in entrants.iter().zip(&mut speeds) {
                speeds.push(room.trace(&pool, built.intersector.as_ref(), *packets, set));
            }
        }
        all.extend(entrants.iter().zip(&speeds).map(|((built, packed, _), speeds)| Speed {
            name: built.name,
            maker: built.maker,
            robust: built.robust,
            packed: *packed,
            class: set.class,
            million_rays_per_s: median(speeds),
        }));
    }
    Ok(all)
}

fn best_packing(pool: &ThreadPool, intersector: &dyn Intersector, set: &RaySet, room: &mut Room) -> Packets {
    let mut speeds = Packets::ALL.map(|packets| (packets, Vec::new()));
    for _ in 0..CHOOSING_ROUNDS {
        for (packets, speeds) in &mut speeds {
            speeds.push(room.trace(pool, intersector, *packets, set));
        }
    }
    let best = speeds.iter().max_by(|a, b| median(&a.1).total_cmp(&median(&b.1)));
    best.map_or(Packets::Single, |(packets, _)| *packets)
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    (sorted[middle] + sorted[(sorted.len() - 1) / 2]) / 2.0
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
        let (hits, any) = (&mut self.hits[..], &mut self.any[..]);
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
