//! The scenes and settings of the measurement.

use std::{fmt, str::FromStr, sync::Arc};

use treewright_render_cli::arguments::{SceneArguments, Size};
use treewright_render_cli::error::Result;
use treewright_renderer::limits::THREADS_MAX;
use treewright_scene::Scene;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    /// Without spaces.
    pub(crate) name: String,
    path: String,
    detail: f32,
    seed: Option<u64>,
    time: f32,
}

/// Built-in scenes with seeds that nothing was ever chosen on: name, scene, detail, seed, time.
const BUILT_IN: [(&str, &str, f32, u64, f32); 15] = [
    ("hall-7", "hall", 1.0, 7, 0.0),
    ("voxels-7", "voxels", 0.6, 7, 0.0),
    ("gallery-7", "gallery", 1.0, 7, 0.0),
    ("statue-7", "statue", 0.4, 7, 0.0),
    ("needles-7", "needles", 1.0, 7, 0.3),
    ("hair-7", "hair", 1.0, 7, 0.0),
    ("cables-7", "cables", 1.0, 7, 0.0),
    ("scaffold-7", "scaffold", 1.0, 7, 0.0),
    ("city-7", "city", 0.8, 7, 0.0),
    ("model-7", "model", 0.5, 7, 0.0),
    ("sea-7", "sea", 1.0, 7, 0.4),
    ("quick-7", "quick", 1.0, 7, 0.0),
    ("forest-7", "forest", 0.1, 7, 0.0),
    ("voxels-11", "voxels", 2.0, 11, 0.0),
    ("city-11", "city", 0.2, 11, 0.0),
];

pub(crate) fn built_in() -> Vec<Entry> {
    let entry = |(name, scene, detail, seed, time): (&str, &str, f32, u64, f32)| Entry {
        name: name.to_owned(),
        path: format!("builtin:{scene}"),
        detail,
        seed: Some(seed),
        time,
    };
    BUILT_IN.into_iter().map(entry).collect()
}

impl Entry {
    pub(crate) fn load(&self) -> Result<Arc<Scene>> {
        let Self { path, detail, seed, time, .. } = self;
        SceneArguments::plain(path.clone(), *detail, *seed, *time).load()
    }
}

impl fmt::Display for Entry {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, path, detail, seed, .. } = self;
        write!(formatter, "{name}={path}")?;
        if path.starts_with("builtin:") {
            write!(formatter, ":{detail}")?;
        }
        seed.map_or(Ok(()), |seed| write!(formatter, ":{seed}"))
    }
}

/// `NAME=PATH`, or `NAME=builtin:SCENE:DETAIL:SEED`.
impl FromStr for Entry {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            "a scene is written NAME=PATH or NAME=builtin:SCENE:DETAIL:SEED, the name without spaces"
                .to_owned()
        };
        let (name, path) = text.split_once('=').ok_or_else(wrong)?;
        if name.is_empty() || name.contains(char::is_whitespace) || path.is_empty() {
            return Err(wrong());
        }
        let file = Self { name: name.to_owned(), path: path.to_owned(), detail: 1.0, seed: None, time: 0.0 };
        let Some(given) = path.strip_prefix("builtin:") else { return Ok(file) };
        let mut parts = given.split(':');
        let scene = parts.next().ok_or_else(wrong)?;
        let detail = parts.next().map_or(Ok(1.0), |detail| detail.parse().map_err(|_| wrong()))?;
        let seed = parts.next().map(|seed| seed.parse().map_err(|_| wrong())).transpose()?;
        Ok(Self { path: format!("builtin:{scene}"), detail, seed, ..file })
    }
}

/// Number of threads and size of frames, written `2@320x240`; 0 threads are one a core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Context {
    pub(crate) threads: usize,
    pub(crate) size: Size,
}

impl fmt::Display for Context {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}@{}", self.threads, self.size)
    }
}

impl FromStr for Context {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "a context is written THREADS@WIDTHxHEIGHT, for example 2@320x240".to_owned();
        let (threads, size) = text.split_once('@').ok_or_else(wrong)?;
        let threads =
            threads.parse().ok().filter(|threads| (0..=THREADS_MAX).contains(threads)).ok_or_else(wrong)?;
        Ok(Self { threads, size: size.parse()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_and_contexts_are_read() {
        let entry = |text: &str| text.parse::<Entry>();
        assert_eq!(entry("a=b/c.glb").map(|entry| entry.path), Ok("b/c.glb".to_owned()));
        let city = entry("c=builtin:city:0.1:5").expect("it is sound");
        assert_eq!((city.path.as_str(), city.detail, city.seed), ("builtin:city", 0.1, Some(5)));
        for text in ["a=b/c.glb", "c=builtin:city:0.1", "c=builtin:city:0.1:5"] {
            assert_eq!(entry(text).map(|entry| entry.to_string()).as_deref(), Ok(text));
        }
        for wrong in ["a", "=b", "a b=c", "a=", "a=builtin:city:x", "a=builtin:city:1:y"] {
            assert!(entry(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            "2@320x240".parse::<Context>().map(|context| context.to_string()),
            Ok("2@320x240".to_owned())
        );
        for wrong in ["2", "2000@8x8", "x@8x8", "2@8"] {
            assert!(wrong.parse::<Context>().is_err(), "{wrong}");
        }
        let names: std::collections::BTreeSet<String> =
            built_in().into_iter().map(|entry| entry.name).collect();
        assert_eq!(names.len(), BUILT_IN.len());
        assert!(built_in().iter().all(|entry| !entry.name.contains(' ')));
    }
}
