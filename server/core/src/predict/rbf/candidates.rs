//! The configurations among which a model of features chooses: those with the least cost relative to the
//! default.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::CANDIDATES_MAX;
use crate::predict::Lesson;
use crate::space::Space;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CandidateConfiguration {
    #[serde(with = "crate::configuration::unchecked")]
    pub(super) configuration: Configuration,
    /// The best cost it reached anywhere, over that of the default configuration in that state.
    ratio: f64,
    /// The action's part of the squared distance to each centre.
    pub(super) action_2: Vec<f64>,
}

/// At most [`CANDIDATES_MAX`] of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Candidates {
    list: Vec<CandidateConfiguration>,
    /// Only looked up, never walked, so its order does not matter.
    #[serde(skip)]
    index: HashMap<Configuration, usize>,
}

impl Candidates {
    pub(super) fn iter(&self) -> impl Iterator<Item = &CandidateConfiguration> {
        self.list.iter()
    }

    /// Completes candidates that were read from a checkpoint. `false` when a configuration does not fit the
    /// space.
    pub(super) fn settle(&mut self, space: &Space) -> bool {
        let places = self.list.iter().enumerate();
        self.index = places.map(|(place, candidate)| (candidate.configuration.clone(), place)).collect();
        self.list.iter().all(|candidate| space.owns(&candidate.configuration))
    }

    /// Keeps the configuration of a lesson. When full, the candidate with the greatest cost relative to the
    /// default is dropped.
    pub(super) fn keep(&mut self, lesson: &Lesson<'_>, cost: f64, action_2: Vec<f64>) {
        let ratio = match lesson.default_cost {
            Some(default) if default > 0.0 => cost / default,
            _ => 1.0,
        };
        if let Some(&index) = self.index.get(lesson.configuration) {
            let candidate = &mut self.list[index];
            assert!(candidate.configuration == *lesson.configuration, "the place of another configuration");
            candidate.ratio = candidate.ratio.min(ratio);
            return;
        }
        let candidate =
            CandidateConfiguration { configuration: lesson.configuration.clone(), ratio, action_2 };
        let place = if self.list.len() < CANDIDATES_MAX {
            self.list.push(candidate);
            self.list.len() - 1
        } else {
            let by_ratio = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
            let ratios = self.list.iter().map(|candidate| candidate.ratio).enumerate();
            match ratios.max_by(by_ratio) {
                Some((worst, worst_ratio)) if ratio < worst_ratio => {
                    self.index.remove(&self.list[worst].configuration);
                    self.list[worst] = candidate;
                    worst
                }
                _ => return,
            }
        };
        self.index.insert(lesson.configuration.clone(), place);
        assert_eq!(self.index.len(), self.list.len(), "every candidate is found by its configuration");
    }
}
