//! The gain of each parameter: a winner taken apart, one deviation at a time.
//!
//! The winner is compared with native Embree as everybody uses it: medium quality, path by path, ray by ray.
//! Each value in which they differ is once taken back from the winner, all others staying, and once given to
//! native Embree alone, with the values that it requires. The first measures the value's gain beside the
//! others, the second its gain alone. Where the two disagree, values work together or replace each other.

pub mod report;

use treewright_client::{Configuration, Constraint, Parameter, Space, Value};

/// A value of the winner, and the two configurations that measure its gain.
#[derive(Clone, Debug, PartialEq)]
pub struct Deviation {
    /// The parameter.
    pub name: String,
    /// The winner's value.
    pub value: Value,
    /// The value of native Embree, or the closest one.
    pub plain: Value,
    /// The winner without it.
    pub without: Configuration,
    /// Native Embree with the value, and with the values that it requires.
    pub alone: Configuration,
}

/// The value of a parameter in native Embree, used as everybody uses it. Parameters of the tunable tree get
/// the values nearest to Embree's own: eight boxes a node, four triangles a block, as the builder leaves
/// them.
fn plain(parameter: &Parameter) -> Value {
    match parameter.name.as_str() {
        "backend" => "native".into(),
        "native_quality" => "medium".into(),
        "quality" => 2.into(),
        "collapse" | "order" => "builder".into(),
        "branching_factor" | "node_width" => 8.into(),
        "block_width" => 4.into(),
        "reinsertion_passes" => 0.into(),
        "staged" => false.into(),
        "tile" => 16.into(),
        "primary" | "first_shadow" | "bounce" | "shadow" => "single".into(),
        _ => parameter.default.clone(),
    }
}

/// Native Embree, used as everybody uses it, as a configuration of the full space.
pub fn plain_configuration(space: &Space) -> Configuration {
    active(space, &space.parameters().iter().map(plain).collect::<Vec<_>>())
}

/// Takes a complete configuration of the full space apart.
pub fn deviations(space: &Space, winner: &Configuration) -> Vec<Deviation> {
    let parameters = space.parameters();
    let plain: Vec<Value> = parameters.iter().map(plain).collect();
    let whole = |configuration: &Configuration| -> Vec<Value> {
        let values = parameters.iter().zip(&plain);
        values.map(|(one, plain)| configuration.get(&one.name).unwrap_or(plain).clone()).collect()
    };
    let winners = whole(winner);
    let deviates =
        |index: usize| winner.get(&parameters[index].name).is_some() && winners[index] != plain[index];
    (0..parameters.len())
        .filter(|&index| deviates(index))
        .map(|index| {
            let mut without = winners.clone();
            without[index] = plain[index].clone();
            let mut alone = plain.clone();
            // The parameters that it requires are named earlier, link by link.
            let mut link = Some(index);
            while let Some(at) = link {
                alone[at] = winners[at].clone();
                link = parameters[at].active_if.as_ref().and_then(|condition| {
                    parameters.iter().position(|earlier| earlier.name == condition.parameter)
                });
            }
            Deviation {
                name: parameters[index].name.clone(),
                value: winners[index].clone(),
                plain: plain[index].clone(),
                without: active(space, &without),
                alone: active(space, &alone),
            }
        })
        .collect()
}

/// The values that are active, given one for every parameter.
fn active(space: &Space, values: &[Value]) -> Configuration {
    let mut configuration = Configuration::new();
    for (parameter, value) in space.parameters().iter().zip(values) {
        let exists = parameter.active_if.as_ref().is_none_or(|condition| {
            configuration.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
        });
        if exists {
            configuration.set(parameter.name.clone(), value.clone());
        }
    }
    // A value taken back can contradict the winner's other one; then the lesser is as large as it may be.
    for (lesser, greater) in space.constraints().iter().filter_map(Constraint::as_order) {
        if let (Ok(low), Ok(high)) = (configuration.integer(lesser), configuration.integer(greater))
            && low > high
        {
            configuration.set(lesser, high);
        }
    }
    configuration
}

#[cfg(test)]
mod tests {
    use treewright_accel::NativeQuality;

    use super::*;
    use treewright_renderer::space::{Choice, Premises, Preset, TuningSpace, parse};

    fn full() -> TuningSpace {
        TuningSpace::new(Preset::Full, &Premises::all())
    }

    fn complete(text: &str) -> Configuration {
        full().complete(&parse(text).expect("it reads")).expect("it is sound")
    }

    #[test]
    fn the_plain_configuration_is_native_embree() {
        let plain = plain_configuration(full().space());
        assert_eq!(full().choice(&plain), Ok(Choice::native(NativeQuality::Medium)));
        assert!(deviations(full().space(), &plain).is_empty());
    }

    #[test]
    fn what_a_value_needs_comes_along_and_nothing_else() {
        let all = deviations(full().space(), &complete("native_quality=high,first_shadow=sixteen,tile=64"));
        let names: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["native_quality", "staged", "tile", "primary", "first_shadow"]);
        let find = |name: &str| all.iter().find(|one| one.name == name).expect("it deviates");
        let primary = find("primary");
        let stages = "native_quality=medium,staged=true,tile=16,primary=sixteen_coherent,first_shadow=single";
        assert_eq!(primary.alone, complete(stages));
        assert_eq!(
            primary.without,
            complete("native_quality=high,primary=single,first_shadow=sixteen,tile=64")
        );
        let staged = find("staged");
        assert_eq!(
            staged.alone,
            complete("native_quality=medium,tile=16,primary=single,first_shadow=single")
        );
        assert_eq!(staged.without, complete("native_quality=high,staged=false,tile=64"));
    }

    #[test]
    fn a_tunable_tree_is_one_deviation_and_its_values_are_more() {
        let tree = "node_width=16,reinsertion_passes=9,block_width=4,order=builder,staged=false,tile=16";
        let all = deviations(full().space(), &complete(tree));
        let names: Vec<&str> = all.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["backend", "collapse", "node_width", "reinsertion_passes"]);
        assert_eq!(
            all[0].without,
            complete("native_quality=medium,staged=false,tile=16"),
            "nothing of the tree is left"
        );
        let alone = "node_width=8,reinsertion_passes=9,block_width=4,order=builder,staged=false,tile=16";
        assert_eq!(all[3].alone, complete(alone), "the chain comes along");
        assert!(
            all.iter().all(|one| full().choice(&one.without).is_ok() && full().choice(&one.alone).is_ok())
        );
        let small = deviations(full().space(), &complete("min_leaf_size=1,max_leaf_size=2"));
        let find = |name: &str| small.iter().find(|one| one.name == name).expect("it deviates");
        assert_eq!(find("min_leaf_size").without.integer("min_leaf_size").ok(), Some(2), "4 is above 2");
    }
}
