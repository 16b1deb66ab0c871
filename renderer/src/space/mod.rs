//! What can be tuned, and configurations of it as work for the renderer.
//!
//! | module | what it holds |
//! |---|---|
//! | `full` | the full space: native Embree and the tunable tree, and how rays are grouped |
//! | `paper` | the eleven parameters of the paper's Table 1 |
//! | `explained` | parameters as data, with a sentence each |
//! | `choice` | a configuration as a build choice and render options |
//! | `error` | why a configuration is refused |

mod choice;
mod error;
mod explained;
mod full;
mod paper;
#[cfg(test)]
mod tests;

use clap::ValueEnum;
use serde::Serialize;
use treewright_client::{Configuration, Constraint, Domain, Parameter, Space, SpaceBuilder, Value};

pub use choice::Choice;
pub use error::ConfigurationError;
pub use explained::Explained;

use crate::scene::Scene;

/// Which parameters there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Everything: native Embree, the tunable tree, and how rays are grouped.
    #[default]
    Full,
    /// The eleven parameters of the paper's Table 1, exactly.
    Paper,
}

impl Preset {
    /// `full` or `paper`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Paper => "paper",
        }
    }
}

/// Values of the full space's parameter `backend`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Backend {
    Native,
    Tunable,
}

impl Backend {
    fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Tunable => "tunable",
        }
    }
}

/// What decides which parameters the full space has, and where its search begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Premises {
    /// Each frame pays for a build of its own.
    pub builds_each_frame: bool,
    /// The user wants watertight intersection.
    pub robust: bool,
    /// The scene has lights that shadow rays are sent to.
    pub shadow_rays: bool,
    /// The scene moves from frame to frame.
    pub animated: bool,
    /// How many render threads there are; 0 for one a core.
    pub threads: usize,
}

impl Premises {
    /// For a scene that stands still.
    pub fn of(scene: &Scene, builds_each_frame: bool, robust: bool, threads: usize) -> Self {
        let shadow_rays = scene.has_sampled_lights();
        Self { builds_each_frame, robust, shadow_rays, animated: false, threads }
    }

    /// Under which every parameter there is exists.
    pub fn all() -> Self {
        Self { builds_each_frame: false, robust: false, shadow_rays: true, animated: true, threads: 0 }
    }
}

/// A parameter space that the renderer understands.
#[derive(Clone, Debug, PartialEq)]
pub struct TuningSpace {
    preset: Preset,
    robust: bool,
    animated: bool,
    threads: usize,
    space: Space,
    about: Vec<&'static str>,
}

impl TuningSpace {
    /// The space of a preset. `premises` matter for the full one only.
    pub fn new(preset: Preset, premises: &Premises) -> Self {
        let explained = match preset {
            Preset::Full => full::parameters(premises),
            Preset::Paper => paper::parameters(),
        };
        let about = explained.iter().map(|one| one.about).collect();
        let builder = explained
            .into_iter()
            .fold(SpaceBuilder::new(), |builder, one| builder.with_parameter(one.parameter));
        let space = builder.less_or_equal("min_leaf_size", "max_leaf_size").build();
        let space = space.expect("the spaces of this program are sound");
        let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let threads = if premises.threads == 0 { cores() } else { premises.threads };
        let Premises { robust, animated, .. } = *premises;
        Self { preset, robust, animated, threads, space, about }
    }

    /// Table 1.
    pub fn paper() -> Self {
        Self::new(Preset::Paper, &Premises::all())
    }

    /// What tells it apart from others, e.g. `full-robust`.
    pub fn name(&self) -> String {
        let mark = |holds: bool, mark: &'static str| if holds { mark } else { "" };
        let full = self.preset == Preset::Full;
        let robust = mark(self.robust && full, "-robust");
        format!("{}{robust}{}", self.preset.name(), mark(self.animated && full, "-moving"))
    }

    /// Which one it is.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// As the service sees it.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The parameters, each with what it does.
    pub fn explained(&self) -> impl Iterator<Item = Explained> {
        let pairs = self.space.parameters().iter().zip(&self.about);
        pairs.map(|(parameter, about)| Explained { parameter: parameter.clone(), about })
    }

    /// The recommended configuration.
    pub fn default_configuration(&self) -> Configuration {
        self.space.default_configuration()
    }

    /// The recommended configuration as work.
    pub fn default_choice(&self) -> Choice {
        self.choice(&self.default_configuration()).expect("the spaces of this program are sound")
    }

    /// What to build, and how to render with it.
    pub fn choice(&self, configuration: &Configuration) -> Result<Choice, ConfigurationError> {
        let complete = self.complete(configuration)?;
        Ok(match self.preset {
            Preset::Full => choice::of_full(&complete, self.robust, self.threads),
            Preset::Paper => choice::of_paper(&complete),
        })
    }

