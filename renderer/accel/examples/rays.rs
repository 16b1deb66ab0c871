//! How fast is our own tree against native Embree? Million rays a second, in interleaved rounds.
//!
//! `cargo run --release -p treewright-accel --example rays [ROUNDS]`
//!
//! One thread. Every round runs every structure once on every set of rays; a ratio is the median over the
//! rounds of the ratio within a round, so that a slow spell of the machine hits both sides. Hits must
//! agree: the expected answer is checked before anything is timed.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use rand::RngExt;
use treewright_accel::{
    BuildChoice, Device, Intersector, Isa, NativeOptions, NativeQuality, Quality, Ray, Structure,
    TreeParameters, Triangles, Visitor, build, set_flush_denormals,
};

#[path = "../tests/scenes/mod.rs"]
mod scenes;

const WIDTH: u32 = 400;
const HEIGHT: u32 = 300;

/// Rays of one kind.
struct Set {
    name: &'static str,
    rays: Vec<Ray>,
    any: bool,
}

/// Traces a set and counts the hits.
struct Trace<'a>(&'a Set);

impl Visitor for Trace<'_> {
    type Output = usize;

    fn visit<I: Intersector>(self, intersector: &I) -> usize {
        let hit = |ray: &&Ray| {
            if self.0.any { intersector.occluded(ray) } else { intersector.closest(ray).is_some() }
        };
        self.0.rays.iter().filter(hit).count()
    }
}

/// Camera rays, one diffuse bounce of them, and shadow rays from where they hit.
fn sets(structure: &Structure, triangles: &Triangles, eye: Vec3, target: Vec3) -> Vec<Set> {
    let mut random = scenes::random(7);
    let forward = (target - eye).normalize();
    let right = forward.cross(Vec3::Y).normalize();
    let up = right.cross(forward);
    let open = |origin: Vec3, direction: Vec3| Ray { origin, direction, t_min: 1e-4, t_max: f32::INFINITY };
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    let primary: Vec<Ray> = pixels
        .map(|(x, y)| {
            let (sx, sy) = (x as f32 / WIDTH as f32 - 0.5, 0.5 - y as f32 / HEIGHT as f32);
            open(eye, forward + right * sx + up * sy * HEIGHT as f32 / WIDTH as f32)
        })
        .collect();
    let mut bounce = |rays: &[Ray]| -> Vec<Ray> {
        let from = |ray: &Ray| {
            let hit = structure.closest(ray)?;
            let [a, b, c] = triangles.corners(hit.triangle as usize);
            let normal = Vec3::from((b - a).cross(c - a)).normalize_or_zero();
            let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
            Some(open(ray.origin + ray.direction * hit.t, normal + scenes::on_sphere(&mut random) * 0.999))
        };
        rays.iter().filter_map(from).collect()
    };
    let first = bounce(&primary);
    let second = bounce(&first);
    let sun = Vec3::new(0.4, 0.8, 0.3);
    let shadow = first
        .iter()
        .map(|ray| {
            let (dx, dz) = (random.random_range(-0.1..0.1), random.random_range(-0.1..0.1));
            open(ray.origin, sun + Vec3::new(dx, 0.0, dz))
        })
        .collect();
    let set = |name, rays, any| Set { name, rays, any };
    vec![
        set("primary", primary, false),
        set("bounce 1", first, false),
        set("bounce 2", second, false),
        set("shadow", shadow, true),
    ]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rounds: usize = std::env::args().nth(1).map_or(Ok(21), |rounds| rounds.parse())?;
    set_flush_denormals();
    let device = Device::open(0)?;
    let wide = TreeParameters {
        branching_factor: 8,
        sah_block_size: 4,
        min_leaf_size: 4,
        max_leaf_size: 28,
        max_depth: 64,
        ..TreeParameters::default()
    };
    let native = |quality| BuildChoice::Native(NativeOptions { quality, ..NativeOptions::default() });
    let choices = [
        ("native medium", native(NativeQuality::Medium)),
        ("native high", native(NativeQuality::High)),
        ("tree bf8 sah", BuildChoice::Tree(wide)),
        ("tree bf8 split", BuildChoice::Tree(TreeParameters { quality: Quality::SahSplit, ..wide })),
        ("tree bf8 robust", BuildChoice::Tree(TreeParameters { robust: true, ..wide })),
        ("tree bf4 sah", BuildChoice::Tree(TreeParameters { branching_factor: 4, ..wide })),
        ("Table 1 default", BuildChoice::Tree(TreeParameters::default())),
        ("tree bf8 avx2", BuildChoice::Tree(wide)),
        ("tree bf8 scalar", BuildChoice::Tree(wide)),
    ];
    let places = [
        ("hills 500k", scenes::hills(500), Vec3::new(0.9, 0.45, 0.9), Vec3::ZERO),
        ("city 480k", scenes::city(200, 1), Vec3::new(0.5, 0.25, 0.6), Vec3::new(-0.3, 0.0, -0.3)),
        ("soup 300k", scenes::soup(300_000, 0.03, 2), Vec3::new(1.5, 1.0, 1.8), Vec3::ZERO),
    ];
    println!("{:?} kernels, {rounds} rounds; each cell: ratio to native medium (Mrays/s)", Isa::detect());
    for (scene, triangles, eye, target) in places {
        measure(&device, scene, &triangles, (eye, target), &choices, rounds)?;
    }
    Ok(())
}

