//! Memory that will be needed soon: asks the processor to fetch it.

/// Asks for an element to be brought into the cache, on x86-64 only. Beyond the end nothing happens.
#[inline(always)]
pub fn prefetch<T>(values: &[T], index: usize) {
    if let Some(value) = values.get(index) {
        prefetch_line(std::ptr::from_ref(value).cast());
    }
}

/// Asks for the cache line of an address, whatever is there. Elsewhere than on x86-64 it does nothing.
#[inline(always)]
pub(crate) fn prefetch_line(address: *const u8) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: prefetching reads nothing and faults on no address; SSE is part of x86-64.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}
