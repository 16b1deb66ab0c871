//! More landscapes in the manner of compute kernels and of programs around them: mixed and conditional spaces
//! with resources that run out, divisors that must divide, and regions that cannot be run for no visible
//! reason.
//!
//! Two suites: the search may be tuned on `kernels`; `unseen` is only ever measured. Costs are rooflines of
//! compute and traffic times small factors and a ruggedness; the seed draws the properties of the device.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::space::{Condition, Domain, Parameter, Scale, Space};
use treewright_core::{configuration::Configuration, value::Value};
use treewright_lab::simulated::share;

use crate::problem::Problem;

pub(crate) const KERNELS: [&str; 3] = ["reduction", "hotspot", "sorting"];
pub(crate) const UNSEEN: [&str; 4] = ["dedispersion", "tiled loops", "wavefront", "transform"];

/// The inputs of a cost: the values of one configuration, and properties of the device, in 0..1.
struct At<'a> {
    configuration: &'a Configuration,
    device: &'a [f64],
    seed: u64,
}

impl At<'_> {
    /// The number of a parameter; 0 where it is inactive.
    fn of(&self, name: &str) -> f64 {
        match self.configuration.get(name) {
            Some(Value::Boolean(boolean)) => f64::from(u8::from(*boolean)),
            Some(value) => value.as_number().unwrap_or(0.0),
            None => 0.0,
        }
    }

    fn is(&self, name: &str, text: &str) -> bool {
        self.configuration.get(name) == Some(&Value::Text(text.into()))
    }

    fn device(&self, index: usize) -> f64 {
        self.device[index % self.device.len()]
    }

    /// A factor from 1 to 1 + `height` that no model follows.
    fn rough(&self, height: f64) -> f64 {
        let number = |value: &Value| match value {
            Value::Text(text) => text.bytes().map(f64::from).sum(),
            Value::Boolean(boolean) => f64::from(u8::from(*boolean)),
            // Coarse, so that floats are rough on a scale of tenths.
            number => (20.0 * number.as_number().unwrap_or(0.0).abs().max(1e-3).log2()).round(),
        };
        let values: Vec<f64> = self.configuration.values().values().map(number).collect();
        1.0 + height * hash(&values, self.seed)
    }
}

/// A number from 0 to 1 for some values and a seed.
fn hash(values: &[f64], seed: u64) -> f64 {
    let mix = values.iter().fold(seed ^ 0x9e37_79b9_7f4a_7c15, |hash, value| {
        let hash = (hash ^ value.to_bits()).wrapping_mul(0xff51_afd7_ed55_8ccd);
        hash ^ (hash >> 32)
    });
    (mix.wrapping_mul(0xc4ce_b9fe_1a85_ec53) >> 11) as f64 / (1u64 << 53) as f64
}

/// Distance of a value from the best one, in powers of two.
fn off(value: f64, best: f64) -> f64 {
    (value.max(1e-9) / best).log2().abs()
}

fn reduction(at: &At) -> Option<f64> {
    let (block, items, vector, blocks) = (at.of("block"), at.of("items"), at.of("vector"), at.of("blocks"));
    let bytes = 4.0 * block * items * (1.0 - 0.9 * at.of("shuffle"));
    let registers = 12.0 + 2.0 * items * vector + 6.0 * at.of("unroll");
    if items % vector != 0.0 || bytes > 24_576.0 || registers * block > 65_536.0 || block * blocks > 2048.0 {
        return None;
    }
    let occupancy = block * blocks / 2048.0;
    let latency = 1.0 / (0.15 + 0.85 * (occupancy * items * vector / (3.0 + 5.0 * at.device(0))).min(1.0));
    let tail = 1.0 + 0.25 * (1.0 - at.of("shuffle")) + 0.03 * (block.log2() - 6.0) * at.device(1);
    let wide = 1.0 + 0.14 * off(vector, 4.0);
    let atomics = if at.of("atomic") > 0.5 { 1.0 + 0.3 * at.device(2) } else { 1.12 };
    Some(latency * tail * wide * atomics * (1.1 - 0.1 * at.of("unroll")) * at.rough(0.06))
}

