//! Builds the wide hierarchy over references, in parallel pieces.
//!
//! The top of the binary hierarchy is split into treelets. They are built and planned one by one, their costs go into the
//! plan of the top, and each is collapsed into as many of its parent's slots as that plan gives it: the result is that of
//! one piece, while the binary nodes of a treelet live no longer than it takes.

use super::bounds::{INSTANCE, Reference};
use super::bvh8::{Bvh8, Child, Node8, StoredTriangle, Tri4};
use super::collapse::{Costs, Leaves, Plan, Root, WIDTH, emit, plan};
use super::pages::with_large_pages;
use super::sah::{self, Bvh2, Node2};
use rayon::prelude::*;

/// Cost of testing a block of triangles, relative to a node.
const BLOCK_COST: f32 = 0.6;
/// Cost of entering an instance, relative to a node.
const INSTANCE_COST: f32 = 12.0;
/// Most blocks of a leaf.
const LEAF_BLOCKS: usize = 2;
/// References that are built and planned as one task.
const TREELET: usize = 1 << 14;

/// Builds the hierarchy over `references`; `stored` gives the triangle of an id.
pub(super) fn assemble<S: Fn(u32) -> StoredTriangle + Sync>(mut references: Vec<Reference>, stored: &S) -> Bvh8 {
    if references.is_empty() {
        return Bvh8 { blocks: vec![Tri4::new([])], ..Bvh8::EMPTY };
    }
    let top = sah::build(&mut references, TREELET, 0);
    let treelets = treelets(&top, &mut references, stored);

    // A first walk of the top finds out how many slots it gives to every treelet, the second links what came of them.
    let mut leaves = TreeletLeaves {
        first: treelets.iter().map(|t| t.first).collect(),
        costs: treelets.iter().map(|t| t.plan.costs).collect(),
        slots: vec![0; treelets.len()],
        roots: Vec::new(),
    };
    let top_plan = plan(&top, &leaves);
    emit(&top, &top_plan, 1, &mut leaves, &mut Vec::new());
    let collapse = |(treelet, &slots): (Treelet, &usize)| {
        let mut leaves = BlockLeaves { references: treelet.references, stored, blocks: Vec::new() };
        let mut nodes = Vec::new();
        let roots = emit(&treelet.bvh, &treelet.plan, slots, &mut leaves, &mut nodes);
        (roots, nodes, leaves.blocks)
    };
    let parts: Vec<_> = treelets.into_par_iter().zip(&leaves.slots).map(collapse).collect();
    drop(references);

    // Nodes of the top come first; a binary hierarchy of k leaves has fewer than k inner nodes.
    let top_room = parts.len() - 1;
    let mut bvh = Bvh8 {
        nodes: with_large_pages(top_room + parts.iter().map(|(_, nodes, _)| nodes.len()).sum::<usize>()),
        blocks: with_large_pages(1 + parts.iter().map(|(.., blocks)| blocks.len()).sum::<usize>()),
        ..Bvh8::EMPTY
    };
    bvh.nodes.resize(top_room, Node8::EMPTY);
    bvh.blocks.push(Tri4::new([]));
    for (roots, nodes, blocks) in parts {
        let shift = bvh.append(nodes, blocks.into_iter());
        leaves.roots.push(roots.into_iter().map(|(child, bounds)| (child.shifted(shift), bounds)).collect());
    }
    let mut top_nodes = Vec::new();
    let roots = emit(&top, &top_plan, 1, &mut leaves, &mut top_nodes);
    bvh.nodes[..top_nodes.len()].copy_from_slice(&top_nodes);
    bvh.root = Some(roots[0].0);
    bvh
}

/// A run of references with its part of the hierarchy: first planned, later collapsed.
struct Treelet<'a> {
    references: &'a [Reference],
    first: usize,
    bvh: Bvh2,
    plan: Plan,
}

/// Builds and plans the subtree below every leaf of `top`, in order.
fn treelets<'a, S: Fn(u32) -> StoredTriangle + Sync>(
    top: &Bvh2,
    references: &'a mut [Reference],
    stored: &S,
) -> Vec<Treelet<'a>> {
    let mut depths = vec![0; top.nodes.len()];
    let mut parts = Vec::new();
    let (mut rest, mut first) = (references, 0);
    for (index, node) in top.nodes.iter().enumerate() {
        if let Some(right) = node.right() {
            depths[index + 1] = depths[index] + 1;
            depths[right] = depths[index] + 1;
        } else {
            let (part, after) = rest.split_at_mut(node.count());
            parts.push((first, depths[index], part));
            (rest, first) = (after, first + node.count());
        }
    }
    let build = |(first, depth, references): (usize, usize, &'a mut [Reference])| {
        let bvh = sah::build(references, 1, depth);
        let leaves = BlockLeaves { references, stored, blocks: Vec::new() };
        let plan = plan(&bvh, &leaves);
        Treelet { first, references, bvh, plan }
    };
    parts.into_par_iter().map(build).collect()
}

/// Leaves of triangles and instances.
struct BlockLeaves<'a, S> {
    references: &'a [Reference],
    stored: &'a S,
    blocks: Vec<Tri4>,
}

impl<S: Fn(u32) -> StoredTriangle> Leaves for BlockLeaves<'_, S> {
    fn costs(&self, node: &Node2, first: usize) -> Costs {
        let blocks = node.count().div_ceil(Tri4::LANES);
        let cost = if blocks > LEAF_BLOCKS {
            f32::INFINITY
        } else if self.references[first..][..node.count()].iter().all(|r| r.id() & INSTANCE == 0) {
            blocks as f32 * BLOCK_COST
        } else if node.count() == 1 {
            INSTANCE_COST
        } else {
            f32::INFINITY
        };
        [if cost.is_finite() { cost * node.bounds().half_area() } else { cost }; WIDTH - 1]
    }

    fn emit(&mut self, node: &Node2, first: usize, _: usize, roots: &mut Vec<Root>) {
        let ids: Vec<u32> = self.references[first..][..node.count()].iter().map(Reference::id).collect();
        let child = if ids[0] & INSTANCE != 0 {
            Child::instance((ids[0] & !INSTANCE) as usize)
        } else {
            // Index zero is that of the empty block.
            let block = 1 + self.blocks.len();
            self.blocks.extend(ids.chunks(Tri4::LANES).map(|ids| Tri4::new(ids.iter().map(|&id| (self.stored)(id)))));
            Child::leaf(block, ids.len().div_ceil(Tri4::LANES))
        };
        roots.push((child, node.bounds()));
    }
}

/// Leaves of the top, which stand for treelets.
struct TreeletLeaves {
    /// First reference of every treelet.
    first: Vec<usize>,
    costs: Vec<Costs>,
    /// Slots that each treelet was given.
    slots: Vec<usize>,
    /// What each treelet was collapsed to, once that is known.
    roots: Vec<Vec<Root>>,
}

impl TreeletLeaves {
    fn find(&self, first: usize) -> usize {
        self.first.partition_point(|&f| f < first)
    }
}

impl Leaves for TreeletLeaves {
    fn costs(&self, node: &Node2, first: usize) -> Costs {
        if node.right().is_none() { self.costs[self.find(first)] } else { [f32::INFINITY; WIDTH - 1] }
    }

    fn emit(&mut self, _: &Node2, first: usize, slots: usize, roots: &mut Vec<Root>) {
        let treelet = self.find(first);
        self.slots[treelet] = slots;
        roots.extend(self.roots.get(treelet).into_iter().flatten());
    }
}
