//! From the scene's triangles to the wide hierarchy.

use super::alpha::alpha_test;
use super::bounds::{Bounds, Reference};
use super::bvh8::{AlphaTest, Child, MAX_INSTANCES, Node8, StoredTriangle, Tag, Tri4};
use super::collapse::{Collapsed, Leaves, collapse};
use super::{Builder, ploc};
use super::sah::{self, Bvh2, Node2};
use super::traverse::Bvh8;
use crate::scene::Scene;
use rayon::prelude::*;

/// Cost of testing a block of triangles, relative to a node.
const BLOCK_COST: f32 = 1.0;
/// Most blocks of a leaf.
const LEAF_BLOCKS: usize = 2;
/// References that are built and collapsed as one task; bounds the memory that binary nodes take.
const TREELET: usize = 1 << 14;

/// Builds over every triangle that can stop a ray.
pub(super) fn build(scene: &Scene, builder: Builder) -> Bvh8 {
    let triangles = WorldTriangles::new(scene);
    let mut references = triangles.references();
    assemble(&mut references, &|id| triangles.stored(id), builder)
}

/// The triangles of all casting instances, numbered through.
struct WorldTriangles<'a> {
    scene: &'a Scene,
    /// First number of every instance, and the end.
    first: Vec<u32>,
}

impl<'a> WorldTriangles<'a> {
    fn new(scene: &'a Scene) -> Self {
        assert!(scene.instances.len() <= MAX_INSTANCES, "more instances than ids");
        let mut first = Vec::with_capacity(scene.instances.len() + 1);
        let mut count = 0usize;
        for instance in &scene.instances {
            first.push(count as u32);
            if instance.casts_shadows {
                count += scene.meshes[instance.mesh].triangles.len();
            }
        }
        assert!(count < i32::MAX as usize, "more triangles than ids");
        first.push(count as u32);
        Self { scene, first }
    }

    /// Boxes of all triangles that are finite and not wholly transparent.
    fn references(&self) -> Vec<Reference> {
        let instances = 0..self.scene.instances.len();
        let parts = instances.into_par_iter().flat_map_iter(|instance| {
            let first = self.first[instance];
            (0..self.first[instance + 1] - first).filter_map(move |triangle| {
                let corners = self.scene.corners(instance, triangle as usize);
                let solid = alpha_test(self.scene, instance, triangle as usize).is_some();
                (solid && corners.iter().all(|c| c.is_finite()))
                    .then(|| Reference::new(Bounds::of_points(corners).padded(), first + triangle))
            })
        });
        parts.collect()
    }

    fn stored(&self, id: u32) -> StoredTriangle {
        // Instances without triangles share their first number with the next.
        let instance = self.first.partition_point(|&first| first <= id) - 1;
        let triangle = id - self.first[instance];
        let alpha = alpha_test(self.scene, instance, triangle as usize).unwrap_or(AlphaTest::None);
        StoredTriangle {
            corners: self.scene.corners(instance, triangle as usize),
            tag: Tag::new(instance, self.scene.instances[instance].flips(), alpha),
            triangle,
        }
    }
}

/// Leaves of triangles and instances.
struct BlockLeaves<'a, S> {
    references: &'a [Reference],
    /// What the nodes take for the first of `references`.
    first: usize,
    stored: &'a S,
    blocks: Vec<Tri4>,
}

impl<S: Fn(u32) -> StoredTriangle> BlockLeaves<'_, S> {
    fn members(&self, node: &Node2) -> &[Reference] {
        &self.references[node.first as usize - self.first..][..node.count as usize]
    }
}

impl<S: Fn(u32) -> StoredTriangle> Leaves for BlockLeaves<'_, S> {
    fn cost(&self, node: &Node2) -> f32 {
        let blocks = (node.count as usize).div_ceil(Tri4::LANES);
        if blocks > LEAF_BLOCKS { f32::INFINITY } else { node.bounds.half_area() * blocks as f32 * BLOCK_COST }
    }

    fn emit(&mut self, node: &Node2) -> Child {
        let ids: Vec<u32> = self.members(node).iter().map(Reference::id).collect();
        // Block zero of the whole structure is the empty one.
        let first = 1 + self.blocks.len();
        self.blocks.extend(ids.chunks(Tri4::LANES).map(|ids| Tri4::new(ids.iter().map(|&id| (self.stored)(id)))));
        Child::leaf(first, ids.len().div_ceil(Tri4::LANES))
    }
}

/// Leaves that stand for collapsed treelets.
struct TreeletLeaves<'a> {
    treelets: &'a [Treelet],
    /// Where the nodes and blocks of every treelet go.
    offsets: &'a [(usize, usize)],
}

