//! Portable box and triangle tests.

use super::bvh8::{Bvh8, Child, Node8, Tri4};
use super::traverse::{BlockHits, Kernel, Query, RayFrame, traverse};

/// Plain loops over the lanes.
pub(super) struct Scalar;

/// Ray data of [`Scalar`].
#[derive(Clone, Copy)]
pub(super) struct Prepared {
    origin: [f32; 3],
    reciprocal: [f32; 3],
    slack: [f32; 3],
    relative_slack: f32,
    /// Row of the plane that the ray meets first, per axis.
    near_row: [usize; 3],
    t_min: f32,
    axes: [usize; 3],
    shear: [f32; 3],
}

/// The larger, `b` if `a` is NaN.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller, `b` if `a` is NaN.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Kernel for Scalar {
    type Prepared = Prepared;

    #[inline(always)]
    fn prepare(ray: &RayFrame) -> Prepared {
        Prepared {
            origin: ray.origin.to_array(),
            reciprocal: ray.reciprocal.to_array(),
            slack: ray.slack.to_array(),
            relative_slack: ray.relative_slack,
            near_row: std::array::from_fn(|axis| if ray.reciprocal[axis] < 0.0 { axis + 3 } else { axis }),
            t_min: ray.t_min,
            axes: ray.axes,
            shear: ray.shear,
        }
    }

    #[inline(always)]
    fn boxes(ray: &Prepared, node: &Node8, limit: f32, near: &mut [f32; 8]) -> u32 {
        *near = [ray.t_min; 8];
        let mut far = [limit; 8];
        for axis in 0..3 {
            let row = ray.near_row[axis];
            let (enter, leave) = (&node.planes[row], &node.planes[2 * axis + 3 - row]);
            for lane in 0..8 {
                let t0 = (enter[lane] - ray.origin[axis]) * ray.reciprocal[axis];
                let t1 = (leave[lane] - ray.origin[axis]) * ray.reciprocal[axis];
                near[lane] = max(t0 - t0.abs() * ray.relative_slack - ray.slack[axis], near[lane]);
                far[lane] = min(t1 + t1.abs() * ray.relative_slack + ray.slack[axis], far[lane]);
            }
        }
        (0..8).fold(0, |mask, lane| mask | u32::from(near[lane] <= far[lane]) << lane)
    }

    #[inline(always)]
    fn prefetch(_: &Bvh8, _: Child) {}

    #[inline(never)]
    fn descend<'b, Q: Query<'b>>(bvh: &'b Bvh8, root: Child, frame: &RayFrame, query: &mut Q) -> bool {
        traverse::<Self, Q>(bvh, root, frame, query)
    }

    #[inline(always)]
    fn triangles(ray: &Prepared, block: &Tri4, limit: f32) -> Option<BlockHits> {
        let mut hits = BlockHits { mask: 0, t: [0.0; 4], v: [0.0; 4], w: [0.0; 4] };
        let [kx, ky, kz] = ray.axes;
        for lane in 0..Tri4::LANES {
            // Corners relative to the origin, sheared so that the ray runs along z.
            let corner = |rows: &[[f32; 4]; 3]| {
                let z = rows[kz][lane] - ray.origin[kz];
                let x = rows[kx][lane] - ray.origin[kx] - ray.shear[0] * z;
                let y = rows[ky][lane] - ray.origin[ky] - ray.shear[1] * z;
                [x, y, z]
            };
            let [ax, ay, az] = corner(&block.corners[0]);
            let [bx, by, bz] = corner(&block.corners[1]);
            let [cx, cy, cz] = corner(&block.corners[2]);
            let u = cx * by - cy * bx;
            let v = ax * cy - ay * cx;
            let w = bx * ay - by * ax;
            if !(min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0) {
                continue;
            }
            let det = u + v + w;
            let t = (u * az + v * bz + w * cz) * ray.shear[2] / det;
            if det != 0.0 && t > ray.t_min && t <= limit {
                hits.mask |= 1 << lane;
                hits.t[lane] = t;
                hits.v[lane] = v / det;
                hits.w[lane] = w / det;
            }
        }
        (hits.mask != 0).then_some(hits)
    }
}
