//! Every structure over a scene of instances gives the answers of the flattened scene.

use std::{ops::Range, sync::Arc};

use glam::{Affine3A, Mat3, Quat, Vec3, Vec3A};
use rand::RngExt;
use treewright_accel::{
    BruteForce, BuildChoice, Builder, Collapse, Hit, Instances, Intersector, NativeOptions, NativeQuality,
    Packets, Quality, Ray, Structure, TreeParameters, Triangles, build_instanced,
};

mod scenes;

use scenes::back_ends::{device, packed, wide_trees};

/// Objects side by side in one array, and the numbers of their triangles.
fn objects(parts: &[Arc<Triangles>]) -> (Arc<Triangles>, Vec<Range<u32>>) {
    let (mut positions, mut indices, mut ranges) = (Vec::new(), Vec::new(), Vec::new());
    for part in parts {
        let (first_vertex, first) = (positions.len() as u32, indices.len() as u32);
        positions.extend_from_slice(part.positions());
        indices.extend(part.indices().iter().map(|corners| corners.map(|corner| corner + first_vertex)));
        ranges.push(first..indices.len() as u32);
    }
    (Arc::new(Triangles::new(positions, indices).expect("the scene is valid")), ranges)
}

/// A few objects of different kinds, one of them empty and one that nothing places.
fn kinds() -> (Arc<Triangles>, Vec<Range<u32>>) {
    objects(&[
        scenes::soup(60, 0.4, 1),
        scenes::hills(6),
        Arc::new(Triangles::default()),
        scenes::city(2, 3),
        scenes::needles(40, 4),
        scenes::soup(500, 0.5, 5),
    ])
}

/// Number of the object in [`kinds`] that has no triangle.
const EMPTY: u32 = 2;

/// The triangles of every instance in the world, in the order of instances, with both their numbers.
fn flattened(triangles: &Triangles, instances: &Instances) -> (Arc<Triangles>, Vec<(u32, u32)>) {
    let (mut corners, mut numbers) = (Vec::new(), Vec::new());
    for (number, instance) in instances.placed().iter().enumerate() {
        for triangle in instances.objects()[instance.object as usize].clone() {
            let placed = triangles.corners(triangle as usize);
            corners.push(placed.map(|corner| instance.to_world.transform_point3a(corner)));
            numbers.push((triangle, number as u32));
        }
    }
    (scenes::separate(corners), numbers)
}

/// Every back end, and trees of every width, builder and test.
fn choices() -> Vec<BuildChoice> {
    let mut all = vec![BuildChoice::BruteForce];
    all.extend(wide_trees(&[
        (Quality::Morton, false, 4),
        (Quality::Sah, true, 8),
        (Quality::SahSplit, false, 4),
        (Quality::SahSplit, true, 4),
    ]));
    // Upper levels that are improved, and our own builder.
    for reinsertion_passes in 0..4 {
        for robust in [false, true] {
            all.push(BuildChoice::Tree(TreeParameters {
                builder: if reinsertion_passes % 2 == 0 { Builder::Embree } else { Builder::Ploc },
                branching_factor: if reinsertion_passes < 2 { 8 } else { 16 },
                collapse: Collapse::Optimal,
                reinsertion_passes,
                robust,
                max_depth: 64,
                ..TreeParameters::default()
            }));
        }
    }
    all.push(BuildChoice::Tree(TreeParameters { compact: true, ..TreeParameters::default() }));
    for quality in [NativeQuality::Low, NativeQuality::Medium, NativeQuality::High] {
        for robust in [false, true] {
            all.push(BuildChoice::Native(NativeOptions { quality, robust, ..NativeOptions::default() }));
        }
    }
    all
}

/// Builds everything and asks it about the rays.
fn all_agree(triangles: &Arc<Triangles>, ranges: &[Range<u32>], placed: Vec<(u32, Affine3A)>, rays: &[Ray]) {
    let count = placed.len();
    let instances =
        Arc::new(Instances::new(triangles.len(), ranges.to_vec(), placed).expect("the instances are valid"));
    let (flat, numbers) = flattened(triangles, &instances);
    assert_eq!(instances.placed_triangles(), flat.len() as u64);
    let number_of = |hit: Hit| {
        let (triangle, instance) = numbers[hit.triangle as usize];
        Hit { triangle, instance, ..hit }
    };
    let oracle = BruteForce::new(&flat);
    let flat_hits: Vec<Option<Hit>> = rays.iter().map(|ray| oracle.closest(ray)).collect();
    let expected: Vec<Option<Hit>> = flat_hits.iter().map(|hit| hit.map(number_of)).collect();
    let flat_corners = |hit: &Hit| {
        let to_world = &instances.placed()[hit.instance as usize].to_world;
        triangles.corners(hit.triangle as usize).map(|corner| to_world.transform_point3a(corner))
    };
    for choice in choices() {
        let structure = build_instanced(&device(), triangles, &instances, &choice)
            .unwrap_or_else(|error| panic!("{choice:?}: {error}"));
        if let Structure::TwoLevel(two_level) = &structure {
            two_level.validate().unwrap_or_else(|fault| panic!("{choice:?}: {fault}"));
        }
        let mut close_calls = 0;
        let mut compare =
            |what: &dyn std::fmt::Debug, ray: &Ray, expected: Option<Hit>, found: Option<Hit>| {
                let same = scenes::same_distance(expected, found, 2e-4);
                let numbers = |hit: Hit| (hit.triangle, hit.instance);
                if let Some(found) = found.filter(|_| same && expected.map(numbers) == found.map(numbers)) {
                    let [a, b, c] = flat_corners(&found);
                    let at = Vec3::from(a + (b - a) * found.u + (c - a) * found.v);
                    let along = ray.origin + ray.direction * found.t;
                    let scale = 1.0 + ray.origin.length() + at.length();
                    let edge_on = scenes::is_close_call([a, b, c], ray, &found);
                    assert!(edge_on || at.distance(along) < 1e-3 * scale, "{what:?}: {at} is not {along}");
                }
                let involved = [expected, found];
                let mut involved = involved.iter().flatten();
                if !same {
                    let close = involved.any(|hit| scenes::is_close_call(flat_corners(hit), ray, hit));
                    assert!(
                        close,
                        "{what:?}, {count} instances: {ray:?} should give {expected:?}, gave {found:?}"
                    );
                    close_calls += 1;
                }
            };
        for packets in Packets::ALL {
            let (hits, occluded) = packed(&structure, packets, rays);
            for (index, ray) in rays.iter().enumerate() {
                compare(&(choice, packets), ray, expected[index], hits[index]);
                if occluded[index] != hits[index].is_some() {
                    let hit = hits[index].or(expected[index]).expect("something occludes");
                    assert!(
                        scenes::is_close_call(flat_corners(&hit), ray, &hit),
                        "{choice:?}, {packets:?}: {ray:?}"
                    );
                }
            }
        }
        let asked = rays.len() * Packets::ALL.len();
        assert!(close_calls * 50 <= asked, "{choice:?}: {close_calls} of {asked} answers are close calls");
    }
}

