//! Rays in packets of 8 and 16 through a native Embree scene: `rtcIntersect8/16` and `rtcOccluded8/16`.
//!
//! Embree wants a packet as one array a component. Rays are turned into that on the stack and hits turned
//! back, with no memory taken. The coherent flag chooses traversal of the whole packet along one common
//! way: on camera rays and first shadow rays it doubles the speed and more, on scattered rays it halves it.
//! Without it Embree follows each ray on its own once they part.

use std::{ffi::c_int, ptr};

use super::ffi::{self, ActiveRays, HitPacket, RayHitPacket, RayPacket};
use crate::geometry::{Hit, Ray};

impl<const N: usize> RayPacket<N> {
    /// A packet whose rays are all still to be filled in.
    const BLANK: Self = Self {
        origin: [[0.0; N]; 3],
        t_near: [0.0; N],
        direction: [[0.0; N]; 3],
        time: [0.0; N],
        t_far: [0.0; N],
        mask: [u32::MAX; N],
        id: [0; N],
        flags: [0; N],
    };

    /// Takes in up to `N` rays and says which to trace: not the invalid ones. Idle places keep finite rays,
    /// since a coherent packet's common bounds could read them.
    #[inline(always)]
    fn fill(&mut self, rays: &[Ray]) -> ActiveRays<N> {
        let mut mask = ActiveRays([0; N]);
        for (lane, ray) in rays.iter().enumerate().take(N) {
            if ray.is_valid() {
                for axis in 0..3 {
                    self.origin[axis][lane] = ray.origin[axis];
                    self.direction[axis][lane] = ray.direction[axis];
                }
                self.t_near[lane] = ray.t_min;
                self.t_far[lane] = ray.t_max;
                mask.0[lane] = -1;
            }
        }
        mask
    }
}

impl<const N: usize> HitPacket<N> {
    /// No hit anywhere.
    const BLANK: Self = Self {
        normal: [[0.0; N]; 3],
        u: [0.0; N],
        v: [0.0; N],
        primitive: [ffi::INVALID_GEOMETRY; N],
        geometry: [ffi::INVALID_GEOMETRY; N],
        instance: [ffi::INVALID_GEOMETRY; N],
        instance_primitive: [ffi::INVALID_GEOMETRY; N],
    };
}

/// The nearest hit of each ray, `N` rays at a time; `hits` is as long as `rays`. A ray from so far away that
/// Embree's numbers overflow can come back with weights that are none: it has missed.
///
/// # Safety
/// The scene is committed and lives through the call. The scenes of its instances have kernels for packets.
pub(super) unsafe fn closest<const N: usize>(
    scene: ffi::RTCScene,
    coherent: bool,
    rays: &[Ray],
    hits: &mut [Option<Hit>],
) {
    let mut arguments = intersect_arguments(coherent);
    let mut query = RayHitPacket::<N> { ray: RayPacket::BLANK, hit: HitPacket::BLANK };
    for (rays, hits) in rays.chunks(N).zip(hits.chunks_mut(N)) {
        let mask = query.ray.fill(rays);
        query.hit.geometry = [ffi::INVALID_GEOMETRY; N];
        // SAFETY: the caller vouches for the scene.
        unsafe { intersect(scene, &mask, &mut query, &mut arguments) };
        for (lane, hit) in hits.iter_mut().enumerate() {
            let (u, v) = (query.hit.u[lane], query.hit.v[lane]);
            let met = query.hit.geometry[lane] != ffi::INVALID_GEOMETRY && (u + v).is_finite();
            let (t, triangle) = (query.ray.t_far[lane], query.hit.primitive[lane]);
            *hit = met.then_some(Hit { t, u, v, triangle, instance: query.hit.instance[lane] });
        }
    }
}

/// Whether anything lies inside each segment, `N` rays at a time; `occluded` is as long as `rays`.
///
/// # Safety
/// The scene is committed and lives through the call. The scenes of its instances have kernels for packets.
pub(super) unsafe fn occluded<const N: usize>(
    scene: ffi::RTCScene,
    coherent: bool,
    rays: &[Ray],
    occluded: &mut [bool],
) {
    let mut arguments = occluded_arguments(coherent);
    let mut query = RayPacket::<N>::BLANK;
    for (rays, occluded) in rays.chunks(N).zip(occluded.chunks_mut(N)) {
        let mask = query.fill(rays);
        // SAFETY: the caller vouches for the scene.
        unsafe { occlude(scene, &mask, &mut query, &mut arguments) };
        for (lane, occluded) in occluded.iter_mut().enumerate() {
            // Embree answers with minus infinity.
            *occluded = mask.0[lane] != 0 && query.t_far[lane] == f32::NEG_INFINITY;
        }
    }
}

