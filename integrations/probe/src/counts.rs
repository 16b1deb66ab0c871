//! What was counted, in memory of its own for each thread, and how it is written.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU32, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};

use crate::SAMPLE;

/// Kinds of queries.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Closest,
    Occluded,
}

/// Threads with a shard of their own; further ones share the last.
const SHARDS: usize = 128;

/// Counts of one kind of query.
#[derive(Default)]
struct Queries {
    calls: AtomicU64,
    rays: AtomicU64,
    sampled: AtomicU64,
    sampled_ns: AtomicU64,
}

/// Counts of one thread, on cache lines of their own.
#[repr(align(128))]
#[derive(Default)]
struct Shard([Queries; 2]);

/// Everything that is counted.
pub(crate) struct Room {
    shards: OnceLock<Box<[Shard]>>,
    threads: AtomicUsize,
    builds: AtomicU64,
    build_wall_ns: AtomicU64,
    build_cpu_ns: AtomicU64,
    triangles: AtomicU64,
    devices: AtomicU64,
    flags: AtomicU32,
    qualities: AtomicU32,
    device: Mutex<String>,
    path: OnceLock<Option<String>>,
    began_ns: AtomicU64,
}

pub(crate) static ROOM: Room = Room {
    shards: OnceLock::new(),
    threads: AtomicUsize::new(0),
    builds: AtomicU64::new(0),
    build_wall_ns: AtomicU64::new(0),
    build_cpu_ns: AtomicU64::new(0),
    triangles: AtomicU64::new(0),
    devices: AtomicU64::new(0),
    flags: AtomicU32::new(0),
    qualities: AtomicU32::new(0),
    device: Mutex::new(String::new()),
    path: OnceLock::new(),
    began_ns: AtomicU64::new(0),
};

thread_local! {
    static PLACE: Cell<usize> = const { Cell::new(usize::MAX) };
    /// Within a query: what its callbacks ask for is part of it.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: there is room for the answer.
    unsafe { libc::clock_gettime(clock, &raw mut now) };
    (now.tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(now.tv_nsec as u64)
}

impl Room {
    pub(crate) fn begin(&self) {
        self.began_ns.store(clock_ns(libc::CLOCK_MONOTONIC), Relaxed);
        self.path.get_or_init(|| std::env::var("TREEWRIGHT_PROBE").ok());
    }

    fn shards(&self) -> &[Shard] {
        self.shards.get_or_init(|| (0..SHARDS).map(|_| Shard::default()).collect())
    }
}

/// Adds to a number that this thread alone writes, unless it is shared.
#[inline]
fn add(number: &AtomicU64, more: u64, shared: bool) -> u64 {
    if shared {
        return number.fetch_add(more, Relaxed);
    }
    let before = number.load(Relaxed);
    number.store(before.wrapping_add(more), Relaxed);
    before
}

/// Counts a query and runs it.
#[inline]
pub(crate) fn count(kind: Kind, rays: u64, run: impl FnOnce()) {
    let place = PLACE.with(|place| {
        if place.get() == usize::MAX {
            place.set(ROOM.threads.fetch_add(1, Relaxed).min(SHARDS - 1));
        }
        place.get()
    });
    let (numbers, shared) = (&ROOM.shards()[place].0[kind as usize], place == SHARDS - 1);
    add(&numbers.rays, rays, shared);
    let is_sample = add(&numbers.calls, 1, shared).is_multiple_of(SAMPLE);
    if !is_sample || INSIDE.get() {
        return run();
    }
    INSIDE.set(true);
    // The thread's own time: on a crowded machine a query is interrupted for longer than it takes.
    let start = clock_ns(libc::CLOCK_THREAD_CPUTIME_ID);
    run();
    let took = clock_ns(libc::CLOCK_THREAD_CPUTIME_ID).saturating_sub(start);
    INSIDE.set(false);
    add(&numbers.sampled, 1, shared);
    add(&numbers.sampled_ns, took, shared);
}

/// Runs a build and times it.
pub(crate) fn timed(run: impl FnOnce()) {
    let (wall, cpu) = (clock_ns(libc::CLOCK_MONOTONIC), clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID));
    run();
    ROOM.builds.fetch_add(1, Relaxed);
    ROOM.build_wall_ns.fetch_add(clock_ns(libc::CLOCK_MONOTONIC).saturating_sub(wall), Relaxed);
    ROOM.build_cpu_ns.fetch_add(clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID).saturating_sub(cpu), Relaxed);
}

