//! The memory bandwidth of this machine, from which rays read the nodes and blocks that they visit.

use std::hint::black_box;
use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// Bytes for each thread that lie in the second cache, in the third one, and in neither.
const SIZES: [(&str, usize); 3] =
    [("second cache", 512 << 10), ("third cache", 4 << 20), ("memory", 128 << 20)];

/// Time of reading at each size.
const TIME: Duration = Duration::from_millis(200);

/// Gigabytes a second that some threads read together, by where the bytes lie, in words.
pub(crate) fn measured(threads: usize) -> Result<String, ThreadPoolBuildError> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build()?;
    let places = SIZES.map(|(name, bytes)| format!("{name} {:.1}", read(&pool, bytes)));
    Ok(format!("which read, in GB/s, from {}", places.join(", ")))
}

fn read(pool: &ThreadPool, bytes: usize) -> f64 {
    let each = pool.broadcast(|_| {
        let numbers = vec![1.0_f32; bytes / size_of::<f32>()];
        let begin = Instant::now();
        let mut rounds = 0;
        while begin.elapsed() < TIME {
            // Many sums, so that the additions do not wait for each other.
            let mut sums = [0.0_f32; 64];
            for some in black_box(&numbers).chunks_exact(64) {
                sums.iter_mut().zip(some).for_each(|(sum, number)| *sum += number);
            }
            black_box(sums);
            rounds += 1;
        }
        (rounds * bytes) as f64 / begin.elapsed().as_secs_f64() / 1e9
    });
    each.into_iter().sum()
}
