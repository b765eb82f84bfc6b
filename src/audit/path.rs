//! Paths from a surface point back to the lights: unbiased estimates of the irradiance at texels.
//!
//! At every turn one light is drawn, and the ray that goes on finds lights by chance; what both can find is weighted by
//! the balance heuristic. Paths end by Russian roulette. Based on: Kajiya, "The Rendering Equation", 1986; Veach,
//! Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995.

use super::emitters::emitted;
use super::footprint::Footprint;
use super::lamps::{Lamps, Receiver};
use super::rounds::ESTIMATES;
use crate::accel::{Accel, Hit, Ray, offset_origin};
use crate::atlas::{Atlas, SurfacePoint, Texels};
use crate::math::{Sequence, cosine_hemisphere, hash2, hash3, shuffled, unit_float};
use crate::scene::{Rgb, Scene};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI};
use std::ops::Range;

/// Turns before the roulette begins.
const SURE: u32 = 2;
/// Least chance to go on.
const LEAST_CHANCE: f32 = 0.05;
/// A lamp counts as reached when nothing is hit up to this share of its distance: lamps may lie on surfaces.
const REACHED: f32 = 1.0 - 1e-4;

/// Estimates irradiance by paths.
pub struct Tracer<'a> {
    accel: &'a Accel<'a>,
    atlas: &'a Atlas,
    texels: &'a Texels,
    lamps: Lamps<'a>,
    seed: u32,
}

/// Sums over paths.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Paths {
    /// Irradiance, W/m².
    pub(super) sum: DVec3,
    /// Rays cast.
    pub(super) rays: u64,
}

/// A point of a surface from which light is gathered.
struct Vertex {
    origin: Vec3,
    position: Vec3,
    geometric_normal: Vec3,
    shading_normal: Vec3,
}

/// What becomes of a path at a surface.
enum Next {
    /// It is reflected.
    Turn(Vertex),
    /// It goes through.
    Ahead,
    End,
}

/// A path on its way.
struct Walk<'t, 'a> {
    tracer: &'t Tracer<'a>,
    seed: u32,
    index: u32,
    /// Turns and translucent surfaces so far.
    events: u32,
    /// What the path's end counts at its start.
    weight: Rgb,
    gathered: Rgb,
    rays: u64,
}

impl<'a> Tracer<'a> {
    /// Paths through the scene of `accel`; `seed` makes them.
    pub fn new(accel: &'a Accel<'a>, atlas: &'a Atlas, texels: &'a Texels, seed: u32) -> Self {
        Self { accel, atlas, texels, lamps: Lamps::new(accel.scene()), seed }
    }

    /// Independent estimates of the mean irradiance over the texel's footprint, W/m², by `paths` paths each.
    pub fn estimates(&self, texel: u32, paths: u32) -> [Rgb; ESTIMATES] {
        let footprint = self.footprint(texel);
        let mean = |estimate: usize| self.paths(&footprint, estimate as u32, 0..paths).sum / f64::from(paths.max(1));
        std::array::from_fn(|estimate| mean(estimate).as_vec3())
    }

    /// Where the paths of a texel start.
    pub(super) fn footprint(&self, texel: u32) -> Footprint<'a> {
        Footprint::new(self.accel, self.atlas, self.texels, texel)
    }

    /// Paths `indices` of one of a texel's estimates.
    pub(super) fn paths(&self, footprint: &Footprint, estimate: u32, indices: Range<u32>) -> Paths {
        let seed = hash3(self.seed, footprint.texel, estimate);
        let mut paths = Paths::default();
        for index in indices {
            let place = Sequence::new(seed).second(index);
            let start = footprint.point(place, hash3(seed, index, 0xf007));
            let mut walk =
                Walk { tracer: self, seed, index, events: 0, weight: Rgb::ONE, gathered: Rgb::ZERO, rays: 0 };
            walk.run(Vertex::new(&start));
            paths.sum += walk.gathered.as_dvec3();
            paths.rays += walk.rays;
        }
        paths
    }

    fn scene(&self) -> &'a Scene {
        self.accel.scene()
    }
}

