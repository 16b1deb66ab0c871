//! The C interface of Embree 4.4, as far as we use it.
//!
//! Functions, handles and constants come from `embree4-sys`, whose headers are of 4.2. Two things there
//! do not fit a 4.4 library and are declared here instead:
//!
//! * **Structures that grew.** A 4.4 library built with instance arrays writes one more word per hit
//!   (`instPrimID`): its `RTCRayHit` has 96 bytes, the crate's 80. Passing the smaller one corrupts the
//!   stack. A 4.4 library built without them writes less, which the larger one bears as well.
//! * **Functions with Rust enums.** A value the enum lacks would be undefined behaviour, so these
//!   functions are declared again with plain integers.

use std::ffi::{c_char, c_int, c_uint, c_void};

pub(crate) use embree4_sys::{
    RTCBVH, RTCBounds, RTCBufferType, RTCBuildArguments, RTCBuildFlags, RTCBuildPrimitive, RTCBuildQuality,
    RTCCreateLeafFunction, RTCCreateNodeFunction, RTCDevice, RTCDeviceProperty, RTCFeatureFlags, RTCFormat,
    RTCGeometry, RTCGeometryType, RTCIntersectArguments, RTCOccludedArguments, RTCRayQueryFlags, RTCScene,
    RTCSceneFlags, RTCSetNodeBoundsFunction, RTCSetNodeChildrenFunction, RTCSplitPrimitiveFunction,
    RTCThreadLocalAllocator, rtcAttachGeometryByID, rtcBuildBVH, rtcCommitGeometry, rtcCommitScene,
    rtcGetDeviceProperty, rtcGetGeometry, rtcIntersect1, rtcIntersect8, rtcIntersect16, rtcNewBVH,
    rtcNewDevice, rtcNewGeometry, rtcNewScene, rtcOccluded1, rtcOccluded8, rtcOccluded16, rtcReleaseBVH,
    rtcReleaseDevice, rtcReleaseGeometry, rtcReleaseScene, rtcSetDeviceMemoryMonitorFunction,
    rtcSetGeometryBuildQuality, rtcSetGeometryInstancedScene, rtcSetGeometryTransform,
    rtcSetSceneBuildQuality, rtcSetSceneFlags, rtcSetSharedGeometryBuffer, rtcThreadLocalAlloc,
};

/// "No geometry was hit."
pub(crate) const INVALID_GEOMETRY: u32 = embree4_sys::RTC_INVALID_GEOMETRY_ID;

// A hit without an instance comes back with our own mark, and goes out as it is.
const _: () = assert!(INVALID_GEOMETRY == crate::rays::NO_INSTANCE);

/// `RTCRay` (`rtcore_ray.h`): equal in 4.2 and 4.4, declared again to stand beside [`RayHit`].
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct RtcRay {
    pub(crate) origin: [f32; 3],
    pub(crate) t_near: f32,
    pub(crate) direction: [f32; 3],
    pub(crate) time: f32,
    pub(crate) t_far: f32,
    pub(crate) mask: u32,
    pub(crate) id: u32,
    pub(crate) flags: u32,
}

/// `RTCHit` of a 4.4 library with instance arrays: one word more than in 4.2.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct RtcHit {
    pub(crate) normal: [f32; 3],
    pub(crate) u: f32,
    pub(crate) v: f32,
    pub(crate) primitive: u32,
    pub(crate) geometry: u32,
    pub(crate) instance: u32,
    pub(crate) instance_primitive: u32,
}

impl RtcHit {
    pub(crate) const NONE: Self = Self {
        normal: [0.0; 3],
        u: 0.0,
        v: 0.0,
        primitive: INVALID_GEOMETRY,
        geometry: INVALID_GEOMETRY,
        instance: INVALID_GEOMETRY,
        instance_primitive: INVALID_GEOMETRY,
    };
}

/// `RTCRayHit` of a 4.4 library with instance arrays.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayHit {
    pub(crate) ray: RtcRay,
    pub(crate) hit: RtcHit,
}

/// `RTCRay8` and `RTCRay16`: [`RtcRay`] field by field, `N` numbers each, as aligned as the wider one.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayPacket<const N: usize> {
    pub(crate) origin: [[f32; N]; 3],
    pub(crate) t_near: [f32; N],
    pub(crate) direction: [[f32; N]; 3],
    pub(crate) time: [f32; N],
    pub(crate) t_far: [f32; N],
    pub(crate) mask: [u32; N],
    pub(crate) id: [u32; N],
    pub(crate) flags: [u32; N],
}

