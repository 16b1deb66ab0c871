//! The paper's section 4: parameters searched alone (4.2), splitting by frame size (4.1), needles (4.3).

use treewright_client::Configuration;
use treewright_render_cli::error::Result;
use treewright_renderer::space::{Narrowing, TuningSpace, parse};

use super::measure::{ALL, best_within};
use super::record::{PartSearch, Record};

/// A few parameters, and what the others are held to besides their recommended values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) name: &'static str,
    /// The parameters; the first two are the axes of its figure.
    pub(crate) parameters: &'static [&'static str],
    pub(crate) title: &'static str,
}

/// Figures 6 to 8.
pub(crate) const PARTS: [Part; 3] = [
    Part {
        name: "leaves",
        parameters: &["min_leaf_size", "max_leaf_size"],
        title: "Leaf sizes alone (Figure 6)",
    },
    Part {
        name: "costs",
        parameters: &["traversal_cost", "intersection_cost"],
        title: "SAH costs alone (Figure 7)",
    },
    Part {
        name: "costs_and_block",
        parameters: &["traversal_cost", "intersection_cost", "sah_block_size"],
        title: "SAH costs with the block size (Figure 8)",
    },
];

impl Part {
    /// Its space: all other parameters of the paper's space at their recommended values.
    pub(crate) fn space(&self, whole: &TuningSpace) -> Result<TuningSpace> {
        let default = whole.default_configuration();
        let others = default.as_raw().iter().filter(|(name, _)| !self.parameters.contains(&name.as_str()));
        let held: Vec<Narrowing> =
            others.map(|(name, value)| Narrowing::Fix { name: name.clone(), value: value.clone() }).collect();
        Ok(whole.narrowed(&held)?)
    }
}

/// The best and the last of a search over a part, as whole configurations. `None` if nothing was built.
pub(crate) fn came_to(search: &PartSearch, whole: &TuningSpace) -> Result<Option<[Configuration; 2]>> {
    let part = PARTS.iter().find(|part| part.name == search.part);
    let Some((part, objective)) = part.zip(search.search.minimised()) else { return Ok(None) };
    let space = part.space(whole)?;
    let found = best_within(&search.search, ALL, objective);
    let last = search.search.iterations.iter().rfind(|one| one.times.is_some());
    let both = found.zip(last).map(|((found, _), last)| [&found.configuration, &last.configuration]);
    Ok(both.map(|both| both.map(|one| space.with_held(one))))
}

/// The configurations to measure again at a scene: the default, then its searches' results, each once.
pub(crate) fn compared(record: &Record, whole: &TuningSpace, scene: &str) -> Result<Vec<Configuration>> {
    let mut all = vec![whole.default_configuration()];
    for search in record.parts.iter().filter(|search| search.search.place.scene == scene) {
        for one in came_to(search, whole)?.into_iter().flatten() {
            if !all.contains(&one) {
                all.push(one);
            }
        }
    }
    Ok(all)
}

/// The recommended build without splitting, and with it.
pub(crate) fn pair(space: &TuningSpace) -> Result<[Configuration; 2]> {
    Ok([space.complete(&parse("quality=2")?)?, space.complete(&parse("quality=3")?)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_leaves_its_own_parameters_and_holds_the_others_to_the_default() {
        let whole = TuningSpace::paper();
        for part in PARTS {
            let space = part.space(&whole).expect("it is sound");
            let names: Vec<&str> =
                space.space().parameters().iter().map(|parameter| parameter.name.as_str()).collect();
            let mut expected = part.parameters.to_vec();
            expected.sort_unstable_by_key(|name| names.iter().position(|other| other == name));
            assert_eq!(names, expected, "{}", part.name);
            assert_eq!(space.with_held(&space.default_configuration()), whole.default_configuration());
        }
        let [without, with] = pair(&whole).expect("both are sound");
        assert_eq!(without, whole.default_configuration());
        assert_ne!(without, with);
    }
}
