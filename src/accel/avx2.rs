//! Box and triangle tests with AVX2 and FMA.

use super::bvh8::{Bvh8, Child, Node8, Tri4};
use super::traverse::{BlockHits, Kernel, Query, RayFrame, traverse};
use glam::Vec3;
use std::arch::x86_64::*;

/// Eight boxes and four triangles at a time. To be used only from within functions that enable `avx2` and `fma`.
struct Avx2;

/// True if this machine has what [`traverse_avx2`] needs.
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

/// [`traverse`] with vector instructions.
///
/// # Safety
/// [`available`] must hold.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn traverse_avx2<'b, Q: Query<'b>>(
    bvh: &'b Bvh8,
    root: Child,
    frame: &RayFrame,
    query: &mut Q,
) -> bool {
    traverse::<Avx2, Q>(bvh, root, frame, query)
}

/// Ray data of [`Avx2`]. Distances to planes are `plane · reciprocal − offset`, with reciprocals and offsets of the near
/// and of the far planes shifted apart by what rounding may amount to.
#[derive(Clone, Copy)]
struct Prepared {
    near_reciprocal: [__m256; 3],
    near_offset: [__m256; 3],
    far_reciprocal: [__m256; 3],
    far_offset: [__m256; 3],
    /// Row of the plane that the ray meets first, per axis.
    near_row: [usize; 3],
    t_min: __m256,
    origin: [__m128; 3],
    axes: [usize; 3],
    shear: [__m128; 3],
}

impl Kernel for Avx2 {
    type Prepared = Prepared;

    #[inline(always)]
    fn prepare(ray: &RayFrame) -> Prepared {
        // SAFETY: only `traverse_avx2` and functions inlined into it use this kernel.
        unsafe {
            let splat = |v: Vec3| [_mm256_set1_ps(v.x), _mm256_set1_ps(v.y), _mm256_set1_ps(v.z)];
            let near = ray.reciprocal * (1.0 - ray.relative_slack);
            let far = ray.reciprocal * (1.0 + ray.relative_slack);
            let o = ray.origin;
            let (origin, reciprocal) = (o.to_array(), ray.reciprocal.to_array());
            Prepared {
                near_reciprocal: splat(near),
                near_offset: splat(o * near + ray.slack),
                far_reciprocal: splat(far),
                far_offset: splat(o * far - ray.slack),
                near_row: [0, 1, 2].map(|axis| if reciprocal[axis] < 0.0 { axis + 3 } else { axis }),
                t_min: _mm256_set1_ps(ray.t_min),
                origin: ray.axes.map(|axis| _mm_set1_ps(origin[axis])),
                axes: ray.axes,
                shear: ray.shear.map(|s| _mm_set1_ps(s)),
            }
        }
    }

