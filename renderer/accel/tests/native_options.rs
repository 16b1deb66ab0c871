//! Every option of native scenes has its documented effect, seen in memory and in the last bits of answers.

use std::sync::Arc;

use treewright_accel::{
    BuildChoice, BuildError, Device, Intersector, Isa, NativeOptions, NativeQuality, Ray, Structure,
    TreeParameters, Triangles, build,
};

mod scenes;

use NativeQuality::{High, Low, Medium};

/// One build thread: then equal builds take equal memory.
fn device() -> Device {
    Device::open(1).expect("Embree is set up")
}

/// Small triangles, and every tenth long enough to be worth splitting.
fn triangles() -> Arc<Triangles> {
    let mut random = scenes::random(71);
    scenes::separate((0..20_000).map(|number| {
        let size = if number % 10 == 0 { 0.4 } else { 0.03 };
        let corner = scenes::in_cube(&mut random);
        [corner, corner + scenes::in_cube(&mut random) * size, corner + scenes::in_cube(&mut random) * size]
    }))
}

fn native(triangles: &Arc<Triangles>, options: &NativeOptions) -> Structure {
    build(&device(), triangles, &BuildChoice::Native(*options))
        .unwrap_or_else(|error| panic!("{options:?}: {error}"))
}

/// Bytes a triangle, and the last bits of some answers.
fn traits(triangles: &Arc<Triangles>, rays: &[Ray], options: &NativeOptions) -> (f64, Vec<u32>) {
    let mut bytes = usize::MAX;
    let mut weights = Vec::new();
    // Beside other work Embree at times takes one block more: the least of a few builds is the tree's.
    for _ in 0..3 {
        // A device of its own counts the memory of this build alone.
        let alone = device().with_memory_budget(usize::MAX).expect("another device");
        let structure = build(&alone, triangles, &BuildChoice::Native(*options)).expect("it builds");
        bytes = bytes.min(structure.statistics().bytes);
        weights = rays.iter().filter_map(|ray| structure.closest(ray)).map(|hit| hit.u.to_bits()).collect();
    }
    (bytes as f64 / triangles.len() as f64, weights)
}

/// More than the rounding of Embree's blocks of memory.
fn clearly(a: f64, b: f64) -> bool {
    (a / b).max(b / a) > 1.01
}

/// The numbers hold where Embree has its eight-wide trees.
fn eight_wide() -> bool {
    Isa::Avx2.is_available()
}

#[test]
fn every_quality_is_another_one() {
    if !eight_wide() {
        return;
    }
    let triangles = triangles();
    let of = |quality| NativeOptions { quality, ..NativeOptions::default() };
    let bytes = |quality| traits(&triangles, &[], &of(quality)).0;
    for quality in [Low, High] {
        assert!(clearly(bytes(quality), bytes(Medium)), "{quality:?}");
    }
}

#[test]
fn flags_act_and_make_high_quality_medium() {
    if !eight_wide() {
        return;
    }
    let (triangles, rays) = (triangles(), scenes::rays(400, 73));
    let of = |options: NativeOptions| traits(&triangles, &rays, &options);
    let plain = NativeOptions::default();
    let (bytes, weights) = of(plain);
    assert!(of(NativeOptions { compact: true, ..plain }).0 < 0.7 * bytes);
    assert_ne!(of(NativeOptions { robust: true, ..plain }).1, weights, "another triangle test");
    let dynamic = of(NativeOptions { dynamic: true, ..plain }).0;
    assert!((dynamic - bytes - 32.0).abs() < 5.0, "{dynamic} against {bytes}");
    for flagged in [NativeOptions { compact: true, ..plain }, NativeOptions { robust: true, ..plain }] {
        let high = NativeOptions { quality: High, ..flagged };
        assert!(!clearly(of(high).0, of(flagged).0), "{high:?} is of medium quality");
        assert_eq!(high.effective_quality(), Medium);
    }
}

