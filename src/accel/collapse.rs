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
pub(super) const WIDTH: usize = 8;

/// Least area-weighted costs of a subtree that may use 1..8 slots of its parent: entry `i` is for `i + 1` slots.
pub(super) type Costs = [f32; WIDTH - 1];

/// A child and its box.
pub(super) type Root = (Child, Bounds);

/// What the collapse must know of the leaves of the wide hierarchy.
pub(super) trait Leaves {
    /// Costs of making one leaf of everything below the node, whose references start at `first`; infinite if it cannot be
    /// one.
    fn costs(&self, node: &Node2, first: usize) -> Costs;
    /// Stores the leaf as at most `slots` children.
    fn emit(&mut self, node: &Node2, first: usize, slots: usize, roots: &mut Vec<Root>);
}

/// Which subtrees become leaves, and how every inner node shares its slots out.
pub(super) struct Plan {
    /// Costs of the whole hierarchy.
    pub(super) costs: Costs,
    choices: Vec<Choice>,
}

/// The left child's share of `slots` slots in four bits each, for 2 to 8 slots; zero is "use one slot less". The lowest four
/// bits are one if a single slot is best used by a leaf.
#[derive(Clone, Copy)]
struct Choice(u32);

impl Choice {
    const INNER: Self = Self(0);
    const LEAF: Self = Self(1);

    fn share(self, slots: usize) -> usize {
        (self.0 >> (4 * (slots - 1)) & 7) as usize
    }

    fn with_share(self, slots: usize, share: usize) -> Self {
        Self(self.0 | (share as u32) << (4 * (slots - 1)))
    }

    fn is_leaf(self) -> bool {
        self.0 & 1 == 1
    }
}

/// Finds the cheapest collapse of a hierarchy that is not empty.
pub(super) fn plan(bvh: &Bvh2, leaves: &impl Leaves) -> Plan {
    let mut choices = vec![Choice::LEAF; bvh.nodes.len()];
    let costs = plan_subtree(bvh, leaves, 0, 0, &mut choices);
    Plan { costs, choices }
}

fn plan_subtree(bvh: &Bvh2, leaves: &impl Leaves, index: usize, first: usize, choices: &mut [Choice]) -> Costs {
    let node = &bvh.nodes[index];
    let leaf = leaves.costs(node, first);
    let Some(right) = node.right() else { return leaf };
    let middle = first + bvh.nodes[index + 1].count();
    let left = plan_subtree(bvh, leaves, index + 1, first, choices);
    let right = plan_subtree(bvh, leaves, right, middle, choices);

    let (cost, share) = distribute(&left, &right, WIDTH);
    let inner = cost + node.bounds().half_area() * NODE_COST;
    let mut choice = if leaf[0] <= inner { Choice::LEAF } else { Choice::INNER }.with_share(WIDTH, share);
    let mut costs = [leaf[0].min(inner); WIDTH - 1];
    for slots in 2..WIDTH {
        let (cost, share) = distribute(&left, &right, slots);
        costs[slots - 1] = costs[slots - 2];
        if cost < costs[slots - 2] {
            costs[slots - 1] = cost;
            choice = choice.with_share(slots, share);
        }
    }
    choices[index] = choice;
    costs
}

/// Least cost of two siblings within `slots` slots, and the left one's share.
fn distribute(left: &Costs, right: &Costs, slots: usize) -> (f32, usize) {
    let mut best = (f32::INFINITY, 1);
    for share in 1..slots {
        let cost = left[share - 1] + right[slots - share - 1];
        if cost < best.0 {
            best = (cost, share);
        }
    }
    best
}

/// Collapses the hierarchy as planned into at most `slots` children; `nodes` receives the nodes below them.
pub(super) fn emit<L: Leaves>(
    bvh: &Bvh2,
    plan: &Plan,
    slots: usize,
    leaves: &mut L,
    nodes: &mut Vec<Node8>,
) -> Vec<Root> {
    let mut roots = Vec::with_capacity(slots);
    Emission { bvh, plan, leaves, nodes }.roots(0, 0, slots, &mut roots);
    roots
}

struct Emission<'a, L> {
    bvh: &'a Bvh2,
    plan: &'a Plan,
    leaves: &'a mut L,
    nodes: &'a mut Vec<Node8>,
}

impl<L: Leaves> Emission<'_, L> {
    /// Collapses the subtree at `index`, whose references start at `first`, into at most `slots` children.
    fn roots(&mut self, index: usize, first: usize, slots: usize, roots: &mut Vec<Root>) {
        let node = self.bvh.nodes[index];
        let choice = self.plan.choices[index];
        if node.right().is_none() {
            self.leaves.emit(&node, first, slots, roots);
        } else if slots == 1 && choice.is_leaf() {
            self.leaves.emit(&node, first, 1, roots);
        } else if slots == 1 {
            roots.push((self.node(index, first), node.bounds()));
        } else {
            match choice.share(slots) {
                0 => self.roots(index, first, slots - 1, roots),
                share => self.children(index, first, share, slots - share, roots),
            }
        }
    }

    /// Collapses the children of the node at `index` into at most so many children each.
    fn children(&mut self, index: usize, first: usize, left: usize, right: usize, roots: &mut Vec<Root>) {
        self.roots(index + 1, first, left, roots);
        if let Some(right_index) = self.bvh.nodes[index].right() {
            let middle = first + self.bvh.nodes[index + 1].count();
            self.roots(right_index, middle, right, roots);
        }
    }

    /// Stores a wide node for the subtree at `index`.
    fn node(&mut self, index: usize, first: usize) -> Child {
        let at = self.nodes.len();
        self.nodes.push(Node8::EMPTY);
        let share = self.plan.choices[index].share(WIDTH);
        let mut children = Vec::with_capacity(WIDTH);
        self.children(index, first, share, WIDTH - share, &mut children);
        self.nodes[at] = Node8::new(&children);
        Child::inner(at)
    }
}