fn measure(
    device: &Device,
    scene: &str,
    triangles: &Arc<Triangles>,
    (eye, target): (Vec3, Vec3),
    choices: &[(&str, BuildChoice)],
    rounds: usize,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut structures = Vec::new();
    let mut build_ms = Vec::new();
    for (name, choice) in choices {
        let mut times = Vec::new();
        let mut last = None;
        for _ in 0..3 {
            let start = Instant::now();
            let structure = build(device, triangles, choice)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
            last = Some(structure);
        }
        build_ms.push(median(times));
        let isa = if name.ends_with("avx2") {
            Some(Isa::Avx2)
        } else {
            name.ends_with("scalar").then_some(Isa::Scalar)
        };
        let structure = match (last, isa) {
            (Some(Structure::Tree(tree)), Some(isa)) => {
                Structure::Tree(tree.with_isa(isa).ok_or("the processor lacks this instruction set")?)
            }
            (Some(structure), _) => structure,
            (None, _) => return Err("nothing was built".into()),
        };
        structures.push(structure);
    }
    let sets = sets(&structures[0], triangles, eye, target);
    let expected: Vec<usize> = sets.iter().map(|set| structures[0].visit(Trace(set))).collect();
    for ((name, _), structure) in choices.iter().zip(&structures) {
        for (set, &expected) in sets.iter().zip(&expected) {
            let hits = structure.visit(Trace(set));
            let difference = hits.abs_diff(expected);
            assert!(
                difference * 10_000 <= expected,
                "{scene}, {name}, {}: {hits} hits, expected {expected}",
                set.name
            );
        }
    }
    // Million rays a second by structure, set and round.
    let mut speeds = vec![vec![Vec::new(); sets.len()]; structures.len()];
    for _ in 0..rounds {
        for (structure, speeds) in structures.iter().zip(&mut speeds) {
            for (set, speeds) in sets.iter().zip(speeds) {
                let start = Instant::now();
                black_box(structure.visit(Trace(set)));
                speeds.push(set.rays.len() as f64 / start.elapsed().as_secs_f64() / 1e6);
            }
        }
    }
    print!("\n{scene:<18} build_ms ");
    sets.iter().for_each(|set| print!("{:>16}", set.name));
    println!();
    for (index, (name, _)) in choices.iter().enumerate() {
        print!("{name:<18} {:>8.1} ", build_ms[index]);
        for (set, reference) in speeds[index].iter().zip(&speeds[0]) {
            let ratio = median(set.iter().zip(reference).map(|(a, b)| a / b).collect());
            print!("{:>8.2} ({:>5.2})", ratio, median(set.clone()));
        }
        println!();
    }
    Ok(())
}
