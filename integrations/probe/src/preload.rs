//! A library that is preloaded into a program and stands in front of Embree 4's entry points: it counts and times calls, hands each on
//! unchanged, and writes what it found when a device is released and when the program ends.
//!
//! It never changes a result and never ends its host: what cannot be found, timed or written is left out. One query in
//! [`SAMPLE`] is timed, so that a query costs a few nanoseconds more; builds are all timed. `TREEWRIGHT_PROBE` names the file, to which
//! the process's number is added, since programs start others.

mod counts;
mod real;

use std::ffi::{c_char, c_int, c_uint, c_void};

use counts::{Kind, ROOM, count, note_device, note_flags, note_quality, note_triangles, timed};
use real::real;

/// One query in so many is timed.
pub(crate) const SAMPLE: u64 = 256;

/// A handle or pointer that is handed on.
type Handle = *mut c_void;

/// Defines entry points that are counted as a kind of query and handed on.
macro_rules! queries {
    ($($name:ident($($argument:ident),+) as $kind:ident x $rays:literal;)+) => {$(
        #[unsafe(no_mangle)]
        #[allow(non_snake_case)]
        extern "C" fn $name($($argument: Handle),+) {
            type Entry = extern "C" fn($(queries!(@type $argument)),+);
            static ROOM_OF: real::Room = real::Room::new();
            if let Some(found) = real(&ROOM_OF, concat!(stringify!($name), "\0")) {
                // SAFETY: Embree 4 declares this entry point with as many pointers and no result.
                let entry = unsafe { std::mem::transmute::<Handle, Entry>(found) };
                count(Kind::$kind, $rays, || entry($($argument),+));
            }
        }
    )+};
    (@type $argument:ident) => { Handle };
}

queries! {
    rtcIntersect1(scene, ray, arguments) as Closest x 1;
    rtcIntersect4(valid, scene, ray, arguments) as Closest x 4;
    rtcIntersect8(valid, scene, ray, arguments) as Closest x 8;
    rtcIntersect16(valid, scene, ray, arguments) as Closest x 16;
    rtcTraversableIntersect1(traversable, ray, arguments) as Closest x 1;
    rtcTraversableIntersect4(valid, traversable, ray, arguments) as Closest x 4;
    rtcTraversableIntersect8(valid, traversable, ray, arguments) as Closest x 8;
    rtcTraversableIntersect16(valid, traversable, ray, arguments) as Closest x 16;
    rtcOccluded1(scene, ray, arguments) as Occluded x 1;
    rtcOccluded4(valid, scene, ray, arguments) as Occluded x 4;
    rtcOccluded8(valid, scene, ray, arguments) as Occluded x 8;
    rtcOccluded16(valid, scene, ray, arguments) as Occluded x 16;
    rtcTraversableOccluded1(traversable, ray, arguments) as Occluded x 1;
    rtcTraversableOccluded4(valid, traversable, ray, arguments) as Occluded x 4;
    rtcTraversableOccluded8(valid, traversable, ray, arguments) as Occluded x 8;
    rtcTraversableOccluded16(valid, traversable, ray, arguments) as Occluded x 16;
}

/// Defines an entry point that is handed on after something was noted of its arguments.
macro_rules! noted {
    ($name:ident($($argument:ident: $type:ty),*) -> $result:ty, else $nothing:expr, $before:expr) => {
        #[unsafe(no_mangle)]
        #[allow(non_snake_case)]
        extern "C" fn $name($($argument: $type),*) -> $result {
            type Entry = extern "C" fn($($type),*) -> $result;
            static ROOM_OF: real::Room = real::Room::new();
            $before;
            match real(&ROOM_OF, concat!(stringify!($name), "\0")) {
                Some(found) => {
                    // SAFETY: Embree 4 declares this entry point so.
                    let entry = unsafe { std::mem::transmute::<Handle, Entry>(found) };
                    entry($($argument),*)
                }
                None => $nothing,
            }
        }
    };
}

noted!(rtcNewDevice(config: *const c_char) -> Handle, else std::ptr::null_mut(), note_device(config));
noted!(rtcReleaseDevice(device: Handle) -> (), else (), counts::write());
noted!(rtcSetSceneFlags(scene: Handle, flags: c_int) -> (), else (), note_flags(flags));
noted!(rtcSetSceneBuildQuality(scene: Handle, quality: c_int) -> (), else (), note_quality(quality));
noted!(
    rtcSetNewGeometryBuffer(geometry: Handle, kind: c_int, slot: c_uint, format: c_int, stride: usize, items: usize) -> Handle,
    else std::ptr::null_mut(), note_triangles(kind, items)
);
noted!(
    rtcSetSharedGeometryBuffer(geometry: Handle, kind: c_int, slot: c_uint, format: c_int, data: *const c_void,
        offset: usize, stride: usize, items: usize) -> (),
    else (), note_triangles(kind, items)
);

/// Defines an entry point that builds.
macro_rules! builds {
    ($($name:ident)+) => {$(
        #[unsafe(no_mangle)]
        #[allow(non_snake_case)]
        extern "C" fn $name(scene: Handle) {
            static ROOM_OF: real::Room = real::Room::new();
            if let Some(found) = real(&ROOM_OF, concat!(stringify!($name), "\0")) {
                // SAFETY: Embree 4 declares this entry point with a scene and no result.
                let entry = unsafe { std::mem::transmute::<Handle, extern "C" fn(Handle)>(found) };
                timed(|| entry(scene));
            }
        }
    )+};
}

builds!(rtcCommitScene rtcJoinCommitScene);

extern "C" fn at_the_end() {
    counts::write();
}

extern "C" fn begin() {
    // SAFETY: the function takes nothing, returns nothing and lives as long as the program.
    unsafe { libc::atexit(at_the_end) };
    // Reads the environment while nobody changes it.
    ROOM.begin();
}

/// Run by the loader.
#[used]
#[unsafe(link_section = ".init_array")]
static BEGIN: extern "C" fn() = begin;