fn hotspot(at: &At) -> Option<f64> {
    let (bx, by, tx, ty) = (at.of("bx"), at.of("by"), at.of("tx"), at.of("ty"));
    let (time, unroll, resident) = (at.of("time"), at.of("unroll"), at.of("resident"));
    let (w, h) = (bx * tx + 2.0 * time, by * ty + 2.0 * time);
    let threads = bx * by;
    let bytes = 4.0 * w * h * (2.0 + at.of("power"));
    if !(32.0..=1024.0).contains(&threads)
        || bytes * resident.max(1.0) > 98_304.0
        || threads * resident > 2048.0
        || time % unroll != 0.0
    {
        return None;
    }
    let redundant = w * h / (bx * tx * by * ty);
    let compute = redundant * (1.0 + 0.15 * (1.0 - at.of("power")));
    let traffic = (0.6 + 2.4 * at.device(0)) * redundant / time;
    let spill = 1.0 + 0.15 * (tx * ty / (6.0 + 10.0 * at.device(1)) - 1.0).max(0.0);
    let coalesced = 1.0 + 0.3 * (32.0 / bx).log2().max(0.0);
    let hidden = 1.0 + 0.4 * (1.0 - threads * resident.max(1.0) / 1024.0).max(0.0);
    Some(compute.max(traffic) * spill * coalesced * hidden * (1.0 + 0.04 * off(unroll, 2.0)) * at.rough(0.07))
}

fn sorting(at: &At) -> Option<f64> {
    let (radix, tile, threads) = (at.of("radix"), at.of("tile"), at.of("threads"));
    if at.is("method", "radix") {
        if threads * 2f64.powf(radix) > 131_072.0 || tile * threads > 524_288.0 {
            return None;
        }
        let passes = (32.0 / radix).ceil();
        let misses = 1.0 + 0.25 * (radix - 6.0 - 3.0 * at.device(0)).max(0.0).powi(2);
        let buffered = if at.of("buffered") > 0.5 { 0.85 + 0.03 * off(at.of("buffer"), 64.0) } else { 1.0 };
        let spread = 1.0 + 0.08 * off(threads, 16.0 + 16.0 * at.device(1)) + 0.05 * off(tile, 4096.0);
        return Some(passes / 3.0 * misses * buffered * spread * at.rough(0.05));
    }
    let samples = at.of("samples");
    let buckets = at.of("buckets");
    if buckets > samples || buckets * threads > 65_536.0 {
        return None;
    }
    let balance = 1.0 + 1.5 * (buckets / samples).powf(0.7) + samples / 4e4;
    let small = 1.0 + 0.1 * (at.of("cutoff").ln() - 3.0 - at.device(2)).powi(2);
    let merge = if at.is("method", "merge") { 1.25 } else { 1.05 + 0.1 * at.device(3) };
    Some(2.0 * balance * small * merge * (1.0 + 0.08 * off(threads, 16.0)) * at.rough(0.05))
}

fn dedispersion(at: &At) -> Option<f64> {
    let (bx, by, tx, ty) = (at.of("bx"), at.of("by"), at.of("tx"), at.of("ty"));
    let (unroll, resident) = (at.of("unroll"), at.of("resident"));
    let threads = bx * by;
    if !(64.0..=1024.0).contains(&threads)
        || (unroll > 0.0 && 1536.0 % unroll != 0.0)
        || threads * resident > 2048.0
        || tx * ty * threads > 16_384.0
    {
        return None;
    }
    let reuse = 1.0 / (ty * by).powf(0.25 + 0.3 * at.device(0)) + 0.12 / tx;
    let stride = if at.of("stride_x") > 0.5 { 1.0 } else { 1.0 + 0.15 * tx.log2() }
        * if at.of("stride_y") > 0.5 { 1.0 + 0.1 * at.device(1) } else { 1.05 };
    let registers = tx * ty + unroll;
    let spill = 1.0 + 0.6 * ((registers * threads * resident.max(1.0)) / 30_000.0 - 1.0).max(0.0);
    let loops = 1.0 + if unroll == 0.0 { 0.2 } else { 0.05 * off(unroll, 8.0) };
    let coalesced = 1.0 + 0.35 * (32.0 / bx).log2().max(0.0);
    Some(reuse * stride * spill * loops * coalesced * at.rough(0.08))
}

