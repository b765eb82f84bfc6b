//! What a texel reflects and emits: material factor × texture × vertex colour, averaged over the texel's square.

use super::rasterise::Fragment;
use super::surface::Surface;
use crate::scene::{Appearance, TextureSlot};
use glam::Vec2;

/// Most samples per axis of a texel: bounds its cost where a texture is far finer than the lightmap.
const MAX_GRID: usize = 8;
/// Texels with more triangles than this are sampled once per triangle.
const MAX_GRID_TRIANGLES: usize = 4;
/// No more triangles than this are sampled; the smaller ones hardly count.
const MAX_TRIANGLES: usize = 64;

/// Mean over the texel at `pixel`, given what overlaps it, largest first.
pub(super) fn mean_appearance(surface: &Surface, pixel: Vec2, fragments: &[Fragment]) -> Appearance {
    let grid = match fragments.len() {
        1..=MAX_GRID_TRIANGLES => fragments.iter().map(|f| grid_size(surface, f.triangle)).max().unwrap_or(1),
        _ => 1,
    };
    let at = |triangle: u32, barycentric: Vec2| {
        surface.scene.appearance_at(surface.instance, triangle as usize, barycentric)
    };
    if grid > 1 {
        let on_grid = |i: usize| {
            let offset = (Vec2::new((i % grid) as f32, (i / grid) as f32) + 0.5) / grid as f32;
            let hit = |f: &Fragment| surface.barycentric(f.triangle, pixel + offset).map(|b| at(f.triangle, b));
            fragments.iter().find_map(hit)
        };
        let mut points = (0..grid * grid).filter_map(on_grid).map(|point| (point, 1.0)).peekable();
        if points.peek().is_some() {
            return Appearance::mean(points);
        }
    }
    // Also where a sliver slipped through the grid.
    let largest = &fragments[..fragments.len().min(MAX_TRIANGLES)];
    let middle = |f: &Fragment| at(f.triangle, surface.nearest(f.triangle, pixel + f.centroid));
    Appearance::mean(largest.iter().map(|f| (middle(f), f.area)))
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
