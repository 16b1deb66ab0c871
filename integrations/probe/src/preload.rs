//! A library that is preloaded into a program and stands in front of Embree's entry points. It counts and
//! times calls, hands each on unchanged, and writes its findings when a device is released and when the
//! program ends.
//!
//! It never ends its host, and changes a result only by the settings that it was given ([`settings`]). Calls
//! that cannot be found or timed are left out. A query costs a nanosecond or two more, and a thread of the
//! library samples the work of the others ([`counts`]). `TREEWRIGHT_PROBE` names the file, to which the
//! process's number is added, since programs start others.
//!
//! Embree 3 and 4 have these entry points with as many arguments of equal sizes; Mitsuba's own copy of Embree
//! 3 has them in its namespace, hence the long names.

mod counts;
mod findings;
mod real;
mod settings;

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};

use counts::{Kind, count, note_device, note_flags, note_quality, note_triangles, timed, weight};
use real::{Address, real};
use settings::SETTINGS;

/// A handle or pointer that is handed on.
type Handle = *mut c_void;

/// The address of the real entry point, looked up once, as a function of this type.
macro_rules! entry {
    ($name:expr, $type:ty) => {{
        static ADDRESS: Address = Address::new();
        real(&ADDRESS, $name).map(|found| entry!(@of found, $type))
    }};
    (@of $found:expr, $type:ty) => {
        // SAFETY: Embree declares the entry point of this name with this type, as far as sizes and registers
        // go.
        unsafe { std::mem::transmute::<Handle, $type>($found) }
    };
}

/// Defines entry points that are counted as a kind of query and handed on. Where nothing is to be counted the
/// way is as short as it can be: two loads and a jump, without a stack frame.
macro_rules! queries {
    ($($export:literal $name:ident($($argument:ident),+) as $kind:ident x $rays:literal;)+) => {$(
        #[unsafe(export_name = $export)]
        extern "C" fn $name($($argument: Handle),+) {
            type Entry = extern "C" fn($(queries!(@type $argument)),+);
            static ADDRESS: Address = Address::new();
            #[inline(never)]
            extern "C" fn counted($($argument: Handle),+) {
                if let Some(found) = real(&ADDRESS, concat!($export, "\0")) {
                    count(Kind::$kind, $rays, weight(), move || entry!(@of found, Entry)($($argument),+));
                }
            }
            match ADDRESS.known() {
                Some(found) if weight() == 0 => entry!(@of found, Entry)($($argument),+),
                _ => counted($($argument),+),
            }
        }
    )+};
    (@type $argument:ident) => { Handle };
}

// The third pointer is what a query is asked with: in Embree 4 its arguments, in Embree 3 the ray, after a
// context.
queries! {
    "rtcIntersect1" intersect1(scene, ray, arguments) as Closest x 1;
    "rtcIntersect4" intersect4(valid, scene, ray, arguments) as Closest x 4;
    "rtcIntersect8" intersect8(valid, scene, ray, arguments) as Closest x 8;
    "rtcIntersect16" intersect16(valid, scene, ray, arguments) as Closest x 16;
    "rtcTraversableIntersect1" traversable_intersect1(traversable, ray, arguments) as Closest x 1;
    "rtcTraversableIntersect4" traversable_intersect4(valid, traversable, ray, arguments) as Closest x 4;
    "rtcTraversableIntersect8" traversable_intersect8(valid, traversable, ray, arguments) as Closest x 8;
    "rtcTraversableIntersect16" traversable_intersect16(valid, traversable, ray, arguments) as Closest x 16;
    "rtcOccluded1" occluded1(scene, ray, arguments) as Occluded x 1;
    "rtcOccluded4" occluded4(valid, scene, ray, arguments) as Occluded x 4;
    "rtcOccluded8" occluded8(valid, scene, ray, arguments) as Occluded x 8;
    "rtcOccluded16" occluded16(valid, scene, ray, arguments) as Occluded x 16;
    "rtcTraversableOccluded1" traversable_occluded1(traversable, ray, arguments) as Occluded x 1;
    "rtcTraversableOccluded4" traversable_occluded4(valid, traversable, ray, arguments) as Occluded x 4;
    "rtcTraversableOccluded8" traversable_occluded8(valid, traversable, ray, arguments) as Occluded x 8;
    "rtcTraversableOccluded16" traversable_occluded16(valid, traversable, ray, arguments) as Occluded x 16;
    "_ZN7mitsuba13rtcIntersect1EPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_9RTCRayHitE"
        mitsuba_intersect1(scene, context, ray) as Closest x 1;
    "_ZN7mitsuba13rtcIntersect4EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_10RTCRayHit4E"
        mitsuba_intersect4(valid, scene, context, ray) as Closest x 4;
    "_ZN7mitsuba13rtcIntersect8EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_10RTCRayHit8E"
        mitsuba_intersect8(valid, scene, context, ray) as Closest x 8;
    "_ZN7mitsuba14rtcIntersect16EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_11RTCRayHit16E"
        mitsuba_intersect16(valid, scene, context, ray) as Closest x 16;
    "_ZN7mitsuba12rtcOccluded1EPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_6RTCRayE"
        mitsuba_occluded1(scene, context, ray) as Occluded x 1;
    "_ZN7mitsuba12rtcOccluded4EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_7RTCRay4E"
        mitsuba_occluded4(valid, scene, context, ray) as Occluded x 4;
    "_ZN7mitsuba12rtcOccluded8EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_7RTCRay8E"
        mitsuba_occluded8(valid, scene, context, ray) as Occluded x 8;
    "_ZN7mitsuba13rtcOccluded16EPKiPNS_10RTCSceneTyEPNS_19RTCIntersectContextEPNS_8RTCRay16E"
        mitsuba_occluded16(valid, scene, context, ray) as Occluded x 16;
}

