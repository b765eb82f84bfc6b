//! What a texel reflects and emits: material factor × texture × vertex colour, averaged over the texel's square.

use super::rasterise::Fragment;
use super::surface::Surface;
use crate::scene::{AlphaMode, MAX_REFLECTANCE, Material, Rgb, TextureSlot};
use glam::{Vec2, Vec4, Vec4Swizzles};

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
        self.reflectance += reflectance_at(surface, triangle, barycentric) * weight;
        self.emission += emission_at(surface, triangle, barycentric) * weight;
        self.weight += weight;
    }

    fn finish(self) -> (Rgb, Rgb) {
        let scale = if self.weight > 0.0 { 1.0 / self.weight } else { 0.0 };
        (self.reflectance * scale, self.emission * scale)
    }
}

/// Samples per axis that meet every texture texel under one lightmap texel, within bounds.
fn grid_size(surface: &Surface, triangle: u32) -> usize {
    let material = material(surface, triangle);
    let emission = material.emission_texture.filter(|_| material.emits());
    let footprint = [material.base_color_texture, emission]
        .iter()
        .flatten()
        .map(|slot| footprint(surface, slot, triangle))
        .fold(1.0, f32::max);
    (footprint.ceil() as usize).clamp(1, MAX_GRID)
}

/// Largest extent, in texels of the slot's texture, that one lightmap texel spans along either of its axes.
fn footprint(surface: &Surface, slot: &TextureSlot, triangle: u32) -> f32 {
    let Some(set) = texture_coordinates(surface, slot) else { return 1.0 };
    let texture = &surface.scene.textures[slot.texture];
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let [a, b, c] = surface.mesh.triangles[triangle as usize].map(|v| slot.coordinate(set[v as usize]) * size);
    let [dx, dy] = surface.barycentric_gradient(triangle);
    [dx, dy].iter().map(|d| ((b - a) * d.x + (c - a) * d.y).abs().max_element()).fold(0.0, f32::max)
}

/// Diffuse reflectance at barycentrics (of the 2nd and 3rd corner) of a triangle; zero in a hole.
fn reflectance_at(surface: &Surface, triangle: u32, barycentric: Vec2) -> Rgb {
    let material = material(surface, triangle);
    let color = base_color(surface, material, triangle, barycentric);
    if is_hole(material, color) {
        return Rgb::ZERO;
    }
    (color.xyz() * (1.0 - material.metallic)).clamp(Rgb::ZERO, Rgb::splat(MAX_REFLECTANCE))
}

/// Radiance that the front face emits at a point of a triangle, W/(m²·sr); zero in a hole.
fn emission_at(surface: &Surface, triangle: u32, barycentric: Vec2) -> Rgb {
    let material = material(surface, triangle);
    if !material.emits() || is_hole(material, base_color(surface, material, triangle, barycentric)) {
        return Rgb::ZERO;
    }
    let texture = material.emission_texture.as_ref();
    texture.map_or(material.emission, |slot| material.emission * sampled(surface, slot, triangle, barycentric).xyz())
}

/// Base colour and alpha: factor × texture × vertex colour.
fn base_color(surface: &Surface, material: &Material, triangle: u32, barycentric: Vec2) -> Vec4 {
    let mut color = material.base_color.extend(material.alpha);
    if let Some(slot) = &material.base_color_texture {
        color *= sampled(surface, slot, triangle, barycentric);
    }
    if !surface.mesh.colors.is_empty() {
        color *= surface.interpolated(&surface.mesh.colors, triangle, barycentric);
    }
    color
}

/// True where an alpha mask leaves no surface.
fn is_hole(material: &Material, color: Vec4) -> bool {
    matches!(material.alpha_mode, AlphaMode::Mask(cutoff) if color.w < cutoff)
}

/// Material of a triangle.
fn material<'a>(surface: &Surface<'a>, triangle: u32) -> &'a Material {
    &surface.scene.materials[surface.mesh.primitive_of(triangle as usize).material]
}

/// Linear colour of a slot at a point; white if the mesh lacks the set that the slot reads.
fn sampled(surface: &Surface, slot: &TextureSlot, triangle: u32, barycentric: Vec2) -> Vec4 {
    texture_coordinates(surface, slot).map_or(Vec4::ONE, |set| {
        let uv = slot.coordinate(surface.interpolated(set, triangle, barycentric));
        surface.scene.textures[slot.texture].sample(uv, slot.wrap, slot.filter)
    })
}

/// The texture coordinate set that a slot reads, none if the mesh lacks it.
fn texture_coordinates<'a>(surface: &Surface<'a>, slot: &TextureSlot) -> Option<&'a [Vec2]> {
    surface.mesh.texcoords.get(slot.set).map(Vec::as_slice).filter(|set| !set.is_empty())
}
