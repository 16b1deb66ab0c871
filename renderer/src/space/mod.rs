//! Tuning spaces, and their configurations as work for the renderer.
//!
//! | module | holds |
//! |---|---|
//! | `full` | the full space: native Embree and the tunable tree, and the grouping of rays |
//! | `paper` | the eleven parameters of the paper's Table 1 |
//! | `light` | the sampling of light |
//! | `follow` | updates of structures in scenes that move |
//! | `narrow` | parts of a space: parameters fixed or held to a range |
//! | `start` | where a search begins, as a space's defaults |
//! | `explained` | parameters as data, with a sentence each |
//! | `retired` | parameters that were there once, in configurations that people kept |
//! | `choice` | a configuration as a build choice and render options |
//! | `error` | why a configuration is refused |

mod choice;
mod error;
mod explained;
mod follow;
mod full;
mod light;
mod narrow;
mod paper;
#[cfg(test)]
mod paper_page;
mod retired;
mod start;
#[cfg(test)]
mod tests;

use serde::Serialize;
use treewright_client::{Configuration, Parameter, Space, SpaceBuilder, SpaceError, Value};

pub use choice::Choice;
pub use error::ConfigurationError;
pub use explained::Explained;
pub use light::LightKinds;
pub use narrow::{Narrowing, Recommendation};
pub use start::Start;

/// Which parameters there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Everything: native Embree, the tunable tree, and how rays are grouped.
    #[default]
    Full,
    /// The eleven parameters of the paper's Table 1.
    Paper,
    /// The sampling of light, with the recommended tree.
    Light,
    /// Updates of structures in scenes that move.
    Follow,
}

impl Preset {
    /// All, in the order in which they are listed.
    pub const ALL: [Self; 4] = [Self::Full, Self::Paper, Self::Light, Self::Follow];

    /// `full`, `paper`, `light` or `follow`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Paper => "paper",
            Self::Light => "light",
            Self::Follow => "follow",
        }
    }
}

/// Values of the full space's parameter `backend`.
const NATIVE: &str = "native";
const TUNABLE: &str = "tunable";

/// The facts that decide which parameters the full space has, and where its search begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Premises {
    /// Each frame pays for a build of its own.
    pub builds_each_frame: bool,
    /// The user wants watertight intersection.
    pub robust: bool,
    /// The kinds of light that the scene has.
    pub lights: LightKinds,
}

impl Premises {
    /// Under which every parameter there is exists.
    pub fn all() -> Self {
        Self { builds_each_frame: false, robust: false, lights: LightKinds::ALL }
    }
}

/// A parameter space that the renderer understands.
#[derive(Clone, Debug, PartialEq)]
pub struct TuningSpace {
    preset: Preset,
    robust: bool,
    lights: LightKinds,
    /// The tree and the grouping of rays that go with light sampling.
    base: Choice,
    space: Space,
    about: Vec<&'static str>,
    /// Parameters that have left the space, with the value that they are held to as their default.
    held: Vec<Parameter>,
}

impl TuningSpace {
    /// The space of a preset. `premises` matter for the full one only.
    pub fn new(preset: Preset, premises: &Premises) -> Self {
        let explained = match preset {
            Preset::Full => full::parameters(premises),
            Preset::Paper => paper::parameters(),
            Preset::Light => light::parameters(premises),
            Preset::Follow => follow::parameters(),
        };
        let about = explained.iter().map(|one| one.about).collect();
        let space = space_of(explained.into_iter().map(|one| one.parameter).collect());
        let space = space.expect("the spaces of this program are sound");
        let Premises { robust, lights, .. } = *premises;
        let base = match preset {
            Preset::Light => Self::new(Preset::Full, premises).default_choice(),
            Preset::Follow => follow::base(premises),
            Preset::Full | Preset::Paper => Choice::paper_default(),
        };
        Self { preset, robust, lights, base, space, about, held: Vec::new() }
    }

    /// Table 1.
    pub fn paper() -> Self {
        Self::new(Preset::Paper, &Premises::all())
    }

    /// The name that distinguishes it from other spaces, e.g. `full-robust`.
    pub fn name(&self) -> String {
        match self.preset {
            Preset::Light => self.preset.name().to_owned() + &self.lights.mark(),
            Preset::Full | Preset::Follow if self.robust => format!("{}-robust", self.preset.name()),
            _ => self.preset.name().to_owned(),
        }
    }

    fn premises(&self) -> Premises {
        let Self { robust, lights, .. } = *self;
        Premises { builds_each_frame: true, robust, lights }
    }

    /// Which one it is.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// As the service sees it.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The parameters, each with its effect.
    pub fn explained(&self) -> impl Iterator<Item = Explained> {
        let pairs = self.space.parameters().iter().zip(&self.about);
        pairs.map(|(parameter, about)| Explained { parameter: parameter.clone(), about })
    }

    /// The recommended configuration.
    pub fn default_configuration(&self) -> Configuration {
        self.space.default_configuration().into()
    }

    /// The recommended choice where each frame builds: the quick tree.
    pub fn quick_choice(&self) -> Choice {
        follow::base(&self.premises())
    }

    /// The recommended configuration as work.
    pub fn default_choice(&self) -> Choice {
        self.choice(&self.default_configuration()).expect("the spaces of this program are sound")
    }

    /// The structure to build, and the way to render with it.
    pub fn choice(&self, configuration: &Configuration) -> Result<Choice, ConfigurationError> {
        let complete = self.with_held(&self.complete(configuration)?);
        Ok(match self.preset {
            Preset::Full => choice::of_full(&complete, self.robust),
            Preset::Paper => choice::of_paper(&complete),
            Preset::Light => choice::of_light(&complete, &self.base),
            Preset::Follow => choice::of_follow(&complete, &self.base, &self.premises()),
        })
    }

    /// Adds recommended values for missing ones and checks everything; every active parameter has a value
    /// then, no other. Retired ones go ([`TuningSpace::retired`]). Values imply those they need: see
    /// [`Space::complete`].
    pub fn complete(&self, given: &Configuration) -> Result<Configuration, ConfigurationError> {
        let given = self.without_retired(given)?;
        match self.space.complete(&self.without_held(&given)) {
            Ok(complete) => Ok(complete.into()),
            Err(problem) => Err(ConfigurationError::Space { space: self.preset.name(), problem }),
        }
    }
}

const LESSER: &str = "min_leaf_size";
const GREATER: &str = "max_leaf_size";

/// The space of these parameters, with the leaf sizes in order where it has both.
fn space_of(parameters: Vec<Parameter>) -> Result<Space, SpaceError> {
    let has = |name: &str| parameters.iter().any(|one| one.name == name);
    let ordered = has(LESSER) && has(GREATER);
    let builder = parameters.into_iter().fold(SpaceBuilder::new(), SpaceBuilder::with_parameter);
    if ordered { builder.less_or_equal(LESSER, GREATER).build() } else { builder.build() }
}

/// A hash of a text in a few letters (FNV-1a, 32 bits).
pub fn short_hash(text: &str) -> String {
    let hash =
        text.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    format!("{hash:08x}")
}

/// Reads `name=value,name=value`. The values are checked by [`TuningSpace::complete`].
pub fn parse(text: &str) -> Result<Configuration, ConfigurationError> {
    text.split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| match part.split_once('=') {
            Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
                Ok((name.trim().to_owned(), Value::parse(value.trim())))
            }
            _ => Err(ConfigurationError::Syntax { part: part.to_owned() }),
        })
        .collect()
}