/// A run of references with their part of the hierarchy.
struct Treelet {
    first: u32,
    collapsed: Collapsed,
    blocks: Vec<Tri4>,
}

impl TreeletLeaves<'_> {
    fn find(&self, node: &Node2) -> usize {
        self.treelets.partition_point(|t| t.first < node.first)
    }
}

impl Leaves for TreeletLeaves<'_> {
    fn cost(&self, node: &Node2) -> f32 {
        if node.right == 0 { self.treelets[self.find(node)].collapsed.cost } else { f32::INFINITY }
    }

    fn emit(&mut self, node: &Node2) -> Child {
        let treelet = self.find(node);
        let (nodes, blocks) = self.offsets[treelet];
        self.treelets[treelet].collapsed.root.shifted(nodes, blocks)
    }
}

/// Builds the hierarchy over `references`; `stored` gives the triangle of an id.
fn assemble<S: Fn(u32) -> StoredTriangle + Sync>(references: &mut Vec<Reference>, stored: &S, builder: Builder) -> Bvh8 {
    if references.is_empty() {
        return Bvh8 { nodes: Vec::new(), blocks: vec![Tri4::new([])], root: None };
    }
    let ratio = std::env::var("RATIO").map_or(0.1, |s| s.parse().unwrap());
    let full = match builder {
        Builder::Sah => None,
        Builder::Ploc => ploc::build(references),
        Builder::SahReinsertion => {
            let b = sah::build(references, 0, 1, 0);
            ploc::optimise(&b, references, ratio)
        }
    };
    if let Some(bvh) = full {
        let mut leaves = BlockLeaves { references, first: 0, stored, blocks: vec![Tri4::new([])] };
        let collapsed = collapse(&bvh, &mut leaves);
        eprintln!("cost {}", collapsed.cost / bvh.nodes[0].bounds.half_area());
        return Bvh8 { nodes: collapsed.nodes.iter().map(|n| Node8{child: n.child.map(|c| if c.is_inner()||c==Child::EMPTY {c} else {Child::leaf(c.index()-1, c.blocks())}), ..*n}).collect(), blocks: leaves.blocks, root: Some(collapsed.root) };
    }
    let top = sah::build(references, 0, TREELET, 0);
    let area = top.nodes[0].bounds.half_area();
    let treelets = treelets(&top, references, stored);
    let mut offsets = Vec::with_capacity(treelets.len());
    // Nodes of the top come first; a binary hierarchy of k leaves has at most k − 1 wide nodes.
    let top_room = if treelets.len() == 1 { 0 } else { treelets.len() - 1 };
    let (mut node_count, mut block_count) = (top_room, 0);
    for t in &treelets {
        offsets.push((node_count, block_count));
        node_count += t.collapsed.nodes.len();
        block_count += t.blocks.len();
    }
    let top = collapse(&top, &mut TreeletLeaves { treelets: &treelets, offsets: &offsets });

    eprintln!("cost {}", top.cost / area);
    let mut nodes = Vec::with_capacity(node_count);
    nodes.extend_from_slice(&top.nodes);
    nodes.resize(top_room, Node8::EMPTY);
    let mut blocks = Vec::with_capacity(1 + block_count);
    blocks.push(Tri4::new([]));
    for (t, (node_base, block_base)) in treelets.into_iter().zip(offsets) {
        nodes.extend(
            t.collapsed
                .nodes
                .iter()
                .map(|n| Node8 { planes: n.planes, child: n.child.map(|c| c.shifted(node_base, block_base)) }),
        );
        blocks.extend(t.blocks);
    }
    Bvh8 { nodes, blocks, root: Some(top.root) }
}

/// Builds and collapses the subtree below every leaf of `top`, in order.
fn treelets<S: Fn(u32) -> StoredTriangle + Sync>(top: &Bvh2, references: &mut [Reference], stored: &S) -> Vec<Treelet> {
    let mut depths = vec![0; top.nodes.len()];
    let mut parts = Vec::new();
    let mut rest = references;
    for (index, node) in top.nodes.iter().enumerate() {
        if node.right != 0 {
            depths[index + 1] = depths[index] + 1;
            depths[node.right as usize] = depths[index] + 1;
        } else {
            let (part, after) = rest.split_at_mut(node.count as usize);
            parts.push((node.first, depths[index], part));
            rest = after;
        }
    }
    let build = |(first, depth, references): (u32, usize, &mut [Reference])| {
        let bvh = sah::build(references, first as usize, 1, depth);
        let mut leaves = BlockLeaves { references, first: first as usize, stored, blocks: Vec::new() };
        let collapsed = collapse(&bvh, &mut leaves);
        Treelet { first, collapsed, blocks: leaves.blocks }
    };
    parts.into_par_iter().map(build).collect()
}
