//! Builds the hierarchy: surfaces → quadtrees of elements → binary cluster tree.

use super::{Element, Hierarchy, NO_ELEMENT, Node, Side, Surface, Surfels};
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Bins per axis in the cluster build.
const BINS: usize = 16;

/// Builds the tree over the fronts of all `surfaces` and the backs of those that `backs` marks. Elements have up to
/// `side`×`side` surfels, a power of two.
pub fn build(surfels: &Surfels, surfaces: &[Surface], backs: &[bool], side: u32) -> Hierarchy {
    let mut sides: Vec<(usize, Side)> = (0..surfaces.len()).map(|s| (s, Side::Front)).collect();
    sides.extend((0..surfaces.len()).filter(|&s| backs[s]).map(|s| (s, Side::Back)));
    let mut roots: Vec<Root> = sides
        .into_iter()
        .map(|(surface, side)| {
            let bounds = bounds_of(surfels, surfaces[surface].surfels.clone(), side);
            Root { surface, side, bounds }
        })
        .collect();
    let mut tree = Hierarchy {
        front: vec![NO_ELEMENT; surfels.len()],
        back: vec![NO_ELEMENT; surfels.len()],
        cumulative_area: vec![0.0],
        ..Hierarchy::default()
    };
    if !roots.is_empty() {
        Builder { surfels, surfaces, element_bits: 2 * side.ilog2(), tree: &mut tree }.cluster(&mut roots);
    }
    tree
}

/// One side of a surface, waiting for its place in the cluster tree.
struct Root {
    surface: usize,
    side: Side,
    bounds: Bounds,
}

/// Extent, orientation and area of a set of surfels.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
    axis: Vec3,
    cone: f32,
    area: f32,
}

impl Bounds {
    const EMPTY: Bounds =
        Bounds { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, axis: Vec3::ZERO, cone: -1.0, area: 0.0 };

    fn join(self, o: Bounds) -> Bounds {
        let (axis, cone) = join_cones((self.axis, self.cone), (o.axis, o.cone));
        Bounds { low: self.low.min(o.low), high: self.high.max(o.high), axis, cone, area: self.area + o.area }
    }

    /// Surface area heuristic with orientation: how much a ray or a receiver is likely to see of it.
    fn cost(&self) -> f32 {
        if self.cone < 0.0 {
            return 0.0;
        }
        let d = self.high - self.low;
        let box_area = d.x * d.y + d.y * d.z + d.z * d.x;
        // Solid angle from which any of the normals is seen, per Conty and Kulla, equation 1.
        let spread = (self.cone + PI / 2.0).min(PI);
        let (s, c) = self.cone.sin_cos();
        let orientation = 2.0 * PI * (1.0 - c)
            + PI / 2.0 * (2.0 * spread * s - (self.cone - 2.0 * spread).cos() - 2.0 * self.cone * s + c);
        box_area * orientation * self.area.max(f32::MIN_POSITIVE)
    }
}

/// Smallest cone (up to a little) around two cones; a negative angle is the empty cone.
fn join_cones(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let ((a, ca), (b, cb)) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    if cb < 0.0 {
        return (a, ca);
    }
    let between = a.dot(b).clamp(-1.0, 1.0).acos();
    if (between + cb).min(PI) <= ca {
        return (a, ca);
    }
    let half = (ca + between + cb) / 2.0;
    let turn = half - ca;
    let side = (b - a * a.dot(b)).normalize_or_zero();
    if half >= PI || side == Vec3::ZERO {
        return (a, PI);
    }
    ((a * turn.cos() + side * turn.sin()).normalize(), half)
}

fn bounds_of(surfels: &Surfels, range: Range<u32>, side: Side) -> Bounds {
    let mut b = Bounds::EMPTY;
    let (mut sum, mut cos_min) = (Vec3::ZERO, 1f32);
    for s in range.clone() {
        let (p, a) = (surfels.position(s), surfels.area(s));
        // A texel reaches about half its side beyond its centre.
        let reach = Vec3::splat(0.5 * a.sqrt()) * (Vec3::ONE - surfels.normal(s).abs());
        (b.low, b.high) = (b.low.min(p - reach), b.high.max(p + reach));
        b.area += a;
        sum += surfels.normal(s) * a;
    }
    b.axis = sum.normalize_or(Vec3::Y);
    for s in range {
        cos_min = cos_min.min(b.axis.dot(surfels.normal(s)));
    }
    b.cone = cos_min.clamp(-1.0, 1.0).acos();
    if side == Side::Back {
        b.axis = -b.axis;
    }
    b
}

struct Builder<'a, 'b> {
    surfels: &'a Surfels<'a>,
    surfaces: &'a [Surface],
    /// Bits of the Morton key inside one element.
    element_bits: u32,
    tree: &'b mut Hierarchy,
}

impl Builder<'_, '_> {
    /// Adds the tree over `roots`, returns its bounds.
    fn cluster(&mut self, roots: &mut [Root]) -> Bounds {
        if let [root] = roots {
            let surface = self.surfaces[root.surface].surfels.clone();
            return self.quadtree(surface, root.side);
        }
        let node = self.open();
        let middle = split(roots);
        let (left, right) = roots.split_at_mut(middle);
        let left = self.cluster(left);
        let bounds = left.join(self.cluster(right));
        self.close(node, bounds)
    }

