//! The libraries whose builders are tuned, as one conditional space: the library, and the options of the
//! chosen one.

mod bvh;
mod obvhs;
#[cfg(feature = "tinybvh")]
mod tinybvh;

use std::error::Error;

use glam::Vec3A;
use treewright_client::{Condition, Configuration, Domain, Parameter, Space, SpaceError, Value};

use crate::mesh::Mesh;

/// Builds with a configuration, and traces.
type Run = fn(&Configuration, &Mesh, u32) -> Result<Cost, Box<dyn Error>>;

/// A library that builds trees: its name, and the functions of its module.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Library {
    pub(crate) name: &'static str,
    space: fn() -> Result<Space, SpaceError>,
    fixed: fn() -> Vec<(String, Configuration)>,
    run: Run,
}

/// The libraries of this build. The first is the default where several may be taken.
pub(crate) const LIBRARIES: &[Library] = &[
    // PLOC and reinsertion, binary or compressed eight-wide.
    Library { name: "obvhs", space: obvhs::space, fixed: obvhs::fixed, run: obvhs::run },
    // Binary, with one shape in each leaf.
    Library { name: "bvh", space: bvh::space, fixed: bvh::fixed, run: bvh::run },
    // Binned or with spatial splits, binary or eight-wide for AVX2; C++ behind a Rust interface.
    #[cfg(feature = "tinybvh")]
    Library { name: "tinybvh", space: tinybvh::space, fixed: tinybvh::fixed, run: tinybvh::run },
];

pub(crate) fn named(name: &str) -> Result<Library, String> {
    let known = LIBRARIES.iter().find(|library| library.name == name).copied();
    known.ok_or_else(|| {
        let names: Vec<&str> = LIBRARIES.iter().map(|library| library.name).collect();
        format!("this build has no library {name}; it has {}", names.join(", "))
    })
}

/// The spaces of these libraries, joined below a parameter that says which is taken; the default is the first
/// as its documentation uses it.
pub(crate) fn space(libraries: &[Library]) -> Result<Space, SpaceError> {
    let names: Vec<Value> = libraries.iter().map(|library| library.name.into()).collect();
    let default = names.first().cloned().unwrap_or_else(|| "".into());
    let domain = Domain::Categorical { values: names };
    let mut joined = Space::builder().with_parameter(Parameter::new("library", domain, default));
    for library in libraries {
        for parameter in (library.space)()?.parameters() {
            let mine = Condition { parameter: "library".into(), any_of: vec![library.name.into()] };
            let active_if = parameter.active_if.clone().or(Some(mine));
            joined = joined.with_parameter(Parameter { active_if, ..parameter.clone() });
        }
    }
    joined.build()
}

/// Settings to compare with, by name, the first library's default first: presets, or what stands for them in
/// a library without.
pub(crate) fn fixed(libraries: &[Library]) -> Vec<(String, Configuration)> {
    let of = |library: &Library| {
        let (fixed, library) = ((library.fixed)(), library.name);
        fixed
            .into_iter()
            .map(move |(name, settings)| (format!("{library} {name}"), settings.with("library", library)))
    };
    libraries.iter().flat_map(of).collect()
}

/// Times of one build and of its rays, and the number of hits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    pub(crate) build_ms: f64,
    pub(crate) rays_ms: f64,
    pub(crate) hits: u32,
}

/// Builds a tree over the mesh and traces this many rays through it.
pub(crate) fn run(configuration: &Configuration, mesh: &Mesh, rays: u32) -> Result<Cost, Box<dyn Error>> {
    (named(configuration.text("library")?)?.run)(configuration, mesh, rays)
}

/// Processor time of all threads in milliseconds: what else the machine does is left out.
fn processor_ms() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    now.tv_sec as f64 * 1e3 + now.tv_nsec as f64 / 1e6
}

/// Times the rays of a tree whose build began at `start_ms`. `closest` says how far along a direction of
/// length 1 the nearest triangle is, infinity where there is none. Rays go from the middle of the mesh and on
/// from where they hit, as a path does.
fn trace(mesh: &Mesh, rays: u32, start_ms: f64, closest: impl Fn(Vec3A, Vec3A) -> f32) -> Cost {
    let built_ms = processor_ms();
    let (min, max) = mesh.bounds();
    let (center, shortest) = ((min + max) * 0.5, (max - min).length() * 1e-3);
    let (mut random, mut origin, mut hits) = (Random(1), center, 0);
    for _ in 0..rays {
        let direction = random.direction();
        let distance = closest(origin, direction);
        // A path could not leave the immediate neighbourhood of a surface: rounding would decide its hits.
        let goes_on = distance.is_finite() && distance > shortest;
        origin = if goes_on { origin + direction * (distance * 0.999) } else { center };
        hits += u32::from(distance.is_finite());
    }
    let rays_ms = processor_ms() - built_ms;
    Cost { build_ms: built_ms - start_ms, rays_ms, hits: std::hint::black_box(hits) }
}

/// Numerical Recipes' quick generator: enough to scatter rays, and equal on every machine.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn direction(&mut self) -> Vec3A {
        loop {
            let point = Vec3A::new(self.next(), self.next(), self.next());
            if (1e-4..=1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fixed_setting_is_in_the_space_and_hits_alike() {
        let mesh = crate::mesh::field();
        let space = space(LIBRARIES).unwrap();
        let mut hits = Vec::new();
        for (name, settings) in fixed(LIBRARIES) {
            for (parameter, value) in settings.iter() {
                let known = space.parameters().iter().find(|one| one.name == *parameter);
                assert!(known.is_some(), "{name}: {parameter} = {value:?}");
            }
            hits.push((run(&settings, &mesh, 2000).unwrap().hits, name));
        }
        // Paths part where two triangles are met at one distance, so the numbers can differ a little.
        let (least, most) = (hits.iter().min().unwrap().0, hits.iter().max().unwrap().0);
        assert!(least > 0 && most - least <= most / 20, "{hits:?}");
    }

    #[test]
    fn the_first_fixed_setting_is_the_default_of_the_space() {
        for libraries in LIBRARIES.chunks(1).chain([LIBRARIES]) {
            let default = Configuration::from(space(libraries).unwrap().default_configuration());
            let (name, first) = fixed(libraries).swap_remove(0);
            assert_eq!(default.len(), first.len(), "{name}: {default:?} {first:?}");
            for (parameter, value) in default.iter() {
                let numbers =
                    first.get(parameter).and_then(|other| Some((other.as_number()?, value.as_number()?)));
                let same = numbers.map_or(first.get(parameter) == Some(value), |(a, b)| (a - b).abs() < 1e-6);
                assert!(same, "{name}: {parameter}");
            }
        }
    }
}
