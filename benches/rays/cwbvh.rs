//! The crate `obvhs`: its compressed wide hierarchy, as a library user would call it.

use lightkiln::accel::Ray;
use lightkiln::scene::Scene;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::RayHit;
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use std::time::Duration;

/// A hierarchy and its triangles, in the hierarchy's order.
pub(crate) struct Cwbvh {
    bvh: CwBvh,
    triangles: Vec<RtTriangle>,
}

impl Cwbvh {
    /// Builds over all instances, flattened.
    pub(crate) fn build(scene: &Scene) -> Self {
        let triangles: Vec<Triangle> = (0..scene.instances.len())
            .flat_map(|i| (0..scene.meshes[scene.instances[i].mesh].triangles.len()).map(move |t| (i, t)))
            .map(|(i, t)| scene.corners(i, t).map(|p| p.to_array().into()))
            .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
            .collect();
        let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let triangles = bvh.primitive_indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect();
        Self { bvh, triangles }
    }

    /// True if there is a nearest hit.
    pub(crate) fn closest(&self, ray: &Ray) -> bool {
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(convert(ray), &mut hit, |ray, id| self.triangles[id].intersect(ray))
    }

    /// True if anything is hit.
    pub(crate) fn occluded(&self, ray: &Ray) -> bool {
        !self.bvh.ray_traverse_miss(convert(ray), |ray, id| self.triangles[id].intersect(ray))
    }
}

fn convert(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(ray.origin.to_array().into(), ray.direction.to_array().into(), ray.t_min, ray.t_max)
}
