//! With every choice of light sampling expectations are equal, and both orders of work give equal bits.

use std::sync::Arc;

use glam::Vec3;
use treewright_accel::NativeQuality;
use treewright_scene::builtin::{self, Options};

use super::tests::{quad, scene};
use crate::film::{Film, Picture};
use crate::light_sampling::{LampChoice, LightSampling, SkyChoice};
use crate::scene::{Camera, Material, Scene, Sky, Sun, Volume};
use crate::{
    frame::Renderer, integrator::View, noise::FrameNoise, render_options::RenderOptions, space::Choice,
};

const SIZE: [u32; 2] = [24, 16];
/// Pixels of a square of the picture along either side.
const SQUARE: u32 = 8;
const SEEDS: u64 = 10;
const SAMPLES: u32 = 24;

fn ways() -> Vec<LightSampling> {
    let plain = LightSampling::default();
    let sky = LightSampling { sky: SkyChoice::Learnt, ..plain };
    let lamps = LightSampling { lamps: LampChoice::Learnt, ..plain };
    vec![
        plain,
        LightSampling { candidates: 1, ..plain },
        LightSampling { candidates: 8, lamp_weight: 8.0, ..plain },
        LightSampling { candidates: 16, lamp_weight: 64.0, ..plain },
        sky,
        LightSampling { lamp_weight: 4.0, candidates: 4, ..sky },
        lamps,
        LightSampling { candidates: 1, lamp_weight: 4.0, ..lamps },
        LightSampling { candidates: 8, lamps: LampChoice::Learnt, ..sky },
        LightSampling { shadow_roulette: 0.4, path_roulette: 0.5, ..plain },
        LightSampling { shadow_roulette: 0.4, path_roulette: 0.5, ..sky },
    ]
}

fn built_in(name: &str, detail: f32) -> Scene {
    builtin::build(name, &Options { detail, ..Options::default() }).expect("it is built in")
}

/// A renderer of a built-in scene that has learnt from its first camera.
fn renderer(name: &str, detail: f32) -> (Renderer, View) {
    learnt(built_in(name, detail))
}

fn learnt(scene: Scene) -> (Renderer, View) {
    let view = View { camera: scene.cameras[0], seed: 1, bounces: 3 };
    let mut renderer = Renderer::new(Arc::new(scene), 0).expect("Embree starts");
    renderer.rebuild(&Choice::native(NativeQuality::Medium).build).expect("it can be built");
    renderer.learn_light(&view, [120, 80]).expect("there is a structure");
    (renderer, view)
}

fn picture(renderer: &Renderer, view: &View, options: &RenderOptions, samples: u32) -> Picture {
    let mut film = Film::new(SIZE);
    for _ in 0..samples {
        let (_, counts) = renderer.render(view, options, &mut film).expect("there is a structure");
        assert_eq!(counts.bad_samples, 0);
    }
    film.picture()
}

/// Mean luminance of each square, and its standard error, over seeds.
fn squares(renderer: &Renderer, view: &View) -> Vec<(f64, f64)> {
    let mut sums = [(0.0, 0.0); (SIZE[0] * SIZE[1] / (SQUARE * SQUARE)) as usize];
    for seed in 0..SEEDS {
        let view = View { seed: 100 + seed, ..*view };
        let means = picture(renderer, &view, &RenderOptions::default(), SAMPLES).block_luminances(SQUARE);
        for ((sum, squares), mean) in sums.iter_mut().zip(means) {
            *sum += mean;
            *squares += mean * mean;
        }
    }
    let count = SEEDS as f64;
    let of = |(sum, squares): (f64, f64)| {
        let mean = sum / count;
        (mean, ((squares / count - mean * mean).max(0.0) / (count - 1.0)).sqrt())
    };
    sums.map(of).to_vec()
}

/// Whether a way is another one in a scene: there is no sky in the doorway, and little else on the patio.
fn matters(name: &str, way: &LightSampling) -> bool {
    match name {
        "doorway" => way.sky == SkyChoice::Plain,
        "patio" => way.sky == SkyChoice::Learnt || way.candidates == 16,
        _ => true,
    }
}

