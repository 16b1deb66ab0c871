//! Lights without size: one is chosen by how much of it reaches the surface if nothing is in between.
//!
//! Few are all looked at. Of many, a few candidates are drawn by power and one of them is taken by what it would bring
//! (resampled importance sampling, as for emissive triangles in [`lights`](super::lights)).

use std::sync::Arc;

use glam::Vec3;

use super::light_sample::LightSample;
use super::sampling::{AliasTable, luminance};
use crate::scene::{Arrival, Punctual, Scene};

/// Most lights that are all looked at, and how many candidates are drawn of more.
const CANDIDATES: usize = 8;

/// The density of a direction without width: so high that the weight of any other technique rounds to nothing. A power
/// of two, which costs no digits when it cancels.
const NO_WIDTH: f32 = (1_u64 << 40) as f32;

/// The lights without size of a scene, ready to be sampled.
#[derive(Clone, Debug)]
pub(super) struct PunctualLights {
    lights: Arc<[Punctual]>,
    /// For more lights than [`CANDIDATES`]: draws by power, and the probability of each light.
    table: Option<(AliasTable, Arc<[f32]>)>,
}

impl PunctualLights {
    /// Those of a scene: O(lights). `None` without any.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let lights: Arc<[Punctual]> = scene.lights.clone().into();
        if lights.len() <= CANDIDATES {
            return (!lights.is_empty()).then_some(Self { lights, table: None });
        }
        // What comes of a point at the other end of the scene, so that both kinds can be compared.
        let far = f64::from(scene.bounds().diagonal()).max(1e-9);
        let mut powers: Vec<f64> = lights
            .iter()
            .map(|light| match light {
                Punctual::Directional { irradiance, .. } => f64::from(luminance(*irradiance)),
                Punctual::Point { intensity, .. } => f64::from(luminance(*intensity)) / (far * far),
            })
            .collect();
        // Half by power, half evenly: a weak light may stand where it is the only one.
        let total: f64 = powers.iter().sum();
        powers.iter_mut().for_each(|power| *power += total / lights.len() as f64);
        let table = AliasTable::new(&powers)?;
        let shares = powers.iter().map(|power| (power / (2.0 * total)) as f32).collect();
        Some(Self { lights, table: Some((table, shares)) })
    }

    /// Chooses a light for a surface, by two numbers in [0, 1). `None` where none of the candidates reaches it. `share` is
    /// the probability that lights without size are asked at all.
    pub(super) fn sample(
        &self,
        position: Vec3,
        normal: Vec3,
        [choice, pick]: [f32; 2],
        share: f32,
    ) -> Option<LightSample> {
        let count = self.lights.len().min(CANDIDATES);
        let (mut rest, mut sum, mut taken) = (choice, 0.0, None);
        for candidate in 0..count {
            let (number, drawn) = match &self.table {
                None => (candidate, 1.0 / count as f32),
                Some((table, shares)) => {
                    let moved = pick + candidate as f32 / count as f32;
                    let number = table.sample(if moved >= 1.0 { moved - 1.0 } else { moved });
                    (number, shares[number])
                }
            };
            let arrival = self.lights[number].arrival(position);
            let worth = luminance(arrival.irradiance) * arrival.direction.dot(normal).max(0.0);
            let weight = worth / drawn;
            sum += weight;
            let probability = if sum > 0.0 { weight / sum } else { 0.0 };
            if rest < probability {
                taken = Some((arrival, worth));
                rest /= probability;
            } else {
                rest = (rest - probability) / (1.0 - probability);
            }
        }
        let (Arrival { direction, distance, irradiance }, worth) = taken?;
        let scale = sum / (worth * count as f32);
        let light = LightSample {
            direction,
            distance,
            radiance: irradiance * scale * NO_WIDTH,
            pdf: share * NO_WIDTH,
        };
        light.is_sound().then_some(light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::random::PathRandom;
    use crate::integrator::tests::{quad, scene};
    use crate::integrator::vertex::weight_over_density;
    use crate::scene::{Material, Sky};

    #[test]
    fn few_and_many_lights_bring_what_all_of_them_bring() {
        let light = |number: usize| {
            let (sin, cos) = (number as f32).sin_cos();
            let place = Vec3::new(3.0 * sin, 1.0 + (number % 5) as f32, 3.0 * cos);
            if number % 7 == 3 {
                Punctual::towards(place, Vec3::splat(0.02))
            } else {
                Punctual::point(place, Vec3::new(0.1, 0.2, 0.3) * (1 + number % 3) as f32)
            }
        };
        for count in [1, 5, 8, 40] {
            let all: Vec<Punctual> = (0..count).map(light).collect();
            let ground = quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0);
            let mut scene = (*scene(&[(ground, Material::default())], Sky::BLACK)).clone();
            scene.lights = all.clone();
            let lights = PunctualLights::of(&scene).expect("there are some");
            let random = PathRandom::new(7, 0, 0);
            let draws = 60_000;
            let drawn: f32 = (0..draws)
                .filter_map(|place| lights.sample(Vec3::ZERO, Vec3::Y, random.pair(place), 0.5))
                .map(|light| light.radiance.y / light.pdf * light.direction.y)
                .sum();
            let expected: f32 = all
                .iter()
                .map(|light| light.arrival(Vec3::ZERO))
                .map(|arrival| arrival.irradiance.y * arrival.direction.y.max(0.0))
                .sum();
            // They are asked in all cases here, so each brings twice its light.
            let ratio = drawn / draws as f32 / (2.0 * expected);
            assert!((ratio - 1.0).abs() < 0.02, "{count}: {ratio}");
        }
    }

    #[test]
    fn no_other_technique_shares_their_light() {
        for pdf in [0.0, 1.0, 1e5] {
            assert_eq!(weight_over_density(NO_WIDTH * 0.5, pdf), 2.0 / NO_WIDTH);
        }
    }
}
