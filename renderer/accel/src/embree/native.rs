//! A native Embree scene: the baseline of comparisons, and the only way to Embree's own compact trees.
//!
//! One triangle geometry shares our vertex and index arrays. Its geometry number is 0, so a hit's
//! primitive number is the triangle's number.

use std::{ptr, sync::Arc};

use super::{device::Device, ffi, filter::set_masks, packets};
use crate::error::{BuildError, EmbreeFailure};
use crate::geometry::{Hit, Intersector, Packets, Ray, Triangles};
use crate::parameters::{NativeOptions, NativeQuality, Update};
use crate::rays::one_by_one;

/// A committed Embree scene over shared triangles.
#[derive(Debug)]
pub struct NativeScene {
    pub(super) scene: SceneHandle,
    bytes: usize,
    options: NativeOptions,
    refits: bool,
    /// The scene reads these vertices and lives on this device: both must outlive it.
    triangles: Arc<Triangles>,
    /// The scene reads these indices, even where new triangles bring an equal copy.
    _indexed: Arc<Triangles>,
    device: Device,
}

/// Releases the scene on every way out, also that of a failed build.
#[derive(Debug)]
pub(super) struct SceneHandle(pub(super) ffi::RTCScene);

// SAFETY: a committed scene is read-only, and Embree allows queries and release from any thread.
unsafe impl Send for SceneHandle {}
// SAFETY: as above.
unsafe impl Sync for SceneHandle {}

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and valid.
        unsafe { ffi::rtcReleaseScene(self.0) };
    }
}

impl NativeScene {
    /// Builds a scene with `rtcCommitScene` on a device that suits the options.
    pub(crate) fn build(
        device: &Device,
        triangles: &Arc<Triangles>,
        options: &NativeOptions,
    ) -> Result<Self, BuildError> {
        Self::build_as(device, triangles, options, false)
    }

    /// As [`NativeScene::build`]; for refits, of the kind whose geometries keep trees of their own.
    fn build_as(
        device: &Device,
        triangles: &Arc<Triangles>,
        options: &NativeOptions,
        refits: bool,
    ) -> Result<Self, BuildError> {
        let before = device.bytes_held();
        let scene = new_scene(device, options)?;
        if refits {
            // SAFETY: the scene is valid and not committed yet. Embree refits nothing but in scenes of two
            // levels, which are those of low quality; the quality of the tree below is the geometry's.
            unsafe { ffi::rtcSetSceneBuildQuality(scene.0, ffi::RTCBuildQuality::LOW) };
        }
        if !triangles.is_empty() {
            attach(device, &scene, triangles, options, refits)?;
        }
        let scene = commit(device, scene, triangles, options, before)?;
        Ok(Self { refits, ..scene })
    }

    /// Follows moved triangles by a refit: the first one builds a scene that later ones refit.
    pub(crate) fn update(&mut self, triangles: &Arc<Triangles>, update: Update) -> Result<(), BuildError> {
        BuildError::same_count(self.triangles.len(), triangles.len())?;
        update.check()?;
        let device = self.device.clone();
        let options = self.options;
        if update == Update::Rebuild || triangles.is_empty() {
            *self = Self::build(&device, triangles, &options)?;
        } else if !self.refits || !self.triangles.same_indices(triangles) {
            *self = Self::build_as(&device, triangles, &options, true)?;
        } else {
            // SAFETY: the scene is valid and has the one geometry that `attach` gave it, under number 0. The
            // old vertices live until the scene is committed with the new ones, and these with the scene,
            // which is also as long as masks are asked.
            unsafe {
                let geometry = ffi::rtcGetGeometry(self.scene.0, 0);
                set_positions(geometry, triangles);
                set_masks(geometry, Arc::as_ptr(triangles));
                ffi::rtcCommitGeometry(geometry);
                ffi::rtcCommitScene(self.scene.0);
            }
            let outcome = device.check().map_err(BuildError::from);
            let before = std::mem::replace(&mut self.triangles, Arc::clone(triangles));
            if let Err(error) = outcome {
                // Embree may still read the old vertices: they are leaked rather than taken from under it.
                std::mem::forget(before);
                return Err(error);
            }
        }
        Ok(())
    }