#[test]
fn every_way_of_looking_for_light_has_the_same_expectation() {
    let built_in = [
        ("loft", 0.2),
        ("quick", 0.05),
        ("market", 0.025),
        ("city", 0.02),
        ("doorway", 0.2),
        ("patio", 0.05),
    ];
    let built_in = built_in.into_iter().map(|(name, detail)| (name, renderer(name, detail)));
    let glass = std::iter::once_with(|| ("glass", behind_glass()));
    for (name, (mut renderer, view)) in built_in.chain(glass) {
        let expected = squares(&renderer, &view);
        for way in ways().into_iter().skip(1).filter(|way| matters(name, way)) {
            renderer.set_light_sampling(way);
            for (square, (found, expected)) in squares(&renderer, &view).iter().zip(&expected).enumerate() {
                // Errors are estimated from ten pictures; bright dots are rarer in some ways than in others.
                let error = found.1.hypot(expected.1) + 0.003 * expected.0;
                let off = (found.0 - expected.0).abs() / error;
                assert!(off < 5.0, "{name}, square {square}, {way:?}: {found:?} and {expected:?}");
            }
        }
    }
}

/// A floor under a large lamp, under an even sky and a wide sun: much light for either technique to find.
fn open_room() -> (Renderer, View) {
    room(0.4, &[])
}

/// The same under a dark sky, behind dark glass, whose back few paths survive with `path_roulette`.
fn behind_glass() -> (Renderer, View) {
    let glass = Material {
        base_color: Vec3::ONE,
        roughness: 0.0,
        transmission: 1.0,
        ior: 2.0,
        volume: Some(Volume::new(Vec3::splat(0.1), 0.2)),
        ..Material::default()
    };
    let side = |z: f32, a: Vec3, b: Vec3| quad(Vec3::new(-6.0, -3.0, z), a, b);
    let [across, up] = [Vec3::X * 12.0, Vec3::Y * 6.2];
    let pane = [side(3.6, across, up), side(3.4, up, across)].concat();
    let (mut renderer, view) = room(0.05, &[(pane, glass)]);
    let view = View { bounces: 2, ..view };
    renderer.learn_light(&view, [120, 80]).expect("there is a structure");
    (renderer, view)
}

/// The room under a sky of some radiance, with more in it.
fn room(radiance: f32, more: &[(Vec<[Vec3; 3]>, Material)]) -> (Renderer, View) {
    let matt = |shade: f32, glow: f32| Material {
        base_color: Vec3::splat(shade),
        emission: Vec3::splat(glow),
        ior: 1.0,
        ..Material::default()
    };
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let floor = quad(at(-3.0, 0.0, -3.0), at(0.0, 0.0, 6.0), at(6.0, 0.0, 0.0));
    let wall = quad(at(-3.0, 0.0, -3.0), at(6.0, 0.0, 0.0), at(0.0, 4.0, 0.0));
    let lamp = quad(at(-1.5, 1.2, -1.5), at(2.0, 0.0, 0.0), at(0.0, 0.0, 2.0));
    let sun = Sun { direction: at(0.4, 0.8, 0.5), irradiance: Vec3::splat(1.5), half_angle_rad: 0.5 };
    let sky = Sky { zenith: Vec3::splat(radiance), horizon: Vec3::splat(radiance), sun: Some(sun) };
    let mut parts = vec![(floor, matt(0.7, 0.0)), (wall, matt(0.5, 0.0)), (lamp, matt(0.3, 2.0))];
    parts.extend_from_slice(more);
    let scene = scene(&parts, sky);
    let mut renderer = Renderer::new(scene, 0).expect("Embree starts");
    renderer.rebuild(&Choice::native(NativeQuality::Medium).build).expect("it can be built");
    let (position, target) = (at(0.5, 2.6, 5.0), at(0.0, 0.3, -0.5));
    let camera = Camera::upright(position, target, 55.0);
    (renderer, View { camera, seed: 1, bounces: 0 })
}

#[test]
fn shares_are_accounted_for_at_every_vertex() {
    let (mut renderer, view) = open_room();
    for bounces in 0..3 {
        let view = View { bounces, ..view };
        renderer.set_light_sampling(LightSampling::default());
        // Without a bounce the sky is not found, so there is nothing to learn.
        renderer.learn_light(&View { bounces: bounces.max(1), ..view }, [120, 80]).expect("a structure");
        let mut means = ways().into_iter().map(|way| {
            renderer.set_light_sampling(way);
            let all = squares(&renderer, &view);
            let error = all.iter().map(|(_, error)| error * error).sum::<f64>().sqrt();
            (way, all.iter().map(|(mean, _)| mean).sum::<f64>(), error)
        });
        let (_, expected, error) = means.next().expect("the plain way");
        assert!(error < 0.01 * expected, "there is little noise");
        for (way, found, own_error) in means {
            let off = (found - expected).abs() / own_error.hypot(error);
            assert!(off < 4.5, "{bounces} bounces, {way:?}: {found} and {expected}, {off} standard errors");
        }
    }
}