fn flags(coherent: bool) -> ffi::RTCRayQueryFlags {
    if coherent { ffi::RTCRayQueryFlags::COHERENT } else { ffi::RTCRayQueryFlags::INCOHERENT }
}

/// The result of `rtcInitIntersectArguments`, which is inline in C, with the flag set.
fn intersect_arguments(coherent: bool) -> ffi::RTCIntersectArguments {
    ffi::RTCIntersectArguments {
        flags: flags(coherent),
        feature_mask: ffi::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
        context: ptr::null_mut(),
        filter: None,
        intersect: None,
    }
}

/// The result of `rtcInitOccludedArguments`, which is inline in C, with the flag set.
fn occluded_arguments(coherent: bool) -> ffi::RTCOccludedArguments {
    ffi::RTCOccludedArguments {
        flags: flags(coherent),
        feature_mask: ffi::RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
        context: ptr::null_mut(),
        filter: None,
        occluded: None,
    }
}

/// A function for packets of 8 or 16 rays by the library's two of that kind.
macro_rules! by_width {
    ($name:ident, $packet:ident, $arguments:ident, $eight:ident, $sixteen:ident) => {
        #[doc = concat!("`", stringify!($eight), "` or `", stringify!($sixteen), "`.")]
        ///
        /// # Safety
        /// The scene is committed.
        #[inline(always)]
        unsafe fn $name<const N: usize>(
            scene: ffi::RTCScene,
            mask: &ActiveRays<N>,
            query: &mut $packet<N>,
            arguments: &mut ffi::$arguments,
        ) {
            const { assert!(N == 8 || N == 16, "Embree's packets have 8 or 16 rays") };
            let (valid, query): (*const c_int, *mut $packet<N>) = (mask.0.as_ptr(), query);
            // SAFETY: mask and query are laid out and aligned for this width, at least as large as the
            // library's structures (see `ffi`); the caller vouches for the scene.
            unsafe {
                match N {
                    8 => ffi::$eight(valid, scene, query.cast(), arguments),
                    _ => ffi::$sixteen(valid, scene, query.cast(), arguments),
                }
            }
        }
    };
}

by_width!(intersect, RayHitPacket, RTCIntersectArguments, rtcIntersect8, rtcIntersect16);
by_width!(occlude, RayPacket, RTCOccludedArguments, rtcOccluded8, rtcOccluded16);

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::embree::native::tests::{CANARY, Guarded, ray, triangle};

    /// Traces one packet in which every second place is idle, with known words right behind the structures.
    fn check<const N: usize>(coherent: bool) {
        let native = triangle();
        let aside = Ray { origin: Vec3::new(2.0, 2.0, 1.0), ..ray() };
        let mut closest = Guarded {
            query: RayHitPacket::<N> { ray: RayPacket::BLANK, hit: HitPacket::BLANK },
            canary: CANARY,
        };
        closest.query.hit.primitive = [7; N];
        closest.query.ray.fill(&[ray(); N]);
        closest.query.ray.fill(&[ray(), ray(), aside]);
        let mut any = Guarded { query: closest.query.ray, canary: CANARY };
        let mask = ActiveRays(std::array::from_fn(|lane| if lane % 2 == 0 { -1 } else { 0 }));
        // SAFETY: the scene is committed.
        unsafe {
            intersect(native.scene.0, &mask, &mut closest.query, &mut intersect_arguments(coherent));
            occlude(native.scene.0, &mask, &mut any.query, &mut occluded_arguments(coherent));
        }
        assert_eq!(closest.canary, CANARY);
        assert_eq!(any.canary, CANARY);
        for lane in 0..N {
            let hit = lane % 2 == 0 && lane != 2;
            assert_eq!(closest.query.hit.geometry[lane], if hit { 0 } else { ffi::INVALID_GEOMETRY });
            assert_eq!(closest.query.hit.primitive[lane], if hit { 0 } else { 7 }, "idle places stay");
            assert_eq!(any.query.t_far[lane] == f32::NEG_INFINITY, hit);
        }
    }

    #[test]
    fn the_library_keeps_within_our_structures_and_leaves_idle_places_alone() {
        for coherent in [false, true] {
            check::<8>(coherent);
            check::<16>(coherent);
        }
    }

    #[test]
    fn places_left_over_and_broken_rays_are_idle() {
        let mut packet = RayPacket::<8>::BLANK;
        let broken = Ray { direction: Vec3::NAN, ..ray() };
        let mask = packet.fill(&[ray(), broken, ray()]);
        assert_eq!(mask.0, [-1, 0, -1, 0, 0, 0, 0, 0]);
        assert!(packet.direction.as_flattened().iter().all(|component| component.is_finite()));
    }
}
