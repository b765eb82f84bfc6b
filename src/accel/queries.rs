//! What is asked of a ray: the nearest hit, any hit, or the light that passes.

use super::bvh8::{Placed, Tri4};
use super::traverse::{BlockHits, Query};
use super::{Hit, Ray};
use crate::scene::{Rgb, Scene};
use glam::{Vec2, Vec3, Vec3A};

/// Lanes of a mask, from the lowest.
#[inline(always)]
fn lanes(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < Tri4::LANES).then_some(lane)
    })
}

/// The largest distance below `t_max`, which itself does not count.
fn last_distance(ray: &Ray) -> f32 {
    ray.t_max.next_down()
}

/// A hit triangle where it is stored.
#[derive(Clone, Copy)]
struct Stored<'a> {
    placed: Option<&'a Placed>,
    block: &'a Tri4,
    lane: usize,
}

impl Stored<'_> {
    /// Scene instance and triangle, which also rank hits at equal distance.
    fn id(&self) -> (u32, u32) {
        let instance = self.placed.map_or(self.block.tag[self.lane].instance(), |p| p.instance);
        (instance, self.block.triangle[self.lane])
    }

    /// Unit normal of the front face, in the world.
    fn normal(&self) -> Vec3 {
        let winding = self.block.winding_normal(self.lane);
        let normal = match self.placed {
            // Cofactors carry normals; they differ from the transposed inverse by the determinant, whose sign is that of
            // the winding, so that the front stays in front.
            Some(placed) => Vec3::from(placed.to_local.matrix3.transpose() * Vec3A::from(winding)),
            None if self.block.tag[self.lane].flipped() => -winding,
            None => winding,
        };
        normal.normalize_or_zero()
    }

    /// False in a hole.
    #[inline(always)]
    fn is_solid(&self, scene: &Scene, barycentric: Vec2) -> bool {
        !self.block.tag[self.lane].masked() || self.is_covered(scene, barycentric)
    }

    #[cold]
    #[inline(never)]
    fn is_covered(&self, scene: &Scene, barycentric: Vec2) -> bool {
        let (instance, triangle) = self.id();
        scene.covers_at(scene.instances[instance as usize].mesh, triangle as usize, barycentric)
    }
}

/// Nearest hit; of several at one distance that of the lowest instance and triangle, whatever the traversal's order.
pub(super) struct Closest<'a> {
    scene: &'a Scene,
    limit: f32,
    placed: Option<&'a Placed>,
    best: Option<(Stored<'a>, Vec2)>,
}

impl<'a> Closest<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        Self { scene, limit: last_distance(ray), placed: None, best: None }
    }

    /// The answer.
    pub(super) fn result(&self) -> Option<Hit> {
        let (stored, barycentric) = self.best?;
        let (instance, triangle) = stored.id();
        Some(Hit { t: self.limit, instance, triangle, barycentric, normal: stored.normal() })
    }
}

impl<'a> Query<'a> for Closest<'a> {
    const ORDERED: bool = true;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn enter(&mut self, placed: Option<&'a Placed>) {
        self.placed = placed;
    }

    #[inline(always)]
    fn hit(&mut self, block: &'a Tri4, hits: BlockHits) -> bool {
        for lane in lanes(hits.mask) {
            let t = hits.t[lane];
            let stored = Stored { placed: self.placed, block, lane };
            let ranks_behind = |(best, _): (Stored, Vec2)| t == self.limit && best.id() <= stored.id();
            if t > self.limit || self.best.is_some_and(ranks_behind) {
                continue;
            }
            let barycentric = Vec2::new(hits.v[lane], hits.w[lane]);
            if stored.is_solid(self.scene, barycentric) {
                self.limit = t;
                self.best = Some((stored, barycentric));
            }
        }
        false
    }
}

/// Whether anything is hit. Blended surfaces count as solid.
pub(super) struct Occluded<'a> {
    scene: &'a Scene,
    limit: f32,
    placed: Option<&'a Placed>,
}

impl<'a> Occluded<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        Self { scene, limit: last_distance(ray), placed: None }
    }
}

impl<'a> Query<'a> for Occluded<'a> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn enter(&mut self, placed: Option<&'a Placed>) {
        self.placed = placed;
    }

    #[inline(always)]
    fn hit(&mut self, block: &'a Tri4, hits: BlockHits) -> bool {
        for lane in lanes(hits.mask) {
            let stored = Stored { placed: self.placed, block, lane };
            if stored.is_solid(self.scene, Vec2::new(hits.v[lane], hits.w[lane])) {
                return true;
            }
        }
        false
    }
}

/// How many hits on edges are remembered; more than one at a time are pending only where surfaces nearly touch.
const EDGES: usize = 4;

/// Product of what all surfaces on the segment let through.
pub(super) struct Transmittance<'a> {
    scene: &'a Scene,
    limit: f32,
    placed: Option<&'a Placed>,
    /// The product so far.
    pub(super) product: Rgb,
    /// Instance and distance of the latest hits on edges, in turn.
    edges: [(u32, f32); EDGES],
    edge_count: usize,
}

impl<'a> Transmittance<'a> {
    pub(super) fn new(scene: &'a Scene, ray: &Ray) -> Self {
        let edges = [(0, f32::NAN); EDGES];
        Self { scene, limit: last_distance(ray), placed: None, product: Rgb::ONE, edges, edge_count: 0 }
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

impl<'a> Query<'a> for Transmittance<'a> {
    const ORDERED: bool = false;

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn enter(&mut self, placed: Option<&'a Placed>) {
        self.placed = placed;
    }

    #[inline(always)]
    fn hit(&mut self, block: &'a Tri4, hits: BlockHits) -> bool {
        for lane in lanes(hits.mask) {
            let stored = Stored { placed: self.placed, block, lane };
            let barycentric = Vec2::new(hits.v[lane], hits.w[lane]);
            if !block.tag[lane].blended() {
                if stored.is_solid(self.scene, barycentric) {
                    self.product = Rgb::ZERO;
                }
                continue;
            }
            let (instance, triangle) = stored.id();
            if !self.repeats_edge(instance, hits.t[lane], barycentric) {
                let mesh = self.scene.instances[instance as usize].mesh;
                self.product *= self.scene.transmittance_at(mesh, triangle as usize, barycentric);
            }
        }
        self.product == Rgb::ZERO
    }
}
