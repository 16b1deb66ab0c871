//! Lights without size: one is chosen by its unshadowed light.
//!
//! Few lights are all weighed, and chosen by sixteenths, which random numbers fill evenly: the choice adds no
//! noise. Of many lights, a few candidates are drawn by power and one is taken by its light, as in
//! [`lights`](super::lights).

use std::sync::Arc;

use glam::Vec3;

use super::lamp::LightSample;
use super::sampling::{AliasTable, luminance};
use crate::scene::{Arrival, Punctual, Scene};

/// Most lights that are all looked at, and how many candidates are drawn of more.
const CANDIDATES: usize = 8;
/// Parts of the probability that few lights share. At least twice as many as lights.
const SHARES: u32 = 16;
/// The density of a direction without width: so high that any other weight vanishes; a power of two.
const NO_WIDTH: f32 = (1_u64 << 40) as f32;

/// The lights without size of a scene, ready to be sampled.
#[derive(Clone, Debug)]
pub(super) struct PunctualLights {
    lights: Arc<[Punctual]>,
    /// For more lights than [`CANDIDATES`]: draws by power, and the probability of each light.
    table: Option<(AliasTable, Arc<[f32]>)>,
}

impl PunctualLights {
    /// The lights of a scene: O(lights). `None` without any.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let lights: Arc<[Punctual]> = scene.lights.clone().into();
        if lights.len() <= CANDIDATES {
            return (!lights.is_empty()).then_some(Self { lights, table: None });
        }
        // The light of a point at the other end of the scene, so that both kinds can be compared.
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

    /// Chooses a light by two numbers in [0, 1), asked with probability `share`. `None` where none reaches.
    pub(super) fn sample(
        &self,
        position: Vec3,
        normal: Vec3,
        [choice, pick]: [f32; 2],
        share: f32,
    ) -> Option<LightSample> {
        let (Arrival { direction, distance, irradiance }, scale) = match &self.table {
            None => self.one_of_few(position, normal, choice)?,
            Some((table, shares)) => self.one_of_many(position, normal, [choice, pick], table, shares)?,
        };
        let radiance = irradiance * scale * NO_WIDTH;
        let light = LightSample { direction, distance, radiance, pdf: share * NO_WIDTH };
        light.is_sound().then_some(light)
    }

    /// The arrival of the chosen light, and one over the probability that it was chosen.
    fn one_of_few(&self, position: Vec3, normal: Vec3, choice: f32) -> Option<(Arrival, f32)> {
        let arrivals = self.lights.iter().map(|light| light.arrival(position));
        let mut worths = [0.0; CANDIDATES];
        for (worth, arrival) in worths.iter_mut().zip(arrivals) {
            *worth = worth_of(&arrival, normal);
        }
        let sum: f32 = worths.iter().sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return None;
        }
        // One that brings anything has a share, and the brightest has what that leaves: at least one.
        let part = |worth: f32| if worth > 0.0 { ((worth / sum * SHARES as f32) as u32).max(1) } else { 0 };
        let mut parts = worths.map(part);
        let brightest =
            (1..CANDIDATES).fold(0, |best, number| if worths[number] > worths[best] { number } else { best });
        let others = parts.iter().sum::<u32>() - parts[brightest];
        parts[brightest] = SHARES - others;
        let mut slot = (choice * SHARES as f32) as u32;
        let number = parts.iter().position(|&part| {
            let here = slot < part;
            slot = slot.saturating_sub(part);
            here
        })?;
        Some((self.lights[number].arrival(position), SHARES as f32 / parts[number] as f32))
    }

    /// The arrival of one of a few candidates drawn by power; the second number weighs it.
    fn one_of_many(
        &self,
        position: Vec3,
        normal: Vec3,
        [choice, pick]: [f32; 2],
        table: &AliasTable,
        shares: &[f32],
    ) -> Option<(Arrival, f32)> {
        let (mut rest, mut sum, mut taken) = (choice, 0.0, None);
        for candidate in 0..CANDIDATES {
            let moved = pick + candidate as f32 / CANDIDATES as f32;
            let number = table.sample(if moved >= 1.0 { moved - 1.0 } else { moved });
            let arrival = self.lights[number].arrival(position);
            let worth = worth_of(&arrival, normal);
            let weight = worth / shares[number];
            sum += weight;
            let probability = if sum > 0.0 { weight / sum } else { 0.0 };
            if rest < probability {
                taken = Some((arrival, worth));
                rest /= probability;
            } else {
                rest = (rest - probability) / (1.0 - probability);
            }
        }
        let (arrival, worth) = taken?;
        Some((arrival, sum / (worth * CANDIDATES as f32)))
    }
}

