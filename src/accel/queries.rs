//! What is asked of a ray: the nearest hit, any hit, or the light that passes.

use super::alpha::{base_color_at, covers, transmitted};
use super::bvh8::Tri4;
use super::traverse::{BlockHits, Query};
use super::{Hit, Ray};
use crate::scene::{Rgb, Scene};
use glam::{Vec2, Vec3};

/// Lanes of a mask, from the lowest.
fn lanes(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < u32::BITS as usize).then_some(lane)
    })
}

/// The largest distance below `t_max`, which itself does not count.
fn last_distance(ray: &Ray) -> f32 {
    ray.t_max.next_down()
}

/// Nearest hit; of several at one distance that of the lowest instance and triangle, whatever the traversal's order.
pub(super) struct Closest<'a> {
    scene: &'a Scene,
    limit: f32,
    best: Option<Candidate>,
}

#[derive(Clone, Copy)]
struct Candidate {
    instance: u32,
    triangle: u32,
    barycentric: Vec2,
    block: *const Tri4,
    lane: usize,
}

impl<'a> Closest<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        Self { scene, limit: last_distance(ray), best: None }
    }

    /// The answer.
    pub(super) fn hit(&self) -> Option<Hit> {
        let Candidate { instance, triangle, barycentric, block, lane } = self.best?;
        let winding = unsafe { &*block }.winding_normal(lane);
        let normal = if unsafe { &*block }.tag[lane].flipped() { -winding } else { winding };
        Some(Hit { t: self.limit, instance, triangle, barycentric, normal: normal.normalize_or_zero() })
    }
}

impl Query for Closest<'_> {
    const ORDERED: bool = true;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn hit(&mut self, block: &Tri4, hits: BlockHits) -> bool {
        for lane in lanes(hits.mask) {
            let (t, tag) = (hits.t[lane], block.tag[lane]);
            let (instance, triangle) = (tag.instance(), block.triangle[lane]);
            if t > self.limit {
                continue;
            }
            let later = |best: Candidate| (best.instance, best.triangle) <= (instance, triangle);
            if t == self.limit && self.best.is_some_and(later) {
                continue;
            }
            let barycentric = Vec2::new(hits.v[lane], hits.w[lane]);
            if tag.masked() && !covers(self.scene, instance as usize, triangle as usize, barycentric) {
                continue;
            }
            self.limit = t;
            self.best = Some(Candidate { instance, triangle, barycentric, block, lane });
        }
        false
    }
}

/// Whether anything is hit. Blended surfaces count as solid.
pub(super) struct Occluded<'a> {
    scene: &'a Scene,
    limit: f32,
}

impl<'a> Occluded<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        Self { scene, limit: last_distance(ray) }
    }
}

impl Query for Occluded<'_> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn hit(&mut self, block: &Tri4, hits: BlockHits) -> bool {
        lanes(hits.mask).any(|lane| {
            let tag = block.tag[lane];
            let barycentric = Vec2::new(hits.v[lane], hits.w[lane]);
            !tag.masked() || covers(self.scene, tag.instance() as usize, block.triangle[lane] as usize, barycentric)
        })
    }
}

/// Product of what all surfaces on the segment let through.
pub(super) struct Transmittance<'a> {
    scene: &'a Scene,
    limit: f32,
    /// The product so far.
    pub(super) product: Rgb,
    /// Instance and distance of the latest hits on edges, in turn.
    edges: [(u32, f32); EDGES],
    edge_count: usize,
}

/// How many hits on edges are remembered; more than one at a time are pending only where surfaces nearly touch.
const EDGES: usize = 4;

impl<'a> Transmittance<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        Self { scene, limit: last_distance(ray), product: Rgb::ONE, edges: [(0, f32::NAN); EDGES], edge_count: 0 }
    }

    /// True if an edge was hit there before. A ray through an edge meets both triangles that share it, but one surface.
    fn repeats_edge(&mut self, instance: u32, t: f32, barycentric: Vec2) -> bool {
        let inside = barycentric.min_element() > 0.0 && barycentric.element_sum() < 1.0 - f32::EPSILON;
        if inside {
            return false;
        }
        let same = |&(i, s): &(u32, f32)| i == instance && (t - s).abs() <= 1e-6 * t;
        if self.edges.iter().any(same) {
            return true;
        }
        self.edges[self.edge_count % EDGES] = (instance, t);
        self.edge_count += 1;
        false
    }
}

impl Query for Transmittance<'_> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn hit(&mut self, block: &Tri4, hits: BlockHits) -> bool {
        for lane in lanes(hits.mask) {
            let (tag, triangle) = (block.tag[lane], block.triangle[lane] as usize);
            let instance = tag.instance() as usize;
            let barycentric = Vec2::new(hits.v[lane], hits.w[lane]);
            if tag.blended() {
                if !self.repeats_edge(tag.instance(), hits.t[lane], barycentric) {
                    self.product *= transmitted(base_color_at(self.scene, instance, triangle, barycentric));
                }
            } else if !tag.masked() || covers(self.scene, instance, triangle, barycentric) {
                self.product = Rgb::ZERO;
            }
        }
        self.product == Rgb::ZERO
    }
}