/// Defines entry points that are handed on after something was noted of their arguments.
macro_rules! noted {
    ($($export:literal $name:ident($($argument:ident: $type:ty),*), $before:expr;)+) => {$(
        #[unsafe(export_name = $export)]
        extern "C" fn $name($($argument: $type),*) {
            $before;
            if let Some(entry) = entry!(concat!($export, "\0"), extern "C" fn($($type),*)) {
                entry($($argument),*);
            }
        }
    )+};
}

noted! {
    "rtcReleaseDevice" release_device(device: Handle), counts::write();
    "_ZN7mitsuba16rtcReleaseDeviceEPNS_11RTCDeviceTyE" mitsuba_release_device(device: Handle), counts::write();
    "rtcSetSceneFlags" set_flags(scene: Handle, flags: c_int), note_flags(flags);
    "_ZN7mitsuba16rtcSetSceneFlagsEPNS_10RTCSceneTyENS_13RTCSceneFlagsE"
        mitsuba_set_flags(scene: Handle, flags: c_int), note_flags(flags);
    "rtcSetSceneBuildQuality" set_quality(scene: Handle, quality: c_int), note_quality(quality);
    "_ZN7mitsuba23rtcSetSceneBuildQualityEPNS_10RTCSceneTyENS_15RTCBuildQualityE"
        mitsuba_set_quality(scene: Handle, quality: c_int), note_quality(quality);
    "rtcSetSharedGeometryBuffer" share_buffer(geometry: Handle, kind: c_int, slot: c_uint, format: c_int, data: *const c_void,
        offset: usize, stride: usize, items: usize), note_triangles(kind, items);
    "_ZN7mitsuba26rtcSetSharedGeometryBufferEPNS_13RTCGeometryTyENS_13RTCBufferTypeEjNS_9RTCFormatEPKvmmm"
        mitsuba_share_buffer(geometry: Handle, kind: c_int, slot: c_uint, format: c_int, data: *const c_void, offset: usize,
            stride: usize, items: usize), note_triangles(kind, items);
}

#[unsafe(export_name = "rtcSetNewGeometryBuffer")]
extern "C" fn new_buffer(
    geometry: Handle,
    kind: c_int,
    slot: c_uint,
    format: c_int,
    stride: usize,
    items: usize,
) -> Handle {
    type Entry = extern "C" fn(Handle, c_int, c_uint, c_int, usize, usize) -> Handle;
    note_triangles(kind, items);
    entry!("rtcSetNewGeometryBuffer\0", Entry)
        .map_or(std::ptr::null_mut(), |entry| entry(geometry, kind, slot, format, stride, items))
}

/// Defines entry points that make a device.
macro_rules! devices {
    ($($export:literal $name:ident;)+) => {$(
        #[unsafe(export_name = $export)]
        extern "C" fn $name(config: *const c_char) -> Handle {
            note_device(config);
            // SAFETY: Embree asks for text that ends in a zero, or none.
            let own = (!config.is_null()).then(|| unsafe { CStr::from_ptr(config) });
            let text = SETTINGS.device(own);
            let config = text.as_ref().map_or(config, |text| text.as_ptr());
            entry!(concat!($export, "\0"), extern "C" fn(*const c_char) -> Handle)
                .map_or(std::ptr::null_mut(), |entry| entry(config))
        }
    )+};
}

devices! {
    "rtcNewDevice" new_device;
    "_ZN7mitsuba12rtcNewDeviceEPKc" mitsuba_new_device;
}

