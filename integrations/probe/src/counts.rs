//! The counts, in memory of its own for each thread, and their file.
//!
//! No query is timed: a clock around it costs as much as the query, and a thread that waits for its turn
//! inside one would be taken for a slow query. Each thread says in its shard whether it is within a query. A
//! thread of the library looks every [`LOOK`] and attributes the processor time of each thread since the last
//! look to its present work. Over thousands of looks that gives the work's share.
//!
//! Even that costs a tracing program some percent. So only the first [`EXACT`] queries are counted one by
//! one. From then on the library looks and counts in windows of two milliseconds, for one part in [`SHARE`]
//! of the time; these counts stand for the rest. The windows are at random places, so that they do not keep
//! step with the host's frames. Outside of them a query costs one more jump.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int};
use std::sync::atomic::{AtomicI32, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{LazyLock, Mutex, Once, OnceLock};
use std::time::{Duration, Instant};

use crate::findings::{self, Findings};

#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Closest,
    Occluded,
}

/// Threads with a shard of their own; further ones share the last, where they are counted and not looked at.
const SHARDS: usize = 128;
/// Between two looks at what every thread is at.
const LOOK: Duration = Duration::from_micros(350);
/// Queries of all threads that are counted before the windows begin.
const EXACT: u64 = 1 << 20;
/// One part in this many of the time is within a window.
const SHARE: u32 = 4;
/// Looks in a window.
const LOOKS: u32 = 5;

/// For how many queries one that is counted stands; 0 outside of a window.
static WEIGHT: AtomicU64 = AtomicU64::new(1);

/// For how many queries one that begins now stands; 0 where it is not to be counted.
#[inline]
pub(crate) fn weight() -> u64 {
    WEIGHT.load(Relaxed)
}

#[derive(Default)]
struct Queries {
    calls: AtomicU64,
    /// Rays beyond the first of a call.
    more_rays: AtomicU64,
    /// Processor time that looks have put down to it.
    ns: AtomicU64,
}

/// Counts of one thread, on cache lines of their own.
#[repr(align(128))]
#[derive(Default)]
struct Shard {
    queries: [Queries; 2],
    /// The kind of query that the thread is within, and 1; or 0.
    within: AtomicU8,
    /// The thread's own processor clock; 0 until it has one.
    clock: AtomicI32,
    /// Processor time that it took since it was first looked at.
    cpu_ns: AtomicU64,
    /// For how much of that the looks stand: about as much, as windows are a part of the wall clock's time.
    seen_ns: AtomicU64,
}

impl Shard {
    /// A count or time of this thread, as it is when its windows stand for exactly the processor time that it
    /// took.
    fn scaled(&self, number: &AtomicU64) -> u64 {
        let (number, cpu, seen) =
            (number.load(Relaxed), self.cpu_ns.load(Relaxed), self.seen_ns.load(Relaxed));
        if seen == 0 || seen == cpu { number } else { (number as f64 * cpu as f64 / seen as f64) as u64 }
    }
}

static SHARDS_OF_THREADS: LazyLock<Box<[Shard]>> =
    LazyLock::new(|| (0..SHARDS).map(|_| Shard::default()).collect());
static THREADS: AtomicUsize = AtomicUsize::new(0);
static BUILDING: AtomicUsize = AtomicUsize::new(0);
static BUILDS: AtomicU64 = AtomicU64::new(0);
static BUILD_WALL_NS: AtomicU64 = AtomicU64::new(0);
static BUILD_CPU_NS: AtomicU64 = AtomicU64::new(0);
static TRIANGLES: AtomicU64 = AtomicU64::new(0);
static DEVICES: AtomicU64 = AtomicU64::new(0);
static FLAGS: AtomicU32 = AtomicU32::new(0);
static QUALITIES: AtomicU32 = AtomicU32::new(0);
static DEVICE: Mutex<String> = Mutex::new(String::new());
static PATH: OnceLock<Option<String>> = OnceLock::new();
static BEGAN_NS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static MINE: Cell<Option<&'static Shard>> = const { Cell::new(None) };
}

fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: there is room for the answer.
    unsafe { libc::clock_gettime(clock, &raw mut now) };
    (now.tv_sec as u64).wrapping_mul(1_000_000_000).wrapping_add(now.tv_nsec as u64)
}

pub(crate) fn begin() {
    BEGAN_NS.store(clock_ns(libc::CLOCK_MONOTONIC), Relaxed);
    PATH.get_or_init(|| std::env::var("TREEWRIGHT_PROBE").ok());
}