fn tiled_loops(at: &At) -> Option<f64> {
    let (i, j, k, u) = (at.of("tile_i"), at.of("tile_j"), at.of("tile_k"), at.of("unroll"));
    if u > k || (at.of("pack") > 0.5 && i * k > 32_768.0) || j % at.of("vector") != 0.0 || i * j * k > 4e6 {
        return None;
    }
    let working = 8.0 * (i * k + k * j + i * j);
    let (near, far) = (16_384.0 * (1.0 + at.device(0)), 262_144.0 * (1.0 + at.device(1)));
    let cache =
        1.0 + 0.6 * (working / near).log2().clamp(0.0, 4.0) / 4.0 + 1.2 * (working / far).log2().max(0.0);
    let start = 1.0 + 6.0 / i + 10.0 / j + 4.0 / k;
    let order =
        ["ijk", "ikj", "jik", "jki", "kij", "kji"].iter().position(|o| at.is("order", o)).unwrap_or(0);
    let walk = [1.6, 1.0, 1.7, 2.4, 1.15, 2.5][order];
    let packed = if at.of("pack") > 0.5 { 1.1 } else { 1.0 + 0.25 * (walk - 1.0) };
    let wide = if order == 1 || order == 4 { 1.0 + 0.2 * off(at.of("vector"), 8.0) } else { 1.6 };
    let unrolled = 1.0 + 0.07 * off(u, 4.0 + 4.0 * at.device(2)).powi(2).min(4.0);
    let threads = at.of("threads");
    let parallel = 1.0 / threads.min(6.0 + 6.0 * at.device(3)) + 0.012 * threads;
    let chunk = if at.is("schedule", "dynamic") { 1.0 + 0.04 * off(at.of("chunk"), 4.0) } else { 1.1 };
    Some(10.0 * cache * start * walk * packed * wide * unrolled * parallel * chunk * at.rough(0.05))
}

fn wavefront(at: &At) -> Option<f64> {
    let (queue, batch, bias) = (at.of("queue"), at.of("batch"), at.of("bias"));
    if batch * 4.0 > queue || queue * at.of("streams") > 4_194_304.0 {
        return None;
    }
    // A driver's fault: runs fail in a slab of no meaning.
    if at.of("streams") > 2.0 && (0.3..0.45).contains(&bias) {
        return None;
    }
    let mut cost = 1.0 + 0.12 * off(queue, 65_536.0 * (1.0 + 7.0 * at.device(0))) + 0.1 * off(batch, 2048.0);
    cost *= 1.0 + 1.5 * (bias - 0.25 - 0.5 * at.device(1)).powi(2);
    cost *= 1.0 + 0.08 * (at.of("streams") - 1.0 - 3.0 * at.device(2)).abs();
    if at.of("sort") > 0.5 {
        cost *= 1.02 - 0.3 * at.device(3) * (1.0 - (at.of("bits") / 10.0 - 1.0).powi(2));
        cost *= if at.is("key", "morton") { 1.0 } else { 1.06 };
    }
    cost *= if at.is("walk", "stackless") { 1.15 } else { 1.0 + 0.04 * off(at.of("stack"), 12.0) };
    Some(cost * at.rough(0.03))
}