/// `RTCHit8` and `RTCHit16` of a 4.4 library with instance arrays.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct HitPacket<const N: usize> {
    pub(crate) normal: [[f32; N]; 3],
    pub(crate) u: [f32; N],
    pub(crate) v: [f32; N],
    pub(crate) primitive: [u32; N],
    pub(crate) geometry: [u32; N],
    pub(crate) instance: [u32; N],
    pub(crate) instance_primitive: [u32; N],
}

/// `RTCRayHit8` and `RTCRayHit16` of a 4.4 library with instance arrays.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayHitPacket<const N: usize> {
    pub(crate) ray: RayPacket<N>,
    pub(crate) hit: HitPacket<N>,
}

/// Which rays of a packet take part, -1 or 0 each, aligned as the wider packet wants it.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct ActiveRays<const N: usize>(pub(crate) [i32; N]);

const _: () = {
    assert!(size_of::<RayPacket<8>>() == 384 && size_of::<RayPacket<16>>() == 768);
    assert!(size_of::<embree4_sys::RTCRay8>() == 384 && size_of::<embree4_sys::RTCRay16>() == 768);
    // The hits follow the rays at once. The C structure of eight is 672 bytes long (its alignment is 32).
    assert!(std::mem::offset_of!(RayHitPacket<8>, hit) == 384);
    assert!(std::mem::offset_of!(RayHitPacket<16>, hit) == 768);
    assert!(size_of::<HitPacket<8>>() == 288 && size_of::<HitPacket<16>>() == 576);
    assert!(size_of::<RayHitPacket<8>>() >= 672 && size_of::<RayHitPacket<16>>() == 1344);
    // Flags, feature mask, context and two callbacks, in both versions.
    assert!(size_of::<RTCIntersectArguments>() == 32 && size_of::<RTCOccludedArguments>() == 32);
};

const _: () = {
    assert!(size_of::<RtcRay>() == 48 && align_of::<RtcRay>() == 16);
    assert!(size_of::<embree4_sys::RTCRay>() == 48);
    // Nine words, rounded up to a multiple of 16 bytes.
    assert!(size_of::<RtcHit>() == 48);
    assert!(size_of::<RayHit>() == 96 && align_of::<RayHit>() == 16);
    assert!(std::mem::offset_of!(RayHit, hit) == 48);
    // Equal in both versions; the build arguments and primitives are handed over as the crate has them.
    assert!(size_of::<RTCBuildArguments>() == 136);
    assert!(size_of::<RTCBuildPrimitive>() == 32 && align_of::<RTCBuildPrimitive>() == 32);
    assert!(size_of::<RTCBounds>() == 32);
};

unsafe extern "C" {
    /// `rtcGetDeviceError` as an integer: the thread's error, cleared; null for a failed `rtcNewDevice`.
    #[link_name = "rtcGetDeviceError"]
    pub(crate) fn rtc_get_device_error(device: RTCDevice) -> c_uint;

    /// `rtcSetDeviceErrorFunction` with a plain integer as the callback's code.
    #[link_name = "rtcSetDeviceErrorFunction"]
    pub(crate) fn rtc_set_device_error_function(
        device: RTCDevice,
        callback: Option<unsafe extern "C" fn(user: *mut c_void, code: c_uint, text: *const c_char)>,
        user: *mut c_void,
    );

    #[link_name = "rtcSetGeometryUserData"]
    pub(crate) fn rtc_set_geometry_user_data(geometry: RTCGeometry, user: *mut c_void);

    /// `rtcSetGeometryIntersectFilterFunction`, with our structure of arguments.
    #[link_name = "rtcSetGeometryIntersectFilterFunction"]
    pub(crate) fn rtc_set_geometry_intersect_filter_function(geometry: RTCGeometry, filter: Filter);

    /// `rtcSetGeometryOccludedFilterFunction`, with our structure of arguments.
    #[link_name = "rtcSetGeometryOccludedFilterFunction"]
    pub(crate) fn rtc_set_geometry_occluded_filter_function(geometry: RTCGeometry, filter: Filter);
}

/// `RTCFilterFunctionN`.
pub(crate) type Filter = Option<unsafe extern "C" fn(*const FilterArguments)>;

/// `RTCFilterFunctionNArguments`: rays and hits are `count` numbers a field, as [`RtcRay`], [`RtcHit`].
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct FilterArguments {
    pub(crate) valid: *mut c_int,
    pub(crate) user: *mut c_void,
    pub(crate) context: *const c_void,
    pub(crate) ray: *mut c_void,
    pub(crate) hit: *mut c_void,
    pub(crate) count: c_uint,
}

pub(crate) const ERROR_NONE: u32 = 0;
/// `RTC_ERROR_UNKNOWN`: what a builder says that ran into its depth limit.
pub(crate) const ERROR_UNKNOWN: u32 = 1;
pub(crate) const ERROR_OUT_OF_MEMORY: u32 = 4;
