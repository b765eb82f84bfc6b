//! Top-down construction of a binary hierarchy by the surface area heuristic with binned splits.
//! References in → [`Bvh2`] out; the references are reordered so that every node covers a run of them. The result does
//! not depend on the number of threads: every choice rests on exact minima, maxima and counts.
//! Based on: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007.

use super::bounds::{Bounds, INSTANCE, Reference};
use glam::Vec4;
use rayon::prelude::*;

/// A binary hierarchy in depth-first order: the left child of an inner node follows it.
pub(super) struct Bvh2 {
    pub(super) nodes: Vec<Node2>,
}

/// A node over a run of references, in 32 bytes: the fourth lane of `min` is the index of the right child, that of `max` the
/// length of the run. The run starts where that of the left sibling ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node2 {
    min: Vec4,
    max: Vec4,
}

impl Node2 {
    /// A node without children, over `count` references.
    fn leaf(bounds: Bounds, count: usize) -> Self {
        let with = |v: Vec4, lane: u32| v.truncate().extend(f32::from_bits(lane));
        Self { min: with(bounds.min, 0), max: with(bounds.max, count as u32) }
    }

    pub(super) fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max }
    }

    /// Number of references.
    pub(super) fn count(&self) -> usize {
        self.max.w.to_bits() as usize
    }

    /// Index of the right child, none for a leaf.
    pub(super) fn right(&self) -> Option<usize> {
        let lane = self.min.w.to_bits();
        (lane != 0).then_some(lane as usize)
    }

    fn set_right(&mut self, right: usize) {
        self.min.w = f32::from_bits(right as u32);
    }
}

/// Nodes deeper than this are halved by count, which bounds the depth of every hierarchy by `MAX_DEPTH`.
const SAH_DEPTH: usize = 40;
/// No node lies deeper.
pub(super) const MAX_DEPTH: usize = SAH_DEPTH + 32;
/// Bins per axis.
const BINS: usize = 32;
/// Visiting an instance costs about as much as testing this many triangles.
const INSTANCE_WEIGHT: u32 = 32;
/// Ranges from this size on are binned by all threads.
const PARALLEL_BINNING: usize = 1 << 16;
/// Ranges from this size on are built as tasks of their own.
const PARALLEL_SUBTREE: usize = 1 << 13;

/// Builds down to ranges of at most `leaf_size` references. `depth` is that of the root. Empty without references.
pub(super) fn build(references: &mut [Reference], leaf_size: usize, depth: usize) -> Bvh2 {
    let mut nodes = Vec::new();
    if !references.is_empty() {
        subdivide(references, leaf_size, depth, &mut nodes);
    }
    Bvh2 { nodes }
}

fn subdivide(references: &mut [Reference], leaf_size: usize, depth: usize, nodes: &mut Vec<Node2>) {
    let (bounds, centres) = extent(references);
    let at = nodes.len();
    nodes.push(Node2::leaf(bounds, references.len()));
    if references.len() <= leaf_size {
        return;
    }
    let middle = split(references, centres, depth);
    let (left, right) = references.split_at_mut(middle);
    if left.len() + right.len() < PARALLEL_SUBTREE {
        subdivide(left, leaf_size, depth + 1, nodes);
        let right_at = nodes.len();
        nodes[at].set_right(right_at);
        subdivide(right, leaf_size, depth + 1, nodes);
        return;
    }
    let mut right_nodes = Vec::new();
    rayon::join(
        || subdivide(left, leaf_size, depth + 1, nodes),
        || subdivide(right, leaf_size, depth + 1, &mut right_nodes),
    );
    let base = nodes.len();
    nodes[at].set_right(base);
    nodes.extend(right_nodes.into_iter().map(|mut node| {
        if let Some(right) = node.right() {
            node.set_right(base + right);
        }
        node
    }));
}

/// Box of the references and box of their doubled centres.
fn extent(references: &[Reference]) -> (Bounds, Bounds) {
    let of = |references: &[Reference]| {
        references.iter().fold((Bounds::EMPTY, Bounds::EMPTY), |(b, c), r| {
            let centre = r.centre2();
            (b.union(r.bounds()), Bounds { min: c.min.min(centre), max: c.max.max(centre) })
        })
    };
    if references.len() < PARALLEL_BINNING {
        return of(references);
    }
    let parts = references.par_chunks(PARALLEL_BINNING / 4).map(of);
    parts.reduce(|| (Bounds::EMPTY, Bounds::EMPTY), |a, b| (a.0.union(b.0), a.1.union(b.1)))
}

