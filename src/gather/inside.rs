//! Whether points lie inside other geometry, where no light is: what they see are backs, and no light reaches them.
//!
//! Backs alone do not tell: from under a crown of one-sided leaves, or in a house modelled from outside only, one sees
//! backs wherever one looks, and the sun between them.

use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::SurfacePoint;
use crate::math::{cosine_hemisphere, hash3, orthonormal_basis, unit_float};
use crate::scene::{LightShape, Scene};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// Rays by which points look around for light, and as many to what shines.
const LOOKS: usize = 96;

/// What has an inside, and what may light it.
pub(super) struct Insides<'a> {
    accel: &'a Accel<'a>,
    /// True if anything has an inside.
    exist: bool,
    shining: Vec<Shining>,
}

/// Something that shines and is hidden by what stands before it.
enum Shining {
    /// Direction to a sun.
    Sun(Vec3),
    /// Where a lamp is.
    Lamp(Vec3),
    /// Emissive triangles of an instance.
    Surface(usize, Range<u32>),
}

impl<'a> Insides<'a> {
    pub(super) fn new(accel: &'a Accel<'a>) -> Self {
        let scene = accel.scene();
        let lamps = scene.lights.iter().filter(|lamp| lamp.casts_shadows).map(|lamp| match lamp.shape {
            LightShape::Sun { .. } => Shining::Sun(lamp.axes[2]),
            _ => Shining::Lamp(lamp.position),
        });
        let surfaces = scene.instances.iter().enumerate().flat_map(|(i, instance)| {
            let primitives = scene.meshes[instance.mesh].primitives.iter();
            let shining = primitives.filter(|p| !p.triangles.is_empty() && scene.materials[p.material].emits());
            shining.map(move |p| Shining::Surface(i, p.triangles.clone()))
        });
        Self { accel, exist: has_solids(scene), shining: lamps.chain(surfaces).collect() }
    }

    /// True if most of what is seen from the point is the back of a solid.
    pub(super) fn shows_backs(&self, position: Vec3, normal: Vec3) -> bool {
        let (scene, origin) = (self.accel.scene(), offset_origin(position, normal));
        let is_back = |direction: Vec3| {
            self.accel.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }).is_some_and(|hit| {
                let mesh = scene.instances[hit.instance as usize].mesh;
                let solid = scene.meshes[mesh].closed || !scene.material_of(mesh, hit.triangle as usize).double_sided;
                solid && hit.normal.dot(direction) > 0.0 && self.accel.transmission_at(&hit).is_none()
            })
        };
        if !self.exist || !is_back(normal) {
            return false;
        }
        let (x, y) = orthonormal_basis(normal);
        [x, -x, y, -y].iter().filter(|&&side| is_back((normal + side).normalize())).count() >= 3
    }

    /// True if light comes to one of `points`: from outside, through something, from a lamp or from an emitter.
    pub(super) fn are_reached(&self, points: &[SurfacePoint], seed: u32) -> bool {
        let looks = if points.is_empty() { 0 } else { LOOKS };
        points.iter().cycle().take(looks).enumerate().any(|(i, p)| {
            let random = |axis| unit_float(hash3(seed, i as u32, axis));
            let shining = self.shining.get((random(2) * self.shining.len() as f32) as usize);
            self.sees_light(p, cosine_hemisphere(p.geometric_normal, Vec2::new(random(0), random(1))))
                || shining.is_some_and(|shining| self.sees(p, shining, random(3)))
        })
    }

    /// True if light may come to `p` along `direction`.
    fn sees_light(&self, p: &SurfacePoint, direction: Vec3) -> bool {
        let (scene, origin) = (self.accel.scene(), offset_origin(p.position, p.geometric_normal));
        match self.accel.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }) {
            None => !scene.environment.is_black(),
            Some(hit) => {
                let mesh = scene.instances[hit.instance as usize].mesh;
                scene.material_of(mesh, hit.triangle as usize).emits() || self.accel.transmission_at(&hit).is_some()
            }
        }
    }

    /// True if nothing stands between `p` and what shines; `u` chooses the place on a surface.
    fn sees(&self, p: &SurfacePoint, shining: &Shining, u: f32) -> bool {
        let origin = offset_origin(p.position, p.geometric_normal);
        let (direction, t_max) = match *shining {
            Shining::Sun(direction) => (direction, f32::INFINITY),
            Shining::Lamp(position) => ((position - origin).normalize_or_zero(), (position - origin).length()),
            Shining::Surface(instance, ref triangles) => {
                let triangle = triangles.start as usize + (u * triangles.len() as f32) as usize;
                let [a, b, c] = self.accel.scene().corners(instance, triangle.min(triangles.end as usize - 1));
                let v = (a + b + c) / 3.0 - origin;
                return v.dot(p.geometric_normal) > 0.0 && self.sees_light(p, v.normalize_or_zero());
            }
        };
        let faces = direction.dot(p.geometric_normal) > 0.0;
        faces && !self.accel.occluded(&Ray { origin, direction, t_min: 0.0, t_max })
    }
}

/// True if anything in the scene has an inside, or a back that is no surface.
fn has_solids(scene: &Scene) -> bool {
    scene.instances.iter().any(|i| {
        let mesh = &scene.meshes[i.mesh];
        mesh.closed || mesh.primitives.iter().any(|p| !scene.materials[p.material].double_sided)
    })
}
