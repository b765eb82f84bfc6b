//! Emissive surfaces: which are sent like lamps and which are met by gather rays.

use super::lamp::{EmitterTriangle, Lamp, Shape};
use crate::scene::{Rgb, Scene};
use glam::{Vec2, Vec3};

/// Emitters this many times brighter than the mean exitance are too bright to be found by chance.
const CONTRAST: f32 = 4.0;
/// So few triangles are always cheaper and exact when sent.
const FEW: usize = 128;
/// Where this share of all surfaces emits, every ray finds emitters and sending them gains nothing.
const MOST: f32 = 0.6;
/// Triangles of one lamp at most.
const GROUP: usize = 64;

/// How each emissive primitive is treated.
#[derive(Clone, Debug, Default)]
pub struct Emission {
    /// Per instance and primitive: true if gather rays see its emission, false if it is sent (or dark).
    seen: Vec<Vec<bool>>,
}

impl Emission {
    /// True if gather rays see the emission of a triangle; false if it is sent like a lamp, or dark.
    pub fn is_seen(&self, scene: &Scene, instance: usize, triangle: usize) -> bool {
        let mesh = &scene.meshes[scene.instances[instance].mesh];
        self.seen[instance][mesh.primitives.partition_point(|p| p.triangles.end as usize <= triangle)]
    }

    /// True if gather rays may see any emission at all.
    pub fn any_seen(&self) -> bool {
        self.seen.iter().flatten().any(|&s| s)
    }
}

/// Sorts emissive surfaces into those that are met by gather rays and those that are sent; returns the lamps that
/// stand for the latter.
pub fn classify(scene: &Scene) -> (Emission, Vec<Lamp>) {
    let mut emission =
        Emission { seen: scene.instances.iter().map(|i| vec![false; scene.meshes[i.mesh].primitives.len()]).collect() };
    let mut candidates = Vec::new();
    for instance in 0..scene.instances.len() {
        let mesh = &scene.meshes[scene.instances[instance].mesh];
        for (primitive, p) in mesh.primitives.iter().enumerate() {
            if scene.materials[p.material].emits() {
                let triangles = triangles_of(scene, instance, p.triangles.start as usize..p.triangles.end as usize);
                if !triangles.is_empty() {
                    candidates.push((instance, primitive, triangles));
                }
            }
        }
    }
    let total = surface_area(scene);
    let sum = |f: &dyn Fn(&EmitterTriangle) -> f32| candidates.iter().flat_map(|c| &c.2).map(f).sum::<f32>();
    let mean = sum(&|t| t.area * t.radiance.max_element()) / total;
    let emitting = sum(&|t| t.area) / total;
    let few = candidates.iter().map(|c| c.2.len()).sum::<usize>() <= FEW && emitting < MOST;
    let mut lamps = Vec::new();
    for (instance, primitive, triangles) in candidates {
        let area: f32 = triangles.iter().map(|t| t.area).sum();
        let power: f32 = triangles.iter().map(|t| t.area * t.radiance.max_element()).sum();
        if few || power / area >= CONTRAST * mean {
            group(triangles, &mut lamps);
        } else {
            emission.seen[instance][primitive] = true;
        }
    }
    (emission, lamps)
}

/// Area of all surfaces, m².
fn surface_area(scene: &Scene) -> f32 {
    (0..scene.instances.len())
        .flat_map(|i| (0..scene.meshes[scene.instances[i].mesh].triangles.len()).map(move |t| (i, t)))
        .map(|(i, t)| area(scene.corners(i, t)))
        .sum::<f32>()
        .max(f32::MIN_POSITIVE)
}

fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

fn triangles_of(scene: &Scene, instance: usize, range: std::ops::Range<usize>) -> Vec<EmitterTriangle> {
    let mesh = scene.instances[instance].mesh;
    // Four points per triangle bound the work for textures; the corners' thirds and the middle.
    let points = [(1.0 / 3.0, 1.0 / 3.0), (0.6, 0.2), (0.2, 0.6), (0.2, 0.2)].map(|(v, w)| Vec2::new(v, w));
    range
        .filter_map(|triangle| {
            let corners = scene.corners(instance, triangle);
            let radiance =
                points.iter().map(|&b| emitted(scene, instance, triangle, b)).sum::<Rgb>() / points.len() as f32;
            let area = area(corners);
            (radiance.max_element() > 0.0 && area > 0.0).then(|| EmitterTriangle {
                corners,
                normal: scene.geometric_normal(instance, triangle),
                radiance,
                area,
                two_sided: scene.material_of(mesh, triangle).double_sided,
                cumulative: 0.0,
            })
        })
        .collect()
}

/// Radiance of a point; what is not covered does not emit.
fn emitted(scene: &Scene, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
    scene.emission_at(instance, triangle, barycentric) * scene.alpha_at(instance, triangle, barycentric)
}

/// Splits triangles at the median of their longest extent until each group is small, and makes each a lamp.
fn group(mut triangles: Vec<EmitterTriangle>, lamps: &mut Vec<Lamp>) {
    if triangles.len() > GROUP {
        let centre = |t: &EmitterTriangle| (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
        let low = triangles.iter().map(centre).fold(Vec3::INFINITY, Vec3::min);
        let high = triangles.iter().map(centre).fold(Vec3::NEG_INFINITY, Vec3::max);
        let size = high - low;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three axes");
        triangles.sort_by(|a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
        let rest = triangles.split_off(triangles.len() / 2);
        group(triangles, lamps);
        group(rest, lamps);
        return;
    }
    let total: f32 = triangles.iter().map(|t| t.area * t.radiance.max_element()).sum();
    let mut sum = 0.0;
    for t in &mut triangles {
        sum += t.area * t.radiance.max_element();
        t.cumulative = sum / total;
    }
    let corners = || triangles.iter().flat_map(|t| t.corners);
    let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
    let (centre, radius) = ((low + high) * 0.5, low.distance(high) * 0.5);
    lamps.push(Lamp { shape: Shape::Triangles { triangles, centre, radius }, casts_shadows: true });
}
