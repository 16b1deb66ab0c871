//! Records the rays of a frame: an [`Intersector`] in front of another one that writes down its queries.
//!
//! The rays are those of a real frame, path by path on one thread, in the order of pixels. The class of a ray
//! follows from the order of a path's queries: its first ray starts at the camera's eye, further ones are
//! bounces, and shadow rays belong to the point before them. Rays that only ask for the sky count as shadow
//! rays; continuations behind a thin sheet are left out.

use std::sync::{Mutex, PoisonError};

use glam::Vec3;
use treewright_accel::recording::{RayClass, RaySet, Recording};
use treewright_accel::{Hit, Intersector, Ray, limits::RECORDED_RAYS_MAX};

use crate::integrator::{Prepared, View, render_sample};
use crate::{film::Film, render_options::RenderOptions};

/// Renders one sample a pixel; gives triangles and rays, [`RECORDED_RAYS_MAX`] a class, on one thread.
pub fn record<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    film: &mut Film,
) -> Recording {
    let sets = RayClass::ALL.map(|class| RaySet { class, rays: Vec::new() });
    let log = Log { sets, depth: 0, last: Vec3::ZERO, last_shadow: Vec3::ZERO };
    let recorder = Recorder { intersector, eye: view.camera.position, log: Mutex::new(log) };
    // Path by path: the class of a query follows from its order.
    render_sample(prepared, &recorder, view, &RenderOptions::default(), prepared.needs, film, None);
    let log = recorder.log.into_inner().unwrap_or_else(PoisonError::into_inner);
    let sets = log.sets.into_iter().filter(|set| !set.rays.is_empty()).collect();
    Recording { triangles: prepared.scene.triangles.clone(), sets }
}

/// The queries so far, and the progress of the present path.
struct Log {
    /// In the order of [`RayClass::ALL`].
    sets: [RaySet; RayClass::ALL.len()],
    /// Surfaces the present path was scattered at.
    depth: u32,
    last: Vec3,
    last_shadow: Vec3,
}

impl Log {
    fn closest(&mut self, ray: &Ray, eye: Vec3) {
        let class = if ray.origin == eye {
            self.depth = 0;
            RayClass::Primary
        } else if ray.direction == self.last || ray.direction == self.last_shadow {
            return;
        } else {
            self.depth += 1;
            match self.depth {
                1 => RayClass::FirstBounce,
                2 => RayClass::SecondBounce,
                // Like the second: scattered all over.
                _ => return,
            }
        };
        self.last = ray.direction;
        self.push(class, ray);
    }

    fn occluded(&mut self, ray: &Ray) {
        self.last_shadow = ray.direction;
        self.push(if self.depth == 0 { RayClass::FirstShadow } else { RayClass::Shadow }, ray);
    }

    fn push(&mut self, class: RayClass, ray: &Ray) {
        let rays = &mut self.sets[class as usize].rays;
        if ray.is_valid() && rays.len() < RECORDED_RAYS_MAX {
            rays.push(*ray);
        }
    }
}

/// Passes every question on and writes it down.
struct Recorder<'a, I> {
    intersector: &'a I,
    eye: Vec3,
    log: Mutex<Log>,
}

impl<I: Intersector> Intersector for Recorder<'_, I> {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).closest(ray, self.eye);
        self.intersector.closest(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).occluded(ray);
        self.intersector.occluded(ray)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use treewright_accel::{BuildChoice, Device, NativeOptions, build};

    use super::*;
    use treewright_scene::builtin;

    #[test]
    fn a_frame_is_recorded_by_class() {
        let options = builtin::Options { detail: 0.1, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build("hall", &options).expect("it is built in"));
        let prepared = Prepared::new(scene.clone());
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 3 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
        let (mut film, mut plain) = (Film::new([24, 16]), Film::new([24, 16]));
        let choice = BuildChoice::Native(NativeOptions::default());
        let device = Device::open(0).expect("Embree is set up");
        let native = build(&device, &scene.triangles, &choice).expect("it builds");
        let recording = pool.install(|| record(&prepared, &native, &view, &mut film));
        let options = RenderOptions::default();
        let rendered =
            || render_sample(&prepared, &native, &view, &options, prepared.needs, &mut plain, None);
        let (counts, _) = pool.install(rendered);
        assert_eq!(film.picture(), plain.picture(), "being watched changes nothing");

        let count =
            |class| recording.sets.iter().find(|set| set.class == class).map_or(0, |set| set.rays.len());
        assert_eq!(count(RayClass::Primary), 24 * 16);
        assert!(count(RayClass::FirstBounce) > 0 && count(RayClass::FirstBounce) <= 24 * 16);
        assert!(count(RayClass::SecondBounce) <= count(RayClass::FirstBounce));
        let shadow = (count(RayClass::FirstShadow) + count(RayClass::Shadow)) as u64;
        // Beside them, at most one last look at the sky a path.
        assert!((counts.shadow_rays..=counts.shadow_rays + 24 * 16).contains(&shadow), "{shadow}");
        // Neighbours in the file are neighbours in the picture: the first 16 rays make one block.
        let primary = &recording.sets[0].rays;
        let cosine = |ray: &Ray| ray.direction.dot(primary[0].direction);
        let block = primary[..16].iter().map(cosine).fold(1.0, f32::min);
        let row = primary[16 * 5..16 * 6].iter().map(cosine).fold(1.0, f32::min);
        assert!(
            block > row,
            "the first 16 rays make a block, those of the last block of the row lie far off"
        );
    }
}