#[test]
fn both_orders_of_work_give_the_same_bits() {
    for (name, detail) in [("loft", 0.2), ("city", 0.02), ("patio", 0.05)] {
        let (mut renderer, view) = renderer(name, detail);
        for way in ways() {
            renderer.set_light_sampling(way);
            let [by_path, staged] = [false, true].map(|staged| {
                picture(&renderer, &view, &RenderOptions { staged, ..RenderOptions::default() }, 3)
            });
            assert_eq!(by_path, staged, "{name} {way:?}");
        }
    }
}

#[test]
fn a_sky_that_is_no_longer_learnt_leaves_no_need_behind() {
    let (mut renderer, _) = renderer("loft", 0.2);
    let before = renderer.needs();
    for way in ways() {
        renderer.set_light_sampling(way);
        assert_eq!(renderer.needs().environment, way.sky == SkyChoice::Learnt);
    }
    renderer.set_light_sampling(LightSampling::default());
    assert_eq!(renderer.needs(), before);
}

/// The noise of a frame by a way, once the view was studied.
fn noise(renderer: &mut Renderer, way: LightSampling) -> FrameNoise {
    renderer.set_light_sampling(way);
    let structure = renderer.structure().expect("there is one");
    let frame = renderer.noisy_frame(structure, &RenderOptions::default());
    frame.expect("the view was studied").0.noise.expect("it was measured")
}

fn variances(name: &str, detail: f32, ways: [LightSampling; 2]) -> [f64; 2] {
    let (mut renderer, view) = renderer(name, detail);
    renderer.study_view(&view, &RenderOptions::default(), [96, 64]).expect("there is a structure");
    ways.map(|way| noise(&mut renderer, way).relative_variance)
}

#[test]
fn no_way_is_taken_for_a_biased_one() {
    let (mut renderer, view) = renderer("loft", 0.2);
    let options = RenderOptions::default();
    renderer.study_view(&view, &options, [96, 64]).expect("there is a structure");
    for way in ways() {
        let bias = noise(&mut renderer, way).bias;
        let bias = bias.filter(|bias| renderer.finds_again(bias, &options));
        assert_eq!(bias, None, "{way:?}");
    }
}

#[test]
fn the_sky_through_windows_is_found_sooner_once_it_was_learnt() {
    let plain = LightSampling::default();
    let learnt = LightSampling { sky: SkyChoice::Learnt, ..plain };
    let [plain, learnt] = variances("loft", 0.2, [plain, learnt]);
    assert!(learnt < 0.7 * plain, "variance {learnt} and {plain}");
}

#[test]
fn a_sky_that_bounces_find_takes_no_rays_from_lamps() {
    let plain = LightSampling::default();
    let learnt = LightSampling { sky: SkyChoice::Learnt, ..plain };
    // Lamps at night below a dim sky.
    let [plain, learnt] = variances("market", 0.025, [plain, learnt]);
    assert!(learnt < 1.15 * plain, "variance {learnt} and {plain}");
}

#[test]
fn a_small_sun_of_a_map_is_found_also_where_the_sky_was_learnt() {
    let plain = LightSampling { candidates: 1, ..LightSampling::default() };
    let learnt = LightSampling { sky: SkyChoice::Learnt, ..plain };
    let [plain, learnt] = variances("patio", 0.05, [plain, learnt]);
    assert!(learnt < 2.0 * plain, "variance {learnt} and {plain}");
}

#[test]
fn near_lamps_among_many_are_found_sooner_once_they_were_learnt() {
    let plain = LightSampling { candidates: 4, lamp_weight: 64.0, ..LightSampling::default() };
    let learnt = LightSampling { lamps: LampChoice::Learnt, lamp_weight: 8.0, ..plain };
    let [plain, learnt] = variances("market", 0.3, [plain, learnt]);
    assert!(learnt < 0.85 * plain, "variance {learnt} and {plain}");
}

#[test]
fn lamps_are_learnt_alike_each_time() {
    let (mut renderer, view) = renderer("market", 0.05);
    renderer.set_light_sampling(LightSampling { lamps: LampChoice::Learnt, ..LightSampling::default() });
    let first = picture(&renderer, &view, &RenderOptions::default(), 2);
    renderer.set_light_sampling(LightSampling::default());
    renderer.learn_light(&view, [120, 80]).expect("there is a structure");
    let plain = picture(&renderer, &view, &RenderOptions::default(), 2);
    renderer.set_light_sampling(LightSampling { lamps: LampChoice::Learnt, ..LightSampling::default() });
    assert_eq!(picture(&renderer, &view, &RenderOptions::default(), 2), first);
    assert_ne!(plain, first, "they are drawn otherwise");
}