impl Vertex {
    fn new(point: &SurfacePoint) -> Self {
        Self {
            origin: offset_origin(point.position, point.geometric_normal),
            position: point.position,
            geometric_normal: point.geometric_normal,
            shading_normal: point.shading_normal,
        }
    }
}

impl Walk<'_, '_> {
    /// Follows the path from its first vertex until nothing more is to come.
    fn run(&mut self, first: Vertex) {
        let mut vertex = Some(first);
        while let Some(v) = vertex {
            let receiver = self.tracer.lamps.receiver(v.position, v.shading_normal);
            self.gather_drawn(&v, &receiver);
            let direction = cosine_hemisphere(v.shading_normal, self.numbers(0).0);
            if direction.dot(v.geometric_normal) <= 0.0 {
                return;
            }
            vertex = self.go_on(&v, &receiver, direction);
        }
    }

    /// Four stratified numbers for one purpose at the present event.
    fn numbers(&self, purpose: u32) -> (Vec2, Vec2) {
        let seed = hash2(self.seed, 2 * self.events + purpose);
        let index = shuffled(self.index, seed);
        let sequence = Sequence::new(seed);
        (sequence.first(index), sequence.second(index))
    }

    /// Light from one light, drawn.
    fn gather_drawn(&mut self, v: &Vertex, receiver: &Receiver) {
        let (place, which) = self.numbers(1);
        let Some(drawn) = self.tracer.lamps.draw(receiver, which.x, place) else { return };
        let found = drawn.found;
        let cosine = v.shading_normal.dot(found.direction);
        if cosine <= 0.0 || v.geometric_normal.dot(found.direction) <= 0.0 || found.weight == Rgb::ZERO {
            return;
        }
        let share = found.density.map_or(1.0, |density| {
            let drawn = density * drawn.chance;
            drawn / (drawn + cosine * FRAC_1_PI)
        });
        let passed = if drawn.casts_shadows {
            self.rays += 1;
            self.tracer.accel.visibility(&segment(v, found.direction, found.distance))
        } else {
            Rgb::ONE
        };
        self.gathered += self.weight * found.weight * passed * (share * cosine / drawn.chance);
    }

