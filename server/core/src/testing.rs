//! How property tests are run: with a fixed seed, so that a failure comes back.

use proptest::test_runner::{Config, RngSeed};

/// A configuration of `cases` cases. `PROPTEST_CASES` and `PROPTEST_RNG_SEED` widen the search by hand.
pub(crate) fn cases(cases: u32) -> Config {
    let environment = Config::default();
    let by_hand = std::env::var_os("PROPTEST_CASES").is_some();
    let rng_seed = match environment.rng_seed {
        RngSeed::Random => RngSeed::Fixed(1),
        fixed => fixed,
    };
    let cases = if by_hand { environment.cases } else { cases };
    Config {
        cases,
        rng_seed,
        failure_persistence: None,
        ..environment
    }
}
