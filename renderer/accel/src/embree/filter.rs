//! Masks in native scenes: filter functions, which Embree calls for each hit it is about to take.
//!
//! They are set on geometries with masks alone, so that Embree walks all others as it does without them.

use std::ffi::{c_int, c_void};
use std::slice;

use glam::Vec3;

use super::ffi;
use crate::geometry::{Ray, Triangles};

/// Lets a geometry's hits be filtered by the masks of its triangles, or not if they have none.
///
/// # Safety
/// The geometry is valid, its primitives are numbered as `triangles`, and these stay where they are and live
/// as long as anything is traced through it, or until this is called again.
pub(super) unsafe fn set_masks(geometry: ffi::RTCGeometry, triangles: *const Triangles) {
    // SAFETY: the caller vouches for the triangles.
    let filter: ffi::Filter = if unsafe { (*triangles).has_masks() } { Some(keep_solid) } else { None };
    // SAFETY: the caller vouches for the geometry, and for the triangles while it is used.
    unsafe {
        ffi::rtc_set_geometry_user_data(geometry, triangles.cast_mut().cast());
        ffi::rtc_set_geometry_intersect_filter_function(geometry, filter);
        ffi::rtc_set_geometry_occluded_filter_function(geometry, filter);
    }
}

/// `RTCFilterFunctionN`: takes hits back where a mask lets the ray through. It cannot panic.
unsafe extern "C" fn keep_solid(arguments: *const ffi::FilterArguments) {
    // SAFETY: Embree hands over `count` rays and hits, field by field, and what `set_masks` gave it.
    let (triangles, rays, primitives, valid) = unsafe {
        let arguments = &*arguments;
        let count = arguments.count as usize;
        (
            &*arguments.user.cast::<Triangles>(),
            slice::from_raw_parts(arguments.ray.cast::<f32>(), 9 * count),
            slice::from_raw_parts(arguments.hit.cast::<u32>().add(5 * count), count),
            slice::from_raw_parts_mut(arguments.valid, count),
        )
    };
    let count = valid.len();
    for (lane, valid) in valid.iter_mut().enumerate().filter(|(_, valid)| **valid != 0) {
        let field = |number: usize| rays[number * count + lane];
        let ray = Ray {
            origin: Vec3::new(field(0), field(1), field(2)),
            direction: Vec3::new(field(4), field(5), field(6)),
            t_min: field(3),
            t_max: field(8),
        };
        if !triangles.is_met(primitives[lane] as usize, &ray) {
            *valid = 0;
        }
    }
}

const _: () = assert!(size_of::<c_int>() == 4 && size_of::<*mut c_void>() == 8);
