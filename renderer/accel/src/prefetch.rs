//! Memory that will be needed soon: asks the processor to fetch it, and the kernel to put it on huge pages.

/// A huge page of x86-64, and of ARM with its usual small ones.
#[cfg(target_os = "linux")]
const HUGE_PAGE: usize = 2 << 20;

/// Asks for an element of a slice to be brought into the cache. Nothing happens beyond the end. Elsewhere than
/// on x86-64 it does nothing.
#[inline(always)]
pub fn prefetch<T>(values: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(value) = values.get(index) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: prefetching reads nothing and faults on no address; SSE is part of x86-64.
        unsafe { _mm_prefetch(std::ptr::from_ref(value).cast(), _MM_HINT_T0) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, index);
}

/// Asks the kernel for huge pages under the memory of a vector, best before it is filled: a table that rays look into
/// all over misses the page table cache as often as the data caches otherwise. Changes nothing but speed; elsewhere
/// than on Linux it does nothing.
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
