//! Ray queries against the world's triangles.
//!
//! [`Accel::build`] takes the scene's instances into a hierarchy of eight-wide nodes over blocks of four triangles,
//! split by the surface area heuristic; what casts no shadow gets one of its own, which only [`Accel::surface`] asks.
//! Queries are watertight: no ray passes through the edge or corner that triangles
//! of a mesh share. Their results do not depend on the instruction set, nor on the number of threads that built.
//! Based on: Wald et al., "Getting Rid of Packets", 2008 (wide nodes for single rays); Woop, Benthin, Wald, "Watertight
//! Ray/Triangle Intersection", 2013; Ize, "Robust BVH Ray Traversal", 2013.

mod alpha;
mod assemble;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod bounds;
mod bvh8;
mod collapse;
mod offset;
mod pages;
mod queries;
mod sah;
mod scalar;
mod structure;
mod translucent;
mod traverse;

pub use offset::offset_origin;

use crate::scene::{Rgb, Scene};
use bvh8::Bvh8;
use glam::{Vec2, Vec3};
use traverse::{Query, RayFrame};

/// A ray segment `origin + t·direction`, `t_min < t < t_max`. A ray that is not finite, or has no direction, meets nothing.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// World position.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Nearest distance that counts.
    pub t_min: f32,
    /// Farthest distance that counts; may be infinite.
    pub t_max: f32,
}

/// The nearest triangle along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance.
    pub t: f32,
    /// Scene instance.
    pub instance: u32,
    /// Triangle within the instance's mesh.
    pub triangle: u32,
    /// Barycentrics of the triangle's second and third corner.
    pub barycentric: Vec2,
    /// Unit geometric normal of the front face.
    pub normal: Vec3,
}

/// How the structure is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelSettings {
    /// A mesh is built once and shared by its instances, rather than copied for each of them, where that saves more than
    /// this many triangles (about 70 bytes each). Rays are faster without sharing.
    pub sharing_saves: usize,
}

impl Default for AccelSettings {
    fn default() -> Self {
        Self { sharing_saves: 1 << 17 }
    }
}

/// The instructions that queries use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instructions {
    /// Whatever every machine has.
    Portable,
    /// AVX2 and FMA of x86-64.
    Avx2,
}

impl Instructions {
    /// The fastest that this machine has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if avx2::available() {
            return Self::Avx2;
        }
        Self::Portable
    }
}

/// Acceleration structure over every instance. Holes of alpha-masked materials are open.
pub struct Accel<'a> {
    scene: &'a Scene,
    /// What casts shadows.
    bvh: Bvh8,
    /// What does not.
    shadowless: Bvh8,
    instructions: Instructions,
    /// Light goes through some surface in part.
    translucent: bool,
}

impl<'a> Accel<'a> {
    /// Builds the structure with all threads of the current pool.
    pub fn build(scene: &'a Scene) -> Self {
        Self::build_with(scene, &AccelSettings::default())
    }

    /// Builds with other than the default settings.
    pub fn build_with(scene: &'a Scene, settings: &AccelSettings) -> Self {
        let [bvh, shadowless] = [true, false].map(|casts| structure::build(scene, casts, settings.sharing_saves));
        Self { scene, bvh, shadowless, instructions: Instructions::detect(), translucent: translucent::any(scene) }
    }

    /// The same structure, queried with portable instructions only. The answers are the same.
    pub fn portable(self) -> Self {
        Self { instructions: Instructions::Portable, ..self }
    }

    /// The scene that is queried.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Memory that the structure takes, bytes.
    pub fn size(&self) -> usize {
        self.bvh.size() + self.shadowless.size()
    }

    /// A number that tells structures apart: equal ones have equal digests.
    pub fn digest(&self) -> u64 {
        self.bvh.digest() ^ self.shadowless.digest().rotate_left(1)
    }

    /// Nearest hit of what casts shadows.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.closest_in(&self.bvh, ray)
    }

    /// Nearest hit of anything that can send light back, with or without a shadow: what casts none lights and is lit, but
    /// hides no light source. Its backs that are no surfaces are not there.
    pub fn surface(&self, ray: &Ray) -> Option<Hit> {
        let solid = self.closest(ray);
        let mut rest = Ray { t_max: solid.map_or(ray.t_max, |hit| hit.t), ..*ray };
        while let Some(hit) = self.closest_in(&self.shadowless, &rest) {
            let mesh = self.scene.instances[hit.instance as usize].mesh;
            if hit.normal.dot(ray.direction) <= 0.0 || self.scene.material_of(mesh, hit.triangle as usize).double_sided
            {
                return Some(hit);
            }
            rest = self.behind(&rest, &hit);
        }
        solid
    }

    /// True if what was hit casts a shadow.
    pub fn casts_shadow(&self, hit: &Hit) -> bool {
        self.scene.instances[hit.instance as usize].casts_shadows
    }

    fn closest_in(&self, bvh: &Bvh8, ray: &Ray) -> Option<Hit> {
        let mut query = queries::Closest::new(self.scene, ray);
        self.ask(bvh, ray, &mut query);
        query.result()
    }

    /// True if anything lies on the segment that casts a shadow. Blended surfaces count as solid; see [`Self::transmittance`].
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.ask(&self.bvh, ray, &mut queries::Occluded::new(self.scene, ray))
    }

    /// Share of light, per channel, that travels the whole segment: zero behind a solid surface, else the product over the
    /// blended surfaces of (1 − α)·(1 − α + α·base colour) and over transmitting ones of transmission·base colour.
    pub fn transmittance(&self, ray: &Ray) -> Rgb {
        let mut query = queries::Transmittance::new(self.scene, ray);
        self.ask(&self.bvh, ray, &mut query);
        query.product
    }

    /// Traverses `bvh`; true if the query ended it.
    #[inline(always)]
    fn ask<'b, Q: Query<'b>>(&'b self, bvh: &'b Bvh8, ray: &Ray, query: &mut Q) -> bool {
        let (Some(root), Some(frame)) = (bvh.root, RayFrame::new(ray)) else { return false };
        match self.instructions {
            // SAFETY: `Instructions::detect` has found these instructions.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { avx2::traverse_avx2(bvh, root, &frame, query) },
            _ => traverse::traverse::<scalar::Scalar, Q>(bvh, root, &frame, query),
        }
    }
}
