//! In every packing each ray gets the answer it would get alone.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use treewright_accel::limits::COORDINATE_MAX;
use treewright_accel::{
    BuildChoice, Hit, Intersector, Isa, Packets, Quality, Ray, Structure, TreeParameters, Triangles, build,
};

mod scenes;

use scenes::back_ends;

/// Every back end that may trace packets its own way: native scenes, and every kind of tree.
fn structures(triangles: &Arc<Triangles>) -> Vec<(String, Structure)> {
    let device = back_ends::device();
    let mut all = Vec::new();
    for options in back_ends::native_kinds() {
        let native = build(&device, triangles, &BuildChoice::Native(options)).expect("it builds");
        all.push((format!("{options:?}"), native));
    }
    let (quality, max_depth, max_leaf_size) = (Quality::SahSplit, 64, 12);
    let plain = TreeParameters { quality, max_depth, max_leaf_size, ..TreeParameters::default() };
    for parameters in back_ends::tree_kinds(plain) {
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let tree = back_ends::tree(triangles, &parameters).with_isa(isa).expect("it is available");
            all.push((format!("{isa:?}, {parameters:?}"), Structure::Tree(tree)));
        }
    }
    all
}

/// Rays of a small camera, line by line: neighbours go one way.
fn camera(width: u32, height: u32) -> Vec<Ray> {
    let at = |x: u32, y: u32| {
        let (sx, sy) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32 - 0.5);
        let origin = Vec3::new(1.3, 0.9, 1.6);
        Ray { origin, direction: Vec3::new(sx, sy, 0.0) - origin, t_min: 0.0, t_max: f32::INFINITY }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect()
}

/// Rays of which every third is broken or reaches far beyond the scene.
fn with_odd_ones(mut rays: Vec<Ray>) -> Vec<Ray> {
    let kinds: [fn(&mut Ray); 9] = [
        |ray| ray.direction = Vec3::NAN,
        |ray| ray.origin.y = f32::INFINITY,
        |ray| ray.t_min = f32::NAN,
        |ray| ray.t_max = -1.0,
        |ray| ray.direction = Vec3::ZERO,
        |ray| (ray.origin, ray.direction) = (Vec3::splat(1e30), Vec3::splat(-1e30)),
        |ray| ray.direction = Vec3::new(1e-30, -1.0, 0.0),
        |ray| ray.direction *= 1e30,
        |ray| (ray.origin, ray.direction) = (Vec3::splat(f32::MAX), Vec3::new(1e-30, 0.0, 1.0)),
    ];
    for (number, ray) in rays.iter_mut().step_by(3).enumerate() {
        kinds[number % kinds.len()](ray);
    }
    rays
}

/// Whether two answers to one ray agree: hit or miss, distance, and triangle unless several lie there.
fn same(triangles: &Triangles, alone: Option<Hit>, packed: Option<Hit>) -> bool {
    match (alone, packed) {
        (None, None) => true,
        (Some(alone), Some(packed)) => {
            let near = |a: f32, b: f32| (a - b).abs() <= 1e-5 * (1.0 + a.abs());
            let point = |hit: Hit| {
                let [a, b, c] = triangles.corners(hit.triangle as usize);
                a + (b - a) * hit.u + (c - a) * hit.v
            };
            near(alone.t, packed.t)
                && alone.instance == packed.instance
                && point(alone).distance(point(packed)) <= 1e-3
        }
        _ => false,
    }
}

/// Runs of all lengths from 0 to 40 out of the rays, in every packing, over every back end.
fn check(name: &str, triangles: &Arc<Triangles>, rays: &[Ray]) {
    for (what, structure) in structures(triangles) {
        let alone: Vec<Option<Hit>> = rays.iter().map(|ray| structure.closest(ray)).collect();
        let shadowed: Vec<bool> = rays.iter().map(|ray| structure.occluded(ray)).collect();
        for packets in Packets::ALL {
            // Then our own trees take the steps that they take for single rays.
            let in_turns = matches!(structure, Structure::Tree(_))
                && matches!(packets, Packets::Four | Packets::Eight | Packets::Sixteen);
            let (mut begin, mut wrong) = (0, 0);
            for length in (0..=40).cycle() {
                let end = (begin + length).min(rays.len());
                let run = &rays[begin..end];
                // Earlier contents must not shine through.
                let mut hits =
                    vec![Some(Hit { t: 7.0, u: 7.0, v: 7.0, triangle: 7, instance: 7 }); run.len()];
                let mut occluded: Vec<bool> = shadowed[begin..end].iter().map(|shadowed| !shadowed).collect();
                structure.closest_each(packets, run, &mut hits);
                structure.occluded_each(packets, run, &mut occluded);
                for (offset, ray) in run.iter().enumerate() {
                    let (hit, alone) = (hits[offset], alone[begin + offset]);
                    assert!(ray.is_valid() || (hit.is_none() && !occluded[offset]), "{ray:?} is not valid");
                    assert!(
                        hit.is_none_or(|hit| hit.u.is_finite() && hit.v.is_finite()),
                        "{hit:?} of {ray:?}"
                    );
                    if in_turns {
                        assert_eq!(hit, alone, "{name}, {what}, {packets:?}: {ray:?}");
                        assert_eq!(occluded[offset], shadowed[begin + offset], "{name}, {what}: {ray:?}");
                    }
                    // Rays from beyond every possible scene get some answer.
                    let near = ray.origin.abs().max_element() <= COORDINATE_MAX;
                    let differs =
                        !same(triangles, alone, hit) || occluded[offset] != shadowed[begin + offset];
                    wrong += usize::from(differs && (near || !ray.is_valid()));
                }
                begin = end;
                if begin == rays.len() {
                    break;
                }
            }
            assert!(wrong == 0, "{name}, {what}, {packets:?}: {wrong} rays of {} differ", rays.len());
        }
    }
}

#[test]
fn random_triangles() {
    check("soup", &scenes::soup(400, 0.2, 51), &scenes::rays(1200, 52));
    check("camera", &scenes::soup(400, 0.2, 53), &camera(48, 32));
}

#[test]
fn surfaces_and_boxes() {
    check("hills", &scenes::hills(12), &scenes::rays(1200, 54));
    check("hills", &scenes::hills(12), &camera(48, 32));
    check("city", &scenes::city(5, 55), &camera(48, 32));
}

#[test]
fn broken_and_far_rays_do_not_disturb_their_neighbours() {
    check("scattered", &scenes::soup(400, 0.2, 56), &with_odd_ones(scenes::rays(1200, 57)));
    check("camera", &scenes::soup(400, 0.2, 58), &with_odd_ones(camera(48, 32)));
}

#[test]
fn degenerate_scenes() {
    let one = [Vec3A::new(-1.0, -1.0, 0.1), Vec3A::new(1.0, -1.0, 0.2), Vec3A::new(0.0, 1.0, 0.0)];
    check("nothing", &Arc::new(Triangles::default()), &scenes::rays(120, 59));
    check("coincident", &scenes::separate(vec![one; 60]), &scenes::rays(400, 60));
    check("flat", &scenes::separate([[one[0]; 3], [one[0], one[1], one[0]], one]), &scenes::rays(400, 61));
    check("needles", &scenes::needles(200, 62), &scenes::rays(600, 63));
}