/// Defines entry points that build, with those that set the flags and quality of a scene.
macro_rules! builds {
    ($($export:literal $name:ident, $get_flags:literal, $set_flags:literal, $set_quality:literal;)+) => {$(
        #[unsafe(export_name = $export)]
        extern "C" fn $name(scene: Handle) {
            let Some(entry) = entry!(concat!($export, "\0"), extern "C" fn(Handle)) else { return };
            if let Some(quality) = SETTINGS.quality()
                && let Some(set) = entry!(concat!($set_quality, "\0"), extern "C" fn(Handle, c_int))
            {
                set(scene, quality);
            }
            if SETTINGS.has_flags()
                && let Some(get) = entry!(concat!($get_flags, "\0"), extern "C" fn(Handle) -> c_int)
                && let Some(set) = entry!(concat!($set_flags, "\0"), extern "C" fn(Handle, c_int))
            {
                set(scene, SETTINGS.flags(get(scene)));
            }
            timed($export.contains("Join"), || entry(scene));
        }
    )+};
}

builds! {
    "rtcCommitScene" commit, "rtcGetSceneFlags", "rtcSetSceneFlags", "rtcSetSceneBuildQuality";
    "rtcJoinCommitScene" join_commit, "rtcGetSceneFlags", "rtcSetSceneFlags", "rtcSetSceneBuildQuality";
    "_ZN7mitsuba14rtcCommitSceneEPNS_10RTCSceneTyE" mitsuba_commit, "_ZN7mitsuba16rtcGetSceneFlagsEPNS_10RTCSceneTyE",
        "_ZN7mitsuba16rtcSetSceneFlagsEPNS_10RTCSceneTyENS_13RTCSceneFlagsE",
        "_ZN7mitsuba23rtcSetSceneBuildQualityEPNS_10RTCSceneTyENS_15RTCBuildQualityE";
    "_ZN7mitsuba18rtcJoinCommitSceneEPNS_10RTCSceneTyE" mitsuba_join_commit,
        "_ZN7mitsuba16rtcGetSceneFlagsEPNS_10RTCSceneTyE",
        "_ZN7mitsuba16rtcSetSceneFlagsEPNS_10RTCSceneTyENS_13RTCSceneFlagsE",
        "_ZN7mitsuba23rtcSetSceneBuildQualityEPNS_10RTCSceneTyENS_15RTCBuildQualityE";
}

/// Defines entry points that finish a geometry: its own quality decides how trees of quality low are built.
macro_rules! geometries {
    ($($export:literal $name:ident, $set_quality:literal;)+) => {$(
        #[unsafe(export_name = $export)]
        extern "C" fn $name(geometry: Handle) {
            if let Some(quality) = SETTINGS.quality()
                && let Some(set) = entry!(concat!($set_quality, "\0"), extern "C" fn(Handle, c_int))
            {
                set(geometry, quality);
            }
            if let Some(entry) = entry!(concat!($export, "\0"), extern "C" fn(Handle)) {
                entry(geometry);
            }
        }
    )+};
}

geometries! {
    "rtcCommitGeometry" commit_geometry, "rtcSetGeometryBuildQuality";
    "_ZN7mitsuba17rtcCommitGeometryEPNS_13RTCGeometryTyE" mitsuba_commit_geometry,
        "_ZN7mitsuba26rtcSetGeometryBuildQualityEPNS_13RTCGeometryTyENS_15RTCBuildQualityE";
}

/// For a host that knows of the library: gives settings to devices made and scenes built from now on, in the
/// words of `treewright-probe --set`, separated by `;`. Other settings stay as the program asks. Returns
/// false and changes nothing where a word is unknown.
#[unsafe(export_name = "treewright_probe_set")]
extern "C" fn set(words: *const c_char) -> bool {
    // SAFETY: the caller hands over text that ends in a zero, or none.
    let words = if words.is_null() { c"" } else { unsafe { CStr::from_ptr(words) } };
    words.to_str().is_ok_and(|words| SETTINGS.apply(words))
}

extern "C" fn at_the_end() {
    counts::write();
}

extern "C" fn begin() {
    // SAFETY: the function takes nothing, returns nothing and lives as long as the program.
    unsafe { libc::atexit(at_the_end) };
    // Reads the environment while nobody changes it.
    counts::begin();
    if let Ok(words) = std::env::var("TREEWRIGHT_PROBE_SET") {
        SETTINGS.apply(&words);
    }
}

/// Run by the loader.
#[used]
#[unsafe(link_section = ".init_array")]
static BEGIN: extern "C" fn() = begin;