pub(crate) fn note_device(config: *const c_char) {
    ROOM.devices.fetch_add(1, Relaxed);
    if !config.is_null()
        && let Ok(mut device) = ROOM.device.try_lock()
    {
        // SAFETY: Embree asks for text that ends in a zero.
        *device = unsafe { CStr::from_ptr(config) }.to_string_lossy().chars().take(200).collect();
    }
}

pub(crate) fn note_flags(flags: c_int) {
    ROOM.flags.fetch_or(flags as u32, Relaxed);
}

pub(crate) fn note_quality(quality: c_int) {
    ROOM.qualities.fetch_or(1 << (quality & 7), Relaxed);
}

/// `RTC_BUFFER_TYPE_INDEX` is 0; curves and quads count as triangles, too.
pub(crate) fn note_triangles(kind: c_int, items: usize) {
    if kind == 0 {
        ROOM.triangles.fetch_add(items as u64, Relaxed);
    }
}

/// What a look at the clock costs, which is taken off the samples.
fn timer_ns() -> u64 {
    let start = clock_ns(libc::CLOCK_THREAD_CPUTIME_ID);
    for _ in 0..1000 {
        std::hint::black_box(clock_ns(libc::CLOCK_THREAD_CPUTIME_ID));
    }
    clock_ns(libc::CLOCK_THREAD_CPUTIME_ID).saturating_sub(start) / 1000
}

/// Writes what was counted so far, in place of what was written before. What cannot be written is left.
pub(crate) fn write() {
    let Some(Some(path)) = ROOM.path.get() else { return };
    if ROOM.devices.load(Relaxed) == 0 {
        return;
    }
    let cpu_ns = clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID);
    let wall_ns = clock_ns(libc::CLOCK_MONOTONIC).saturating_sub(ROOM.began_ns.load(Relaxed));
    let timer = timer_ns();
    let mut text = String::from("{");
    for (kind, name) in [(Kind::Closest, "closest"), (Kind::Occluded, "occluded")] {
        let sum = |pick: fn(&Queries) -> &AtomicU64| -> u64 {
            ROOM.shards().iter().map(|shard| pick(&shard.0[kind as usize]).load(Relaxed)).sum()
        };
        let (calls, sampled) = (sum(|one| &one.calls), sum(|one| &one.sampled).max(1));
        let each = (sum(|one| &one.sampled_ns) as f64 / sampled as f64 - timer as f64).max(0.0);
        let _ = write!(
            text,
            "\"{name}\":{{\"calls\":{calls},\"rays\":{},\"total_ms\":{:.3}}},",
            sum(|one| &one.rays),
            each * calls as f64 / 1e6
        );
    }
    let device = ROOM.device.try_lock().map_or_else(|_| String::new(), |device| device.clone());
    let quoted = |text: &str| text.replace(['"', '\\'], "'").replace(char::is_control, " ");
    let ms = |ns: &AtomicU64| ns.load(Relaxed) as f64 / 1e6;
    let _ = write!(
        text,
        "\"builds\":{},\"build_wall_ms\":{:.3},\"build_cpu_ms\":{:.3},\"primitives\":{},\"devices\":{},\"flags\":{},\"qualities\":{},\
         \"threads\":{},\"cpu_ms\":{:.3},\"wall_ms\":{:.3},\"device\":\"{}\",\"embree\":\"{}\"}}",
        ROOM.builds.load(Relaxed),
        ms(&ROOM.build_wall_ns),
        ms(&ROOM.build_cpu_ns),
        ROOM.triangles.load(Relaxed),
        ROOM.devices.load(Relaxed),
        ROOM.flags.load(Relaxed),
        ROOM.qualities.load(Relaxed),
        ROOM.threads.load(Relaxed),
        cpu_ns as f64 / 1e6,
        wall_ns as f64 / 1e6,
        quoted(&device),
        quoted(&crate::real::mapped().unwrap_or_default()),
    );
    // The host's business goes on whatever becomes of the file.
    let _ = std::fs::write(format!("{path}.{}", std::process::id()), text);
}
