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

/// The axis of the largest component and the two others, by whether that is y (first bit) or z (second bit).
const AXES: [[usize; 3]; 4] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 0, 1]];

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
        // Arrays, because indexing a vector branches on the axis.
        let [z, x, y] = AXES[usize::from(size.y == largest) | usize::from(size.z == largest) << 1];
        let slopes = d.to_array();
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
            shear: [slopes[x] / slopes[z], slopes[y] / slopes[z], 1.0 / slopes[z]],
        })
    }
}

/// A child and where the ray enters it.
#[derive(Clone, Copy)]
struct Entry {
    near: f32,
    child: Child,
}

/// Children still to be visited.
struct Stack<'a> {
    /// Written up to `height`.
    entries: &'a mut [MaybeUninit<Entry>; STACK],
    height: usize,
}

impl<'a> Stack<'a> {
    /// An empty stack in the given memory.
    #[inline(always)]
    fn new(entries: &'a mut [MaybeUninit<Entry>; STACK]) -> Self {
        Self { entries, height: 0 }
    }

    #[inline(always)]
    fn push(&mut self, entry: Entry) {
        debug_assert!(self.height < STACK);
        // SAFETY: no hierarchy is deeper than `MAX_DEPTH`, so the stack has room.
        unsafe { self.entries.get_unchecked_mut(self.height).write(entry) };
        self.height += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Entry> {
        self.height = self.height.checked_sub(1)?;
        // SAFETY: entries up to the former height have been written.
        Some(unsafe { self.entries.get_unchecked(self.height).assume_init() })
    }

    /// Pushes below all entries from `base` up that are nearer.
    #[inline(always)]
    fn push_sorted(&mut self, base: usize, entry: Entry) {
        let mut at = self.height;
        while at > base {
            // SAFETY: the entry lies below `height`.
            let below = unsafe { self.entries.get_unchecked(at - 1).assume_init() };
            if below.near >= entry.near {
                break;
            }
            // SAFETY: there is room for one more, as in `push`.
            unsafe { self.entries.get_unchecked_mut(at).write(below) };
            at -= 1;
        }
        // SAFETY: as above.
        unsafe { self.entries.get_unchecked_mut(at).write(entry) };
        self.height += 1;
    }
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
    let mut entries = [MaybeUninit::uninit(); STACK];
    let mut stack = Stack::new(&mut entries);
    let mut child = root;
    loop {
        while child.is_inner() {
            match visit_node::<K, Q>(bvh, child, &ray, query.limit(), &mut stack) {
                Some(next) => child = next,
                None => break,
            }
        }
        if child.is_inner() {
            // No child was met.
        } else if child.is_instance() {
            if visit_instance::<K, Q>(bvh, child, frame, query) {
                return true;
            }
        } else if visit_leaf::<K, Q>(bvh, child, &ray, query) {
            return true;
        }
        child = loop {
            let Some(entry) = stack.pop() else { return false };
            if !Q::ORDERED || entry.near <= query.limit() {
                break entry.child;
            }
        };
    }
}

/// Pushes the children that the ray meets, except for one to go on with: the nearest, if order matters.
#[inline(always)]
fn visit_node<'b, K: Kernel, Q: Query<'b>>(
    bvh: &Bvh8,
    child: Child,
    ray: &K::Prepared,
    limit: f32,
    stack: &mut Stack,
) -> Option<Child> {
    // SAFETY: the builder links only nodes that exist.
    let node = unsafe { bvh.nodes.get_unchecked(child.index()) };
    let mut near = [0.0; 8];
    let mut hits = K::boxes(ray, node, limit, &mut near);
    if hits == 0 {
        return None;
    }
    let take = |hits: &mut u32| {
        let lane = hits.trailing_zeros() as usize;
        *hits &= *hits - 1;
        // SAFETY: masks have eight bits, and this one was not empty.
        let entry = unsafe { Entry { near: *near.get_unchecked(lane), child: *node.child.get_unchecked(lane) } };
        K::prefetch(bvh, entry.child);
        entry
    };
    let mut first = take(&mut hits);
    if hits == 0 {
        return Some(first.child);
    }
    let base = stack.height;
    while hits != 0 {
        let entry = take(&mut hits);
        if !Q::ORDERED {
            stack.push(entry);
        } else if entry.near < first.near {
            stack.push_sorted(base, first);
            first = entry;
        } else {
            stack.push_sorted(base, entry);
        }
    }
    Some(first.child)
}

/// Tests the blocks of a leaf; true if the query ended the traversal.
#[inline(always)]
fn visit_leaf<'b, K: Kernel, Q: Query<'b>>(bvh: &'b Bvh8, child: Child, ray: &K::Prepared, query: &mut Q) -> bool {
    let first = child.index();
    // SAFETY: the builder links only blocks that exist.
    let blocks = unsafe { bvh.blocks.get_unchecked(first..first + child.blocks()) };
    // A plain loop, because iterator adapters may stay calls, and those lack the kernel's instructions.
    for block in blocks {
        if let Some(hits) = K::triangles(ray, block, query.limit())
            && query.hit(block, hits)
        {
            return true;
        }
    }
    false
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
