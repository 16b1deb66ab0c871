//! Inner nodes, of any width.

use super::{Bounds, NodeRef, WIDTH_MAX};

/// An inner node with up to [`TreeNode::WIDTH`] children, in the first places.
pub(crate) trait TreeNode: Copy + Send + Sync + 'static {
    /// Most children, at most [`WIDTH_MAX`].
    const WIDTH: usize;
    const EMPTY: Self;

    /// Sets the bounds of the first children, which thereby are in use; the other places become unused.
    fn set_bounds(&mut self, bounds: &[Bounds]);

    /// The references to the children, [`TreeNode::WIDTH`] of them; unused places hold [`NodeRef::EMPTY`].
    fn children(&self) -> &[NodeRef];

    fn children_mut(&mut self) -> &mut [NodeRef];

    /// Puts the child of place `order[p]` into place `p`, for the first [`TreeNode::WIDTH`] places.
    fn permute(&mut self, order: &[u8; WIDTH_MAX]);

    /// The number of places in use.
    fn count(&self) -> usize;

    /// Bounds of one child in use, as rays meet them: they contain what [`TreeNode::set_bounds`] was given.
    fn child_bounds(&self, child: usize) -> Bounds;

    /// A node of these children. Shadow rays go to the last first: the likeliest to end them belongs there.
    fn new(children: &[(Bounds, NodeRef)]) -> Self {
        assert!(children.len() <= Self::WIDTH, "a node holds {} children", Self::WIDTH);
        let mut node = Self::EMPTY;
        let mut bounds = [Bounds::EMPTY; WIDTH_MAX];
        for (place, (of_child, child)) in children.iter().enumerate() {
            bounds[place] = *of_child;
            node.children_mut()[place] = *child;
        }
        node.set_bounds(&bounds[..children.len()]);
        node
    }
}

/// Single-precision bounds. Unused places have inverted ones, which no ray meets.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node<const W: usize> {
    /// `bounds[axis][side][child]`, side 0 being the lower one.
    pub(crate) bounds: [[[f32; W]; 2]; 3],
    pub(crate) children: [NodeRef; W],
}

const _: () = {
    assert!(size_of::<Node<2>>() == 64);
    assert!(size_of::<Node<4>>() == 128);
    assert!(size_of::<Node<8>>() == 256);
    assert!(size_of::<Node<16>>() == 512);
};

impl<const W: usize> TreeNode for Node<W> {
    const WIDTH: usize = W;
    const EMPTY: Self =
        Self { bounds: [[[f32::INFINITY; W], [f32::NEG_INFINITY; W]]; 3], children: [NodeRef::EMPTY; W] };

    fn set_bounds(&mut self, bounds: &[Bounds]) {
        self.bounds = Self::EMPTY.bounds;
        for (child, of_child) in bounds.iter().enumerate() {
            for axis in 0..3 {
                self.bounds[axis][0][child] = of_child.lower[axis];
                self.bounds[axis][1][child] = of_child.upper[axis];
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
        let Self { bounds, children } = *self;
        for (place, from) in order[..W].iter().enumerate() {
            let from = usize::from(*from);
            self.children[place] = children[from];
            for (to, row) in self.bounds.as_flattened_mut().iter_mut().zip(bounds.as_flattened()) {
                to[place] = row[from];
            }
        }
    }

    fn count(&self) -> usize {
        let [lower, upper] = &self.bounds[0];
        lower.iter().zip(upper).take_while(|(lower, upper)| lower <= upper).count()
    }

    fn child_bounds(&self, child: usize) -> Bounds {
        let side = |side: usize| [0, 1, 2].map(|axis| self.bounds[axis][side][child]);
        Bounds { lower: side(0), upper: side(1) }
    }
}
