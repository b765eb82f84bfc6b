//! What two nodes exchange: kernel and visibility between points drawn on their actual surfaces.

use super::form_factor::point_to_point;
use crate::accel::{Accel, Ray, offset_origin};
use crate::hierarchy::{Hierarchy, Surfels};
use crate::math::{Sequence, hash2};
use glam::Vec3;

/// Rays between surfaces stop this share of their length short of the source.
pub const SELF_INTERSECTION: f32 = 1e-4;

/// Kernel statistics over pairs of points of two nodes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Kernel {
    /// Mean point-to-point kernel, 1/m².
    pub mean: f32,
    /// Standard deviation of the kernel over the pairs.
    pub deviation: f32,
}

/// Samples interactions of one hierarchy.
pub struct Exchange<'a> {
    /// The tree.
    pub hierarchy: &'a Hierarchy,
    /// Its surfels.
    pub surfels: &'a Surfels<'a>,
    /// Ray queries.
    pub accel: &'a Accel<'a>,
}

/// A pair of points with the kernel between them.
struct Pair {
    a: Vec3,
    normal_a: Vec3,
    b: Vec3,
    normal_b: Vec3,
    kernel: f32,
}

impl Exchange<'_> {
    fn pair(&self, a: u32, b: u32, sequence: &Sequence, index: u32) -> Pair {
        let u = sequence.first(index);
        let (sa, side_a) = self.hierarchy.sample(self.surfels, a, u.x);
        let (sb, side_b) = self.hierarchy.sample(self.surfels, b, u.y);
        let (pa, na) = (self.surfels.position(sa), self.hierarchy.normal(self.surfels, sa, side_a));
        let (pb, nb) = (self.surfels.position(sb), self.hierarchy.normal(self.surfels, sb, side_b));
        Pair { a: pa, normal_a: na, b: pb, normal_b: nb, kernel: point_to_point(pa, na, pb, nb, false) }
    }

    /// Kernel over `count` stratified pairs of nodes `a` and `b`.
    pub fn kernel(&self, a: u32, b: u32, count: u32) -> Kernel {
        let sequence = Sequence::new(hash2(a, b));
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        for i in 0..count {
            let k = self.pair(a, b, &sequence, i).kernel as f64;
            sum += k;
            squares += k * k;
        }
        let n = count as f64;
        let mean = sum / n;
        Kernel { mean: mean as f32, deviation: (squares / n - mean * mean).max(0.0).sqrt() as f32 }
    }

    /// Share of the exchange between `a` and `b` that nothing blocks, from at most `rays` rays, weighted by the
    /// kernel. Returns it with the number of rays cast; none where no pair of points face each other.
    pub fn visibility(&self, a: u32, b: u32, rays: u32) -> Option<(f32, u32)> {
        // The same points as `kernel` used: what it called visible in principle is what is tested.
        let sequence = Sequence::new(hash2(a, b));
        let (mut open, mut all, mut cast) = (0.0, 0.0, 0);
        for i in 0..4 * rays {
            let p = self.pair(a, b, &sequence, i);
            if p.kernel > 0.0 {
                cast += 1;
                all += p.kernel;
                if self.unoccluded(&p) {
                    open += p.kernel;
                }
                if cast == rays {
                    break;
                }
            }
        }
        (all > 0.0).then(|| (open / all, cast))
    }

    fn unoccluded(&self, p: &Pair) -> bool {
        let origin = offset_origin(p.a, p.normal_a);
        let target = offset_origin(p.b, p.normal_b);
        let v = target - origin;
        let distance = v.length();
        if distance <= 0.0 {
            return true;
        }
        let t_max = distance * (1.0 - SELF_INTERSECTION);
        !self.accel.occluded(&Ray { origin, direction: v / distance, t_min: 0.0, t_max })
    }
}