#[test]
fn turned_scaled_sheared_and_mirrored() {
    let (triangles, ranges) = kinds();
    let mut random = scenes::random(12);
    let placed = (0..24)
        .map(|number| {
            let turn = Quat::from_axis_angle(scenes::on_sphere(&mut random), random.random_range(0.0..6.0));
            let mut scale = Vec3::splat(random.random_range(0.1..0.6));
            if number % 3 == 1 {
                scale *= Vec3::new(-1.0, 1.0, 1.0);
            }
            if number % 3 == 2 {
                scale *= Vec3::new(0.3, 1.0, 2.0);
            }
            let at = Vec3::from(scenes::in_cube(&mut random));
            let mut to_world = Affine3A::from_scale_rotation_translation(scale, turn, at);
            if number % 4 == 3 {
                let shear = Mat3::from_cols(Vec3::X, Vec3::new(0.6, 1.0, 0.0), Vec3::new(0.0, -0.4, 1.0));
                to_world *= Affine3A::from_mat3(shear);
            }
            // Number 5 of the objects is never placed, the empty one often.
            (number % 5, to_world)
        })
        .collect();
    let mut rays = scenes::rays(300, 13);
    // Invalid ones meet nothing.
    let good = Ray { origin: Vec3::Y, direction: Vec3::NEG_Y, t_min: 0.0, t_max: f32::INFINITY };
    rays.extend(scenes::invalid(good));
    all_agree(&triangles, &ranges, placed, &rays);
}

#[test]
fn one_instance_alone_of_a_triangle_or_of_a_point() {
    let one = [Vec3A::new(-1.0, -1.0, 0.1), Vec3A::new(1.0, -1.0, 0.2), Vec3A::new(0.0, 1.0, 0.0)];
    let (triangles, ranges) = objects(&[scenes::separate([one]), scenes::separate([[Vec3A::splat(0.2); 3]])]);
    let moved = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.7), Vec3::new(0.3, -0.2, 0.5));
    for object in [0, 1] {
        all_agree(&triangles, &ranges, vec![(object, moved)], &scenes::rays(60, 11));
    }
}

#[test]
fn nothing_is_met_where_nothing_stands() {
    let (triangles, ranges) = kinds();
    for placed in [vec![], vec![(EMPTY, Affine3A::IDENTITY); 3]] {
        let instances = Arc::new(Instances::new(triangles.len(), ranges.clone(), placed).expect("valid"));
        for choice in choices() {
            let structure = build_instanced(&device(), &triangles, &instances, &choice).expect("it builds");
            for ray in scenes::rays(40, 14) {
                assert_eq!(structure.closest(&ray), None, "{choice:?}");
                assert!(!structure.occluded(&ray), "{choice:?}");
            }
            if let Structure::TwoLevel(two_level) = &structure {
                two_level.validate().expect("an empty structure is valid");
                assert_eq!(two_level.statistics().triangle_references, 0, "what nothing places is not built");
            }
        }
    }
}

#[test]
fn thousands() {
    let (triangles, ranges) = objects(&[scenes::city(1, 20), scenes::soup(8, 1.0, 21)]);
    let mut random = scenes::random(22);
    let placed = (0..3000)
        .map(|number| {
            let turn = Quat::from_rotation_y(random.random_range(0.0..6.0));
            let at = Vec3::from(scenes::in_cube(&mut random)) * Vec3::new(2.0, 0.3, 2.0);
            let scale = Vec3::splat(random.random_range(0.01..0.05));
            (number % 2, Affine3A::from_scale_rotation_translation(scale, turn, at))
        })
        .collect();
    all_agree(&triangles, &ranges, placed, &scenes::rays(120, 23));
}
