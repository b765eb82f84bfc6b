//! Coverage of surfaces: where alpha opens holes, and what blended and transmitting surfaces let through.

use super::bvh8::AlphaTest;
use crate::scene::{AlphaMode, Rgb, Scene, TextureSlot};
use glam::{Vec2, Vec4};

/// How rays must treat a triangle, none if it is transparent everywhere.
pub(super) fn alpha_test(scene: &Scene, mesh: usize, triangle: usize) -> Option<AlphaTest> {
    let material = scene.material_of(mesh, triangle);
    let varies = material.base_color_texture.is_some() || !scene.meshes[mesh].colors.is_empty();
    if material.transmission > 0.0 {
        return Some(AlphaTest::Blend);
    }
    match material.alpha_mode {
        AlphaMode::Opaque => Some(AlphaTest::None),
        AlphaMode::Mask(_) if varies => Some(AlphaTest::Mask),
        AlphaMode::Mask(cutoff) => (material.alpha >= cutoff).then_some(AlphaTest::None),
        AlphaMode::Blend if varies => Some(AlphaTest::Blend),
        AlphaMode::Blend if material.alpha >= 1.0 => Some(AlphaTest::None),
        AlphaMode::Blend => (material.alpha > 0.0).then_some(AlphaTest::Blend),
    }
}

/// Base colour (linear) and alpha at a point of a triangle of mesh `mesh`: factor × texture × vertex colour, whatever the alpha mode.
pub fn base_color_at(scene: &Scene, mesh: usize, triangle: usize, barycentric: Vec2) -> Vec4 {
    let material = scene.material_of(mesh, triangle);
    let geometry = &scene.meshes[mesh];
    let mut color = material.base_color.extend(material.alpha);
    if let Some(slot) = &material.base_color_texture
        && let Some(set) = geometry.texcoords.get(slot.set).filter(|set| !set.is_empty())
    {
        let uv = slot.coordinate(scene.interpolate(mesh, triangle, barycentric, set));
        color *= scene.textures[slot.texture].sample(uv, slot.wrap, slot.filter);
    }
    if !geometry.colors.is_empty() {
        color *= scene.interpolate(mesh, triangle, barycentric, &geometry.colors);
    }
    color
}

/// True if a masked surface is there at that point.
pub(super) fn covers(scene: &Scene, mesh: usize, triangle: usize, barycentric: Vec2) -> bool {
    match scene.material_of(mesh, triangle).alpha_mode {
        AlphaMode::Mask(cutoff) => base_color_at(scene, mesh, triangle, barycentric).w >= cutoff,
        AlphaMode::Opaque | AlphaMode::Blend => true,
    }
}

/// Share of light per channel that goes straight through a point of a triangle of mesh `mesh`. Of a blended surface of
/// base colour c and alpha a it is (1 − a)·(1 − a + a·c): 1 where there is no coverage, 0 where it is full, and in
/// between the more tinted by the surface's colour the more it covers. glTF leaves open what a blended surface does to
/// the light behind it; the factor 1 − a is its compositing, the tint is ours. KHR_materials_transmission adds its share
/// of what is covered and no metal, times c.
pub(super) fn straight_through(scene: &Scene, mesh: usize, triangle: usize, barycentric: Vec2) -> Rgb {
    let material = scene.material_of(mesh, triangle);
    let color = base_color_at(scene, mesh, triangle, barycentric);
    let alpha = match material.alpha_mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask(cutoff) => f32::from(color.w >= cutoff),
        AlphaMode::Blend => color.w.clamp(0.0, 1.0),
    };
    let tint = color.truncate().clamp(Rgb::ZERO, Rgb::ONE);
    let beside = (1.0 - alpha) * (Rgb::splat(1.0 - alpha) + alpha * tint);
    if material.transmission <= 0.0 {
        return beside;
    }
    let data = |slot: &Option<TextureSlot>| {
        let Some(slot) = slot else { return Vec4::ONE };
        let set = scene.meshes[mesh].texcoords.get(slot.set).filter(|set| !set.is_empty());
        let uv = set.map_or(Vec2::ZERO, |set| scene.interpolate(mesh, triangle, barycentric, set));
        scene.textures[slot.texture].sample_data(slot.coordinate(uv), slot.wrap, slot.filter)
    };
    let transmission = material.transmission * data(&material.transmission_texture).x;
    let metallic = material.metallic * data(&material.metallic_texture).z;
    beside + tint * (alpha * transmission * (1.0 - metallic))
}
