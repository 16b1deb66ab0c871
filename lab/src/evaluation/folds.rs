//! Splits of the cameras into those that teach a predictor and those that examine it.

use std::collections::{BTreeMap, BTreeSet};

use rand::{SeedableRng as _, seq::SliceRandom as _};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::record::Place;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Split {
    /// As in the paper: a random fifth of each scene's cameras examines, the others teach.
    Random,
    /// All cameras of one scene examine, those of the others teach: the scene is unseen.
    Scene,
}

impl Split {
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Random => "other cameras of known scenes (80 % teach, 20 % examine)",
            Self::Scene => "scenes that were never seen (each left out once)",
        }
    }
}

/// One parting.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fold {
    pub(crate) split: Split,
    pub(crate) teach: Vec<Place>,
    pub(crate) examine: Vec<Place>,
}

/// The share of a scene's cameras that examines.
const EXAMINED: f64 = 0.2;

/// `rounds` random splits, and one for each scene; equal for equal places and seeds.
pub(crate) fn folds(places: &BTreeSet<Place>, rounds: u32, seed: u64) -> Vec<Fold> {
    let mut by_scene: BTreeMap<&str, Vec<&Place>> = BTreeMap::new();
    for place in places {
        by_scene.entry(&place.scene).or_default().push(place);
    }
    let random = (0..rounds).map(|round| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(u64::from(round));
        let (mut teach, mut examine) = (Vec::new(), Vec::new());
        for cameras in by_scene.values() {
            let mut shuffled = cameras.clone();
            shuffled.shuffle(&mut random);
            let count = ((cameras.len() as f64 * EXAMINED).round() as usize)
                .clamp(usize::from(cameras.len() > 1), cameras.len());
            examine.extend(shuffled.drain(..count).cloned());
            teach.extend(shuffled.into_iter().cloned());
        }
        Fold { split: Split::Random, teach, examine }.sorted()
    });
    let scenes = by_scene.keys().filter(|_| by_scene.len() > 1).map(|left_out| {
        let (examine, teach) = places.iter().cloned().partition(|place| place.scene == **left_out);
        Fold { split: Split::Scene, teach, examine }
    });
    random.chain(scenes).collect()
}

impl Fold {
    fn sorted(mut self) -> Self {
        self.teach.sort();
        self.examine.sort();
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fifth_camera_examines_and_no_camera_does_both() {
        let place = |scene: &str, camera| Place { scene: scene.to_owned(), camera };
        let places: BTreeSet<Place> =
            ["a", "b"].iter().flat_map(|scene| (0..20).map(move |camera| place(scene, camera))).collect();
        let all = folds(&places, 15, 1);
        assert_eq!(all.len(), 17);
        for fold in &all {
            assert_eq!(fold.teach.len() + fold.examine.len(), 40);
            assert!(fold.examine.iter().all(|place| !fold.teach.contains(place)));
            match fold.split {
                Split::Random => {
                    assert_eq!(fold.examine.iter().filter(|place| place.scene == "a").count(), 4)
                }
                Split::Scene => {
                    assert!(fold.examine.iter().all(|place| place.scene == fold.examine[0].scene))
                }
            }
        }
        assert_eq!(all, folds(&places, 15, 1));
        assert_ne!(all[0], all[1]);
    }
}
