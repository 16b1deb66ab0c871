//! Parameters that a space had once (`docs/measurements/lean.md`, `light-sampling.md`), or that another space
//! has now. The renderer does what was recommended; kept configurations may still name them.

use treewright_client::Configuration;

use super::{ConfigurationError, Preset, TuningSpace};

/// A name, and the values that say what the renderer does.
type Gone = (&'static str, &'static [&'static str]);

const FROM_FULL: &[Gone] = &[
    ("format", &["full"]),
    // The one goes with trees as builders make them, the other with the best grouping.
    ("order", &["builder", "depth_first"]),
    ("child_order", &["likely"]),
    ("tile_order", &["rows"]),
    // The one goes with paths one by one, the other with stages.
    ("tile", &["16", "32"]),
    ("threads", &["all"]),
    ("primary", &["sixteen_coherent"]),
    ("first_shadow", &["sixteen_coherent"]),
    ("bounce", &["single"]),
    ("shadow", &["single"]),
    ("sort", &["none"]),
    ("update", &["partial"]),
    ("rebuild_threshold", &["1.3"]),
    ("native_update", &["refit"]),
    ("native_dynamic", &["false"]),
    ("flatten_below", &["0"]),
    ("instance_opening", &["1"]),
    ("native_layout", &["auto"]),
];

const FROM_LIGHT: &[Gone] = &[
    ("first_shadow_rays", &["1"]),
    ("shares", &["learnt"]),
    // Constants are halves. The others were the recommended ones, which learnt shares left without effect.
    ("sun_share", &["0.5", "0.6"]),
    ("sky_share", &["0.5", "0.3"]),
];

fn gone_from(preset: Preset) -> &'static [Gone] {
    match preset {
        Preset::Full => FROM_FULL,
        Preset::Light => FROM_LIGHT,
        Preset::Paper | Preset::Follow => &[],
    }
}

impl TuningSpace {
    /// A configuration's parameters that are gone: where they say what happens anyway, they are ignored.
    pub fn retired(&self, given: &Configuration) -> Vec<&'static str> {
        let all = gone_from(self.preset).iter().map(|(name, _)| *name);
        all.filter(|name| given.get(name).is_some()).collect()
    }

    /// The configuration without them.
    ///
    /// # Errors
    /// [`ConfigurationError::Retired`] where one asks for something else than the renderer does.
    pub(super) fn without_retired(&self, given: &Configuration) -> Result<Configuration, ConfigurationError> {
        let gone = self.retired(given);
        for &(name, kept) in gone_from(self.preset).iter().filter(|(name, _)| gone.contains(name)) {
            let value = given.get(name).map(ToString::to_string).unwrap_or_default();
            if !kept.contains(&value.as_str()) {
                let kept = kept.join(" or ");
                return Err(ConfigurationError::Retired { name, value, kept });
            }
        }
        let left = given.as_raw().iter().filter(|(name, _)| !gone.contains(&name.as_str()));
        Ok(left.map(|(name, value)| (name.clone(), value.clone())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{Premises, parse};

    #[test]
    fn what_the_renderer_does_anyway_is_ignored_and_all_else_refused() {
        for preset in Preset::ALL {
            let space = TuningSpace::new(preset, &Premises::all());
            for (name, kept) in gone_from(preset) {
                assert!(space.space().parameters().iter().all(|parameter| parameter.name != *name), "{name}");
                for value in *kept {
                    let given = parse(&format!("{name}={value}")).expect("it reads");
                    assert_eq!(space.retired(&given), [*name]);
                    assert_eq!(space.complete(&given), Ok(space.default_configuration()));
                    assert!(TuningSpace::paper().complete(&given).is_err(), "the paper's space never had it");
                }
                let problem = space.complete(&parse(&format!("{name}=other")).expect("it reads"));
                let problem = problem.expect_err("nothing does that").to_string();
                assert!(problem.contains(name) && problem.contains(kept[0]), "{problem}");
            }
            assert!(space.retired(&space.default_configuration()).is_empty());
        }
    }
}
