//! What a texel reflects and emits: material factor × texture × vertex colour, averaged over the texel's square.

use super::rasterise::Fragment;
use super::surface::Surface;
use crate::scene::{Rgb, TextureSlot};
use glam::Vec2;

/// Most samples per axis of a texel: bounds its cost where a texture is far finer than the lightmap.
const MAX_GRID: usize = 8;
/// Texels with more triangles than this are sampled once per triangle.
const MAX_GRID_TRIANGLES: usize = 4;
/// No more triangles than this are sampled; the smaller ones hardly count.
const MAX_TRIANGLES: usize = 64;

/// Mean diffuse reflectance and emitted radiance (W/(m²·sr)) over the texel at `pixel`, given what overlaps it, largest
/// first.
pub(super) fn mean_appearance(surface: &Surface, pixel: Vec2, fragments: &[Fragment]) -> (Rgb, Rgb) {
    let grid = match fragments.len() {
        1..=MAX_GRID_TRIANGLES => fragments.iter().map(|f| grid_size(surface, f.triangle)).max().unwrap_or(1),
        _ => 1,
    };
    let mut mean = Mean::default();
    if grid > 1 {
        for i in 0..grid * grid {
            let offset = (Vec2::new((i % grid) as f32, (i / grid) as f32) + 0.5) / grid as f32;
            let hit =
                fragments.iter().find_map(|f| surface.barycentric(f.triangle, pixel + offset).map(|b| (f.triangle, b)));
            if let Some((triangle, barycentric)) = hit {
                mean.add(surface, triangle, barycentric, 1.0);
            }
        }
    }
    // Also where a sliver slipped through the grid.
    if mean.weight == 0.0 {
        for f in &fragments[..fragments.len().min(MAX_TRIANGLES)] {
            mean.add(surface, f.triangle, surface.nearest(f.triangle, pixel + f.centroid), f.area);
        }
    }
    mean.finish()
}

/// Weighted sums of reflectance and emission.
#[derive(Default)]
struct Mean {
    reflectance: Rgb,
    emission: Rgb,
    weight: f32,
}

impl Mean {
    fn add(&mut self, surface: &Surface, triangle: u32, barycentric: Vec2, weight: f32) {
        let (scene, instance, triangle) = (surface.scene, surface.instance, triangle as usize);
        // A hole counts with its area, but neither reflects nor emits.
        let there = scene.alpha_at(instance, triangle, barycentric) * weight;
        self.reflectance += scene.reflectance_at(instance, triangle, barycentric) * there;
        self.emission += scene.emission_at(instance, triangle, barycentric) * there;
        self.weight += weight;
    }

    fn finish(self) -> (Rgb, Rgb) {
        let scale = if self.weight > 0.0 { 1.0 / self.weight } else { 0.0 };
        (self.reflectance * scale, self.emission * scale)
    }
}

/// Samples per axis that meet every texture texel under one lightmap texel, within bounds.
fn grid_size(surface: &Surface, triangle: u32) -> usize {
    let material = surface.scene.material_of(surface.scene.instances[surface.instance].mesh, triangle as usize);
    let emission = material.emission_texture.filter(|_| material.emits());
    let slots = [material.base_color_texture, material.metallic_texture, material.transmission_texture, emission];
    let footprint = slots.iter().flatten().map(|slot| footprint(surface, slot, triangle)).fold(1.0, f32::max);
    (footprint.ceil() as usize).clamp(1, MAX_GRID)
}

/// Largest extent, in texels of the slot's texture, that one lightmap texel spans along either of its axes.
fn footprint(surface: &Surface, slot: &TextureSlot, triangle: u32) -> f32 {
    let mesh = surface.scene.instances[surface.instance].mesh;
    let Some([a, b, c]) = surface.scene.texture_corners(slot, mesh, triangle as usize) else { return 1.0 };
    let [dx, dy] = surface.barycentric_gradient(triangle);
    [dx, dy].iter().map(|d| ((b - a) * d.x + (c - a) * d.y).abs().max_element()).fold(0.0, f32::max)
}
