//! Inner nodes of half the size: bounds in bytes, relative to the node's own box.
//!
//! The idea is that of Mahovsky and Wyvill, "Memory-Conserving Bounding Volume Hierarchies with Coherent
//! Raytracing" (2006), with the grid of Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on
//! GPUs Through Compressed Wide BVHs" (2017): an origin, and a power of two as the step of each axis.
//! A step times a byte is then exact, so that `origin + step * byte` is rounded once however it is
//! computed, and every instruction set decodes the same box.

use super::{Bounds, NodeRef, TreeNode, WIDTH_MAX};

/// Byte bounds: the children's planes lie at `origin + 2^exponent * byte`, rounded outwards.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct QuantisedNode<const W: usize> {
    /// First, so that whole vectors of them are aligned.
    pub(crate) children: [NodeRef; W],
    /// Lower corner of the node's box.
    pub(crate) origin: [f32; 3],
    /// Step of each axis, as the exponent bits of a single-precision number. Never 0.
    pub(crate) exponents: [u8; 3],
    /// Places in use.
    pub(crate) count: u8,
    /// `bounds[axis][side][child]`, side 0 being the lower one. Unused places have inverted ones.
    pub(crate) bounds: [[[u8; W]; 2]; 3],
}

const _: () = {
    assert!(size_of::<QuantisedNode<8>>() == 128);
    assert!(size_of::<QuantisedNode<16>>() == 256);
};

// SAFETY: a node only points to others; who may follow the pointers from which thread is the tree's affair.
unsafe impl<const W: usize> Send for QuantisedNode<W> {}
// SAFETY: as above.
unsafe impl<const W: usize> Sync for QuantisedNode<W> {}

impl<const W: usize> QuantisedNode<W> {
    /// Step of one axis: a normal power of two.
    #[inline(always)]
    pub(crate) fn step(&self, axis: usize) -> f32 {
        step_of(self.exponents[axis])
    }

    fn plane(&self, axis: usize, byte: u8) -> f32 {
        plane(self.origin[axis], self.exponents[axis], byte)
    }
}

#[inline(always)]
fn step_of(exponent: u8) -> f32 {
    f32::from_bits(u32::from(exponent) << (f32::MANTISSA_DIGITS - 1))
}

/// The product is exact: a byte has eight significant bits, and the step is a normal power of two.
fn plane(origin: f32, exponent: u8, byte: u8) -> f32 {
    origin + step_of(exponent) * f32::from(byte)
}

/// The smallest step that reaches from `lower` to `upper` in 255.
fn exponent(lower: f32, upper: f32) -> u8 {
    let step = (f64::from(upper) - f64::from(lower)) / 255.0;
    // One less than needed at most, for the fraction is cut off: the loop ends after a step or two.
    // Coordinates end at 1e12, so the largest exponent is far away.
    let mut exponent = ((step as f32).to_bits() >> (f32::MANTISSA_DIGITS - 1)).clamp(1, 254) as u8;
    while plane(lower, exponent, u8::MAX) < upper && exponent < 254 {
        exponent += 1;
    }
    exponent
}

impl<const W: usize> TreeNode for QuantisedNode<W> {
    const WIDTH: usize = W;
    const EMPTY: Self = Self {
        origin: [0.0; 3],
        exponents: [1; 3],
        count: 0,
        children: [NodeRef::EMPTY; W],
        bounds: [[[u8::MAX; W], [0; W]]; 3],
    };

    fn set_bounds(&mut self, bounds: &[Bounds]) {
        let whole = bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        self.bounds = Self::EMPTY.bounds;
        self.count = bounds.len() as u8;
        if bounds.is_empty() {
            return;
        }
        for axis in 0..3 {
            let origin = whole.lower[axis];
            let exponent = exponent(origin, whole.upper[axis]);
            self.origin[axis] = origin;
            self.exponents[axis] = exponent;
            for (child, of_child) in bounds.iter().enumerate() {
                let steps =
                    |plane: f32| (f64::from(plane) - f64::from(origin)) / f64::from(step_of(exponent));
                // The sum with the origin rounds to nearest, perhaps inwards: then one step more. Byte 0 is
                // the origin itself and byte 255 reaches the far side, so both loops end in time.
                let mut lower = steps(of_child.lower[axis]).floor() as u8;
                while lower > 0 && plane(origin, exponent, lower) > of_child.lower[axis] {
                    lower -= 1;
                }
                let mut upper = steps(of_child.upper[axis]).ceil() as u8;
                while upper < u8::MAX && plane(origin, exponent, upper) < of_child.upper[axis] {
                    upper += 1;
                }
                self.bounds[axis][0][child] = lower;
                self.bounds[axis][1][child] = upper;
            }
        }
    }

    #[inline(always)]
    fn children(&self) -> &[NodeRef] {
        &self.children
    }

