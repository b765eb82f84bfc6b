//! Emissive surfaces: which are sent like lamps and which are met by gather rays.

use super::emitter_triangle::EmitterTriangle;
use super::lamp::{Lamp, Shape};
use crate::math::{Distribution, triangle_middles};
use crate::scene::{Group, LightGroups, Rgb, Scene};
use glam::{Vec2, Vec3};

/// Emitters this many times brighter than the mean exitance are too bright to be found by chance.
const CONTRAST: f32 = 4.0;
/// So few triangles are always cheaper and exact when sent.
const FEW: usize = 128;
/// Where this share of all surfaces emits, every ray finds emitters and sending them gains nothing.
const MOST: f32 = 0.6;
/// Bounds of the parts along a triangle's side where its radiance is looked at: vertex colours vary without texture.
const FEWEST_PARTS: u32 = 2;
const MOST_PARTS: u32 = 256;
/// Triangles of one lamp at most.
pub(super) const BUNDLE: usize = 64;

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
        self.seen[instance][mesh.primitive_index(triangle)]
    }

    /// True if gather rays may see any emission at all.
    pub fn any_seen(&self) -> bool {
        self.seen.iter().flatten().any(|&s| s)
    }
}

/// Sorts emissive surfaces into those that are met by gather rays and those that are sent; returns the lamps that
/// stand for the latter.
pub fn classify(scene: &Scene, groups: &LightGroups) -> (Emission, Vec<Lamp>) {
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
            bundle(triangles, groups.of_emitter(instance, primitive), &mut lamps);
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
    range
        .filter_map(|triangle| {
            let corners = scene.corners(instance, triangle);
            let radiance = mean_radiance(scene, instance, triangle);
            let area = area(corners);
            (radiance.max_element() > 0.0 && area > 0.0).then(|| EmitterTriangle {
                corners,
                normal: scene.geometric_normal(instance, triangle),
                radiance,
                area,
                two_sided: scene.material_of(mesh, triangle).double_sided,
            })
        })
        .collect()
}

/// Mean over the triangle, holes included: over its texels if a texture varies it.
fn mean_radiance(scene: &Scene, instance: usize, triangle: usize) -> Rgb {
    let parts = scene.texture_parts(scene.instances[instance].mesh, triangle).clamp(FEWEST_PARTS, MOST_PARTS);
    let emitted = |at: Vec2| {
        let point = scene.appearance_at(instance, triangle, at);
        point.emission * point.opacity
    };
    triangle_middles(parts).map(emitted).sum::<Rgb>() / (parts * parts) as f32
}

/// Splits triangles at the median of their longest extent until each bundle is small, and makes each a lamp.
fn bundle(mut triangles: Vec<EmitterTriangle>, group: Group, lamps: &mut Vec<Lamp>) {
    if triangles.len() > BUNDLE {
        let centre = |t: &EmitterTriangle| (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
        let low = triangles.iter().map(centre).fold(Vec3::INFINITY, Vec3::min);
        let high = triangles.iter().map(centre).fold(Vec3::NEG_INFINITY, Vec3::max);
        let size = high - low;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three axes");
        triangles.sort_by(|a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
        let rest = triangles.split_off(triangles.len() / 2);
        bundle(triangles, group, lamps);
        bundle(rest, group, lamps);
        return;
    }
    let draw = Distribution::new(triangles.iter().map(|t| f64::from(t.area * t.radiance.max_element())));
    let corners = || triangles.iter().flat_map(|t| t.corners);
    let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
    let (centre, radius) = ((low + high) * 0.5, low.distance(high) * 0.5);
    lamps.push(Lamp { shape: Shape::Triangles { triangles, draw, centre, radius }, casts_shadows: true, group });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Filter, Instance, LightmapRequest, Material, Mesh, Primitive, Texture, TextureSlot, Wrap};

    #[test]
    fn a_textured_emitter_sends_the_sum_of_its_texels() {
        let n = 64;
        // Code 255 on a few texels, black elsewhere: points between them would miss the light.
        let lit = |i: u32| i.is_multiple_of(13);
        let texels = (0..n * n).map(|i| if lit(i) { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let slot = TextureSlot {
            texture: 0,
            set: 0,
            transform: glam::Affine2::IDENTITY,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
        };
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let mesh = Mesh {
            normals: vec![Vec3::Z; 4],
            texcoords: vec![positions.iter().map(|p| p.truncate()).collect()],
            positions,
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            primitives: vec![Primitive { source: 0, vertices: 0..4, triangles: 0..2, material: 0 }],
            ..Mesh::default()
        };
        let instance = Instance {
            path: "Screen".into(),
            node: 0,
            mesh: 0,
            transform: glam::Affine3A::IDENTITY,
            casts_shadows: true,
            lightmap: LightmapRequest::None,
            group: None,
            gpu_instance: None,
        };
        let scene = Scene {
            meshes: vec![mesh],
            instances: vec![instance],
            materials: vec![Material { emission: Rgb::ONE, emission_texture: Some(slot), ..Material::default() }],
            textures: vec![Texture { name: "screen".into(), width: n, height: n, texels }],
            ..Scene::default()
        };
        let triangles = triangles_of(&scene, 0, 0..2);
        let power: f32 = triangles.iter().map(|t| t.area * t.radiance.x).sum();
        let expected = (0..n * n).filter(|&i| lit(i)).count() as f32 / (n * n) as f32;
        assert!((power / expected - 1.0).abs() < 0.01, "{power} instead of {expected}");
    }
}
