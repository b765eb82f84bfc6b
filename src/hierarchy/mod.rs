//! The energy hierarchy: elements (a few texels each) under chart quadtrees under a binary tree of clusters.
//!
//! Topology and geometry only; solver state lives in arrays indexed by node or element, owned by `solve`.
//! Based on: Hanrahan, Salzman, Aupperle, "A Rapid Hierarchical Radiosity Algorithm", 1991; Smits, Arvo, Greenberg,
//! "A Clustering Algorithm for Radiosity in Complex Environments", 1994; Conty Estevez and Kulla, "Importance Sampling
//! of Many Lights with Adaptive Tree Splitting", 2018 (orientation-aware cluster cost).

mod build;
mod surfels;

pub use build::build;
pub use surfels::{Surface, Surfels};

use glam::Vec3;
use std::ops::Range;

/// Which face of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The side that the geometric normal points to.
    Front,
    /// The other side of a double-sided surface.
    Back,
}

/// Elements of the smallest nodes that are linked.
const LINKED: usize = 16;

/// A leaf of the hierarchy: neighbouring surfels of one side of a surface.
#[derive(Clone, Debug)]
pub struct Element {
    /// Surfels it stands for.
    pub surfels: Range<u32>,
    /// Its side.
    pub side: Side,
    /// Its node.
    pub node: u32,
}

/// A node: an element, a part of a chart, a chart or a cluster of charts. Depth-first order.
#[derive(Clone, Debug)]
pub struct Node {
    /// Lower corner of the bounding box.
    pub low: Vec3,
    /// Upper corner.
    pub high: Vec3,
    /// Axis of the normal cone, unit.
    pub axis: Vec3,
    /// Half angle of the normal cone, radians; π if normals point everywhere.
    pub cone: f32,
    /// Sum of surfel areas, m².
    pub area: f32,
    /// Node after this subtree; `index + 1` for a leaf.
    pub skip: u32,
    /// Elements below, contiguous.
    pub elements: Range<u32>,
}

impl Node {
    /// Centre of the bounding box.
    pub fn centre(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// Radius of the sphere around [`Node::centre`] that holds the bounding box.
    pub fn radius(&self) -> f32 {
        (self.high - self.low).length() * 0.5
    }
}

/// The tree over all elements. Node 0 is the root.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    /// Nodes, depth first.
    pub nodes: Vec<Node>,
    /// Leaves, in the order of the nodes.
    pub elements: Vec<Element>,
    /// Area of all elements before element `i`; one more entry than elements.
    pub cumulative_area: Vec<f64>,
    /// Front element of every surfel.
    pub front: Vec<u32>,
    /// Back element of every surfel, `NO_ELEMENT` where the back is never seen.
    pub back: Vec<u32>,
}

/// Marks a surfel side that has no element.
pub const NO_ELEMENT: u32 = u32::MAX;

/// Draws surfels of one element.
pub struct ElementSampler {
    first: u32,
    side: Side,
    /// Running sums of areas, m².
    cumulative: Vec<f32>,
}

impl ElementSampler {
    /// The surfel that `u` in 0..1 draws, with its side.
    pub fn draw(&self, u: f32) -> (u32, Side) {
        let target = u * self.cumulative.last().copied().unwrap_or(0.0);
        let index = self.cumulative.partition_point(|&sum| sum <= target).min(self.cumulative.len().saturating_sub(1));
        (self.first + index as u32, self.side)
    }
}

impl Hierarchy {
    /// True if node `n` is an element.
    pub fn is_leaf(&self, n: u32) -> bool {
        self.nodes[n as usize].skip == n + 1
    }

    /// True if links go no deeper than node `n`: they give the first bounce a start, and its rays tell elements apart.
    pub fn is_link_end(&self, n: u32) -> bool {
        self.nodes[n as usize].elements.len() <= LINKED
    }

    /// Children of node `n`, none for a leaf.
    pub fn children(&self, n: u32) -> impl Iterator<Item = u32> + '_ {
        let end = self.nodes[n as usize].skip;
        let mut next = n + 1;
        std::iter::from_fn(move || {
            (next < end).then(|| {
                let child = next;
                next = self.nodes[child as usize].skip;
                child
            })
        })
    }

    /// Element that holds the side of `surfel`.
    pub fn element_of(&self, surfel: u32, side: Side) -> Option<u32> {
        let table = match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        };
        table.get(surfel as usize).copied().filter(|&e| e != NO_ELEMENT)
    }

    /// Draws a surfel of node `n` with probability proportional to its area, from `u` in 0..1.
    /// Returns it with its side.
    pub fn sample(&self, surfels: &Surfels, n: u32, u: f32) -> (u32, Side) {
        let range = &self.nodes[n as usize].elements;
        let (first, end) = (range.start as usize, range.end as usize);
        let (low, high) = (self.cumulative_area[first], self.cumulative_area[end]);
        let target = low + (high - low) * u as f64;
        let e = (first + self.cumulative_area[first + 1..end].partition_point(|&a| a <= target)).min(end - 1);
        let element = &self.elements[e];
        let mut rest = (target - self.cumulative_area[e]) as f32;
        for s in element.surfels.clone() {
            rest -= surfels.area(s);
            if rest < 0.0 {
                return (s, element.side);
            }
        }
        (element.surfels.end - 1, element.side)
    }

    /// What draws surfels of element `e` with probability proportional to their area, many times.
    pub fn sampler(&self, surfels: &Surfels, e: u32) -> ElementSampler {
        let element = &self.elements[e as usize];
        let mut sum = 0.0;
        let running = |s| {
            sum += surfels.area(s);
            sum
        };
        ElementSampler {
            first: element.surfels.start,
            side: element.side,
            cumulative: element.surfels.clone().map(running).collect(),
        }
    }

    /// True if some part of element `e` is not stood on.
    pub fn is_open(&self, surfels: &Surfels, e: u32) -> bool {
        self.elements[e as usize].surfels.clone().any(|s| !surfels.is_covered(s))
    }

    /// Unit normal of a surfel's side.
    pub fn normal(&self, surfels: &Surfels, surfel: u32, side: Side) -> Vec3 {
        match side {
            Side::Front => surfels.normal(surfel),
            Side::Back => -surfels.normal(surfel),
        }
    }
}
