//! Random configurations as a numbered sequence (paper, section 4.1): sample 17 of a camera is one fixed
//! configuration, for every renderer and at any time.
//!
//! Each is drawn independently and evenly over the space. So a run that was stopped needs to know only which
//! numbers are there, and several renderers can share the numbers.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use treewright_client::{Configuration, Indicators};
use treewright_model::fnv;

use crate::space::TuningSpace;

/// Name of the measurement that holds a sample's number.
pub const SAMPLE: &str = "sample";
/// Name of the measurement that holds the sequence's [identity](Sequence::identity).
pub const SEQUENCE: &str = "sequence";

/// The samples of one place.
#[derive(Clone, Debug)]
pub struct Sequence {
    space: TuningSpace,
    seed: u64,
    identity: u32,
}

impl Sequence {
    /// A space's sequence at the place of the indicators; seed, part of the space and place set it.
    pub fn new(space: &TuningSpace, state: &Indicators, seed: u64) -> Self {
        let mut described = seed.to_le_bytes().to_vec();
        for one in space.explained() {
            described.extend(format!("{:?}", one.parameter).bytes());
        }
        described.extend(space.with_held(&space.default_configuration()).to_string().bytes());
        for (name, value) in state.iter() {
            described.extend(name.bytes());
            described.extend(value.to_bits().to_le_bytes());
        }
        let seed = fnv::hash(described);
        Self { space: space.clone(), seed, identity: (seed >> 32) as u32 ^ seed as u32 }
    }

    /// Its identity within a study: a whole number, so that a measurement can hold it.
    pub fn identity(&self) -> u32 {
        self.identity
    }

    /// A sample by its number.
    pub fn configuration(&self, number: u32) -> Configuration {
        let space = self.space.space();
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(u64::from(number));
        let point: Vec<f64> = (0..space.dimension()).map(|_| random.random()).collect();
        self.space.with_held(&space.decode(&point).to_raw().into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Narrowing;

    #[test]
    fn a_sample_is_its_number() {
        let space = TuningSpace::paper();
        let state = Indicators::new().with("triangles", 12.0);
        let sequence = Sequence::new(&space, &state, 1);
        let all: Vec<Configuration> = (0..200).map(|number| sequence.configuration(number)).collect();
        let again = Sequence::new(&space, &state, 1);
        assert!((0..200).rev().all(|number| again.configuration(number) == all[number as usize]));
        let distinct: std::collections::BTreeSet<&Configuration> = all.iter().collect();
        assert!(distinct.len() > 80, "they differ; all compact ones are alike: {}", distinct.len());
        let other = [
            Sequence::new(&space, &state, 2),
            Sequence::new(&space, &Indicators::new().with("triangles", 13.0), 1),
            Sequence::new(
                &space.narrowed(&[Narrowing::fix("compact=false").expect("it reads")]).expect("sound"),
                &state,
                1,
            ),
        ];
        assert!(other.iter().all(|other| other.identity() != sequence.identity()));
    }

    #[test]
    fn every_value_is_drawn_about_as_often() {
        let narrow = [Narrowing::fix("compact=false").expect("it reads")];
        let space = TuningSpace::paper().narrowed(&narrow).expect("it is sound");
        let sequence = Sequence::new(&space, &Indicators::new(), 3);
        let mut counts = [0_u32; 3];
        for number in 0..3000 {
            let quality = sequence.configuration(number).integer("quality").expect("there is one");
            counts[quality as usize - 1] += 1;
        }
        // Three standard deviations of a binomial count are 77.
        assert!(counts.iter().all(|count| count.abs_diff(1000) < 100), "{counts:?}");
    }
}
