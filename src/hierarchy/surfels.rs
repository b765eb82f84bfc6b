//! The surface elements that the radiosity system works on: lightmap texels, and patches of what has no lightmap.
//!
//! Surfel indices count texels first, then patches.

use crate::atlas::{Atlas, Texels};
use crate::math::triangle_middles;
use crate::scene::{Appearance, Rgb, Scene};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// A triangle without a lightmap is cut into 4ⁿ patches; n is at most this.
const MAX_PATCH_LEVEL: u32 = 6;
/// Most parts along a patch's sides whose looks are averaged.
const MOST_PARTS: u32 = 16;

/// Texels and patches of a scene.
pub struct Surfels<'a> {
    /// The lightmap's texels.
    pub texels: &'a Texels,
    /// Per texel: true if something stands on it.
    covered: &'a [bool],
    /// Per texel: true if geometry parts it from a neighbour.
    parted: &'a [bool],
    /// Per texel: true if geometry crosses it.
    crossed: &'a [bool],
    patches: Patches,
}

/// What is left of the area of a surfel that something stands on or crosses, or that light goes through: it says little of
/// what is seen, but it must not vanish from an element that has no other.
const COVERED: f32 = 1e-3;

/// Pieces of the triangles of instances without a lightmap. Structure of arrays.
#[derive(Default)]
struct Patches {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    area: Vec<f32>,
    reflectance: Vec<Rgb>,
    emission: Vec<Rgb>,
    /// Scene instance and triangle of its mesh.
    owner: Vec<(u32, u32)>,
    /// Per scene instance: its triangles' runs of patches, empty if it has a lightmap.
    triangles: Vec<Vec<TrianglePatches>>,
}

/// The patches of one triangle, in the order of [`patch_index`].
#[derive(Clone, Copy)]
struct TrianglePatches {
    first: u32,
    level: u32,
}

/// A run of surfels that form one surface: a chart or a triangle.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Surfel indices.
    pub surfels: Range<u32>,
    /// Scene instance.
    pub instance: usize,
}

impl<'a> Surfels<'a> {
    /// Collects texels, and patches no larger than the scene's extent over 64 along an edge. `covered` marks texels
    /// that something stands on, `parted` those that geometry parts from a neighbour, `crossed` those that it crosses.
    pub fn new(
        scene: &Scene,
        atlas: &Atlas,
        texels: &'a Texels,
        covered: &'a [bool],
        parted: &'a [bool],
        crossed: &'a [bool],
    ) -> Self {
        let mut patches = Patches { triangles: vec![Vec::new(); scene.instances.len()], ..Patches::default() };
        let target = extent(scene) / 64.0;
        for (instance, layout) in atlas.layouts.iter().enumerate() {
            if layout.is_none() {
                patches.add_instance(scene, instance, target);
            }
        }
        Self { texels, covered, parted, crossed, patches }
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.texels.len() + self.patches.position.len()
    }

    /// True if there is no surface at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All surfaces: charts in order, then triangles without a lightmap.
    pub fn surfaces(&self, atlas: &Atlas) -> Vec<Surface> {
        let charts = self.texels.charts.iter().zip(&atlas.charts);
        let mut all: Vec<Surface> = charts
            .filter(|(r, _)| !r.is_empty())
            .map(|(r, c)| Surface { surfels: r.clone(), instance: c.instance })
            .collect();
        let base = self.texels.len() as u32;
        for (instance, triangles) in self.patches.triangles.iter().enumerate() {
            all.extend(
                triangles
                    .iter()
                    .map(|t| Surface { surfels: base + t.first..base + t.first + (1 << (2 * t.level)), instance }),
            );
        }
        all
    }

    /// World position.
    pub fn position(&self, s: u32) -> Vec3 {
        self.pick(s, |t, i| t.position[i], |p, i| p.position[i])
    }

    /// Unit geometric normal of the front face.
    pub fn normal(&self, s: u32) -> Vec3 {
        self.pick(s, |t, i| t.geometric_normal[i], |p, i| p.normal[i])
    }

    /// True if something stands on the surfel.
    pub fn is_covered(&self, s: u32) -> bool {
        self.covered.get(s as usize).is_some_and(|&c| c)
    }

    /// True if geometry parts the surfel from a neighbour, so that the two must not share an element.
    pub fn is_parted(&self, s: u32) -> bool {
        self.parted.get(s as usize).is_some_and(|&c| c)
    }

    /// True if nothing stands on the surfel or crosses it.
    pub fn is_clear(&self, s: u32) -> bool {
        !self.is_covered(s) && !self.crossed.get(s as usize).is_some_and(|&c| c)
    }

    /// Area that takes part in the exchange of light, without what light goes through, m².
    pub fn area(&self, s: u32) -> f32 {
        let free = if self.is_clear(s) { 1.0 } else { COVERED };
        let texel = |t: &Texels, i: usize| t.area[i] * free * t.opacity.get(i).map_or(1.0, |o| o.max(COVERED));
        self.pick(s, texel, |p, i| p.area[i])
    }

    /// Area with what something stands on or light goes through, m².
    pub fn extent(&self, s: u32) -> f32 {
        self.pick(s, |t, i| t.area[i], |p, i| p.area[i])
    }

    /// Diffuse reflectance of what is there.
    pub fn reflectance(&self, s: u32) -> Rgb {
        self.pick(s, |t, i| t.reflectance[i], |p, i| p.reflectance[i])
    }

    /// Radiance that the front emits, W/(m²·sr).
    pub fn emission(&self, s: u32) -> Rgb {
        self.pick(s, |t, i| t.emission.get(i).copied().unwrap_or(Rgb::ZERO), |p, i| p.emission[i])
    }