/// Reorders the references and returns where the right half starts; both halves are non-empty.
fn split(references: &mut [Reference], centres: Bounds, depth: usize) -> usize {
    let best = if depth < SAH_DEPTH { best_split(references, centres) } else { None };
    if let Some(best) = best {
        let middle = partition(references, |r| best.binning.bin(r, best.axis) < best.bin);
        if middle > 0 && middle < references.len() {
            return middle;
        }
    }
    // Centres that coincide, overflow, or nest too deep: halve by count along the widest axis.
    let size = centres.max - centres.min;
    let axis = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
    let middle = references.len() / 2;
    references.select_nth_unstable_by(middle, |a, b| {
        a.centre2()[axis].total_cmp(&b.centre2()[axis]).then(a.id().cmp(&b.id()))
    });
    middle
}

/// Moves the references that satisfy `left` to the front and returns their number.
fn partition(references: &mut [Reference], left: impl Fn(&Reference) -> bool) -> usize {
    let (mut i, mut j) = (0, references.len());
    loop {
        while i < j && left(&references[i]) {
            i += 1;
        }
        while i < j && !left(&references[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        references.swap(i, j - 1);
    }
}

/// Map from centres to bins.
#[derive(Clone, Copy)]
struct Binning {
    low: Vec4,
    scale: Vec4,
    bins: usize,
}

impl Binning {
    fn new(centres: Bounds, count: usize) -> Self {
        // Few references do not need all bins to be told apart.
        let bins = BINS.min(4 + count / 2);
        let size = centres.max - centres.min;
        let scale = Vec4::splat(bins as f32 * 0.9999) / size;
        // A flat axis has a scale of infinity or NaN; with zero everything falls into its first bin.
        let scale = Vec4::select(size.cmpgt(Vec4::ZERO) & scale.cmplt(Vec4::INFINITY), scale, Vec4::ZERO);
        Self { low: centres.min, scale, bins }
    }

    #[inline]
    fn all(&self, r: &Reference) -> [usize; 3] {
        let p = (r.centre2() - self.low) * self.scale;
        [p.x, p.y, p.z].map(|x| (x as usize).min(self.bins - 1))
    }

    #[inline]
    fn bin(&self, r: &Reference, axis: usize) -> usize {
        self.all(r)[axis]
    }
}

struct Split {
    binning: Binning,
    axis: usize,
    /// First bin of the right half.
    bin: usize,
}

/// Boxes and weights that fell into every bin of every axis.
struct Bins {
    bounds: [[Bounds; BINS]; 3],
    weight: [[u32; BINS]; 3],
}

impl Bins {
    fn of(references: &[Reference], binning: Binning) -> Self {
        let mut bins = Self { bounds: [[Bounds::EMPTY; BINS]; 3], weight: [[0; BINS]; 3] };
        for r in references {
            let weight = if r.id() & INSTANCE != 0 { INSTANCE_WEIGHT } else { 1 };
            let bounds = r.bounds();
            for (axis, bin) in binning.all(r).into_iter().enumerate() {
                bins.bounds[axis][bin] = bins.bounds[axis][bin].union(bounds);
                bins.weight[axis][bin] += weight;
            }
        }
        bins
    }

    fn merge(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..BINS {
                self.bounds[axis][bin] = self.bounds[axis][bin].union(other.bounds[axis][bin]);
                self.weight[axis][bin] += other.weight[axis][bin];
            }
        }
        self
    }
}

/// The cheapest split between bins, none if all references share one bin on every axis.
fn best_split(references: &[Reference], centres: Bounds) -> Option<Split> {
    let binning = Binning::new(centres, references.len());
    let bins = if references.len() < PARALLEL_BINNING {
        Bins::of(references, binning)
    } else {
        let parts = references.par_chunks(PARALLEL_BINNING / 4).map(|chunk| Bins::of(chunk, binning));
        parts.reduce_with(Bins::merge).expect("the range is not empty")
    };
    let mut best = None;
    let mut best_cost = f32::INFINITY;
    for axis in 0..3 {
        if binning.scale[axis] == 0.0 {
            continue;
        }
        let (bounds, weight) = (&bins.bounds[axis], &bins.weight[axis]);
        // Cost of everything right of each boundary, then a sweep from the left.
        let mut right_cost = [0.0; BINS];
        let (mut b, mut w) = (Bounds::EMPTY, 0);
        for bin in (1..binning.bins).rev() {
            b = b.union(bounds[bin]);
            w += weight[bin];
            right_cost[bin] = if w == 0 { f32::INFINITY } else { b.half_area() * w as f32 };
        }
        let (mut b, mut w) = (Bounds::EMPTY, 0);
        for bin in 1..binning.bins {
            b = b.union(bounds[bin - 1]);
            w += weight[bin - 1];
            let cost = if w == 0 { f32::INFINITY } else { b.half_area() * w as f32 + right_cost[bin] };
            if cost < best_cost {
                best_cost = cost;
                best = Some(Split { binning, axis, bin });
            }
        }
    }
    best
}
