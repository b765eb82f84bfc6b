//! Turns a binary hierarchy into one of eight-wide nodes of least expected cost.
//! [`Bvh2`] in → [`Node8`]s out; what leaves hold is the caller's affair.
//! Based on: Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017,
//! section 4.

use super::bounds::Bounds;
use super::bvh8::{Child, Node8};
use super::sah::{Bvh2, Node2};

/// Expected cost of testing a node's eight boxes. The costs of leaves are relative to it.
const NODE_COST: f32 = 1.0;
/// Children of a node.
const WIDTH: usize = 8;

/// What the collapse must know of leaves.
pub(super) trait Leaves {
    /// Cost of meeting the node's references as one leaf, weighted with the node's area; infinite if they cannot be one.
    fn cost(&self, node: &Node2) -> f32;
    /// Stores the leaf.
    fn emit(&mut self, node: &Node2) -> Child;
}

/// Result of a collapse.
pub(super) struct Collapsed {
    /// In depth-first order; empty if the root is a leaf.
    pub(super) nodes: Vec<Node8>,
    /// The root.
    pub(super) root: Child,
    /// Area-weighted cost of the whole.
    pub(super) cost: f32,
}

/// Least costs of a subtree that may use 1..8 slots of its parent: entry `i` is for `i + 1` slots.
type Costs = [f32; WIDTH - 1];

struct Collapse<'a, L> {
    bvh: &'a Bvh2,
    costs: Vec<Costs>,
    nodes: Vec<Node8>,
    leaves: &'a mut L,
}

/// Collapses a hierarchy that is not empty.
pub(super) fn collapse<L: Leaves>(bvh: &Bvh2, leaves: &mut L) -> Collapsed {
    let mut collapse = Collapse { bvh, costs: vec![[0.0; WIDTH - 1]; bvh.nodes.len()], nodes: Vec::new(), leaves };
    for index in (0..bvh.nodes.len()).rev() {
        collapse.costs[index] = collapse.node_costs(index);
    }
    let cost = collapse.costs[0][0];
    let root = collapse.emit(0);
    Collapsed { nodes: collapse.nodes, root, cost }
}

impl<L: Leaves> Collapse<'_, L> {
    /// Costs of node `index`, given those of its children.
    fn node_costs(&self, index: usize) -> Costs {
        let node = &self.bvh.nodes[index];
        let leaf = self.leaves.cost(node);
        if node.right == 0 {
            return [leaf; WIDTH - 1];
        }
        let mut costs = [0.0; WIDTH - 1];
        costs[0] = leaf.min(self.inner_cost(index));
        for slots in 2..WIDTH {
            costs[slots - 1] = costs[slots - 2].min(self.distribute(index, slots).0);
        }
        costs
    }

    /// Cost of the subtree as an inner node.
    fn inner_cost(&self, index: usize) -> f32 {
        self.distribute(index, WIDTH).0 + self.bvh.nodes[index].bounds.half_area() * NODE_COST
    }

    /// Least cost of both children within `slots` slots, and the left child's share.
    fn distribute(&self, index: usize, slots: usize) -> (f32, usize) {
        let (left, right) = (&self.costs[index + 1], &self.costs[self.bvh.nodes[index].right as usize]);
        let mut best = (f32::INFINITY, 1);
        for share in 1..slots {
            let cost = left[share - 1] + right[slots - share - 1];
            if cost < best.0 {
                best = (cost, share);
            }
        }
        best
    }

    /// Stores the subtree as one child.
    fn emit(&mut self, index: usize) -> Child {
        let node = &self.bvh.nodes[index];
        if node.right == 0 || self.leaves.cost(node) <= self.inner_cost(index) {
            return self.leaves.emit(node);
        }
        let mut roots = Vec::with_capacity(WIDTH);
        let share = self.distribute(index, WIDTH).1;
        self.roots(index + 1, share, &mut roots);
        self.roots(node.right as usize, WIDTH - share, &mut roots);

        let at = self.nodes.len();
        self.nodes.push(Node8::EMPTY);
        for (lane, &root) in roots.iter().enumerate() {
            let child = self.emit(root);
            let Bounds { min, max } = self.bvh.nodes[root].bounds;
            let wide = &mut self.nodes[at];
            wide.child[lane] = child;
            for axis in 0..3 {
                wide.planes[axis][lane] = min[axis];
                wide.planes[axis + 3][lane] = max[axis];
            }
        }
        Child::inner(at)
    }

    /// The subtrees that take the `slots` slots given to node `index`.
    fn roots(&self, index: usize, slots: usize, roots: &mut Vec<usize>) {
        if slots == 1 || self.bvh.nodes[index].right == 0 {
            roots.push(index);
            return;
        }
        let (cost, share) = self.distribute(index, slots);
        if self.costs[index][slots - 2] <= cost {
            self.roots(index, slots - 1, roots);
        } else {
            self.roots(index + 1, share, roots);
            self.roots(self.bvh.nodes[index].right as usize, slots - share, roots);
        }
    }
}
