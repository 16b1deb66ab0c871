//! The settings of property tests: a fixed seed, so that failures are reproducible.

use proptest::test_runner::{Config, RngSeed};

/// The library's own number of cases.
const CASES_USUAL: u32 = 256;

/// A configuration of `cases` cases. The library's variables `PROPTEST_CASES` and `PROPTEST_RNG_SEED`
/// widen the search by hand.
pub(crate) fn cases(cases: u32) -> Config {
    let given = Config::default();
    let rng_seed = match given.rng_seed {
        RngSeed::Random => RngSeed::Fixed(1),
        fixed => fixed,
    };
    let cases = if given.cases == CASES_USUAL { cases } else { given.cases };
    Config { cases, rng_seed, failure_persistence: None, ..given }
}
