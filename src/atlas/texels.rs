//! Lightmap texels as surface elements (surfels).

use super::Atlas;
use super::surface::{Face, Surface};
use crate::scene::{Rgb, Scene};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// Marks a page position that no chart covers.
pub const NO_TEXEL: u32 = u32::MAX;

/// All valid texels, chart by chart, within a chart in Morton order of their page position: every aligned
/// 2ⁿ×2ⁿ block of a chart is one range of texels. Structure of arrays, one entry per texel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texels {
    /// Page position.
    pub pixel: Vec<[u16; 2]>,
    /// Chart, index into `Atlas::charts`.
    pub chart: Vec<u32>,
    /// World position at the centroid of the covered part of the texel, on the surface.
    pub position: Vec<Vec3>,
    /// Unit shading normal, on the side of the geometric normal.
    pub shading_normal: Vec<Vec3>,
    /// Unit geometric normal of the front face.
    pub geometric_normal: Vec<Vec3>,
    /// World area covered, m².
    pub area: Vec<f32>,
    /// Share of the texel's square that its chart covers, 0 < c ≤ 1.
    pub coverage: Vec<f32>,
    /// Mean diffuse reflectance of what is there.
    pub reflectance: Vec<Rgb>,
    /// Share of the surface that light does not go through, by holes of alpha masks or in part, 0..=1. Empty if it goes
    /// through nothing with a lightmap.
    pub opacity: Vec<f32>,
    /// Mean radiance emitted by the front face where it is there, W/(m²·sr). Empty if nothing with a lightmap emits.
    pub emission: Vec<Rgb>,
    /// Texels of each chart.
    pub charts: Vec<Range<u32>>,
    /// Page position → texel.
    pub pages: Vec<PageTexels>,
    /// Start of each texel's run in `triangles`; one more entry than texels.
    pub first_triangle: Vec<u32>,
    /// Triangles (of the chart's instance) that overlap each texel, largest overlap first.
    pub triangles: Vec<u32>,
}

/// Texel index per page position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageTexels {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row-major, [`NO_TEXEL`] where no chart covers.
    pub texel: Vec<u32>,
}

/// A point on the surface inside a texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// World position.
    pub position: Vec3,
    /// Unit geometric normal of the front face.
    pub geometric_normal: Vec3,
    /// Unit shading normal, on the side of the geometric normal.
    pub shading_normal: Vec3,
}

impl Texels {
    /// Number of valid texels.
    pub fn len(&self) -> usize {
        self.pixel.len()
    }

    /// Tells layouts apart: a CRC-32 of where all texels lie, on the page and in the world.
    pub fn fingerprint(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(bytemuck::cast_slice(&self.pixel));
        hasher.update(bytemuck::cast_slice(&self.position));
        hasher.finalize()
    }

    /// True if there is no texel.
    pub fn is_empty(&self) -> bool {
        self.pixel.is_empty()
    }

    /// Triangles of the chart's instance that overlap `texel`, largest overlap first.
    pub fn triangles_of(&self, texel: u32) -> &[u32] {
        let t = texel as usize;
        &self.triangles[self.first_triangle[t] as usize..self.first_triangle[t + 1] as usize]
    }

    /// Material of most of `texel`. `scene` and `atlas` are those that the texels were rasterised from.
    pub fn material(&self, scene: &Scene, atlas: &Atlas, texel: u32) -> usize {
        let instance = atlas.charts[self.chart[texel as usize] as usize].instance;
        let mesh = &scene.meshes[scene.instances[instance].mesh];
        mesh.primitive_of(self.triangles_of(texel)[0] as usize).material
    }

    /// The surface under one texel. `scene` and `atlas` are those that the texels were rasterised from.
    pub fn surface<'a>(&'a self, scene: &'a Scene, atlas: &'a Atlas, texel: u32) -> TexelSurface<'a> {
        let corner = self.pixel[texel as usize].map(f32::from).into();
        let instance = atlas.charts[self.chart[texel as usize] as usize].instance;
        let surface = Surface::new(scene, atlas, instance).expect("texels belong to instances with a lightmap");
        let (&first, others) = self.triangles_of(texel).split_first().expect("a triangle covers every texel");
        TexelSurface { corner, first: surface.face(first), others, surface }
    }
}

/// The surface under one texel, ready to be sampled often.
pub struct TexelSurface<'a> {
    /// Page coordinate of the texel's corner.
    corner: Vec2,
    surface: Surface<'a>,
    /// The triangle that covers most of it.
    first: Face,
    others: &'a [u32],
}

impl TexelSurface<'_> {
    /// The surface point at `offset` (0..1 on both axes) inside the texel's square, none where the chart does not cover
    /// it.
    pub fn sample(&self, offset: Vec2) -> Option<SurfacePoint> {
        let p = self.corner + offset;
        let other = |&triangle: &u32| self.surface.barycentric(triangle, p).map(|b| self.surface.point(triangle, b));
        self.first.at(p).or_else(|| self.others.iter().find_map(other))
    }
}

impl PageTexels {
    /// The texel that page coordinate `p` falls into.
    pub fn at(&self, p: Vec2) -> Option<u32> {
        let (x, y) = (p.x.floor(), p.y.floor());
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32) {
            return None;
        }
        let t = self.texel[y as usize * self.width as usize + x as usize];
        (t != NO_TEXEL).then_some(t)
    }
}
