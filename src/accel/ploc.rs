//! Bottom-up construction of a binary hierarchy (PLOC) with reinsertion, by the crate `obvhs`.
//! References in → [`Bvh2`] out, as from [`super::sah`]. This is the only file that names the crate.

use super::bounds::{Bounds, Reference};
use super::sah::{Bvh2, MAX_DEPTH, Node2};
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Share of the nodes that the first round of reinsertion tries to place better.
const REINSERTED: f32 = 0.15;

/// Builds down to single references and orders them as the nodes need. None if the hierarchy is too deep to traverse,
/// as it may be where very many boxes coincide.
pub(super) fn build(references: &mut Vec<Reference>) -> Option<Bvh2> {
    let boxes: Vec<Aabb> = references.iter().map(|r| aabb(&r.bounds())).collect();
    let ids = (0..references.len() as u32).collect();
    let count = references.len();
    let mut bvh = PlocBuilder::with_capacity(count).build(PlocSearchDistance::Medium, &boxes, ids, SortPrecision::U64, 3);
    ReinsertionOptimizer::default().run(&mut bvh, REINSERTED, None);
    depth_first(&bvh, references)
}

/// Improves a hierarchy of single-reference leaves.
pub(super) fn optimise(bvh: &Bvh2, references: &mut Vec<Reference>, ratio: f32) -> Option<Bvh2> {
    let mut nodes = Vec::with_capacity(bvh.nodes.len());
    nodes.push(obvhs::bvh2::node::Bvh2Node::default());
    let mut stack = vec![(0usize, 0usize)];
    while let Some((from, to)) = stack.pop() {
        let n = &bvh.nodes[from];
        if n.right == 0 {
            nodes[to] = obvhs::bvh2::node::Bvh2Node::new(aabb(&n.bounds), n.count, n.first);
        } else {
            let at = nodes.len();
            nodes.push(Default::default());
            nodes.push(Default::default());
            nodes[to] = obvhs::bvh2::node::Bvh2Node::new(aabb(&n.bounds), 0, at as u32);
            stack.push((n.right as usize, at + 1));
            stack.push((from + 1, at));
        }
    }
    let mut o = obvhs::bvh2::Bvh2 { nodes, primitive_indices: (0..references.len() as u32).collect(), ..Default::default() };
    ReinsertionOptimizer::default().run(&mut o, ratio, None);
    depth_first(&o, references)
}

fn aabb(b: &Bounds) -> Aabb {
    Aabb::new(b.min.truncate().to_array().into(), b.max.truncate().to_array().into())
}

fn depth_first(bvh: &obvhs::bvh2::Bvh2, references: &mut Vec<Reference>) -> Option<Bvh2> {
    let mut nodes: Vec<Node2> = Vec::with_capacity(bvh.nodes.len());
    let mut order = Vec::with_capacity(references.len());
    // Node, depth, and the parent whose right child it is.
    let mut stack = vec![(0u32, 0usize, None)];
    while let Some((index, depth, parent)) = stack.pop() {
        if depth > MAX_DEPTH {
            return None;
        }
        if let Some(parent) = parent {
            let at = nodes.len() as u32;
            let parent: &mut Node2 = &mut nodes[parent as usize];
            parent.right = at;
        }
        let node = &bvh.nodes[index as usize];
        let (min, max) = (node.aabb().min.to_array(), node.aabb().max.to_array());
        let bounds = Bounds { min: glam::Vec3::from(min).extend(0.0), max: glam::Vec3::from(max).extend(0.0) };
        let at = nodes.len() as u32;
        nodes.push(Node2 { bounds, first: order.len() as u32, count: 0, right: 0 });
        if node.is_leaf() {
            nodes[at as usize].count = node.prim_count;
            let run = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            order.extend(bvh.primitive_indices[run].iter().map(|&i| references[i as usize]));
        } else {
            stack.push((node.first_index + 1, depth + 1, Some(at)));
            stack.push((node.first_index, depth + 1, None));
        }
    }
    for index in (0..nodes.len()).rev() {
        if nodes[index].right != 0 {
            nodes[index].count = nodes[index + 1].count + nodes[nodes[index].right as usize].count;
        }
    }
    *references = order;
    Some(Bvh2 { nodes })
}
