//! Memory of trees: huge pages under large tables, and freed memory kept for the next build.

/// A huge page of x86-64, and of ARM with its usual small ones.
#[cfg(target_os = "linux")]
const HUGE_PAGE: usize = 2 << 20;

/// Memory that the allocator takes from the kernel at a time, in bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const STEP: libc::c_int = 64 << 20;

/// Makes the allocator of this process keep freed memory, for the next tree. Call it once at the start of a
/// program that builds trees frame by frame.
///
/// By default the C library gives large blocks back at once, and the next build waits while every page is
/// zeroed again: three quarters of the page faults with 1.4 million triangles. The process never shrinks
/// then. Returns whether the C library agreed; only glibc is asked (`mallopt(3)`).
pub fn keep_freed_memory() -> bool {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        // One heap for all threads: blocks too large for a thread's heap would be mapped and unmapped.
        let wishes = [
            (libc::M_ARENA_MAX, 1),
            (libc::M_MMAP_MAX, 0),
            (libc::M_TRIM_THRESHOLD, -1),
            (libc::M_TOP_PAD, STEP),
        ];
        // SAFETY: `mallopt` only sets parameters of the allocator and may be called at any time.
        wishes.into_iter().all(|(name, value)| unsafe { libc::mallopt(name, value) } == 1)
    }
    #[cfg(not(all(target_os = "linux", target_env = "gnu")))]
    false
}

/// Asks the kernel, on Linux, for huge pages under a vector, best before it is filled: a table that rays look
/// into all over would miss the page table cache as often as the data caches.
pub fn wish_for_huge_pages<T>(values: &Vec<T>) {
    #[cfg(target_os = "linux")]
    {
        const PAGE: usize = 4096;
        let start = (values.as_ptr() as usize).next_multiple_of(PAGE);
        let end = values.as_ptr() as usize + values.capacity() * size_of::<T>();
        if end > start + 2 * HUGE_PAGE {
            let length = (end - start) / PAGE * PAGE;
            // SAFETY: whole pages of memory that the vector owns; the advice changes nothing in them.
            let _ = unsafe { libc::madvise(start as *mut libc::c_void, length, libc::MADV_HUGEPAGE) };
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = values;
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    #[test]
    fn the_c_library_agrees() {
        assert!(super::keep_freed_memory());
    }
}
