//! Analytic and statistical tests of the scattering model.

use std::f32::consts::TAU;

use super::*;
use crate::integrator::random::PathRandom;

fn material(base: f32, metallic: f32, roughness: f32, transmission: f32, ior: f32) -> Material {
    Material { base_color: Vec3::splat(base), metallic, roughness, transmission, ior, ..Material::default() }
}

fn view_at(cosine: f32) -> Vec3 {
    Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine)
}

fn seen(bsdf: &Bsdf, view: Vec3) -> Seen<'_, true> {
    bsdf.seen_from(view).expect("it is seen from above")
}

/// Mean weight over many samples: the share of light that leaves again, over all directions.
fn albedo(bsdf: &Bsdf, view: Vec3, samples: u32) -> f32 {
    let random = PathRandom::new(11, 0, 0);
    let seen = seen(bsdf, view);
    let sum: f64 = (0..samples)
        .filter_map(|place| seen.sample(random.single(2 * place), random.pair(2 * place + 1)))
        .map(|sample| f64::from(sample.weight.y))
        .sum();
    (sum / f64::from(samples)) as f32
}

/// The mean over all directions by their cosine.
fn mean_albedo(bsdf: &Bsdf) -> f32 {
    let steps = 40;
    let of = |step: i32| albedo(bsdf, view_at(((step as f32 + 0.5) / steps as f32).sqrt()), 4_000);
    (0..steps).map(of).sum::<f32>() / steps as f32
}

#[test]
fn a_white_surface_keeps_its_light_whatever_it_is_made_of() {
    for metallic in [0.0, 0.3, 0.5, 0.9, 1.0] {
        for roughness in [0.0, 0.1, 0.3, 0.5, 0.7, 0.85, 1.0] {
            let bsdf = Bsdf::new(&material(1.0, metallic, roughness, 0.0, 1.5));
            let found = mean_albedo(&bsdf);
            assert!((found - 1.0).abs() < 0.015, "metallic {metallic}, roughness {roughness}: {found}");
        }
    }
    for ior in [1.0, 1.1, 1.33, 1.8, 2.4] {
        let found = mean_albedo(&Bsdf::new(&material(1.0, 0.0, 0.6, 0.0, ior)));
        assert!((found - 1.0).abs() < 0.015, "index of refraction {ior}: {found}");
    }
    let sheet = mean_albedo(&Bsdf::new(&material(1.0, 0.0, 0.0, 1.0, 1.5)));
    assert!((sheet - 1.0).abs() < 1e-3, "a clear sheet: {sheet}");
}

#[test]
fn a_white_rough_metal_keeps_its_light_from_every_side() {
    for roughness in [0.1, 0.3, 0.5, 0.7, 0.85, 1.0] {
        let white = Bsdf::new(&material(1.0, 1.0, roughness, 0.0, 1.5));
        for cosine in [0.1, 0.3, 0.6, 1.0] {
            let found = albedo(&white, view_at(cosine), 40_000);
            assert!((found - 1.0).abs() < 0.02, "roughness {roughness}, cosine {cosine}: {found}");
        }
    }
}

/// Beside its gloss it is what a body of that albedo is under a layer that lets 96 % through each way.
#[test]
fn middle_grey_is_as_bright_as_its_colour_says() {
    for roughness in [0.5, 0.8, 1.0] {
        let bsdf = Bsdf::new(&material(0.5, 0.0, roughness, 0.0, 1.5));
        let diffuse = seen(&bsdf, Vec3::Z).rough(Vec3::new(0.3, 0.0, 0.953_939)).0.y;
        let lobe = Bsdf::new(&material(0.0, 0.0, roughness, 0.0, 1.5));
        let lobe = seen(&lobe, Vec3::Z).rough(Vec3::new(0.3, 0.0, 0.953_939)).0.y;
        let plain = 0.5 * 0.96 * 0.96 * 0.953_939 * FRAC_1_PI;
        assert!(((diffuse - lobe) / plain - 1.0).abs() < 0.03, "{roughness}: {diffuse} {lobe} {plain}");
    }
}

