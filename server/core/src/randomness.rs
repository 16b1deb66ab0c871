//! Every random decision of the core, each from a stream of its own.
//!
//! A stream is named by the study's seed, its purpose and two numbers (a state, a step). ChaCha is a
//! pseudo-random function of its key, so streams with different names are independent. A restarted tuner
//! needs only the counters to draw these numbers again.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The purpose of a stream.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    /// A step of a search: state, step.
    Search = 1,
    /// Explore or exploit: client, visit.
    Decision = 2,
    /// Centres of the radial basis functions.
    Centres = 3,
    /// An unseen configuration where a search has none: state, trial.
    Unseen = 4,
    /// The points that a contextual model tries: exploit or explore, question.
    Contextual = 5,
}

/// The stream of that name.
pub(crate) fn stream(seed: u64, purpose: Purpose, first: u64, second: u64) -> ChaCha8Rng {
    let mut key = [0u8; 32];
    for (slot, word) in key.chunks_exact_mut(8).zip([seed, purpose as u64, first, second]) {
        slot.copy_from_slice(&word.to_le_bytes());
    }
    ChaCha8Rng::from_seed(key)
}

/// A random number of the standard normal distribution (Box and Muller, "A note on the generation of random
/// normal deviates", Annals of Mathematical Statistics 29, 1958).
pub(crate) fn standard_normal(random: &mut ChaCha8Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    libm::sqrt(-2.0 * libm::log(a)) * libm::cos(2.0 * std::f64::consts::PI * b)
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn streams_are_told_apart_by_every_part_of_their_name() {
        let first = |seed, purpose, a, b| stream(seed, purpose, a, b).next_u64();
        let base = first(1, Purpose::Search, 2, 3);
        assert_eq!(base, first(1, Purpose::Search, 2, 3));
        assert_ne!(base, first(2, Purpose::Search, 2, 3));
        assert_ne!(base, first(1, Purpose::Decision, 2, 3));
        assert_ne!(base, first(1, Purpose::Search, 3, 3));
        assert_ne!(base, first(1, Purpose::Search, 2, 4));
    }
}