    /// Adds the quadtree over a run of surfels of one surface.
    fn quadtree(&mut self, range: Range<u32>, side: Side) -> Bounds {
        let key = |s: u32| self.surfels.morton(s);
        // Smallest aligned block that holds the whole run.
        let differing = 64 - (key(range.start) ^ key(range.end - 1)).leading_zeros();
        let shift = differing.next_multiple_of(2);
        let node = self.open();
        // An element that reached through a wall would carry light through it.
        let parted = range.len() > 1 && range.clone().any(|s| self.surfels.is_parted(s));
        if shift <= self.element_bits && !parted {
            let e = self.tree.elements.len() as u32;
            let table = if side == Side::Front { &mut self.tree.front } else { &mut self.tree.back };
            table[range.start as usize..range.end as usize].fill(e);
            let bounds = bounds_of(self.surfels, range.clone(), side);
            self.tree.elements.push(Element { surfels: range, side, node: node as u32 });
            let total = *self.tree.cumulative_area.last().expect("starts with zero");
            self.tree.cumulative_area.push(total + bounds.area as f64);
            return self.close(node, bounds);
        }
        let mut bounds = Bounds::EMPTY;
        let mut start = range.start;
        while start < range.end {
            let block = key(start) >> (shift - 2);
            let len = (start..range.end).take_while(|&s| self.surfels.morton(s) >> (shift - 2) == block).count();
            let child = self.quadtree(start..start + len as u32, side);
            bounds = bounds.join(child);
            start += len as u32;
        }
        self.close(node, bounds)
    }

    /// Reserves the next node.
    fn open(&mut self) -> usize {
        let first = self.tree.elements.len() as u32;
        self.tree.nodes.push(Node {
            low: Vec3::ZERO,
            high: Vec3::ZERO,
            axis: Vec3::Y,
            cone: 0.0,
            area: 0.0,
            skip: 0,
            elements: first..first,
        });
        self.tree.nodes.len() - 1
    }

    /// Completes a node whose subtree has been added.
    fn close(&mut self, node: usize, b: Bounds) -> Bounds {
        let skip = self.tree.nodes.len() as u32;
        let end = self.tree.elements.len() as u32;
        let n = &mut self.tree.nodes[node];
        (n.low, n.high, n.axis, n.cone, n.area, n.skip) = (b.low, b.high, b.axis, b.cone.max(0.0), b.area, skip);
        n.elements.end = end;
        b
    }
}

/// Partitions `roots` where the summed cost of both halves is least; returns the size of the first half.
fn split(roots: &mut [Root]) -> usize {
    let centre = |r: &Root| (r.bounds.low + r.bounds.high) * 0.5;
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for r in roots.iter() {
        (low, high) = (low.min(centre(r)), high.max(centre(r)));
    }
    let size = high - low;
    let mut best: Option<(f32, Criterion)> = None;
    for axis in 0..6 {
        let criterion = Criterion {
            axis,
            low: if axis < 3 { low[axis] } else { -1.0 },
            size: if axis < 3 { size[axis] } else { 2.0 },
            bin: 0,
        };
        if criterion.size <= 0.0 {
            continue;
        }
        let mut bins = [Bounds::EMPTY; BINS];
        for r in roots.iter() {
            let b = criterion.bin_of(r);
            bins[b] = bins[b].join(r.bounds);
        }
        let mut right = [Bounds::EMPTY; BINS + 1];
        for i in (0..BINS).rev() {
            right[i] = bins[i].join(right[i + 1]);
        }
        // Long thin nodes are bad senders: cuts across the longest side are favoured (Conty and Kulla, section 4.4).
        let regular = if axis < 3 { size.max_element() / size[axis] } else { 1.0 };
        let mut left = Bounds::EMPTY;
        for bin in 1..BINS {
            left = left.join(bins[bin - 1]);
            let cost = regular * (left.cost() + right[bin].cost());
            if left.area > 0.0 && right[bin].area > 0.0 && best.as_ref().is_none_or(|(c, _)| cost < *c) {
                best = Some((cost, Criterion { bin, ..criterion }));
            }
        }
    }
    let first = match best {
        Some((_, criterion)) => partition(roots, |r| criterion.bin_of(r) < criterion.bin),
        None => 0,
    };
    // All in one place: any halves do.
    if first == 0 || first == roots.len() { roots.len() / 2 } else { first }
}

/// A plane in position (axes 0–2) or in the cosine with an axis (3–5).
#[derive(Clone, Copy)]
struct Criterion {
    axis: usize,
    low: f32,
    size: f32,
    bin: usize,
}

impl Criterion {
    fn bin_of(&self, r: &Root) -> usize {
        let v = if self.axis < 3 {
            (r.bounds.low[self.axis] + r.bounds.high[self.axis]) * 0.5
        } else {
            r.bounds.axis[self.axis - 3]
        };
        (((v - self.low) / self.size * BINS as f32) as usize).min(BINS - 1)
    }
}

/// Stable partition; returns the number of items for which `first` holds.
fn partition(roots: &mut [Root], first: impl Fn(&Root) -> bool) -> usize {
    roots.sort_by_key(|r| !first(r));
    roots.partition_point(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_cones_hold_both() {
        let (axis, cone) = join_cones((Vec3::X, 0.2), (Vec3::Y, 0.4));
        assert!((cone - (PI / 2.0 + 0.6) / 2.0).abs() < 1e-5);
        assert!(axis.dot(Vec3::X).acos() + 0.2 <= cone + 1e-4);
        assert!(axis.dot(Vec3::Y).acos() + 0.4 <= cone + 1e-4);
        assert_eq!(join_cones((Vec3::X, 0.0), (Vec3::NEG_X, 0.0)).1, PI);
        assert_eq!(join_cones((Vec3::X, 0.3), (Vec3::Y, -1.0)).1, 0.3);
    }
}
