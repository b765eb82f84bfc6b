//! What a point of a surface reflects, emits and covers: factors × textures × vertex colours.
//!
//! Points are given as instance, triangle of its mesh, and barycentrics of the triangle's second and third corner.

use super::{AlphaMode, MAX_REFLECTANCE, Material, Rgb, Scene, TextureSlot};
use glam::{Vec2, Vec4};

impl Scene {
    /// Diffuse reflectance, 0 ..= [`MAX_REFLECTANCE`] per channel: base colour without the metallic and the transmitted
    /// share. Partial coverage is not in it, see [`Scene::alpha_at`].
    pub fn reflectance_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
        let point = Point::new(self, instance, triangle, barycentric);
        let m = point.material;
        let metallic = m.metallic * point.data(&m.metallic_texture).z;
        let transmission = m.transmission * point.data(&m.transmission_texture).x;
        let diffuse = point.base_color().truncate() * ((1.0 - metallic) * (1.0 - transmission));
        diffuse.clamp(Rgb::ZERO, Rgb::splat(MAX_REFLECTANCE))
    }

    /// Emitted radiance, W/(m²·sr), of the front face and, if the material is double sided, of the back.
    pub fn emission_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
        let material = self.material_of(self.instances[instance].mesh, triangle);
        if !material.emits() {
            return Rgb::ZERO;
        }
        let point = Point::new(self, instance, triangle, barycentric);
        material.emission * point.color(&material.emission_texture).truncate()
    }

    /// Share of the point that is there, 0..=1: 0 or 1 with an alpha mask, 1 if alpha is ignored.
    pub fn alpha_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> f32 {
        let material = self.material_of(self.instances[instance].mesh, triangle);
        let alpha = || Point::new(self, instance, triangle, barycentric).base_color().w;
        match material.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(alpha() >= cutoff),
            AlphaMode::Blend => alpha().clamp(0.0, 1.0),
        }
    }
}

/// A point on the surface with the material that covers it.
struct Point<'a> {
    scene: &'a Scene,
    mesh: usize,
    triangle: usize,
    barycentric: Vec2,
    material: &'a Material,
}

impl<'a> Point<'a> {
    fn new(scene: &'a Scene, instance: usize, triangle: usize, barycentric: Vec2) -> Self {
        let mesh = scene.instances[instance].mesh;
        Self { scene, mesh, triangle, barycentric, material: scene.material_of(mesh, triangle) }
    }

    /// Base colour (linear) and alpha, not clamped.
    fn base_color(&self) -> Vec4 {
        let factor = self.material.base_color.extend(self.material.alpha);
        let colors = &self.scene.meshes[self.mesh].colors;
        let vertex = if colors.is_empty() { Vec4::ONE } else { self.attribute(colors) };
        factor * vertex * self.color(&self.material.base_color_texture)
    }

    /// Value of an sRGB-encoded texture, one without it.
    fn color(&self, slot: &Option<TextureSlot>) -> Vec4 {
        let Some(slot) = slot else { return Vec4::ONE };
        self.scene.textures[slot.texture].sample(self.coordinate(slot), slot.wrap, slot.filter)
    }

    /// Value of a texture that holds data, one without it.
    fn data(&self, slot: &Option<TextureSlot>) -> Vec4 {
        let Some(slot) = slot else { return Vec4::ONE };
        self.scene.textures[slot.texture].sample_data(self.coordinate(slot), slot.wrap, slot.filter)
    }

    /// Where the point lies in a texture: the origin if the mesh lacks the coordinate set.
    fn coordinate(&self, slot: &TextureSlot) -> Vec2 {
        let uv = match self.scene.meshes[self.mesh].texcoords.get(slot.set) {
            Some(set) if !set.is_empty() => self.attribute(set),
            _ => Vec2::ZERO,
        };
        slot.coordinate(uv)
    }

    fn attribute<T>(&self, values: &[T]) -> T
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        self.scene.interpolate(self.mesh, self.triangle, self.barycentric, values)
    }
}
