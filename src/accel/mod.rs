//! Ray queries against the world's triangles.

use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// A ray segment `origin + t·direction`, `t_min < t < t_max`.
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

/// Acceleration structure over every instance that casts shadows. Holes of alpha-masked materials are open.
pub struct Accel<'a> {
    scene: &'a Scene,
}

impl<'a> Accel<'a> {
    /// Builds the structure.
    pub fn build(scene: &'a Scene) -> Self {
        Self { scene }
    }

    /// The scene that is queried.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Nearest hit.
    pub fn closest(&self, _ray: &Ray) -> Option<Hit> {
        None
    }

    /// True if anything lies on the segment.
    pub fn occluded(&self, _ray: &Ray) -> bool {
        false
    }
}