#[test]
fn splits_act_with_high_quality_only() {
    if !eight_wide() {
        return;
    }
    let triangles = triangles();
    let bytes = |options: NativeOptions| traits(&triangles, &[], &options).0;
    let high = NativeOptions { quality: High, ..NativeOptions::default() };
    let sizes = [1.0, 1.2, 1.5, 2.0, 4.0].map(|split_budget| bytes(NativeOptions { split_budget, ..high }));
    assert!(sizes.is_sorted_by(|less, more| less * 1.05 < *more), "{sizes:?}");
    assert!(clearly(bytes(NativeOptions { presplit: true, ..high }), bytes(high)));
    let medium = NativeOptions { quality: Medium, ..high };
    // A block more or less, as above; a split budget of 4 takes far more.
    let (split, plain) =
        (bytes(NativeOptions { split_budget: 4.0, presplit: true, ..medium }), bytes(medium));
    assert!((split / plain - 1.0).abs() < 0.06, "{split} against {plain}");
}

#[test]
fn a_budget_out_of_range_is_no_build() {
    for split_budget in [0.9, 4.1, f32::NAN, f32::INFINITY] {
        let choice = BuildChoice::Native(NativeOptions { split_budget, ..NativeOptions::default() });
        let refused = build(&device(), &Arc::default(), &choice).expect_err("it is out of range");
        assert!(
            matches!(refused, BuildError::InvalidParameters { parameter: "split_budget", .. }),
            "{refused}"
        );
    }
}

#[test]
fn builds_under_memory_pressure_are_infeasible_and_leave_nothing_behind() {
    let (triangles, ray) = (triangles(), scenes::rays(1, 74)[0]);
    let choices = [
        BuildChoice::Native(NativeOptions::default()),
        BuildChoice::Native(NativeOptions { quality: High, presplit: true, ..NativeOptions::default() }),
        BuildChoice::Native(NativeOptions { compact: true, ..NativeOptions::default() }),
        BuildChoice::Tree(TreeParameters::default()),
        BuildChoice::Tree(TreeParameters { compact: true, ..TreeParameters::default() }),
    ];
    for choice in choices {
        let roomy = device().with_memory_budget(1 << 30).expect("another device");
        let needed = {
            let structure = build(&roomy, &triangles, &choice).expect("there is room");
            assert!(roomy.bytes_held() >= structure.statistics().bytes / 2, "{choice:?}");
            roomy.bytes_held()
        };
        assert_eq!(roomy.bytes_held(), 0, "{choice:?}: a dropped structure is given back");
        for budget in [0, needed / 8, needed / 2] {
            let tight = device().with_memory_budget(budget).expect("another device");
            let error = build(&tight, &triangles, &choice).expect_err("there is no room");
            assert_eq!(error, BuildError::OutOfMemory, "{choice:?}, {budget} bytes");
            assert!(error.is_infeasible());
            assert_eq!(tight.bytes_held(), 0, "{choice:?}, {budget} bytes: a failed build is given back");
            // The device goes on.
            let one = scenes::soup(1, 0.1, 75);
            if budget > 1 << 16 {
                let small = build(&tight, &one, &choice).expect("a small scene fits");
                assert!(small.closest(&ray).is_none() || small.occluded(&ray));
            }
        }
    }
}

#[test]
fn any_number_of_options_is_served_by_few_devices() {
    let (device, triangles) = (device(), scenes::soup(300, 0.2, 76));
    let rays = scenes::rays(50, 77);
    let before = device.bytes_held();
    let scenes: Vec<Structure> = (0..60)
        .map(|number| {
            let split_budget = 1.0 + 0.1 * (number % 30) as f32;
            let presplit = number >= 30;
            native(
                &triangles,
                &NativeOptions { quality: High, split_budget, presplit, ..NativeOptions::default() },
            )
        })
        .collect();
    let hits: Vec<Vec<bool>> =
        scenes.iter().map(|scene| rays.iter().map(|ray| scene.occluded(ray)).collect()).collect();
    assert!(hits.iter().all(|some| some == &hits[0]), "scenes outlive the place of their device");
    drop(scenes);
    // Other tests build at the same time, but none takes as much as sixty scenes.
    assert!(device.bytes_held() < before + 60 * 300 * 60);
}