    /// Casts the ray that goes on, collects what shines along it, and returns the next place that reflects. What casts no
    /// shadow reflects, and hides what others reflect, but not what shines behind it.
    fn go_on(&mut self, v: &Vertex, receiver: &Receiver, direction: Vec3) -> Option<Vertex> {
        let cosine = v.shading_normal.dot(direction).max(f32::MIN_POSITIVE);
        let by_chance = cosine * FRAC_1_PI;
        let share = |drawn: f32| by_chance / (drawn + by_chance);
        let start = self.weight;
        let mut shines = start;
        let mut ray = Ray { origin: v.origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        let mut from = 0.0;
        let mut next = Next::Ahead;
        loop {
            self.rays += 1;
            let hit = self.tracer.accel.surface(&ray);
            let until = hit.map_or(f32::INFINITY, |h| h.t / REACHED);
            let (mut open, mut through) = (Rgb::ZERO, Rgb::ZERO);
            self.tracer.lamps.crossings(receiver, direction, |light, crossing| {
                let radiance = crossing.radiance * share(crossing.density);
                if !light.casts_shadows && ray.t_min == 0.0 {
                    open += radiance;
                } else if light.casts_shadows && crossing.distance > from && crossing.distance <= until {
                    through += radiance;
                }
            });
            self.gathered += PI * (start * open + shines * through);
            let scene = self.tracer.scene();
            let Some(hit) = hit else {
                self.gathered += PI * shines * scene.environment.radiance(direction);
                break;
            };
            let facing = -hit.normal.dot(direction);
            let (instance, triangle) = (hit.instance as usize, hit.triangle as usize);
            let is_seen = facing >= 0.0 || scene.material_of(scene.instances[instance].mesh, triangle).double_sided;
            if is_seen {
                let density = self.tracer.lamps.density_at(receiver, &hit, facing.abs());
                let radiance = emitted(scene, instance, triangle, hit.barycentric);
                self.gathered += PI * share(density) * shines * radiance;
            }
            if matches!(next, Next::Ahead) {
                next = self.next_at(&ray, &hit, is_seen);
            }
            if self.tracer.accel.casts_shadow(&hit) {
                shines *= self.tracer.accel.transmission_at(&hit).unwrap_or(Rgb::ZERO);
            }
            if shines == Rgb::ZERO {
                break;
            }
            from = until;
            ray = self.tracer.accel.behind(&ray, &hit);
        }
        match next {
            Next::Turn(vertex) => Some(vertex),
            Next::Ahead | Next::End => None,
        }
    }

    /// Whether the path is reflected at a hit, goes through, or ends there. Its weight changes accordingly.
    fn next_at(&mut self, ray: &Ray, hit: &Hit, is_seen: bool) -> Next {
        let scene = self.tracer.scene();
        let (instance, triangle) = (hit.instance as usize, hit.triangle as usize);
        let reflected = if is_seen {
            scene.reflectance_at(instance, triangle, hit.barycentric)
                * scene.alpha_at(instance, triangle, hit.barycentric)
        } else {
            Rgb::ZERO
        };
        let through = self.tracer.accel.transmission_at(hit).unwrap_or(Rgb::ZERO);
        let (reflects, passes) = ((self.weight * reflected).element_sum(), (self.weight * through).element_sum());
        if reflects + passes <= 0.0 {
            return Next::End;
        }
        self.events += 1;
        let numbers = [0, 1].map(|k| unit_float(hash3(self.seed, self.index, 4 * self.events + k)));
        let chance = reflects / (reflects + passes);
        let turns = numbers[0] < chance;
        self.weight *= if turns { reflected / chance } else { through / (1.0 - chance) };
        if self.events > SURE {
            let chance = self.weight.max_element().clamp(LEAST_CHANCE, 1.0);
            if numbers[1] >= chance {
                return Next::End;
            }
            self.weight /= chance;
        }
        if turns { Next::Turn(self.vertex_at(ray, hit)) } else { Next::Ahead }
    }

    /// The surface at a hit, on the side that was met.
    fn vertex_at(&self, ray: &Ray, hit: &Hit) -> Vertex {
        let scene = self.tracer.scene();
        let instance = &scene.instances[hit.instance as usize];
        let geometric_normal = if hit.normal.dot(ray.direction) <= 0.0 { hit.normal } else { -hit.normal };
        let normals = &scene.meshes[instance.mesh].normals;
        let shading = scene.interpolate(instance.mesh, hit.triangle as usize, hit.barycentric, normals);
        let shading = instance.transform_normal(shading);
        let cosine = shading.dot(geometric_normal);
        // A normal along the surface says nothing.
        let shading_normal = if cosine.abs() < 1e-4 { geometric_normal } else { shading * cosine.signum() };
        let position = ray.origin + ray.direction * hit.t;
        Vertex::new(&SurfacePoint { position, geometric_normal, shading_normal })
    }
}

/// The segment from a vertex to a light at `distance` from its position along `direction`: aimed anew from the lifted
/// origin, so that at grazing angles it does not pierce the light's own surface early.
fn segment(vertex: &Vertex, direction: Vec3, distance: f32) -> Ray {
    let origin = vertex.origin;
    if distance.is_infinite() {
        return Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    }
    let v = vertex.position + direction * distance - origin;
    let length = v.length();
    Ray { origin, direction: v / length.max(f32::MIN_POSITIVE), t_min: 0.0, t_max: length * REACHED }
}
