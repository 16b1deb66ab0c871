//! tinybvh as a further peer: its eight-wide tree for processors, from a library that `tools/tinybvh.sh`
//! compiles.
//!
//! The crate `tinybvh-rs` has no query for any hit, and queries of the wide tree only where the whole program
//! is compiled for AVX2. Hence a few lines of C++ of our own, loaded from the file that `TREEWRIGHT_TINYBVH`
//! names.

use std::ffi::{c_int, c_void};
use std::{error::Error, sync::Arc};

use libloading::Library;
use treewright_accel::{Hit, Intersector, NO_INSTANCE, Packets, Ray, Triangles};

/// Names the library.
const LIBRARY: &str = "TREEWRIGHT_TINYBVH";
/// Rays that are handed over at once, on the stack.
const BATCH: usize = 256;

/// A ray as the C++ side wants it.
#[repr(C)]
#[derive(Clone, Copy, Default)]
struct FlatRay {
    origin: [f32; 3],
    t_min: f32,
    direction: [f32; 3],
    t_max: f32,
}

/// A hit as the C++ side returns it; at infinity where there is none.
#[repr(C)]
#[derive(Clone, Copy, Default)]
struct FlatHit {
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
}

/// The functions of the loaded library.
pub(crate) struct Tinybvh {
    build: unsafe extern "C" fn(*const f32, u32, c_int) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    closest: unsafe extern "C" fn(*const c_void, *const FlatRay, *mut FlatHit, u32),
    occluded: unsafe extern "C" fn(*const c_void, *const FlatRay, *mut u8, u32),
    /// Keeps the functions in memory.
    _library: Library,
}

impl Tinybvh {
    /// Loads the library; none where the environment does not name one.
    pub(crate) fn load() -> Result<Option<Arc<Self>>, Box<dyn Error>> {
        let Some(path) = std::env::var_os(LIBRARY) else { return Ok(None) };
        // SAFETY: the user names the library that tools/tinybvh.sh made of tinybvh.cpp, which runs nothing
        // when it is loaded and has these four functions with these arguments; the library is kept as long as
        // they are.
        unsafe {
            let library =
                Library::new(&path).map_err(|error| format!("{LIBRARY}={}: {error}", path.display()))?;
            Ok(Some(Arc::new(Self {
                build: *library.get(b"treewright_tinybvh_build")?,
                free: *library.get(b"treewright_tinybvh_free")?,
                closest: *library.get(b"treewright_tinybvh_closest")?,
                occluded: *library.get(b"treewright_tinybvh_occluded")?,
                _library: library,
            })))
        }
    }
}

pub(crate) struct Tree {
    functions: Arc<Tinybvh>,
    tree: *mut c_void,
}

// SAFETY: the tree is read only once it is built, and its queries take it as `const` and keep nothing.
unsafe impl Send for Tree {}
// SAFETY: as above.
unsafe impl Sync for Tree {}

impl Tree {
    /// Builds one; `splits` asks for its careful builder.
    pub(crate) fn build(functions: &Arc<Tinybvh>, triangles: &Triangles, splits: bool) -> Self {
        let corners: Vec<[f32; 4]> = (0..triangles.len())
            .flat_map(|number| triangles.corners(number))
            .map(|corner| [corner.x, corner.y, corner.z, 0.0])
            .collect();
        let count = u32::try_from(triangles.len()).expect("limited to less");
        // SAFETY: there are three corners of four floats a triangle; they are copied.
        let tree = unsafe { (functions.build)(corners.as_ptr().cast(), count, c_int::from(splits)) };
        Self { functions: Arc::clone(functions), tree }
    }
}

impl Drop for Tree {
    fn drop(&mut self) {
        // SAFETY: it is a tree of this library, and nothing uses it any more.
        unsafe { (self.functions.free)(self.tree) }
    }
}

impl Intersector for Tree {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut hit = [None];
        self.closest_each(Packets::Single, &[*ray], &mut hit);
        hit[0]
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let mut any = [false];
        self.occluded_each(Packets::Single, &[*ray], &mut any);
        any[0]
    }

    fn closest_each(&self, _packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        for (rays, hits) in rays.chunks(BATCH).zip(hits.chunks_mut(BATCH)) {
            let flat = flatten(rays);
            let mut found = [FlatHit::default(); BATCH];
            // SAFETY: both arrays have room for `rays.len()` entries.
            unsafe {
                (self.functions.closest)(self.tree, flat.as_ptr(), found.as_mut_ptr(), rays.len() as u32)
            };
            for (hit, found) in hits.iter_mut().zip(&found) {
                let FlatHit { t, u, v, triangle } = *found;
                *hit = t.is_finite().then_some(Hit { t, u, v, triangle, instance: NO_INSTANCE });
            }
        }
    }

    fn occluded_each(&self, _packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer a ray");
        for (rays, occluded) in rays.chunks(BATCH).zip(occluded.chunks_mut(BATCH)) {
            let flat = flatten(rays);
            let mut found = [0_u8; BATCH];
            // SAFETY: both arrays have room for `rays.len()` entries.
            unsafe {
                (self.functions.occluded)(self.tree, flat.as_ptr(), found.as_mut_ptr(), rays.len() as u32)
            };
            for (any, found) in occluded.iter_mut().zip(found) {
                *any = found != 0;
            }
        }
    }
}

fn flatten(rays: &[Ray]) -> [FlatRay; BATCH] {
    let mut flat = [FlatRay::default(); BATCH];
    for (flat, ray) in flat.iter_mut().zip(rays) {
        *flat = FlatRay {
            origin: ray.origin.to_array(),
            t_min: ray.t_min,
            direction: ray.direction.to_array(),
            t_max: ray.t_max,
        };
    }
    flat
}
