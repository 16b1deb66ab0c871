//! A wide tree by numbers, before it gets a layout and a place in memory.

use crate::layout::Bounds;

/// A node or a leaf of a [`Plan`], by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link(u32);

const LEAF_BIT: u32 = 1 << 31;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Named {
    Node(usize),
    Leaf(usize),
}

impl Link {
    pub(super) fn node(number: usize) -> Self {
        Self(number as u32)
    }

    pub(super) fn leaf(number: usize) -> Self {
        Self(number as u32 | LEAF_BIT)
    }

    pub(super) fn named(self) -> Named {
        match self.0 & LEAF_BIT {
            0 => Named::Node(self.0 as usize),
            _ => Named::Leaf((self.0 & !LEAF_BIT) as usize),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Child {
    pub(super) bounds: Bounds,
    pub(super) link: Link,
}

/// A run of entries in one of the plan's arrays.
#[derive(Clone, Copy, Debug)]
struct Run {
    first: u32,
    count: u32,
}

impl Run {
    fn of<T>(self, all: &[T]) -> &[T] {
        &all[self.first as usize..][..self.count as usize]
    }
}

/// The tree: nodes are runs of children, level by level, leaves are runs of triangle numbers.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) root: Child,
    nodes: Vec<Run>,
    children: Vec<Child>,
    leaves: Vec<Run>,
    references: Vec<u32>,
    /// Levels below the root.
    pub(super) depth: u32,
}

impl Plan {
    pub(super) fn with_capacity(nodes: usize, leaves: usize, references: usize) -> Self {
        Self {
            root: Child { bounds: Bounds::EMPTY, link: Link::leaf(0) },
            nodes: Vec::with_capacity(nodes),
            children: Vec::with_capacity(nodes + leaves),
            leaves: Vec::with_capacity(leaves),
            references: Vec::with_capacity(references),
            depth: 0,
        }
    }

    /// Grows the tree by levels. `open` adds and returns a leaf, or lists a node's children in order.
    pub(super) fn grow<T: Copy>(
        &mut self,
        root: (Bounds, T),
        mut open: impl FnMut(&mut Self, T, &mut Vec<(Bounds, T)>) -> Option<Link>,
    ) {
        self.root.bounds = root.0;
        let mut found = Vec::new();
        // The item to open, and the place of its link among the children; the root's has a place of its own.
        let mut level = vec![(root.1, None::<usize>)];
        let mut next = Vec::new();
        loop {
            for (item, place) in level.drain(..) {
                found.clear();
                let link = open(self, item, &mut found).unwrap_or_else(|| {
                    self.nodes.push(Run { first: self.children.len() as u32, count: found.len() as u32 });
                    for &(bounds, child) in &found {
                        next.push((child, Some(self.children.len())));
                        self.children.push(Child { bounds, link: Link::leaf(0) });
                    }
                    Link::node(self.nodes.len() - 1)
                });
                match place {
                    Some(place) => self.children[place].link = link,
                    None => self.root.link = link,
                }
            }
            if next.is_empty() {
                return;
            }
            self.depth += 1;
            std::mem::swap(&mut level, &mut next);
        }
    }

    /// Adds a leaf of these triangles. Those that splits have brought in twice are kept once.
    pub(super) fn add_leaf(&mut self, triangles: impl IntoIterator<Item = u32>) -> Link {
        let first = self.references.len();
        for triangle in triangles {
            if !self.references[first..].contains(&triangle) {
                self.references.push(triangle);
            }
        }
        self.leaves.push(Run { first: first as u32, count: (self.references.len() - first) as u32 });
        Link::leaf(self.leaves.len() - 1)
    }

    /// Fits all boxes to those of what leaves hold, by its numbers.
    pub(super) fn fit(&mut self, boxes: impl Fn(u32) -> Bounds) {
        let mut of_nodes = vec![Bounds::EMPTY; self.nodes.len()];
        // Children have higher numbers than their parents.
        for node in (0..self.nodes.len()).rev() {
            let Run { first, count } = self.nodes[node];
            for child in first as usize..(first + count) as usize {
                let bounds = self.around(self.children[child].link, &of_nodes, &boxes);
                self.children[child].bounds = bounds;
                of_nodes[node] = of_nodes[node].union(bounds);
            }
        }
        self.root.bounds = self.around(self.root.link, &of_nodes, &boxes);
    }

    fn around(&self, link: Link, of_nodes: &[Bounds], boxes: &impl Fn(u32) -> Bounds) -> Bounds {
        match link.named() {
            Named::Node(node) => of_nodes[node],
            Named::Leaf(leaf) => {
                self.triangles(leaf).iter().map(|number| boxes(*number)).fold(Bounds::EMPTY, Bounds::union)
            }
        }
    }

    /// How many of its boxes a ray meets that meets the root's, by the surface area heuristic.
    pub(super) fn boxes_met(&self) -> f64 {
        let area: f64 = self.children.iter().map(|child| child.bounds.half_area()).sum();
        let own = self.root.bounds.half_area();
        if own > 0.0 { area / own } else { 1.0 }
    }

    /// Number of inner nodes.
    pub(super) fn nodes(&self) -> usize {
        self.nodes.len()
    }

    pub(super) fn leaves(&self) -> usize {
        self.leaves.len()
    }

    pub(super) fn children(&self, node: usize) -> &[Child] {
        self.nodes[node].of(&self.children)
    }

    pub(super) fn triangles(&self, leaf: usize) -> &[u32] {
        self.leaves[leaf].of(&self.references)
    }
}
