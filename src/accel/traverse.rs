//! Traversal of the wide hierarchy, generic over what is asked ([`Query`]) and over the instruction set ([`Kernel`]).

use super::Ray;
use super::bvh8::{Bvh8, Child, Node8, Placed, Tri4};
use super::sah::MAX_DEPTH;
use glam::Vec3;
use std::mem::MaybeUninit;

/// Every level leaves at most seven siblings behind.
const STACK: usize = 7 * MAX_DEPTH + 1;

/// Components of directions below this share of the largest count as zero, which moves a ray by less than its rounding.
const SMALLEST_SLOPE: f32 = 1e-12;
/// Relative error that the box test allows for, more than that of its arithmetic.
const SLACK: f32 = 4.0 * f32::EPSILON;

/// Where a ray meets up to four triangles of a block.
pub(super) struct BlockHits {
    /// One bit per lane.
    pub(super) mask: u32,
    /// Distances.
    pub(super) t: [f32; 4],
    /// Barycentrics of the second corners.
    pub(super) v: [f32; 4],
    /// Barycentrics of the third corners.
    pub(super) w: [f32; 4],
}

/// What is asked about a ray.
pub(super) trait Query<'b> {
    /// True if nearer boxes are to be visited first.
    const ORDERED: bool;
    /// Distances beyond this do not matter any more; the limit itself still does.
    fn limit(&self) -> f32;
    /// The hits that follow are in this instance, or, with none, in the world.
    fn enter(&mut self, placed: Option<&'b Placed>);
    /// Takes notice of hits; true ends the traversal.
    fn hit(&mut self, block: &'b Tri4, hits: BlockHits) -> bool;
}

/// Box and triangle tests of an instruction set. All kernels give the same triangle hits, bit by bit; box tests may
/// differ in hits that lie within their slack.
pub(super) trait Kernel {
    /// The ray as the tests need it.
    type Prepared: Copy;
    /// Prepares a ray.
    fn prepare(ray: &RayFrame) -> Self::Prepared;
    /// Lanes whose box the segment up to `limit` may meet, and the distances where it enters them.
    fn boxes(ray: &Self::Prepared, node: &Node8, limit: f32, near: &mut [f32; 8]) -> u32;
    /// Starts loading what a child leads to.
    fn prefetch(bvh: &Bvh8, child: Child);
    /// [`traverse`] with this kernel, not inlined: the way into instances.
    fn descend<'b, Q: Query<'b>>(bvh: &'b Bvh8, root: Child, frame: &RayFrame, query: &mut Q) -> bool;
    /// Triangles met within `t_min < t ≤ limit`.
    fn triangles(ray: &Self::Prepared, block: &Tri4, limit: f32) -> Option<BlockHits>;
}

/// A ray with all that the tests derive from it.
pub(super) struct RayFrame {
    pub(super) origin: Vec3,
    direction: Vec3,
    pub(super) t_min: f32,
    /// Reciprocal direction.
    pub(super) reciprocal: Vec3,
    /// Distance by which rounding may displace box planes, per axis.
    pub(super) slack: Vec3,
    /// Relative error of the distances to box planes.
    pub(super) relative_slack: f32,
    /// Axis of the largest direction component, last, and the two others.
    pub(super) axes: [usize; 3],
    /// Shear that maps the direction to that axis, and its scale.
    pub(super) shear: [f32; 3],
}

impl RayFrame {
    /// None if the ray cannot meet anything: not finite, no direction, or an empty segment.
    #[inline(always)]
    pub(super) fn new(ray: &Ray) -> Option<Self> {
        if ray.t_min < ray.t_max { Self::of_line(ray.origin, ray.direction, ray.t_min) } else { None }
    }

    /// The same ray in the space of an instance. Distances stay those of the world.
    fn within(&self, placed: &Placed) -> Option<Self> {
        let to_local = &placed.to_local;
        Self::of_line(to_local.transform_point3(self.origin), to_local.transform_vector3(self.direction), self.t_min)
    }

    #[inline(always)]
    fn of_line(o: Vec3, d: Vec3, t_min: f32) -> Option<Self> {
        let size = d.abs();
        let largest = size.max_element();
        if !(o.is_finite() && d.is_finite() && largest > 0.0) {
            return None;
        }
        let z = if size.z == largest {
            2
        } else if size.y == largest {
            1
        } else {
            0
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let smallest = largest * SMALLEST_SLOPE;
        let slope = |d: f32| if d.abs() < smallest { smallest.copysign(d) } else { d };
        let reciprocal = Vec3::new(slope(d.x), slope(d.y), slope(d.z)).recip();
        Some(Self {
            origin: o,
            direction: d,
            t_min,
            reciprocal,
            slack: reciprocal.abs() * (o.abs().max_element() * SLACK),
            relative_slack: SLACK,
            axes: [x, y, z],
            shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]],
        })
    }
}

/// A child and where the ray enters it.
#[derive(Clone, Copy)]
struct Entry {
    near: f32,
    child: Child,
}

/// Visits everything along the ray until `query` has enough; true if it ended the traversal.
#[inline(always)]
pub(super) fn traverse<'b, K: Kernel, Q: Query<'b>>(
    bvh: &'b Bvh8,
    root: Child,
    frame: &RayFrame,
    query: &mut Q,
) -> bool {
    let ray = K::prepare(frame);
    let mut stack = [MaybeUninit::<Entry>::uninit(); STACK];
    let mut height = 0;
    let mut child = root;
    let mut near = [0.0; 8];
    loop {
        // Go down to a leaf.
        while child.is_inner() {
            // SAFETY: the builder only links nodes that exist.
            let node = unsafe { bvh.nodes.get_unchecked(child.index()) };
            let mut hits = K::boxes(&ray, node, query.limit(), &mut near);
            if hits == 0 {
                break;
            }
            let lane = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            child = node.child[lane];
            K::prefetch(bvh, child);
            if hits == 0 {
                continue;
            }
            let mut nearest = Entry { near: near[lane], child };
            let base = height;
            while hits != 0 {
                let lane = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                let mut entry = Entry { near: near[lane], child: node.child[lane] };
                K::prefetch(bvh, entry.child);
                if Q::ORDERED {
                    if entry.near < nearest.near {
                        std::mem::swap(&mut entry, &mut nearest);
                    }
                    // Keep the farthest at the bottom.
                    let mut at = height;
                    while at > base {
                        // SAFETY: entries from `base` to `height` have been written.
                        let below = unsafe { stack.get_unchecked(at - 1).assume_init() };
                        if below.near >= entry.near {
                            break;
                        }
                        unsafe {
                            *stack.get_unchecked_mut(at) = MaybeUninit::new(below);
                        }
                        at -= 1;
                    }
                    unsafe {
                        *stack.get_unchecked_mut(at) = MaybeUninit::new(entry);
                    }
                } else {
                    unsafe {
                        *stack.get_unchecked_mut(height) = MaybeUninit::new(entry);
                    }
                }
                height += 1;
            }
            child = nearest.child;
        }
        if child.is_instance() {
            if visit_instance::<K, Q>(bvh, child, frame, query) {
                return true;
            }
        } else if !child.is_inner() {
            // SAFETY: the builder only links blocks that exist.
            for block in unsafe { bvh.blocks.get_unchecked(child.index()..child.index() + child.blocks()) } {
                if let Some(hits) = K::triangles(&ray, block, query.limit())
                    && query.hit(block, hits)
                {
                    return true;
                }
            }
        }
        // Next entry that still matters.
        loop {
            if height == 0 {
                return false;
            }
            height -= 1;
            // SAFETY: entries below `height` have been written.
            let entry = unsafe { stack.get_unchecked(height).assume_init() };
            if !Q::ORDERED || entry.near <= query.limit() {
                child = entry.child;
                break;
            }
        }
    }
}

/// Traverses the structure of an instance; true if the query ended it.
#[inline(always)]
fn visit_instance<'b, K: Kernel, Q: Query<'b>>(bvh: &'b Bvh8, child: Child, frame: &RayFrame, query: &mut Q) -> bool {
    let placed = &bvh.placed[child.index()];
    let Some(local) = frame.within(placed) else { return false };
    query.enter(Some(placed));
    let ended = K::descend(bvh, placed.root, &local, query);
    query.enter(None);
    ended
}
