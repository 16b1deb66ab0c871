//! The memory bandwidth of this machine, from which rays read the nodes and blocks that they visit.

use std::fmt;
use std::hint::black_box;
use std::time::{Duration, Instant};

use rayon::ThreadPool;
use serde::Serialize;

/// Bytes for each thread that lie in the second cache, in the third one, and in neither on today's
/// processors.
const SIZES: [(&str, usize); 3] =
    [("second cache", 512 << 10), ("third cache", 4 << 20), ("memory", 128 << 20)];

/// Time of reading at each size.
const TIME: Duration = Duration::from_millis(200);

/// Gigabytes a second that all threads of a pool read together.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Bandwidth {
    threads: usize,
    /// By where the bytes lie.
    pub(crate) gb_per_s: Vec<(&'static str, f64)>,
}

impl Bandwidth {
    pub(crate) fn measure(threads: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let gb_per_s = SIZES.iter().map(|&(name, bytes)| (name, read(&pool, bytes)));
        Ok(Self { threads, gb_per_s: gb_per_s.collect() })
    }
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

impl fmt::Display for Bandwidth {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = if self.threads == 1 {
            "one thread reads".into()
        } else {
            format!("{} threads read", self.threads)
        };
        write!(formatter, "{threads}, in GB/s, from")?;
        for (place, (name, gb_per_s)) in self.gb_per_s.iter().enumerate() {
            let comma = if place == 0 { "" } else { "," };
            write!(formatter, "{comma} {name} {gb_per_s:.1}")?;
        }
        Ok(())
    }
}