/// The sum over reflections: what the lobe loses meets another microfacet, or leaves.
#[test]
fn a_coloured_rough_metal_is_darker_by_each_further_reflection() {
    for roughness in [0.5, 0.7, 1.0] {
        let mean_loss = losses(roughness).1;
        for base in [0.2, 0.5, 0.9_f32] {
            let once = base + (1.0 - base) / 21.0;
            let expected = once * (1.0 - mean_loss) / (1.0 - once * mean_loss);
            let found = mean_albedo(&Bsdf::new(&material(base, 1.0, roughness, 0.0, 1.5)));
            assert!((found - expected).abs() < 0.04, "{roughness} {base}: {found} and {expected}");
        }
    }
}

#[test]
fn no_material_makes_light() {
    for base in [0.5, 1.0] {
        for metallic in [0.0, 0.5, 1.0] {
            for roughness in [0.0, 0.1, 0.4, 1.0] {
                for transmission in [0.0, 0.5, 1.0] {
                    let bsdf = Bsdf::new(&material(base, metallic, roughness, transmission, 1.5));
                    for cosine in [0.02, 0.2, 0.6, 1.0] {
                        let albedo = albedo(&bsdf, view_at(cosine), 20_000);
                        // Weights are at most a few, so the mean of 20,000 is good to about 0.02.
                        let case = (base, metallic, roughness, transmission, cosine);
                        assert!(albedo <= 1.02, "{case:?} reflects {albedo}");
                        assert!(albedo > 0.15 * base, "{case:?} reflects only {albedo}");
                    }
                }
            }
        }
    }
}

#[test]
fn densities_integrate_to_the_share_of_rough_samples() {
    for roughness in [0.25, 0.4, 1.0] {
        for metallic in [0.0, 1.0] {
            let bsdf = Bsdf::new(&material(0.6, metallic, roughness, 0.3, 1.5));
            for cosine in [0.2, 0.8] {
                let view = view_at(cosine);
                let random = PathRandom::new(5, 0, 0);
                let seen = seen(&bsdf, view);
                let drawn = 40_000;
                let rough = (0..drawn)
                    .filter_map(|place| seen.sample(random.single(2 * place), random.pair(2 * place + 1)))
                    .filter(|sample| sample.scatter == Scatter::Rough)
                    .count() as f64
                    / f64::from(drawn);
                let integral = integrate(&bsdf, view, [0.0, 1.0], [0.0, TAU], 600);
                assert!(
                    (rough - integral).abs() < 0.015,
                    "{roughness} {metallic} {cosine}: {rough} vs {integral}"
                );
            }
        }
    }
}

/// Integral of the density over a patch of (cosine, azimuth), midpoint rule.
fn integrate(bsdf: &Bsdf, view: Vec3, cosines: [f32; 2], azimuths: [f32; 2], steps: u32) -> f64 {
    let (dc, da) = ((cosines[1] - cosines[0]) / steps as f32, (azimuths[1] - azimuths[0]) / steps as f32);
    let seen = seen(bsdf, view);
    let mut sum = 0.0;
    for i in 0..steps {
        let cosine = cosines[0] + (i as f32 + 0.5) * dc;
        let sine = (1.0 - cosine * cosine).sqrt();
        for j in 0..steps {
            let (sin, cos) = (azimuths[0] + (j as f32 + 0.5) * da).sin_cos();
            sum += f64::from(seen.rough(Vec3::new(sine * cos, sine * sin, cosine)).1);
        }
    }
    sum * f64::from(dc) * f64::from(da)
}

