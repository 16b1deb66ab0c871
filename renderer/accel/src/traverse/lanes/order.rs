//! The next children: those a ray meets, sorted by distance, straight onto the stack.

use super::{Lanes, Stored};
use crate::layout::NodeRef;

/// The walk's operations on the distances of a node's children.
///
/// # Safety
/// All functions require the processor features the vector is named after. `children` points to as many
/// references as there are lanes; there is room for that number behind `nodes` and `keys`, which may all be
/// written with any number of hits. Distances are not below zero.
pub(crate) trait Order: Lanes {
    /// Writes the two or more children in `hits`, farthest first, with keys: distances that end in the lane.
    #[inline(always)]
    unsafe fn write_sorted(self, hits: u32, children: *const NodeRef, nodes: *mut NodeRef, keys: *mut i32) {
        // SAFETY: the caller vouches for the pointers; `hits` and keys name lanes below their number.
        unsafe {
            let times = Stored::from(self).0;
            let mut left = hits;
            let mut count = 0;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let key = times[lane].to_bits() as i32 & !(Self::COUNT as i32 - 1) | lane as i32;
                // Insertion: there are few.
                let mut place = count;
                while place > 0 && *keys.add(place - 1) < key {
                    *keys.add(place) = *keys.add(place - 1);
                    place -= 1;
                }
                *keys.add(place) = key;
                count += 1;
            }
            for place in 0..count {
                *nodes.add(place) = *children.add(*keys.add(place) as usize & (Self::COUNT - 1));
            }
        }
    }

    /// Writes the children in `hits` in their own order.
    #[inline(always)]
    unsafe fn write_met(hits: u32, children: *const NodeRef, nodes: *mut NodeRef) {
        let mut left = hits;
        let mut place = 0;
        while left != 0 {
            // SAFETY: the caller vouches for the pointers.
            unsafe { *nodes.add(place) = *children.add(left.trailing_zeros() as usize) };
            left &= left - 1;
            place += 1;
        }
    }
}