fn transform(at: &At) -> Option<f64> {
    let (first, second, third) = (at.of("radix_1"), at.of("radix_2"), at.of("radix_3"));
    let length = first * second * third;
    let (threads, batch) = (at.of("threads"), at.of("batch"));
    if !(512.0..=8192.0).contains(&length) || length % threads != 0.0 || length * batch > 16_384.0 {
        return None;
    }
    let registers = first.max(second).max(third) * (1.0 + at.of("twiddles"));
    let spill = 1.0 + 0.5 * (registers / (16.0 + 24.0 * at.device(0)) - 1.0).max(0.0);
    let passes = [first, second, third].iter().filter(|radix| **radix > 1.0).count() as f64;
    let per_thread = length * batch / threads;
    let latency = 1.0 + 0.09 * (per_thread.log2() - 3.0 - 2.0 * at.device(1)).powi(2);
    let conflicts = if at.of("padding") > 0.5 { 1.04 } else { 1.0 + 0.12 * at.device(2) };
    let waste = 1.0 + 0.3 * off(length, 4096.0);
    let table = if at.of("twiddles") > 0.5 { 0.9 } else { 1.0 };
    Some(passes / 2.0 * spill * latency * conflicts * waste * table * at.rough(0.06))
}

/// One of some values; the first is the default.
fn one_of(name: &str, values: Vec<Value>) -> Parameter {
    let default = values[0].clone();
    Parameter::new(name, Domain::Categorical { values }, default)
}

fn list(name: &str, values: &[i64]) -> Parameter {
    one_of(name, values.iter().copied().map(Value::Integer).collect())
}

/// Powers of two between two exponents.
fn powers(name: &str, from: u32, to: u32) -> Parameter {
    one_of(name, (from..=to).map(|exponent| Value::Integer(1 << exponent)).collect())
}

fn range(name: &str, min: i64, max: i64, scale: Scale) -> Parameter {
    Parameter::new(name, Domain::Integer { min, max, scale }, Value::Integer(min))
}

fn switch(name: &str) -> Parameter {
    Parameter::new(name, Domain::Boolean, Value::Boolean(false))
}

fn names(name: &str, values: &[&str]) -> Parameter {
    one_of(name, values.iter().map(|text| Value::Text((*text).into())).collect())
}

fn while_in(parameter: Parameter, other: &str, any_of: &[Value]) -> Parameter {
    let active_if = Some(Condition { parameter: other.into(), any_of: any_of.to_vec() });
    Parameter { active_if, ..parameter }
}