#[test]
fn samples_follow_their_density_cell_by_cell() {
    const CELLS: usize = 8;
    let drawn = 60_000;
    for (roughness, metallic) in [(0.3, 1.0), (0.5, 0.0), (1.0, 0.4)] {
        let bsdf = Bsdf::new(&material(0.8, metallic, roughness, 0.0, 1.5));
        let view = view_at(0.6);
        let mut counts = [[0_u32; CELLS]; CELLS];
        let random = PathRandom::new(17, 0, 0);
        let seen = seen(&bsdf, view);
        for place in 0..drawn {
            let Some(sample) = seen.sample(random.single(2 * place), random.pair(2 * place + 1)) else {
                continue;
            };
            let row = (sample.direction.z * CELLS as f32) as usize;
            let azimuth = sample.direction.y.atan2(sample.direction.x).rem_euclid(TAU);
            let column = (azimuth / TAU * CELLS as f32) as usize;
            counts[row.min(CELLS - 1)][column.min(CELLS - 1)] += 1;
        }
        // Pearson's statistic; 64 degrees of freedom stay below 130 with overwhelming probability.
        let mut statistic = 0.0;
        for (row, line) in counts.iter().enumerate() {
            for (column, &count) in line.iter().enumerate() {
                let edge = |index: usize| index as f32 / CELLS as f32;
                let cosines = [edge(row), edge(row + 1)];
                let azimuths = [edge(column) * TAU, edge(column + 1) * TAU];
                let expected = f64::from(drawn) * integrate(&bsdf, view, cosines, azimuths, 64);
                if expected > 5.0 {
                    statistic += (f64::from(count) - expected).powi(2) / expected;
                }
            }
        }
        assert!(statistic < 130.0, "roughness {roughness}, metallic {metallic}: chi-square {statistic}");
    }
}

#[test]
fn reciprocity_holds() {
    let bsdf = Bsdf::new(&material(0.7, 0.3, 0.4, 0.2, 1.5));
    for (a, b) in [(0.2, 0.9), (0.5, 0.6), (0.1, 0.15)] {
        let (view, light) = (view_at(a), Vec3::new(0.0, (1.0_f32 - b * b).sqrt(), b));
        let there = seen(&bsdf, view).rough(light).0 / light.z;
        let back = seen(&bsdf, light).rough(view).0 / view.z;
        assert!((there - back).length() < 1e-4 * there.length(), "{there} {back}");
    }
}

/// The books' formula in double precision: Walter et al. 2007, height-correlated Smith (Heitz 2014).
#[test]
fn the_rearranged_lobe_is_the_one_in_the_books() {
    let lambda = |alpha: f64, cosine: f64| {
        let tangent = (1.0 - cosine * cosine) / (cosine * cosine);
        ((1.0 + alpha * alpha * tangent).sqrt() - 1.0) * 0.5
    };
    for roughness in [0.1_f32, 0.3, 0.7, 1.0] {
        let bsdf = Bsdf::new(&material(0.9, 1.0, roughness, 0.0, 1.5));
        let alpha = f64::from(roughness * roughness);
        for (cosine, light) in [
            (0.9, Vec3::new(-0.4, 0.1, 0.9)),
            (0.3, Vec3::new(-0.9, 0.2, 0.35)),
            (0.05, Vec3::new(-1.0, 0.0, 0.06)),
        ] {
            let (view, light) = (view_at(cosine), light.normalize());
            let seen = seen(&bsdf, view);
            let (value, pdf) = seen.rough(light);
            // Without the wide lobe, and without the share of draws that it takes.
            let multiple = bsdf.multiple.expect("it is a rough metal");
            let value = value - multiple.value(seen.loss, light.z, roughness * roughness);
            let pdf = (pdf - seen.shares.diffuse * light.z * FRAC_1_PI) / seen.shares.reflect;
            let half = (view.as_dvec3() + light.as_dvec3()).normalize();
            let spread = half.z * half.z * (alpha * alpha - 1.0) + 1.0;
            let density = alpha * alpha / (std::f64::consts::PI * spread * spread);
            let (view_z, light_z) = (f64::from(view.z), f64::from(light.z));
            let fresnel = 0.9 + 0.1 * (1.0 - view.as_dvec3().dot(half)).powi(5);
            let (there, back) = (lambda(alpha, view_z), lambda(alpha, light_z));
            let expected = fresnel * density / (1.0 + there + back) / (4.0 * view_z);
            let expected_pdf = density / (1.0 + there) / (4.0 * view_z);
            let close = |found: f32, expected: f64| (f64::from(found) / expected - 1.0).abs() < 2e-3;
            assert!(close(value.y, expected), "{roughness} {cosine}: {} vs {expected}", value.y);
            assert!(close(pdf, expected_pdf), "{roughness} {cosine}: {pdf} vs {expected_pdf}");
        }
    }
}