    fn children_mut(&mut self) -> &mut [NodeRef] {
        &mut self.children
    }

    fn permute(&mut self, order: &[u8; WIDTH_MAX]) {
        let Self { bounds, children, .. } = *self;
        for (place, from) in order[..W].iter().enumerate() {
            let from = usize::from(*from);
            self.children[place] = children[from];
            for (to, row) in self.bounds.as_flattened_mut().iter_mut().zip(bounds.as_flattened()) {
                to[place] = row[from];
            }
        }
    }

    fn count(&self) -> usize {
        usize::from(self.count)
    }

    fn child_bounds(&self, child: usize) -> Bounds {
        let side = |side: usize| [0, 1, 2].map(|axis| self.plane(axis, self.bounds[axis][side][child]));
        Bounds { lower: side(0), upper: side(1) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::limits::COORDINATE_MAX;

    fn decoded_contain_the_originals<const W: usize>(bounds: &[Bounds]) -> Result<(), TestCaseError> {
        let mut node = QuantisedNode::<W>::EMPTY;
        node.set_bounds(bounds);
        prop_assert_eq!(node.count(), bounds.len());
        let whole = bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        for (child, original) in bounds.iter().enumerate() {
            let decoded = node.child_bounds(child);
            prop_assert!(decoded.contains(original), "{:?} does not contain {:?}", decoded, original);
            for axis in 0..3 {
                // No more is lost than two steps and the rounding of large coordinates, and a step is no
                // larger than the box needs.
                let extent = f64::from(whole.upper[axis]) - f64::from(whole.lower[axis]);
                let rounding =
                    f64::from(whole.lower[axis].abs().max(whole.upper[axis].abs())) * f64::from(f32::EPSILON);
                let slack = 4.0 * (extent / 255.0 + rounding + f64::from(f32::MIN_POSITIVE));
                let lost = f64::from(original.lower[axis]) - f64::from(decoded.lower[axis]);
                prop_assert!(lost <= slack, "axis {}: {} lost of {}", axis, lost, extent);
                let lost = f64::from(decoded.upper[axis]) - f64::from(original.upper[axis]);
                prop_assert!(lost <= slack, "axis {}: {} lost of {}", axis, lost, extent);
            }
        }
        Ok(())
    }

    /// Coordinates of every magnitude, zero among them.
    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![
            4 => -1.0f32..1.0,
            2 => (-45.0f32..=15.0, any::<bool>())
                .prop_map(|(power, minus)| 10f32.powf(power) * if minus { -1.0 } else { 1.0 }),
            1 => prop::sample::select(vec![0.0, -0.0, COORDINATE_MAX, -COORDINATE_MAX, 1e7, 1e7 + 1.0]),
        ]
    }

    fn boxes(most: usize) -> impl Strategy<Value = Vec<Bounds>> {
        let corner = || prop::array::uniform3(coordinate());
        // Some without extent on some axes.
        let one = (corner(), corner(), prop::array::uniform3(prop::bool::weighted(0.2))).prop_map(
            |(a, b, flat)| Bounds {
                lower: [0, 1, 2].map(|axis| if flat[axis] { a[axis] } else { a[axis].min(b[axis]) }),
                upper: [0, 1, 2].map(|axis| if flat[axis] { a[axis] } else { a[axis].max(b[axis]) }),
            },
        );
        // Some far away and close to each other, where a step is finer than the rounding of coordinates.
        let near = (corner(), prop::collection::vec(corner(), 1..=most)).prop_map(|(at, offsets)| {
            let moved = |offset: [f32; 3], by: f32| {
                [0, 1, 2].map(|axis| (at[axis] + offset[axis].clamp(-1.0, 1.0) * at[axis] * 1e-6) + by)
            };
            offsets
                .into_iter()
                .map(|offset| Bounds { lower: moved(offset, 0.0), upper: moved(offset, 1e-3) })
                .collect()
        });
        prop_oneof![2 => prop::collection::vec(one, 1..=most), 1 => near]
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn eight_contain_their_originals(bounds in boxes(8)) {
            decoded_contain_the_originals::<8>(&bounds)?;
        }

        #[test]
        fn sixteen_contain_their_originals(bounds in boxes(16)) {
            decoded_contain_the_originals::<16>(&bounds)?;
        }
    }

    #[test]
    fn boxes_on_the_grid_are_kept_exactly() {
        let of = |lower, upper| Bounds { lower: [lower; 3], upper: [upper; 3] };
        let bounds = [of(-3.0, 252.0), of(-1.0, 7.0), of(5.0, 5.0)];
        let node = QuantisedNode::<8>::new(&bounds.map(|bounds| (bounds, NodeRef::EMPTY)));
        assert_eq!((node.step(0), node.count()), (1.0, 3));
        for (child, bounds) in bounds.into_iter().enumerate() {
            assert_eq!(node.child_bounds(child), bounds);
        }
    }
}
