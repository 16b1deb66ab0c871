//! Who takes part in a comparison: what contenders are, and their names for people and files.

use std::{borrow::Cow, fmt};

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use treewright_accel::NativeQuality;

use super::objective::Objective;

/// Embree's own structure as `rtcCommitScene` builds it untold.
pub const NATIVE_DEFAULT: Who = Who::Native(NativeQuality::Medium);

/// A contender of a comparison, or a standing in its table. Its text is the name there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Who {
    /// Where nothing could be measured.
    #[default]
    Nobody,
    /// The paper's recommended default.
    PaperDefault,
    /// Embree's own structure of a quality, used path by path with single rays.
    Native(NativeQuality),
    /// A variant of Embree's own structure with our stages and packets.
    UsedWellIn(NativeUse),
    /// The fastest of these variants and of Embree's default, path by path.
    UsedWell,
    /// The configuration recommended for all scenes, where a search in the full space begins.
    BestFixed,
    /// The recommendation for an objective, where those for several run side by side.
    BestFixedFor(Objective),
    /// The configuration that is recommended where a tree serves a thousand frames.
    ForStills,
    /// The best of a search, as long as it is not known to be better than all rivals.
    Found,
    /// The search's best, once it has beaten all rivals.
    Tuned,
    /// A configuration of the user's, where the search began.
    YourStart,
    /// The recommended tree with light sampled by the renderer's own constants.
    PlainLight,
    /// The predictor's answer.
    Predicted,
    /// The best by the service after this number of trials.
    AfterTrials(u32),
    /// Its answer after this number of frames in a scene; 0 is the answer before the first.
    AfterFrames(u32),
    /// Somebody whom only a text tells: a configuration of the user's, or a contender of one experiment.
    Named(Cow<'static, str>),
}

impl Who {
    /// Whether only those have it who know the recommended configuration or how to use native Embree well.
    pub fn takes_knowledge(&self) -> bool {
        matches!(self, Self::BestFixed | Self::ForStills | Self::UsedWell | Self::UsedWellIn(_))
    }

    /// As a way to use Embree's own structure that may be the best one; `None` for everybody else.
    pub fn native_use(&self) -> Option<NativeUse> {
        match *self {
            Self::UsedWellIn(variant) => Some(variant),
            Self::Native(quality @ NativeQuality::Medium) => {
                Some(NativeUse { quality, fitted: false, by_path: true })
            }
            _ => None,
        }
    }
}

impl fmt::Display for Who {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name: &str = match self {
            Self::Nobody => "",
            Self::PaperDefault => "paper default",
            Self::Native(NativeQuality::Low) => "native Embree low",
            Self::Native(NativeQuality::Medium) => "native Embree default",
            Self::Native(NativeQuality::High) => "native Embree high",
            Self::UsedWellIn(variant) => return write!(f, "{} {variant}", Self::UsedWell),
            Self::UsedWell => "native used well",
            Self::BestFixed => "best fixed configuration",
            Self::BestFixedFor(objective) => return write!(f, "{} ({})", Self::BestFixed, objective.name()),
            Self::ForStills => "best fixed for stills",
            Self::Found => "found by the search",
            Self::Tuned => "tuned",
            Self::YourStart => "your start",
            Self::PlainLight => "light by the renderer's constants",
            Self::Predicted => "first prediction",
            Self::AfterTrials(trials) => return write!(f, "answer after {trials} trials"),
            Self::AfterFrames(frames) => return write!(f, "after {frames} frames"),
            Self::Named(text) => text,
        };
        f.pad(name)
    }
}

impl Serialize for Who {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Who {
    /// Reads what a record of rounds holds: everybody but answers after trials, and objectives' own.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use Who::*;
        let text = String::deserialize(deserializer)?;
        let uses = NativeQuality::ALL.into_iter().flat_map(|quality| {
            let use_of = |fitted| UsedWellIn(NativeUse { quality, fitted, by_path: false });
            let [plain, fitted] = [false, true].map(use_of);
            [Native(quality), plain, fitted]
        });
        let fixed = [Nobody, PaperDefault, UsedWell, BestFixed, ForStills];
        let others = [Found, Tuned, YourStart, PlainLight, Predicted];
        let known = uses.chain(fixed).chain(others).find(|one| one.to_string() == text);
        let frames = text.strip_prefix("after ").and_then(|rest| rest.strip_suffix(" frames"));
        let answer = frames.and_then(|frames| frames.parse().ok()).map(AfterFrames);
        Ok(known.or(answer).unwrap_or(Named(text.into())))
    }
}

/// A way to use Embree's own structure well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NativeUse {
    /// Of the structure.
    pub quality: NativeQuality,
    /// Whether it is fitted to a scene that moves, and not built for each of its frames.
    pub fitted: bool,
    /// Whether it is used as Embree's default is: path by path, without our stages and packets.
    pub by_path: bool,
}

impl fmt::Display for NativeUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fitted = if self.fitted { " fitted" } else { "" };
        let by_path = if self.by_path { " path by path" } else { "" };
        write!(f, "{}{fitted}{by_path}", self.quality.name())
    }
}

impl Serialize for NativeUse {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_those_whom_they_name() {
        let fitted = NativeUse { quality: NativeQuality::Medium, fitted: true, by_path: false };
        for (who, name) in [
            (Who::PaperDefault, "paper default"),
            (NATIVE_DEFAULT, "native Embree default"),
            (Who::UsedWell, "native used well"),
            (Who::UsedWellIn(fitted), "native used well medium fitted"),
            (Who::BestFixed, "best fixed configuration"),
            (Who::AfterFrames(60), "after 60 frames"),
            (Who::Named("fastest 1".into()), "fastest 1"),
        ] {
            assert_eq!(who.to_string(), name);
            let written = serde_json::to_string(&who).expect("it is a text");
            assert_eq!(written, format!("\"{name}\""));
            assert_eq!(serde_json::from_str::<Who>(&written).expect("it is one"), who);
        }
        let by_path = NATIVE_DEFAULT.native_use().expect("it is a use");
        assert_eq!(by_path.to_string(), "medium path by path");
        assert_eq!(Who::UsedWellIn(fitted).native_use(), Some(fitted));
        assert_eq!(Who::Native(NativeQuality::Low).native_use(), None);
        assert_eq!(Who::AfterTrials(8).to_string(), "answer after 8 trials");
        assert_eq!(Who::BestFixedFor(Objective::Total).to_string(), "best fixed configuration (total)");
    }
}