    #[inline(always)]
    fn boxes(ray: &Prepared, node: &Node8, limit: f32, near: &mut [f32; 8]) -> u32 {
        // SAFETY: the features are there, as above; rows are 32-byte aligned because nodes are.
        unsafe {
            let enter = |axis: usize| {
                let row = _mm256_load_ps(node.planes[ray.near_row[axis]].as_ptr());
                _mm256_fmsub_ps(row, ray.near_reciprocal[axis], ray.near_offset[axis])
            };
            let leave = |axis: usize| {
                let row = _mm256_load_ps(node.planes[2 * axis + 3 - ray.near_row[axis]].as_ptr());
                _mm256_fmsub_ps(row, ray.far_reciprocal[axis], ray.far_offset[axis])
            };
            // These return their second operand where the first is NaN, so that an undefined distance excludes nothing.
            let first = _mm256_max_ps(enter(0), _mm256_max_ps(enter(1), _mm256_max_ps(enter(2), ray.t_min)));
            let last = _mm256_min_ps(leave(0), _mm256_min_ps(leave(1), _mm256_min_ps(leave(2), _mm256_set1_ps(limit))));
            _mm256_storeu_ps(near.as_mut_ptr(), first);
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(first, last)) as u32
        }
    }

    #[inline(always)]
    fn prefetch(bvh: &Bvh8, child: Child) {
        // SAFETY: prefetching has no effect on memory, whatever the address.
        unsafe {
            let address = if child.is_inner() {
                bvh.nodes.as_ptr().cast::<i8>().wrapping_add(child.index() * size_of::<Node8>())
            } else {
                bvh.blocks.as_ptr().cast::<i8>().wrapping_add(child.index() * size_of::<Tri4>())
            };
            _mm_prefetch::<_MM_HINT_T0>(address);
            _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64));
            _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(128));
            _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(192));
        }
    }

    #[inline(never)]
    fn descend<'b, Q: Query<'b>>(bvh: &'b Bvh8, root: Child, frame: &RayFrame, query: &mut Q) -> bool {
        // SAFETY: only traversals that have these features descend.
        unsafe { traverse_avx2(bvh, root, frame, query) }
    }

    #[inline(always)]
    fn triangles(ray: &Prepared, block: &Tri4, limit: f32) -> Option<BlockHits> {
        // SAFETY: the features are there, as above; rows are 16-byte aligned because blocks are.
        unsafe {
            let [kx, ky, kz] = ray.axes;
            // Corners relative to the origin, sheared so that the ray runs along z.
            let corner = |rows: &[[f32; 4]; 3]| {
                let relative = |axis: usize, origin| _mm_sub_ps(_mm_load_ps(rows[axis].as_ptr()), origin);
                let z = relative(kz, ray.origin[2]);
                let x = _mm_sub_ps(relative(kx, ray.origin[0]), _mm_mul_ps(ray.shear[0], z));
                let y = _mm_sub_ps(relative(ky, ray.origin[1]), _mm_mul_ps(ray.shear[1], z));
                (x, y, z)
            };
            let (ax, ay, az) = corner(&block.corners[0]);
            let (bx, by, bz) = corner(&block.corners[1]);
            let (cx, cy, cz) = corner(&block.corners[2]);
            // No fused products here: their rounding would let rays slip through edges.
            let u = _mm_sub_ps(_mm_mul_ps(cx, by), _mm_mul_ps(cy, bx));
            let v = _mm_sub_ps(_mm_mul_ps(ax, cy), _mm_mul_ps(ay, cx));
            let w = _mm_sub_ps(_mm_mul_ps(bx, ay), _mm_mul_ps(by, ax));
            let zero = _mm_setzero_ps();
            let inside = _mm_or_ps(
                _mm_cmpge_ps(_mm_min_ps(_mm_min_ps(u, v), w), zero),
                _mm_cmple_ps(_mm_max_ps(_mm_max_ps(u, v), w), zero),
            );
            if _mm_movemask_ps(inside) == 0 {
                return None;
            }
            let det = _mm_add_ps(_mm_add_ps(u, v), w);
            let scaled = _mm_add_ps(_mm_add_ps(_mm_mul_ps(u, az), _mm_mul_ps(v, bz)), _mm_mul_ps(w, cz));
            let t = _mm_div_ps(_mm_mul_ps(scaled, ray.shear[2]), det);
            let within =
                _mm_and_ps(_mm_cmpgt_ps(t, _mm256_castps256_ps128(ray.t_min)), _mm_cmple_ps(t, _mm_set1_ps(limit)));
            let hit = _mm_and_ps(_mm_and_ps(inside, within), _mm_cmpneq_ps(det, zero));
            let mask = _mm_movemask_ps(hit) as u32;
            if mask == 0 {
                return None;
            }
            let mut hits = BlockHits { mask, t: [0.0; 4], v: [0.0; 4], w: [0.0; 4] };
            _mm_storeu_ps(hits.t.as_mut_ptr(), t);
            _mm_storeu_ps(hits.v.as_mut_ptr(), _mm_div_ps(v, det));
            _mm_storeu_ps(hits.w.as_mut_ptr(), _mm_div_ps(w, det));
            Some(hits)
        }
    }
}
