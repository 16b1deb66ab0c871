//! Every limit of the renderer's loop and programs, in one place. The scene readers have their own.

/// Largest width and height of a picture in pixels.
pub const SIZE_MAX: u32 = 16_384;
/// Most samples a pixel that a picture is rendered with.
pub const SAMPLES_MAX: u32 = 1 << 20;
/// Most bounces of a path.
pub const BOUNCES_MAX: u32 = 64;
/// Most thin sheets (glass) that a ray passes between two bounces.
pub const SHEETS_PER_SEGMENT_MAX: u32 = 4;
/// Most ways through transmitting solids between two bounces: from wall to wall inside counts as one.
pub const SOLID_WAYS_MAX: u32 = 24;
/// Most groups of emissive triangles that are told apart where it is learnt which lamps light a place.
pub const LAMP_GROUPS_MAX: usize = 1024;
/// Most groups of them that are kept for a place.
pub const LAMP_GROUPS_PER_CELL_MAX: usize = 32;
/// Most places for which that is learnt.
pub const LAMP_CELLS_MAX: usize = 2048;
/// Most render threads.
pub const THREADS_MAX: usize = 1024;
/// Most iterations of a tuning run and frames of a flight.
pub const ITERATIONS_MAX: u32 = 100_000;
/// Most frames that one trial of a search renders.
pub const FRAMES_PER_TRIAL_MAX: u32 = 1000;
/// Most frames of an episode.
pub const EPISODE_FRAMES_MAX: u32 = 64;
/// Most triangles and instances of an episode's moments together: some 40 and 144 bytes each.
pub const EPISODE_TRIANGLES_MAX: usize = 100_000_000;
/// Most memory of the structures that a search keeps for later trials, in bytes.
pub const SHELF_BYTES_MAX: usize = 2 << 30;
/// One of this number of render threads builds behind the frames where trees are swapped.
pub const SWAP_THREADS_SHARE: usize = 4;
/// Most trials that one build serves.
pub const TRIALS_PER_BUILD_MAX: u32 = 4;
/// Most trials for which a search remembers the time of a build or of a frame in real time.
pub const TRIALS_APART_MAX: u64 = 32;
/// Most frames that a trial renders beyond the requested ones because its build took long.
pub const FRAMES_PER_SLOW_BUILD_MAX: usize = 5;
/// Longest time in seconds that a search waits for an answer of the daemon.
pub const PATIENCE_S_MAX: u64 = 86_400;
/// Most random samples at one camera.
pub const SAMPLES_PER_PLACE_MAX: u32 = 10_000_000;
/// Most rounds in which winners are measured again.
pub const ROUNDS_MAX: u32 = 10_000;
/// Longest time in seconds that a search waits for the rounds of a second process.
pub const SECOND_PROCESS_S_MAX: u64 = 600;
/// Most configurations of one benchmark.
pub const CONTENDERS_MAX: usize = 64;
/// Most independent runs of a comparison of errors.
pub const RUNS_MAX: u32 = 1000;
/// Longest time in seconds that a contender gets in one of them.
pub const SECONDS_MAX: f64 = 86_400.0;