/// The light that a surface gets if nothing is in between. All colours count alike, so that none is noisier.
fn worth_of(arrival: &Arrival, normal: Vec3) -> f32 {
    arrival.irradiance.element_sum() * arrival.direction.dot(normal).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::tests::{quad, scene};
    use crate::scene::{Material, Sky};
    use crate::{integrator::random::PathRandom, integrator::vertex::weight_over_density};

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
    fn sixteen_samples_look_at_few_lights_as_often_as_they_should() {
        let lights = [
            Punctual::towards(Vec3::Y, Vec3::X),
            Punctual::towards(Vec3::new(0.0, 1.0, 1.0), Vec3::Y),
            Punctual::towards(Vec3::new(1.0, 1.0, 0.0), Vec3::splat(1e-4)),
            Punctual::towards(Vec3::NEG_Y, Vec3::Z),
        ];
        for count in 1..=lights.len() {
            let all = PunctualLights { lights: lights[..count].into(), table: None };
            for pixel in 0..20 {
                let draws = (0..16).filter_map(|sample| {
                    let numbers = PathRandom::new(5, pixel, sample).pair(3);
                    all.sample(Vec3::ZERO, Vec3::Y, numbers, 1.0)
                });
                let light = |sample: LightSample| sample.radiance / sample.pdf * sample.direction.y;
                let drawn: Vec3 = draws.map(light).sum::<Vec3>() / 16.0;
                let arrivals = lights[..count].iter().map(|light| light.arrival(Vec3::ZERO));
                let expected: Vec3 =
                    arrivals.map(|arrival| arrival.irradiance * arrival.direction.y.max(0.0)).sum();
                assert!((drawn - expected).length() < 1e-5, "{count} lights: {drawn} and {expected}");
            }
        }
    }

    /// For all sets of lights, the brightest keeps a share.
    #[test]
    fn shares_add_up() {
        for bright in 1..=CANDIDATES {
            for dim in [0.0, 1e-6, 0.01, 0.3] {
                let light = |number: usize| {
                    let strength = if number < bright { 1.0 + 1e-3 * number as f32 } else { dim };
                    Punctual::towards(Vec3::Y, Vec3::splat(strength))
                };
                let all = PunctualLights { lights: (0..CANDIDATES).map(light).collect(), table: None };
                let chosen = |slot: u32| {
                    let choice = (slot as f32 + 0.5) / SHARES as f32;
                    all.one_of_few(Vec3::ZERO, Vec3::Y, choice).expect("there is light")
                };
                let sum: f32 = (0..SHARES).map(chosen).map(|(light, scale)| light.irradiance.x * scale).sum();
                let expected: f32 = all.lights.iter().map(|light| light.strength().x).sum();
                assert!((sum / SHARES as f32 / expected - 1.0).abs() < 1e-5, "{bright} {dim}");
            }
        }
    }

    #[test]
    fn no_other_technique_shares_their_light() {
        for pdf in [0.0, 1.0, 1e5] {
            assert_eq!(weight_over_density(NO_WIDTH * 0.5, pdf), 2.0 / NO_WIDTH);
        }
    }
}
