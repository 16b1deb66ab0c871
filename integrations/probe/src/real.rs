//! Finds the real entry points: in the next library that has them, or, where an interpreter loaded a library
//! for itself alone, in the one whose file is mapped.

use std::ffi::{CString, c_void};
use std::sync::atomic::{AtomicPtr, Ordering};

/// Room for an address once it is found.
pub(crate) struct Address(AtomicPtr<c_void>);

impl Address {
    pub(crate) const fn new() -> Self {
        Self(AtomicPtr::new(std::ptr::null_mut()))
    }

    /// The function, if it was found before.
    #[inline]
    pub(crate) fn known(&self) -> Option<*mut c_void> {
        let known = self.0.load(Ordering::Relaxed);
        (!known.is_null()).then_some(known)
    }
}

/// The real entry point of a name, which ends in a zero.
#[inline]
pub(crate) fn real(address: &Address, name: &'static str) -> Option<*mut c_void> {
    if let Some(known) = address.known() {
        return Some(known);
    }
    let found = find(name)?;
    address.0.store(found, Ordering::Relaxed);
    Some(found)
}

#[cold]
fn find(name: &'static str) -> Option<*mut c_void> {
    // SAFETY: the name ends in a zero.
    let next = unsafe { libc::dlsym(libc::RTLD_NEXT, name.as_ptr().cast()) };
    if !next.is_null() {
        return Some(next);
    }
    mapped().into_iter().find_map(|path| find_in(path, name))
}

fn find_in(path: String, name: &'static str) -> Option<*mut c_void> {
    let path = CString::new(path).ok()?;
    // SAFETY: the path ends in a zero; the library is loaded already, and is not let go again.
    let library = unsafe { libc::dlopen(path.as_ptr(), libc::RTLD_LAZY | libc::RTLD_NOLOAD) };
    if library.is_null() {
        return None;
    }
    // SAFETY: the library is open, and the name ends in a zero.
    let found = unsafe { libc::dlsym(library, name.as_ptr().cast()) };
    (!found.is_null()).then_some(found)
}

/// The files of Embree 4 and 3 that this process has mapped, each once.
pub(crate) fn mapped() -> Vec<String> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let is_embree = |path: &&str| {
        path.rsplit('/')
            .next()
            .is_some_and(|file| file.starts_with("libembree4") || file.starts_with("libembree3"))
    };
    let mapped = maps.lines().filter_map(|line| line.find('/').map(|at| &line[at..]));
    let mut all: Vec<String> = mapped.filter(is_embree).map(str::to_owned).collect();
    all.dedup();
    all
}