/// Adds to a number that this thread alone writes, but for the last shard: what threads beyond [`SHARDS`]
/// lose there is little.
#[inline]
fn add(number: &AtomicU64, more: u64) {
    number.store(number.load(Relaxed).wrapping_add(more), Relaxed);
}

/// Counts a query with this weight and runs it. Queries of its callbacks are part of it.
#[inline]
pub(crate) fn count(kind: Kind, rays: u64, weight: u64, run: impl FnOnce()) {
    let shard = MINE.with(|mine| mine.get().unwrap_or_else(|| take_place(mine)));
    let numbers = &shard.queries[kind as usize];
    add(&numbers.calls, weight);
    if rays > 1 {
        add(&numbers.more_rays, weight * (rays - 1));
    }
    if shard.within.load(Relaxed) != 0 {
        return run();
    }
    shard.within.store(kind as u8 + 1, Relaxed);
    run();
    shard.within.store(0, Relaxed);
}

#[cold]
fn take_place(mine: &Cell<Option<&'static Shard>>) -> &'static Shard {
    static LOOKING: Once = Once::new();
    let taken = THREADS.fetch_add(1, Relaxed).min(SHARDS - 1);
    let shard = &SHARDS_OF_THREADS[taken];
    mine.set(Some(shard));
    let mut clock = 0;
    // SAFETY: the thread is alive, and there is room for the answer.
    if unsafe { libc::pthread_getcpuclockid(libc::pthread_self(), &raw mut clock) } == 0 && taken < SHARDS - 1
    {
        shard.clock.store(clock, Relaxed);
    }
    LOOKING.call_once(|| {
        // The host's signals are for the host's threads: a new thread has the mask of the one that starts it.
        // SAFETY: both sets are there, and the old mask is put back.
        unsafe {
            let (mut all, mut before) = (std::mem::zeroed(), std::mem::zeroed());
            libc::sigfillset(&raw mut all);
            libc::pthread_sigmask(libc::SIG_SETMASK, &raw const all, &raw mut before);
            // A host that may have no more threads is counted without being looked at.
            let _ =
                std::thread::Builder::new().name("treewright-probe".into()).stack_size(64 << 10).spawn(look);
            libc::pthread_sigmask(libc::SIG_SETMASK, &raw const before, std::ptr::null_mut());
        }
    });
    shard
}

/// Attributes each thread's processor time to its present work, as long as the process lives.
fn look() {
    let mut before = [0u64; SHARDS];
    while counted() < EXACT {
        std::thread::sleep(LOOK);
        look_once(&mut before, 1);
    }
    WEIGHT.store(0, Relaxed);
    let (mut random, begun, mut looked) = (1u32, Instant::now(), Duration::ZERO);
    loop {
        // Somewhere in its part of the time, wherever the host happened to be at the beginning.
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let ahead = (LOOK * LOOKS * (SHARE - 1)).mul_f64(f64::from(random >> 8) / f64::from(1 << 24));
        std::thread::sleep(ahead);
        let window = Instant::now();
        look_once(&mut before, 0);
        WEIGHT.store(u64::from(SHARE), Relaxed);
        for _look in 0..LOOKS {
            std::thread::sleep(LOOK);
            look_once(&mut before, u64::from(SHARE));
        }
        WEIGHT.store(0, Relaxed);
        looked += window.elapsed();
        // On a busy machine sleep takes longer than asked; the excess is taken from the next sleep.
        std::thread::sleep((looked * SHARE).saturating_sub(begun.elapsed()));
    }
}

/// Queries that were counted so far.
fn counted() -> u64 {
    let calls = |shard: &Shard| shard.queries.iter().map(|one| one.calls.load(Relaxed)).sum::<u64>();
    SHARDS_OF_THREADS.iter().map(calls).sum()
}

/// Reads the threads' processor clocks, and attributes the time since the last look, times `weight`, to each
/// thread's present work.
fn look_once(before: &mut [u64; SHARDS], weight: u64) {
    let threads = THREADS.load(Relaxed).min(SHARDS - 1);
    for (shard, before) in SHARDS_OF_THREADS.iter().zip(before).take(threads) {
        let within = usize::from(shard.within.load(Relaxed));
        let clock = shard.clock.load(Relaxed);
        if clock == 0 {
            continue;
        }
        // A thread that has ended has no clock any more: 0.
        let now = clock_ns(clock);
        let took = if *before == 0 { 0 } else { now.saturating_sub(*before) };
        *before = now;
        add(&shard.cpu_ns, took);
        add(&shard.seen_ns, took * weight);
        if let Some(numbers) = within.checked_sub(1).and_then(|kind| shard.queries.get(kind)) {
            numbers.ns.fetch_add(took * weight, Relaxed);
        }
    }
}

/// Runs a build and times it. Of builds at one time, and of threads that join one, the first is timed: the
/// processor time is the whole process's.
pub(crate) fn timed(joins: bool, run: impl FnOnce()) {
    if BUILDING.fetch_add(1, Relaxed) > 0 {
        run();
        BUILDING.fetch_sub(1, Relaxed);
        BUILDS.fetch_add(u64::from(!joins), Relaxed);
        return;
    }
    let (wall, cpu) = (clock_ns(libc::CLOCK_MONOTONIC), clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID));
    run();
    BUILDING.fetch_sub(1, Relaxed);
    BUILDS.fetch_add(1, Relaxed);
    BUILD_WALL_NS.fetch_add(clock_ns(libc::CLOCK_MONOTONIC).saturating_sub(wall), Relaxed);
    BUILD_CPU_NS.fetch_add(clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID).saturating_sub(cpu), Relaxed);
}

