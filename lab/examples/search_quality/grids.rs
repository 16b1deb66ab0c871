//! Landscapes like those of compute kernels: grids of integers on which most combinations cannot be run,
//! with interactions, cliffs and a ruggedness that no model follows.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::value::Value;
use treewright_lab::simulated::normal;

use crate::problem::Problem;

/// Names and values of the parameters.
type Grid = Vec<(&'static str, Vec<i64>)>;

pub(crate) fn hash(values: &[f64], seed: u64) -> f64 {
    let mix = values.iter().fold(seed ^ 0x9e37_79b9_7f4a_7c15, |hash, value| {
        let hash = (hash ^ value.to_bits()).wrapping_mul(0xff51_afd7_ed55_8ccd);
        hash ^ (hash >> 32)
    });
    (mix.wrapping_mul(0xc4ce_b9fe_1a85_ec53) >> 11) as f64 / (1u64 << 53) as f64
}

fn gemm(v: &[f64], seed: u64) -> Option<f64> {
    let [mwg, nwg, kwg, mdimc, ndimc, mdima, ndimb, vwm, vwn, sa, sb, kwi] = v else { return None };
    let divides = |a: f64, b: f64| (a / b).fract() == 0.0 && a >= b;
    let threads = mdimc * ndimc;
    let (kdima, kdimb) = (threads / mdima, threads / ndimb);
    let valid = divides(*mwg, mdimc * vwm)
        && divides(*nwg, ndimc * vwn)
        && divides(*mwg, mdima * vwm)
        && divides(*nwg, ndimb * vwn)
        && kdima >= 1.0
        && kdimb >= 1.0
        && divides(*kwg, kdima)
        && divides(*kwg, kdimb)
        && divides(*kwg, *kwi);
    let shared = 4.0 * (sa * kwg * mwg + sb * kwg * nwg);
    let registers = mwg * nwg / threads + mwg / mdimc + nwg / ndimc;
    if !valid || shared > 49_152.0 || threads > 1024.0 || registers > 255.0 {
        return None;
    }
    let occupancy = (2048.0 / threads)
        .floor()
        .min((98_304.0 / shared.max(1.0)).floor())
        .min((65_536.0 / (registers * 1.3 * threads)).floor())
        .max(1.0)
        * threads
        / 2048.0;
    let compute = 1.0 / (0.35 + 0.65 * (registers / 64.0).min(1.0)) / (0.4 + 0.6 * occupancy.min(0.5) * 2.0);
    let traffic = 40.0 * (1.0 / mwg + 1.0 / nwg) * (1.35 - 0.35 * sa) * (1.25 - 0.25 * sb);
    let vector = 1.0 + 0.12 * (vwm.log2() - 1.0 - (seed % 2) as f64).abs() + 0.1 * (vwn.log2() - 1.0).abs();
    let shape = 1.0 + 0.1 * ((mdimc / mdima).log2().abs() + (ndimc / ndimb).log2().abs()) / 2.0;
    let unroll = 1.0 + 0.06 * (kwi.log2() - 1.0).abs() + 0.04 * (kwg.log2() - 4.5).abs();
    Some(compute.max(traffic) * vector * shape * unroll * (1.0 + 0.08 * hash(v, seed)))
}

fn convolution(v: &[f64], seed: u64) -> Option<f64> {
    let [bx, by, tx, ty, padding, cached, vector] = v else { return None };
    let threads = bx * by;
    let shared = 4.0 * (bx * tx + 16.0 + padding) * (by * ty + 16.0);
    if !(64.0..=1024.0).contains(&threads)
        || (*cached == 0.0 && shared > 49_152.0)
        || (*padding == 1.0 && *cached == 1.0)
        || (tx % vector) != 0.0
    {
        return None;
    }
    let work = tx * ty;
    let reuse = 1.0 + 8.0 / work + 0.02 * (work - 14.0 - 6.0 * (seed % 3) as f64).max(0.0);
    let coalesced = if bx % 32.0 == 0.0 {
        1.0
    } else if bx % 16.0 == 0.0 {
        1.15
    } else {
        1.6
    };
    let conflicts = if *padding == 0.0 && *cached == 0.0 && bx % 32.0 != 0.0 { 1.15 } else { 1.0 };
    let occupancy = 1.0
        + 0.25 * ((threads / 256.0).log2()).abs() / 2.0
        + 0.2 * (shared / 24_576.0 - 1.0).max(0.0) * (1.0 - cached);
    let cache = if *cached == 1.0 { 1.2 + 0.05 * (ty - 4.0) } else { 1.0 };
    Some(
        reuse
            * coalesced
            * conflicts
            * occupancy
            * cache
            * (1.0 - 0.05 * vector.log2())
            * (1.0 + 0.08 * hash(v, seed)),
    )
}

fn stencil(v: &[f64], seed: u64) -> Option<f64> {
    let [bx, by, tx, ty, time, unroll, shared, registers] = v else { return None };
    let threads = bx * by;
    let (w, h) = (bx * tx + 2.0 * time, by * ty + 2.0 * time);
    let bytes = 8.0 * w * h * shared;
    if !(32.0..=1024.0).contains(&threads)
        || bytes > 49_152.0
        || (time % unroll) != 0.0
        || threads * registers > 2_048.0
        || (*time > 1.0 && *shared == 0.0)
    {
        return None;
    }
    let halo = w * h / (bx * tx * by * ty);
    let launches = 1.0 / time + 0.12;
    let spill = 1.0 + 0.3 * (tx * ty / (8.0 * registers) - 1.0).max(0.0);
    let coalesced = 1.0 + 0.5 * (32.0 / bx - 1.0).max(0.0);
    Some(
        halo * launches
            * spill
            * coalesced
            * (1.0 + 0.1 * ((threads / 256.0).log2().abs() - 0.5).max(0.0))
            * (1.0 + 0.05 * (unroll.log2() - (seed % 3) as f64).abs())
            * (1.0 + 0.1 * hash(v, seed)),
    )
}

/// The cost of values with a seed for what differs from device to device; `None` where they cannot be run.
type Cost = fn(&[f64], u64) -> Option<f64>;

fn grid(name: &str) -> (Grid, Cost) {
    match name {
        "gemm" => (
            vec![
                ("mwg", vec![16, 32, 64, 128]),
                ("nwg", vec![16, 32, 64, 128]),
                ("kwg", vec![16, 32]),
                ("mdimc", vec![8, 16, 32]),
                ("ndimc", vec![8, 16, 32]),
                ("mdima", vec![8, 16, 32]),
                ("ndimb", vec![8, 16, 32]),
                ("vwm", vec![1, 2, 4, 8]),
                ("vwn", vec![1, 2, 4, 8]),
                ("sa", vec![0, 1]),
                ("sb", vec![0, 1]),
                ("kwi", vec![2, 8]),
            ],
            gemm,
        ),
        "convolution" => (
            vec![
                ("bx", (1..=16).map(|i| 8 * i).collect()),
                ("by", vec![1, 2, 4, 8, 16, 32]),
                ("tx", (1..=8).collect()),
                ("ty", (1..=8).collect()),
                ("padding", vec![0, 1]),
                ("cached", vec![0, 1]),
                ("vector", vec![1, 2, 4]),
            ],
            convolution,
        ),
        _ => (
            vec![
                ("bx", vec![8, 16, 32, 48, 64, 96, 128, 256]),
                ("by", vec![1, 2, 4, 8, 16, 32]),
                ("tx", (1..=8).collect()),
                ("ty", (1..=8).collect()),
                ("time", (1..=6).collect()),
                ("unroll", vec![1, 2, 3]),
                ("shared", vec![1, 0]),
                ("registers", vec![1, 2, 3, 4]),
            ],
            stencil,
        ),
    }
}

pub(crate) const GRIDS: [&str; 3] = ["gemm", "convolution", "stencil"];

/// A grid either as integers that count the values or as choices among the values.
pub(crate) fn problem(name: &str, seed: u64, counted: bool) -> Problem {
    let (grid, cost) = grid(name);
    let random = &mut ChaCha8Rng::seed_from_u64(seed);
    let domain = |values: &Vec<i64>| {
        if counted {
            Domain::Integer { min: 0, max: values.len() as i64 - 1, scale: Scale::Linear }
        } else {
            Domain::Categorical { values: values.iter().copied().map(Value::Integer).collect() }
        }
    };
    // Every other time the default is one that can be run; else it stands in the middle.
    let mut middle: Vec<usize> = grid.iter().map(|(_, values)| values.len() / 2).collect();
    while seed.is_multiple_of(2)
        && cost(&grid.iter().zip(&middle).map(|((_, v), &i)| v[i] as f64).collect::<Vec<_>>(), seed).is_none()
    {
        middle = grid.iter().map(|(_, values)| random.random_range(0..values.len())).collect();
    }
    let parameters = grid.iter().zip(&middle).map(|((name, values), &middle)| {
        let default = if counted { middle as i64 } else { values[middle] };
        Parameter::new(*name, domain(values), Value::Integer(default))
    });
    let space = Space::new(parameters.collect(), Vec::new()).expect("a valid space");
    let names: Vec<(&str, Vec<i64>)> = grid;
    let truth = move |configuration: &Configuration| {
        let value = |(name, values): &(&str, Vec<i64>)| match configuration.get(name) {
            Some(Value::Integer(integer)) => {
                (if counted { values[*integer as usize] } else { *integer }) as f64
            }
            _ => f64::NAN,
        };
        cost(&names.iter().map(value).collect::<Vec<f64>>(), seed)
    };
    Problem::new(space, 0.02, random, truth)
}

/// A random landscape: each value of seven choices has an effect of its own, six pairs interact, and four
/// axes share a resource that three quarters of the grid exceed.
pub(crate) fn random_effects(seed: u64) -> Problem {
    let random = &mut ChaCha8Rng::seed_from_u64(seed + 900);
    let levels: Vec<usize> = (0..7).map(|_| random.random_range(2..9)).collect();
    let table = |count: usize, deviation: f64, random: &mut ChaCha8Rng| -> Vec<f64> {
        (0..count).map(|_| deviation * normal(random)).collect()
    };
    let single: Vec<Vec<f64>> = levels.iter().map(|&count| table(count, 0.25, random)).collect();
    let mut pairs = Vec::new();
    for _ in 0..6 {
        let a = random.random_range(0..7);
        let b = (a + random.random_range(1..7)) % 7;
        pairs.push((a, b, table(levels[a] * levels[b], 0.2, random)));
    }
    let mut axes: Vec<usize> = (0..7).collect();
    for last in (1..7).rev() {
        axes.swap(last, random.random_range(0..=last));
    }
    let needs: Vec<(usize, f64)> =
        axes[..4].iter().map(|&axis| (axis, 0.5 + random.random::<f64>())).collect();
    let parameters = levels.iter().enumerate().map(|(axis, &count)| {
        let values = (0..count).map(|step| Value::Integer(1 << step)).collect();
        Parameter::new(format!("p{axis}"), Domain::Categorical { values }, Value::Integer(1))
    });
    let space = Space::new(parameters.collect(), Vec::new()).expect("a valid space");
    let bound = 0.36 * needs.iter().map(|need| need.1).sum::<f64>();
    let truth = move |configuration: &Configuration| {
        let place = |axis: usize| match configuration.get(&format!("p{axis}")) {
            Some(Value::Integer(integer)) => integer.trailing_zeros() as usize,
            _ => 0,
        };
        let need: f64 = needs
            .iter()
            .map(|&(axis, need)| need * place(axis) as f64 / (levels[axis] - 1).max(1) as f64)
            .sum();
        let alone: f64 = single.iter().enumerate().map(|(axis, effect)| effect[place(axis)]).sum();
        let both: f64 = pairs.iter().map(|(a, b, table)| table[place(*a) * levels[*b] + place(*b)]).sum();
        (need <= bound).then(|| (alone + both).exp())
    };
    Problem::new(space, 0.05, random, truth)
}