fn parameters(name: &str) -> Vec<Parameter> {
    let on = [Value::Boolean(true)];
    let text = |text: &str| Value::Text(text.into());
    match name {
        "reduction" => vec![
            powers("block", 5, 10),
            list("items", &[1, 2, 3, 4, 6, 8, 12, 16, 24, 32]),
            powers("vector", 0, 3),
            range("blocks", 1, 16, Scale::Linear),
            switch("shuffle"),
            switch("atomic"),
            switch("unroll"),
        ],
        "hotspot" => vec![
            list("bx", &[1, 2, 4, 8, 16, 32, 48, 64, 96, 128, 256]),
            powers("by", 0, 5),
            range("tx", 1, 10, Scale::Linear),
            range("ty", 1, 10, Scale::Linear),
            range("time", 1, 10, Scale::Linear),
            list("unroll", &[1, 2, 3, 4, 5, 8]),
            list("resident", &[0, 1, 2, 3, 4]),
            switch("power"),
        ],
        "sorting" => vec![
            names("method", &["radix", "sample", "merge"]),
            while_in(range("radix", 2, 16, Scale::Linear), "method", &[text("radix")]),
            while_in(switch("buffered"), "method", &[text("radix")]),
            while_in(powers("buffer", 3, 9), "buffered", &on),
            while_in(powers("tile", 8, 16), "method", &[text("radix")]),
            while_in(range("samples", 16, 65_536, Scale::Log), "method", &[text("sample"), text("merge")]),
            while_in(powers("buckets", 2, 13), "method", &[text("sample"), text("merge")]),
            while_in(range("cutoff", 1, 1024, Scale::Log), "method", &[text("sample"), text("merge")]),
            range("threads", 1, 64, Scale::Log),
        ],
        "dedispersion" => vec![
            list("bx", &[1, 2, 4, 8, 16, 32, 48, 64, 96, 128, 256, 512]),
            list("by", &[1, 2, 4, 8, 16, 32, 64]),
            range("tx", 1, 16, Scale::Linear),
            range("ty", 1, 16, Scale::Linear),
            switch("stride_x"),
            switch("stride_y"),
            list("unroll", &[0, 1, 2, 3, 4, 5, 6, 8, 12, 16, 20, 24, 32]),
            range("resident", 0, 4, Scale::Linear),
        ],
        "tiled loops" => vec![
            powers("tile_i", 2, 9),
            powers("tile_j", 2, 9),
            powers("tile_k", 2, 9),
            names("order", &["ijk", "ikj", "jik", "jki", "kij", "kji"]),
            powers("unroll", 0, 5),
            list("vector", &[1, 2, 4, 8, 16]),
            range("threads", 1, 24, Scale::Linear),
            names("schedule", &["static", "dynamic"]),
            while_in(powers("chunk", 0, 8), "schedule", &[text("dynamic")]),
            switch("pack"),
        ],
        "wavefront" => vec![
            range("queue", 1024, 1_048_576, Scale::Log),
            range("batch", 64, 65_536, Scale::Log),
            Parameter { default: Value::Float(1.0), ..share("bias") },
            range("streams", 1, 8, Scale::Linear),
            switch("sort"),
            while_in(range("bits", 4, 24, Scale::Linear), "sort", &on),
            while_in(names("key", &["origin", "direction", "morton"]), "sort", &on),
            names("walk", &["stackless", "stack"]),
            while_in(range("stack", 2, 64, Scale::Log), "walk", &[text("stack")]),
        ],
        _ => vec![
            list("radix_1", &[1, 2, 4, 8, 16, 32]),
            list("radix_2", &[2, 3, 4, 5, 6, 8, 16, 32]),
            list("radix_3", &[2, 4, 8, 10, 12, 16, 32]),
            powers("threads", 5, 10),
            range("batch", 1, 16, Scale::Linear),
            switch("padding"),
            switch("twiddles"),
        ],
    }
}

fn cost(name: &str) -> fn(&At) -> Option<f64> {
    match name {
        "reduction" => reduction,
        "hotspot" => hotspot,
        "sorting" => sorting,
        "dedispersion" => dedispersion,
        "tiled loops" => tiled_loops,
        "wavefront" => wavefront,
        _ => transform,
    }
}

/// One of them, as one device runs it. Its default is a random one that can be run: working, not good.
pub(crate) fn problem(name: &str, seed: u64) -> Problem {
    let random = &mut ChaCha8Rng::seed_from_u64(seed * 7 + 3);
    let device: Vec<f64> = (0..6).map(|_| random.random()).collect();
    let of = cost(name);
    let truth =
        move |configuration: &Configuration| of(&At { configuration, device: &device, seed: seed + 50 });
    let mut parameters = parameters(name);
    let space = Space::new(parameters.clone(), Vec::new()).expect("a valid space");
    let first = (0..10_000)
        .map(|_| space.decode(&(0..space.dimension()).map(|_| random.random()).collect::<Vec<f64>>()))
        .find(|configuration| truth(configuration).is_some())
        .expect("something that can be run");
    for parameter in &mut parameters {
        if let Some(value) = first.get(&parameter.name) {
            parameter.default = value.clone();
        }
    }
    let space = Space::new(parameters, Vec::new()).expect("a valid space");
    Problem::new(space, 0.02, random, truth)
}
