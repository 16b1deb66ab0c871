//! Memory of a finished tree: one block, in which nodes and leaves lie in the order they are wanted.

use std::alloc::{Layout, alloc, dealloc};
use std::ptr::NonNull;

use crate::error::BuildError;

/// Cache lines: nodes start on one.
const LINE: usize = 64;
/// A huge page. Larger blocks start on one: with small pages most nodes miss the page table cache.
const HUGE_PAGE: usize = 2 << 20;

/// A block of memory, aligned to cache lines and not zeroed. Every byte is written before it is read.
#[derive(Debug)]
pub(super) struct Arena {
    start: NonNull<u8>,
    layout: Layout,
}

impl Arena {
    /// Takes at least `bytes` of memory, more than none.
    pub(super) fn new(bytes: usize) -> Result<Self, BuildError> {
        let (size, align) = match bytes {
            0..HUGE_PAGE => (bytes.max(LINE), LINE),
            _ => (bytes.next_multiple_of(HUGE_PAGE), HUGE_PAGE),
        };
        let layout = Layout::from_size_align(size, align).map_err(|_| BuildError::OutOfMemory)?;
        // SAFETY: the size is not zero.
        let start = NonNull::new(unsafe { alloc(layout) }).ok_or(BuildError::OutOfMemory)?;
        if align == HUGE_PAGE {
            // Only a wish, for speed alone. SAFETY: the range is ours.
            #[cfg(target_os = "linux")]
            let _ = unsafe { libc::madvise(start.as_ptr().cast(), size, libc::MADV_HUGEPAGE) };
        }
        Ok(Self { start, layout })
    }

    pub(super) fn start(&self) -> *mut u8 {
        self.start.as_ptr()
    }
}

impl Drop for Arena {
    fn drop(&mut self) {
        // SAFETY: allocated with this layout, and ours.
        unsafe { dealloc(self.start.as_ptr(), self.layout) };
    }
}

// SAFETY: it only owns memory; who may look into it from which thread is the tree's affair.
unsafe impl Send for Arena {}
// SAFETY: as above.
unsafe impl Sync for Arena {}
