//! From parameters to a tree.
//!
//! | `collapse` | steps |
//! |---|---|
//! | builder | Embree's builder makes nodes and leaves in their final form, in its own memory |
//! | optimal | it makes a binary sketch of single triangles; that is optimised, collapsed and written |
//!
//! With our own builder ([`Builder::Ploc`]) the binary tree of single triangles is always there first: it is
//! opened to wide nodes as it is, or collapsed and written as well.

use std::sync::Arc;

use super::binary::{BinaryTree, halved};
use super::grow::{Callbacks, EmbreeMemory, grow, references};
use super::sketch::{self, SketchRef, Sketched};
use super::write::{TriangleBlocks, write};
use super::{
    Memory, Tree, callbacks, collapse::collapse, emit::emit, occlusion::sort_children, plan::Plan,
    ploc::Ploc, reinsertion::optimise,
};
use crate::layout::{Block, Bounds, NodeRef, Root, TreeNode, for_block, for_node};
use crate::parameters::{Builder, Collapse, TreeParameters};
use crate::traverse::{Isa, Kernels};
use crate::{embree::Device, error::BuildError, geometry::Triangles, limits::MAX_DEPTH};

impl Tree {
    pub(crate) fn build(
        device: &Device,
        triangles: &Arc<Triangles>,
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        parameters.check()?;
        let isa = Isa::detect();
        let kernels = Kernels::select(isa, parameters)
            .expect("the parameters were checked and the instruction set detected");
        let (memory, node) = if triangles.is_empty() {
            (Memory::None, NodeRef::EMPTY)
        } else if parameters.collapse == Collapse::Builder {
            build_in_place(device, triangles, parameters)?
        } else {
            let plan = plan(device, triangles, parameters)?;
            if plan.depth > parameters.max_depth {
                return Err(BuildError::DepthLimit(parameters.max_depth));
            }
            let (arena, node) = for_node!(parameters, N => for_block!(parameters, B => {
                let blocks = TriangleBlocks::<B> { triangles, watertight: parameters.robust };
                write::<N, _>(&plan, &blocks)
            }))?;
            (Memory::Own(arena), node)
        };
        let bounds = bounds_below(node, parameters, triangles);
        if !matches!(memory, Memory::Slabs(_)) {
            // SAFETY: the tree was just made with these parameters, and no other reference to it exists yet.
            for_node!(parameters, N => for_block!(parameters, B => unsafe {
                sort_children::<N, B>(node, bounds, parameters);
            }));
        }
        let root = Root { node, bounds, triangles: Arc::clone(triangles) };
        Ok(Self { root, kernels, isa, parameters: *parameters, motion: None, _memory: memory })
    }
}

/// Lets the builder make the final nodes and leaves.
fn build_in_place(
    device: &Device,
    triangles: &Triangles,
    parameters: &TreeParameters,
) -> Result<(Memory, NodeRef), BuildError> {
    if parameters.builder == Builder::Ploc {
        let ploc = Ploc::build(triangles, parameters);
        let (slabs, node) = for_node!(parameters, N => for_block!(parameters, B =>
            emit::<N, B>(&ploc, triangles, parameters)))?;
        return Ok((Memory::Slabs(slabs), node));
    }
    fn of_nodes<N: TreeNode, const B: usize>() -> Callbacks {
        Callbacks {
            create_node: Some(callbacks::create_node::<N>),
            set_children: Some(callbacks::set_children::<N>),
            set_bounds: Some(callbacks::set_bounds::<N>),
            create_leaf: Some(callbacks::create_leaf::<B>),
        }
    }
    let callbacks = for_node!(parameters, N => for_block!(parameters, B => of_nodes::<N, B>()));
    let memory = EmbreeMemory::new(device)?;
    let primitives = references(triangles.len(), parameters, box_of(triangles))?;
    // SAFETY: the callbacks are of the width of these parameters' nodes.
    let root = unsafe { grow(&memory, triangles, primitives, parameters, &callbacks)? };
    Ok((Memory::Embree(memory), NodeRef::from_raw(root)))
}

/// The wide tree of least cost over the builder's binary one.
fn plan(device: &Device, triangles: &Triangles, parameters: &TreeParameters) -> Result<Plan, BuildError> {
    if parameters.builder == Builder::Ploc {
        return Ok(collapsed(Ploc::build(triangles, parameters).into_binary(), parameters));
    }
    // The limit of depth is that of the wide tree, which is far shallower.
    let binary = TreeParameters {
        branching_factor: 2,
        max_depth: *MAX_DEPTH.end(),
        min_leaf_size: 1,
        max_leaf_size: 1,
        sah_block_size: 1,
        ..*parameters
    };
    let tree = sketched(device, triangles, triangles.len(), box_of(triangles), &binary)?;
    Ok(collapsed(tree, parameters))
}

/// The optimised wide tree over one or more boxes. Each leaf has the number of one box.
pub(super) fn plan_over(
    device: &Device,
    boxes: &[Bounds],
    branching_factor: u32,
    reinsertion_passes: u32,
) -> Result<Plan, BuildError> {
    let one_each =
        TreeParameters { max_depth: *MAX_DEPTH.end(), max_leaf_size: 1, ..TreeParameters::default() };
    let tree = sketched(device, &Triangles::default(), boxes.len(), |number| boxes[number], &one_each)?;
    Ok(collapsed(tree, &TreeParameters { branching_factor, reinsertion_passes, ..one_each }))
}