    /// Fills what is missing with recommended values and checks everything. The result is canonical: a value
    /// for each active parameter and no other.
    ///
    /// A value takes along what it needs: `quality=3` alone means the tunable back end in the full space. Where
    /// a given value and a recommended one contradict each other, the recommended one gives way.
    pub fn complete(&self, given: &Configuration) -> Result<Configuration, ConfigurationError> {
        let parameters = self.space.parameters();
        for (name, _) in given.iter() {
            if parameters.iter().all(|parameter| parameter.name != name) {
                let known: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
                return Err(ConfigurationError::Unknown {
                    name: name.to_owned(),
                    space: self.preset.name(),
                    known: known.join(", "),
                });
            }
        }
        let given = self.with_needs(given);
        let mut complete = Configuration::new();
        for parameter in parameters {
            let missing = parameter.active_if.as_ref().filter(|condition| {
                !complete.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
            });
            match (missing, given.get(&parameter.name)) {
                (None, value) => complete.set(parameter.name.clone(), in_domain(parameter, value)?),
                (Some(_), None) => {}
                (Some(condition), Some(_)) => {
                    let condition = format!("{} = {}", condition.parameter, list(&condition.any_of, " or "));
                    return Err(ConfigurationError::Inactive { name: parameter.name.clone(), condition });
                }
            }
        }
        for Constraint { lesser, greater } in self.space.constraints() {
            let (Some(low), Some(high)) = (complete.get(lesser).cloned(), complete.get(greater).cloned())
            else {
                continue;
            };
            if number(&low) <= number(&high) {
                continue;
            }
            match (given.get(lesser), given.get(greater)) {
                (None, _) => complete.set(lesser.clone(), high),
                (_, None) => complete.set(greater.clone(), low),
                (Some(_), Some(_)) => {
                    return Err(ConfigurationError::Constraint {
                        lesser: lesser.clone(),
                        low: low.to_string(),
                        greater: greater.clone(),
                        high: high.to_string(),
                    });
                }
            }
        }
        Ok(complete)
    }

    /// Adds what given values need and nobody has decided otherwise. Conditions name earlier parameters, so
    /// that one walk from the last to the first follows every chain.
    fn with_needs(&self, given: &Configuration) -> Configuration {
        let mut given = given.clone();
        for parameter in self.space.parameters().iter().rev() {
            let Some(condition) =
                parameter.active_if.as_ref().filter(|_| given.get(&parameter.name).is_some())
            else {
                continue;
            };
            let needed = self.space.parameters().iter().find(|earlier| earlier.name == condition.parameter);
            if let Some(needed) = needed
                && given.get(&needed.name).is_none()
            {
                let fits = condition.any_of.contains(&needed.default);
                given.set(
                    needed.name.clone(),
                    if fits { needed.default.clone() } else { condition.any_of[0].clone() },
                );
            }
        }
        given
    }
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

/// What a parameter may be, in words.
pub fn domain_in_words(domain: &Domain) -> String {
    match domain {
        Domain::Integer { min, max, .. } => format!("a whole number from {min} to {max}"),
        Domain::Float { min, max, .. } => format!("a number from {min} to {max}"),
        Domain::Categorical { values } => format!("one of {}", list(values, ", ")),
        Domain::Boolean => "true or false".to_owned(),
    }
}

fn in_domain(parameter: &Parameter, value: Option<&Value>) -> Result<Value, ConfigurationError> {
    let value = match (value, &parameter.domain) {
        (None, _) => return Ok(parameter.default.clone()),
        // People write 1 for 1.0.
        (Some(Value::Integer(value)), Domain::Float { .. }) => Value::Float(*value as f64),
        (Some(Value::Integer(value)), Domain::Categorical { values })
            if matches!(values.first(), Some(Value::Float(_))) =>
        {
            Value::Float(*value as f64)
        }
        (Some(value), _) => value.clone(),
    };
    if parameter.domain.contains(&value) {
        Ok(value)
    } else {
        Err(ConfigurationError::OutOfDomain {
            name: parameter.name.clone(),
            value: value.to_string(),
            domain: domain_in_words(&parameter.domain),
        })
    }
}

fn number(value: &Value) -> f64 {
    match value {
        Value::Integer(value) => *value as f64,
        Value::Float(value) => *value,
        Value::Boolean(_) | Value::Text(_) => 0.0,
    }
}

fn list(values: &[Value], separator: &str) -> String {
    values.iter().map(Value::to_string).collect::<Vec<_>>().join(separator)
}