pub(crate) fn note_device(config: *const c_char) {
    DEVICES.fetch_add(1, Relaxed);
    if !config.is_null()
        && let Ok(mut device) = DEVICE.try_lock()
    {
        // SAFETY: Embree asks for text that ends in a zero.
        *device = unsafe { CStr::from_ptr(config) }.to_string_lossy().chars().take(200).collect();
    }
}

pub(crate) fn note_flags(flags: c_int) {
    FLAGS.fetch_or(flags as u32, Relaxed);
}

pub(crate) fn note_quality(quality: c_int) {
    QUALITIES.fetch_or(1 << (quality & 7), Relaxed);
}

/// `RTC_BUFFER_TYPE_INDEX` is 0; curves and quads count as triangles, too.
pub(crate) fn note_triangles(kind: c_int, items: usize) {
    if kind == 0 {
        TRIANGLES.fetch_add(items as u64, Relaxed);
    }
}

/// Writes the counts so far over the last file. A failure to write is ignored.
pub(crate) fn write() {
    let Some(Some(path)) = PATH.get() else { return };
    if DEVICES.load(Relaxed) == 0 {
        return;
    }
    let cpu_ns = clock_ns(libc::CLOCK_PROCESS_CPUTIME_ID);
    let wall_ns = clock_ns(libc::CLOCK_MONOTONIC).saturating_sub(BEGAN_NS.load(Relaxed));
    let ms = |ns: u64| ns as f64 / 1e6;
    let queries = |kind: Kind| {
        let sum = |pick: fn(&Queries) -> &AtomicU64| -> u64 {
            SHARDS_OF_THREADS.iter().map(|shard| shard.scaled(pick(&shard.queries[kind as usize]))).sum()
        };
        let calls = sum(|one| &one.calls);
        findings::Queries { calls, rays: calls + sum(|one| &one.more_rays), total_ms: ms(sum(|one| &one.ns)) }
    };
    let found = Findings {
        closest: queries(Kind::Closest),
        occluded: queries(Kind::Occluded),
        builds: BUILDS.load(Relaxed),
        build_wall_ms: ms(BUILD_WALL_NS.load(Relaxed)),
        build_cpu_ms: ms(BUILD_CPU_NS.load(Relaxed)),
        primitives: TRIANGLES.load(Relaxed),
        devices: DEVICES.load(Relaxed),
        flags: FLAGS.load(Relaxed),
        qualities: QUALITIES.load(Relaxed),
        threads: THREADS.load(Relaxed) as u64,
        cpu_ms: ms(cpu_ns),
        wall_ms: ms(wall_ns),
        device: DEVICE.try_lock().map_or_else(|_| String::new(), |device| device.clone()),
        embree: crate::real::mapped().join(" "),
    };
    let Ok(text) = serde_json::to_string(&found) else { return };
    // An error must not disturb the host, and a file larger than the host may write would end it by a signal.
    if has_room(text.len()) {
        let _ = std::fs::write(format!("{path}.{}", std::process::id()), text);
    }
}

/// Whether the process may write files of this size (`ulimit -f`).
fn has_room(bytes: usize) -> bool {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: there is room for the answer.
    let known = unsafe { libc::getrlimit(libc::RLIMIT_FSIZE, &raw mut limit) } == 0;
    known && limit.rlim_cur >= bytes as libc::rlim_t
}