/// As [`plan_over`], from halves of the list: where that tree would be too deep.
pub(super) fn plan_over_halves(boxes: &[Bounds], branching_factor: u32, reinsertion_passes: u32) -> Plan {
    let one_each = TreeParameters { max_leaf_size: 1, ..TreeParameters::default() };
    collapsed(halved(boxes), &TreeParameters { branching_factor, reinsertion_passes, ..one_each })
}

fn box_of(triangles: &Triangles) -> impl Fn(usize) -> Bounds + Sync {
    move |number| Bounds::of_corners(&triangles.corners(number))
}

/// The wide tree of least cost, after optimisation.
fn collapsed(mut tree: BinaryTree, parameters: &TreeParameters) -> Plan {
    optimise(&mut tree, parameters.reinsertion_passes);
    for_node!(parameters, N => collapse::<{ N::WIDTH }>(&tree, parameters))
}

/// The binary tree of single boxes (of `triangles` where it splits) that Embree's builder sketches.
fn sketched(
    device: &Device,
    triangles: &Triangles,
    count: usize,
    bounds: impl Fn(usize) -> Bounds + Sync,
    parameters: &TreeParameters,
) -> Result<BinaryTree, BuildError> {
    let callbacks = Callbacks {
        create_node: Some(sketch::create_node),
        set_children: Some(sketch::set_children),
        set_bounds: Some(sketch::set_bounds),
        create_leaf: Some(sketch::create_leaf),
    };
    let memory = EmbreeMemory::new(device)?;
    let primitives = references(count, parameters, &bounds)?;
    // SAFETY: the callbacks are for nodes of two children.
    let root = unsafe { grow(&memory, triangles, primitives, parameters, &callbacks)? };
    let root = SketchRef::from_raw(root);
    // SAFETY: the build succeeded, and its memory lives.
    let around = match unsafe { root.follow() } {
        Sketched::Node(node) => node.children().map(|(bounds, _)| bounds).fold(Bounds::EMPTY, Bounds::union),
        Sketched::Leaf(number) => bounds(number as usize),
    };
    // SAFETY: as above.
    Ok(unsafe { BinaryTree::from_sketch(root, around) })
}

/// Box of the triangles below a node or leaf, from it alone.
fn bounds_below(node: NodeRef, parameters: &TreeParameters, triangles: &Triangles) -> Bounds {
    fn of_children<N: TreeNode>(node: NodeRef) -> Bounds {
        // SAFETY: the builder, or `write`, made this node of the kind `N`, and its memory lives.
        let node = unsafe { node.node::<N>() };
        (0..node.count()).map(|child| node.child_bounds(child)).fold(Bounds::EMPTY, Bounds::union)
    }
    fn of_blocks<const B: usize>(node: NodeRef, triangles: &Triangles) -> Bounds {
        // SAFETY: they made this leaf of blocks of width `B`, and its memory lives.
        let blocks = unsafe { node.blocks::<B>() };
        let numbers = blocks.iter().flat_map(Block::numbers);
        numbers
            .map(|number| Bounds::of_corners(&triangles.corners(number as usize)))
            .fold(Bounds::EMPTY, Bounds::union)
    }
    match node.is_leaf() {
        true => for_block!(parameters, B => of_blocks::<B>(node, triangles)),
        false => for_node!(parameters, N => of_children::<N>(node)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{binary::tests::boxes, ploc::tests::over, walk::Met};
    use super::*;

    /// The boxes of all children, node by node.
    fn children(tree: &Tree) -> Vec<Bounds> {
        let mut all = Vec::new();
        tree.walk(&mut |met| {
            if let Met::Node { children, .. } = met {
                all.extend_from_slice(children);
            }
        });
        all
    }

    proptest::proptest! {
        #[test]
        fn whoever_built_a_tree_its_children_are_in_the_order_for_shadow_rays(boxes in boxes()) {
            let device = Device::open(0).expect("Embree starts");
            let triangles = Arc::new(over(&boxes));
            for builder in [Builder::Embree, Builder::Ploc] {
                for collapse in [Collapse::Builder, Collapse::Optimal] {
                    let parameters = TreeParameters {
                        builder,
                        collapse,
                        branching_factor: 8,
                        max_leaf_size: 4,
                        max_depth: 64,
                        ..TreeParameters::default()
                    };
                    let tree = Tree::build(&device, &triangles, &parameters).expect("it builds");
                    let built = children(&tree);
                    let Root { node, bounds, .. } = tree.root;
                    // SAFETY: the tree has these parameters, and nothing else looks at it meanwhile.
                    for_node!(parameters, N => for_block!(parameters, B => unsafe {
                        sort_children::<N, B>(node, bounds, &parameters);
                    }));
                    proptest::prop_assert!(built == children(&tree), "{:?}", parameters);
                }
            }
        }
    }
}