    /// Scene instance and triangle that the surfel lies on; the largest if a texel lies on several.
    pub fn triangle(&self, atlas: &Atlas, s: u32) -> (usize, usize) {
        let texel =
            |t: &Texels, i: usize| (atlas.charts[t.chart[i] as usize].instance, t.triangles_of(i as u32)[0] as usize);
        self.pick(s, texel, |p, i| (p.owner[i].0 as usize, p.owner[i].1 as usize))
    }

    /// Key whose right-shifts by two group neighbouring surfels of one surface, four by four.
    pub fn morton(&self, s: u32) -> u64 {
        let base = self.texels.len() as u32;
        if s < base {
            let [x, y] = self.texels.pixel[s as usize];
            spread(x) | spread(y) << 1
        } else {
            (s - base) as u64
        }
    }

    /// The surfel at a point of a triangle, or none where the atlas lost it.
    pub fn at(&self, atlas: &Atlas, instance: usize, triangle: usize, barycentric: Vec2) -> Option<u32> {
        match &atlas.layouts[instance] {
            Some(layout) => {
                let [a, b, c] = layout.corners[triangle];
                let p = a + (b - a) * barycentric.x + (c - a) * barycentric.y;
                self.texels.pages[atlas.charts[layout.charts[triangle] as usize].page].at(p)
            }
            None => {
                let t = self.patches.triangles[instance].get(triangle)?;
                Some(self.texels.len() as u32 + t.first + patch_index(barycentric, t.level))
            }
        }
    }

    fn pick<T>(&self, s: u32, texel: impl Fn(&Texels, usize) -> T, patch: impl Fn(&Patches, usize) -> T) -> T {
        let n = self.texels.len();
        let i = s as usize;
        if i < n { texel(self.texels, i) } else { patch(&self.patches, i - n) }
    }
}

impl Patches {
    fn add_instance(&mut self, scene: &Scene, instance: usize, target: f32) {
        let mesh = scene.instances[instance].mesh;
        for triangle in 0..scene.meshes[mesh].triangles.len() {
            let corners = scene.corners(instance, triangle);
            let [a, b, c] = corners;
            let edge = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let level = (edge / target).log2().ceil().clamp(0.0, MAX_PATCH_LEVEL as f32) as u32;
            self.triangles[instance].push(TrianglePatches { first: self.position.len() as u32, level });
            let normal = scene.geometric_normal(instance, triangle);
            let area = 0.5 * (b - a).cross(c - a).length() / (1 << (2 * level)) as f32;
            let parts = (scene.texture_parts(mesh, triangle) >> level).clamp(1, MOST_PARTS);
            for index in 0..1 << (2 * level) {
                let at = |bary: Vec2| scene.appearance_at(instance, triangle, bary);
                // The corners of the patch, between which its looks are averaged.
                let [first, second, third] = patch_corners(index, level);
                let inside = |w: Vec2| first + (second - first) * w.x + (third - first) * w.y;
                let looks = Appearance::mean(triangle_middles(parts).map(|w| (at(inside(w)), 1.0)));
                let centre = inside(Vec2::splat(1.0 / 3.0));
                self.position.push(a + (b - a) * centre.x + (c - a) * centre.y);
                self.normal.push(normal);
                self.area.push(area * looks.opacity.max(COVERED));
                self.reflectance.push(looks.reflectance);
                self.emission.push(looks.emission);
                self.owner.push((instance as u32, triangle as u32));
            }
        }
    }
}

/// Largest side of the bounding box of all instances, metres.
fn extent(scene: &Scene) -> f32 {
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for i in &scene.instances {
        for &p in &scene.meshes[i.mesh].positions {
            let p = i.transform.transform_point3(p);
            (lo, hi) = (lo.min(p), hi.max(p));
        }
    }
    (hi - lo).max_element().max(f32::MIN_POSITIVE)
}

/// Index of the patch that holds `barycentric` when a triangle is cut `level` times into four: one base-4 digit per
/// level, 0, 1, 2 the piece at the first, second, third corner, 3 the (inverted) middle.
fn patch_index(barycentric: Vec2, level: u32) -> u32 {
    let (mut v, mut w) = (barycentric.x, barycentric.y);
    let mut index = 0;
    for _ in 0..level {
        let u = 1.0 - v - w;
        let digit;
        (digit, v, w) = if u >= 0.5 {
            (0, 2.0 * v, 2.0 * w)
        } else if v >= 0.5 {
            (1, 2.0 * v - 1.0, 2.0 * w)
        } else if w >= 0.5 {
            (2, 2.0 * v, 2.0 * w - 1.0)
        } else {
            (3, 1.0 - 2.0 * v, 1.0 - 2.0 * w)
        };
        index = index << 2 | digit;
    }
    index
}

/// Barycentrics of a patch's corners: the inverse of [`patch_index`].
fn patch_corners(index: u32, level: u32) -> [Vec2; 3] {
    [Vec2::ZERO, Vec2::X, Vec2::Y].map(|mut p| {
        for l in 0..level {
            p = match index >> (2 * l) & 3 {
                0 => p * 0.5,
                1 => p * 0.5 + Vec2::new(0.5, 0.0),
                2 => p * 0.5 + Vec2::new(0.0, 0.5),
                _ => 0.5 - p * 0.5,
            };
        }
        p
    })
}

/// Puts a zero bit between the bits of `x`.
fn spread(x: u16) -> u64 {
    let mut x = x as u64;
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patch_centres_lie_in_their_patches() {
        for level in 0..5 {
            for index in 0..1 << (2 * level) {
                let [a, b, c] = patch_corners(index, level);
                assert_eq!(patch_index((a + b + c) / 3.0, level), index);
            }
        }
    }
}
