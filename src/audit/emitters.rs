//! Emissive surfaces as lights: points drawn on them by power, and the density with which a ray's hit would be drawn.

use super::mean_channel;
use super::shapes::Found;
use crate::accel::offset_origin;
use crate::math::Distribution;
use crate::scene::{Rgb, Scene};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Points along a side of a triangle at which its power is estimated: it only steers the draws.
const LOOKS: u32 = 4;
/// Share of the draws that goes by area alone, so that what the estimate of power misses is drawn, too.
const BY_AREA: f64 = 0.1;

/// The emissive triangles of one primitive of an instance.
pub(super) struct Emitter {
    instance: usize,
    triangles: Vec<usize>,
    /// Draws them by power and area.
    draw: Distribution,
    areas: Vec<f32>,
    /// A sphere around it.
    pub(super) centre: Vec3,
    pub(super) radius: f32,
    /// Estimate of radiance × area, mean of channels.
    pub(super) power: f64,
}

/// Where a triangle stands in its emitter.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) emitter: usize,
    index: usize,
}

/// All emissive surfaces of a scene, and where each triangle stands in them.
pub(super) fn collect(scene: &Scene) -> (Vec<Emitter>, HashMap<(u32, u32), Place>) {
    let (mut emitters, mut places) = (Vec::new(), HashMap::new());
    for (i, instance) in scene.instances.iter().enumerate() {
        for primitive in &scene.meshes[instance.mesh].primitives {
            let range = primitive.triangles.start as usize..primitive.triangles.end as usize;
            let lit = scene.materials[primitive.material].emits();
            let Some(emitter) = lit.then(|| Emitter::new(scene, i, range)).flatten() else { continue };
            for (index, &triangle) in emitter.triangles.iter().enumerate() {
                places.insert((i as u32, triangle as u32), Place { emitter: emitters.len(), index });
            }
            emitters.push(emitter);
        }
    }
    (emitters, places)
}

/// Radiance that a point of a triangle emits, W/(m²·sr): what is not there does not emit.
pub(super) fn emitted(scene: &Scene, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
    scene.emission_at(instance, triangle, barycentric) * scene.alpha_at(instance, triangle, barycentric)
}

impl Emitter {
    fn new(scene: &Scene, instance: usize, range: std::ops::Range<usize>) -> Option<Self> {
        let area = |t: usize| {
            let [a, b, c] = scene.corners(instance, t);
            0.5 * (b - a).cross(c - a).length()
        };
        let triangles: Vec<usize> = range.filter(|&t| area(t) > 0.0).collect();
        let areas: Vec<f32> = triangles.iter().map(|&t| area(t)).collect();
        let power = |(&t, &a): (&usize, &f32)| mean_radiance(scene, instance, t) * f64::from(a);
        let powers: Vec<f64> = triangles.iter().zip(&areas).map(power).collect();
        let (total, surface) = (powers.iter().sum::<f64>(), areas.iter().map(|&a| f64::from(a)).sum::<f64>());
        if surface <= 0.0 {
            return None;
        }
        let by_area = if total > 0.0 { BY_AREA } else { 1.0 };
        let draw = Distribution::new(powers.iter().zip(&areas).map(|(&power, &area)| {
            (1.0 - by_area) * power / total.max(f64::MIN_POSITIVE) + by_area * f64::from(area) / surface
        }));
        let corners = || triangles.iter().flat_map(|&t| scene.corners(instance, t));
        let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
        let (centre, radius) = ((low + high) * 0.5, low.distance(high) * 0.5);
        let power = total.max(f64::MIN_POSITIVE);
        Some(Self { instance, triangles, draw, areas, centre, radius, power })
    }

    /// Draws a point as seen from `p`. The distance ends just above the surface.
    pub(super) fn sample(&self, scene: &Scene, p: Vec3, u: Vec2) -> Option<Found> {
        let (index, within) = self.draw.draw(u.x);
        let root = within.sqrt();
        let barycentric = Vec2::new(root * (1.0 - u.y), root * u.y);
        let triangle = self.triangles[index];
        let [a, b, c] = scene.corners(self.instance, triangle);
        let q = a + (b - a) * barycentric.x + (c - a) * barycentric.y;
        let normal = scene.geometric_normal(self.instance, triangle);
        let facing = normal.dot((p - q).normalize_or_zero());
        let two_sided = scene.material_of(scene.instances[self.instance].mesh, triangle).double_sided;
        if facing == 0.0 || (facing < 0.0 && !two_sided) {
            return None;
        }
        let v = offset_origin(q, normal * facing.signum()) - p;
        let density = self.density(index, (q - p).length(), facing.abs());
        let weight = emitted(scene, self.instance, triangle, barycentric) / density;
        Some(Found { direction: v.normalize_or_zero(), distance: v.length(), weight, density: Some(density) })
    }

    /// Density, 1/sr, with which a hit on a triangle at `distance` with cosine `facing` is drawn.
    pub(super) fn density_at(&self, place: Place, distance: f32, facing: f32) -> f32 {
        self.density(place.index, distance, facing)
    }

    fn density(&self, index: usize, distance: f32, facing: f32) -> f32 {
        self.draw.chance(index) as f32 / self.areas[index] * distance * distance / facing.max(f32::MIN_POSITIVE)
    }
}

/// Rough mean over a triangle, mean of channels.
fn mean_radiance(scene: &Scene, instance: usize, triangle: usize) -> f64 {
    let n = LOOKS;
    let places = (0..n).flat_map(|i| (0..n - i).map(move |j| Vec2::new(i as f32 + 1.0 / 3.0, j as f32 + 1.0 / 3.0)));
    let sum: f64 = places.map(|p| mean_channel(emitted(scene, instance, triangle, p / n as f32))).sum();
    sum / f64::from(n * (n + 1) / 2)
}