    /// Whether there is nothing to follow: its triangles rest, and a rebuild would change nothing.
    pub(super) fn rests(&self, triangles: &Triangles, update: Update) -> bool {
        (update != Update::Rebuild || !self.refits) && self.triangles.rest_as(triangles)
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    pub(super) fn device(&self) -> &Device {
        &self.device
    }

    /// Bytes Embree took during the build, with those of other builds on this device at that time.
    pub fn bytes(&self) -> usize {
        self.bytes
    }
}

pub(super) fn new_scene(device: &Device, options: &NativeOptions) -> Result<SceneHandle, BuildError> {
    // SAFETY: the device is valid.
    let scene = SceneHandle(unsafe { ffi::rtcNewScene(device.handle()) });
    if scene.0.is_null() {
        return Err(failure(device));
    }
    let mut flags = ffi::RTCSceneFlags::NONE;
    for (wanted, flag) in [
        (options.compact, ffi::RTCSceneFlags::COMPACT),
        (options.dynamic, ffi::RTCSceneFlags::DYNAMIC),
        (options.robust, ffi::RTCSceneFlags::ROBUST),
    ] {
        if wanted {
            flags |= flag;
        }
    }
    let quality = match options.quality {
        NativeQuality::Low => ffi::RTCBuildQuality::LOW,
        NativeQuality::Medium => ffi::RTCBuildQuality::MEDIUM,
        NativeQuality::High => ffi::RTCBuildQuality::HIGH,
    };
    // SAFETY: the scene is valid and not committed yet.
    unsafe {
        ffi::rtcSetSceneFlags(scene.0, flags);
        ffi::rtcSetSceneBuildQuality(scene.0, quality);
    }
    Ok(scene)
}

/// Commits a scene; `before` is what Embree held when its build began.
pub(super) fn commit(
    device: &Device,
    scene: SceneHandle,
    triangles: &Arc<Triangles>,
    options: &NativeOptions,
    before: usize,
) -> Result<NativeScene, BuildError> {
    // SAFETY: the scene is valid; the shared arrays are alive.
    unsafe { ffi::rtcCommitScene(scene.0) };
    device.check().map_err(BuildError::from)?;
    let bytes = device.bytes_held().saturating_sub(before);
    let (triangles, _indexed, device) = (Arc::clone(triangles), Arc::clone(triangles), device.clone());
    Ok(NativeScene { scene, bytes, options: *options, refits: false, triangles, _indexed, device })
}

pub(super) fn failure(device: &Device) -> BuildError {
    let failure = device
        .check()
        .err()
        .unwrap_or(EmbreeFailure { code: ffi::ERROR_UNKNOWN, message: "no reason given".into() });
    BuildError::from(failure)
}

fn attach(
    device: &Device,
    scene: &SceneHandle,
    triangles: &Arc<Triangles>,
    options: &NativeOptions,
    refits: bool,
) -> Result<(), BuildError> {
    // SAFETY: the device is valid.
    let geometry = unsafe { ffi::rtcNewGeometry(device.handle(), ffi::RTCGeometryType::TRIANGLE) };
    if geometry.is_null() {
        return Err(failure(device));
    }
    let indices = triangles.indices();
    // SAFETY: the arrays and the triangles themselves do not move while the scene's `Arc` holds them; indices
    // are in range by the invariant of `Triangles`. Attaching retains the geometry, so our own reference is
    // released at once.
    unsafe {
        if refits {
            ffi::rtcSetGeometryBuildQuality(geometry, ffi::RTCBuildQuality::REFIT);
        } else if options.effective_quality() == NativeQuality::Low {
            // A scene of low quality builds a tree over trees of its geometries, each of its own quality.
            ffi::rtcSetGeometryBuildQuality(geometry, ffi::RTCBuildQuality::LOW);
        }
        set_positions(geometry, triangles);
        ffi::rtcSetSharedGeometryBuffer(
            geometry,
            ffi::RTCBufferType::INDEX,
            0,
            ffi::RTCFormat::UINT3,
            indices.as_ptr().cast(),
            0,
            12,
            indices.len(),
        );
        set_masks(geometry, Arc::as_ptr(triangles));
        ffi::rtcCommitGeometry(geometry);
        ffi::rtcAttachGeometryByID(scene.0, geometry, 0);
        ffi::rtcReleaseGeometry(geometry);
    }
    device.check().map_err(BuildError::from)
}

/// Shares the vertices with a geometry.
///
/// # Safety
/// The geometry is valid, and the vertices outlive its use of them.
unsafe fn set_positions(geometry: ffi::RTCGeometry, triangles: &Triangles) {
    let positions = triangles.positions();
    // SAFETY: positions are 16 bytes apart and long, as Embree reads them; the caller vouches for the rest.
    unsafe {
        ffi::rtcSetSharedGeometryBuffer(
            geometry,
            ffi::RTCBufferType::VERTEX,
            0,
            ffi::RTCFormat::FLOAT3,
            positions.as_ptr().cast(),
            0,
            16,
            positions.len(),
        );
    }
}

fn to_embree(ray: &Ray) -> ffi::RtcRay {
    ffi::RtcRay {
        origin: ray.origin.to_array(),
        t_near: ray.t_min,
        direction: ray.direction.to_array(),
        time: 0.0,
        t_far: ray.t_max,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

impl Intersector for NativeScene {
    #[inline]
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let mut query = ffi::RayHit { ray: to_embree(ray), hit: ffi::RtcHit::NONE };
        // SAFETY: the scene is committed; our structure is large enough (see `ffi`); null means the defaults.
        unsafe { ffi::rtcIntersect1(self.scene.0, (&raw mut query).cast(), ptr::null_mut()) };
        let hit = &query.hit;
        (hit.geometry != ffi::INVALID_GEOMETRY).then_some(Hit {
            t: query.ray.t_far,
            u: hit.u,
            v: hit.v,
            triangle: hit.primitive,
            // Without instances Embree leaves its own mark here, which is ours as well.
            instance: hit.instance,
        })
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        if !ray.is_valid() {
            return false;
        }
        let mut query = to_embree(ray);
        // SAFETY: as above.
        unsafe { ffi::rtcOccluded1(self.scene.0, (&raw mut query).cast(), ptr::null_mut()) };
        // Embree answers with minus infinity.
        query.t_far < 0.0
    }

    fn closest_each(&self, packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        // SAFETY: the scene is committed, and what Embree chooses below it has kernels for packets.
        unsafe {
            match packets {
                Packets::Single | Packets::Four => one_by_one(rays, hits, |ray| self.closest(ray)),
                Packets::Eight => packets::closest::<8>(self.scene.0, false, rays, hits),
                Packets::EightCoherent => packets::closest::<8>(self.scene.0, true, rays, hits),
                Packets::Sixteen => packets::closest::<16>(self.scene.0, false, rays, hits),
                Packets::SixteenCoherent => packets::closest::<16>(self.scene.0, true, rays, hits),
            }
        }
    }

    fn occluded_each(&self, packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer a ray");
        // SAFETY: as above.
        unsafe {
            match packets {
                Packets::Single | Packets::Four => one_by_one(rays, occluded, |ray| self.occluded(ray)),
                Packets::Eight => packets::occluded::<8>(self.scene.0, false, rays, occluded),
                Packets::EightCoherent => packets::occluded::<8>(self.scene.0, true, rays, occluded),
                Packets::Sixteen => packets::occluded::<16>(self.scene.0, false, rays, occluded),
                Packets::SixteenCoherent => packets::occluded::<16>(self.scene.0, true, rays, occluded),
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use glam::{Vec3, Vec3A};

    use super::*;

    /// The words behind a guarded structure.
    pub(crate) const CANARY: [u64; 16] = [0x5afe_c0de_5afe_c0de; 16];

    /// A query structure with known words right behind it.
    #[repr(C)]
    pub(crate) struct Guarded<T> {
        pub(crate) query: T,
        pub(crate) canary: [u64; 16],
    }

    pub(crate) fn triangle() -> NativeScene {
        let device = Device::open(0).expect("Embree is set up");
        let corners = vec![Vec3A::ZERO, Vec3A::X, Vec3A::Y];
        let triangles = Arc::new(Triangles::new(corners, vec![[0, 1, 2]]).expect("valid"));
        NativeScene::build(&device, &triangles, &NativeOptions::default()).expect("builds")
    }

    pub(crate) fn ray() -> Ray {
        Ray { origin: Vec3::new(0.25, 0.25, 1.0), direction: Vec3::NEG_Z, t_min: 0.0, t_max: f32::INFINITY }
    }

    #[test]
    fn the_library_does_not_write_past_our_structures() {
        let native = triangle();
        let mut closest =
            Guarded { query: ffi::RayHit { ray: to_embree(&ray()), hit: ffi::RtcHit::NONE }, canary: CANARY };
        let mut any = Guarded { query: to_embree(&ray()), canary: CANARY };
        // SAFETY: as in the queries above.
        unsafe {
            ffi::rtcIntersect1(native.scene.0, (&raw mut closest.query).cast(), ptr::null_mut());
            ffi::rtcOccluded1(native.scene.0, (&raw mut any.query).cast(), ptr::null_mut());
        }
        assert_eq!(closest.query.hit.geometry, 0, "the ray must hit, for only then is the hit written");
        assert_eq!(closest.query.hit.primitive, 0);
        assert!(any.query.t_far < 0.0);
        assert_eq!(closest.canary, CANARY);
        assert_eq!(any.canary, CANARY);
    }

    #[test]
    fn a_hit_carries_distance_and_weights() {
        let hit = triangle().closest(&ray()).expect("hits");
        assert_eq!(hit.triangle, 0);
        // Embree divides by way of an approximate reciprocal, whose last bit differs between processors.
        for (found, exact) in [(hit.t, 1.0), (hit.u, 0.25), (hit.v, 0.25)] {
            assert!((found - exact).abs() <= 4.0 * f32::EPSILON * exact, "{found} in place of {exact}");
        }
    }
}
