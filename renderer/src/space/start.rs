//! The start of a search: the configuration recommended for all scenes, or a user's own.

use treewright_client::{Configuration, Parameter};

use super::{ConfigurationError, Preset, TuningSpace, parse, space_of};

/// The full space's defaults untuned: Embree's, its builder's (Table 1), path by path.
const UNTUNED: &str = "native_quality=medium,builder=embree,quality=2,search_radius=8,\
     cluster_size=1,collapse=builder,branching_factor=2,node_width=8,reinsertion_passes=0,\
     max_depth=32,sah_block_size=1,min_leaf_size=1,max_leaf_size=32,traversal_cost=1.0,block_width=4,\
     staged=false";

/// Where a search begins. It is the default of the study, which every gain is compared with.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Start {
    /// At the configuration that is recommended for all scenes, which was tuned beforehand on others.
    #[default]
    Recommended,
    /// At native Embree as `rtcCommitScene` builds it untold, traced path by path.
    Native,
    /// At the paper's recommended default, traced path by path.
    Paper,
    /// At a configuration of the user's own.
    Own(Configuration),
}

impl Start {
    /// The mark of a study that begins here, e.g. `-from-native`; empty for the recommended start.
    pub fn mark(&self, space: &TuningSpace) -> String {
        match self {
            Self::Recommended => String::new(),
            Self::Native => "-from-native".to_owned(),
            Self::Paper => "-from-paper".to_owned(),
            Self::Own(_) => {
                let text = space.with_held(&space.default_configuration()).to_string();
                format!("-from-{}", super::short_hash(&text))
            }
        }
    }
}

impl TuningSpace {
    /// The space with `start` as its default configuration. Parameters that are inactive there get the
    /// defaults of somebody who has tuned nothing, so that no branch of the space begins at a tuned value.
    ///
    /// # Errors
    /// The start is no configuration of this space.
    pub fn beginning_at(&self, start: &Start) -> Result<Self, ConfigurationError> {
        let backend = |name: &str| parse(&format!("backend={name}"));
        let given = match start {
            Start::Recommended => return Ok(self.clone()),
            Start::Native | Start::Paper if matches!(self.preset, Preset::Light | Preset::Follow) => {
                return Err(ConfigurationError::NoSuchStart);
            }
            Start::Paper if self.preset == Preset::Paper => return Ok(self.clone()),
            Start::Native => backend("native")?,
            Start::Paper => backend("tunable")?,
            Start::Own(configuration) => configuration.clone(),
        };
        let plain = match self.preset {
            Preset::Full => self.with_defaults(&parse(UNTUNED)?)?,
            Preset::Paper | Preset::Light | Preset::Follow => self.clone(),
        };
        plain.with_defaults(&plain.complete(&given)?)
    }

    /// The space's parameters, with these defaults where they are allowed.
    fn with_defaults(&self, defaults: &Configuration) -> Result<Self, ConfigurationError> {
        let parameters = self.space.parameters().iter().map(|parameter| {
            let own = defaults.get(&parameter.name).filter(|value| parameter.domain.contains(value));
            Parameter { default: own.unwrap_or(&parameter.default).clone(), ..parameter.clone() }
        });
        let refused = |problem| ConfigurationError::Space { space: self.preset.name(), problem };
        Ok(Self { space: space_of(parameters.collect()).map_err(refused)?, ..self.clone() })
    }
}

#[cfg(test)]
mod tests {
    use treewright_accel::NativeQuality;

    use super::*;
    use crate::space::{Choice, Premises};

    #[test]
    fn each_start_is_what_its_name_says_and_changes_nothing_else() {
        for builds_each_frame in [false, true] {
            let premises = Premises { builds_each_frame, ..Premises::all() };
            let space = TuningSpace::new(Preset::Full, &premises);
            let begun = |start: &Start| space.beginning_at(start).expect("it is one of the space");
            assert_eq!(begun(&Start::Recommended), space);
            assert_eq!(begun(&Start::Native).default_choice(), Choice::native(NativeQuality::Medium));
            assert_eq!(begun(&Start::Paper).default_choice(), Choice::paper_default());
            let own = parse("quality=3,branching_factor=4,collapse=builder,staged=true").expect("words");
            let from_own = begun(&Start::Own(own.clone()));
            assert_eq!(from_own.default_configuration(), begun(&Start::Paper).complete(&own).expect("own"));
            for start in [Start::Native, Start::Paper, Start::Own(own)] {
                let begun = begun(&start);
                let domains = |space: &TuningSpace| -> Vec<_> {
                    let parameters = space.space().parameters().iter();
                    parameters
                        .map(|one| (one.name.clone(), one.domain.clone(), one.active_if.clone()))
                        .collect()
                };
                assert_eq!(domains(&begun), domains(&space));
                // A configuration of one space runs in the other, and does equal work.
                let tuned = space.default_configuration();
                assert_eq!(begun.choice(&tuned).expect("the whole configuration"), space.default_choice());
                assert!(start.mark(&begun).starts_with("-from-"));
            }
        }
    }

    #[test]
    fn no_branch_begins_at_a_tuned_value() {
        let space = TuningSpace::new(Preset::Full, &Premises::all());
        let native = space.beginning_at(&Start::Native).expect("the full space has native Embree");
        let tree =
            native.complete(&parse("backend=tunable").expect("words")).expect("it is one of the space");
        assert_eq!(native.choice(&tree).expect("a tree"), Choice::paper_default());
        assert!(TuningSpace::paper().beginning_at(&Start::Native).is_err(), "it has no native Embree");
        assert_eq!(TuningSpace::paper().beginning_at(&Start::Paper), Ok(TuningSpace::paper()));
    }
}
