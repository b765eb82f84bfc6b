//! What a point of a surface reflects, emits, covers and lets through: factors × textures × vertex colours.
//!
//! Points are given as instance or mesh, triangle of the mesh, and barycentrics of the triangle's second and third corner.

use super::{AlphaMode, MAX_REFLECTANCE, Material, Rgb, Scene, TextureSlot};
use glam::{Vec2, Vec4};

/// What a point of a surface, or a piece of it on average, has of its own. What light passes through, a hole of a mask or
/// in part a blended surface or glass, counts as not there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Appearance {
    /// Diffuse reflectance of what is there.
    pub reflectance: Rgb,
    /// Radiance that what is there emits, W/(m²·sr).
    pub emission: Rgb,
    /// Share that is there, 0..=1, mean of channels.
    pub opacity: f32,
}

impl Appearance {
    /// Mean over points with weights: of all of them for the opacity, of what is there for the rest.
    pub fn mean(points: impl IntoIterator<Item = (Self, f32)>) -> Self {
        let (mut sum, mut weights) = (Self::default(), 0.0);
        for (point, weight) in points {
            // Where all points lie in holes, rays may still meet what lies between them.
            let share = weight * point.opacity.max(f32::EPSILON);
            sum.reflectance += point.reflectance * share;
            sum.emission += point.emission * share;
            sum.opacity += share;
            weights += weight;
        }
        let there = sum.opacity.max(f32::MIN_POSITIVE);
        let opacity = (there / weights.max(f32::MIN_POSITIVE)).min(1.0);
        Self { reflectance: sum.reflectance / there, emission: sum.emission / there, opacity }
    }
}

impl Scene {
    /// All of a point's appearance. In the hole of a mask it is that of the surface without the mask, but for the opacity.
    pub fn appearance_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Appearance {
        let point = Point::new(self, self.instances[instance].mesh, triangle, barycentric);
        let color = point.base_color();
        let (reflectance, emission) = (point.reflectance(color), point.emission());
        if point.material.is_masked() && point.material.transmission <= 0.0 {
            return Appearance { reflectance, emission, opacity: point.alpha(color.w) };
        }
        let opacity = (1.0 - point.transmittance(color).element_sum() / 3.0).clamp(0.0, 1.0);
        let coverage = point.alpha(color.w) / opacity.max(f32::MIN_POSITIVE);
        Appearance { reflectance: reflectance * coverage, emission: emission * coverage, opacity }
    }

    /// Diffuse reflectance, 0 ..= [`MAX_REFLECTANCE`] per channel: base colour without the metallic and the transmitted
    /// share. Partial coverage is not in it, see [`Scene::alpha_at`].
    pub fn reflectance_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
        let point = Point::new(self, self.instances[instance].mesh, triangle, barycentric);
        point.reflectance(point.base_color())
    }

    /// Emitted radiance, W/(m²·sr), of the front face and, if the material is double sided, of the back.
    pub fn emission_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Rgb {
        Point::new(self, self.instances[instance].mesh, triangle, barycentric).emission()
    }

    /// Share of the point that is there, 0..=1: 0 or 1 with an alpha mask, 1 if alpha is ignored.
    pub fn alpha_at(&self, instance: usize, triangle: usize, barycentric: Vec2) -> f32 {
        let point = Point::new(self, self.instances[instance].mesh, triangle, barycentric);
        match point.material.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(_) | AlphaMode::Blend => point.alpha(point.base_color().w),
        }
    }

    /// True if a ray meets the surface of mesh `mesh` at that point, wholly or in part: always but in the holes of a mask.
    pub fn covers_at(&self, mesh: usize, triangle: usize, barycentric: Vec2) -> bool {
        let point = Point::new(self, mesh, triangle, barycentric);
        match point.material.alpha_mode {
            AlphaMode::Mask(cutoff) => point.base_color().w >= cutoff,
            AlphaMode::Opaque | AlphaMode::Blend => true,
        }
    }

    /// Share of light per channel that goes straight through a point of mesh `mesh`. Of a blended surface of base colour
    /// c and alpha a it is (1 − a)·(1 − a + a·c): 1 where there is no coverage, 0 where it is full, and in between the
    /// more tinted by the surface's colour the more it covers. glTF leaves open what a blended surface does to the light
    /// behind it; the factor 1 − a is its compositing, the tint is ours. KHR_materials_transmission adds its share of
    /// what is covered and no metal, times c.
    pub fn transmittance_at(&self, mesh: usize, triangle: usize, barycentric: Vec2) -> Rgb {
        let point = Point::new(self, mesh, triangle, barycentric);
        point.transmittance(point.base_color())
    }

    /// Parts along the sides of a triangle that are about as small as texels of the textures that say what it reflects,
    /// emits and covers, 1 without textures.
    pub fn texture_parts(&self, mesh: usize, triangle: usize) -> u32 {
        let material = self.material_of(mesh, triangle);
        let emission = material.emission_texture.filter(|_| material.emits());
        let slots = [material.base_color_texture, material.metallic_texture, material.transmission_texture, emission];
        let texels = |slot: &TextureSlot| {
            let Some([a, b, c]) = self.texture_corners(slot, mesh, triangle) else { return 0.0 };
            (b - a).abs().max((c - a).abs()).max_element()
        };
        (slots.iter().flatten().map(texels).fold(1.0, f32::max).ceil() as u32).max(1)
    }

    /// Where the corners of a triangle of mesh `mesh` lie in a texture, in its texels; none if the mesh lacks the
    /// coordinate set.
    pub fn texture_corners(&self, slot: &TextureSlot, mesh: usize, triangle: usize) -> Option<[Vec2; 3]> {
        let mesh = &self.meshes[mesh];
        let set = mesh.texcoords.get(slot.set).filter(|set| !set.is_empty())?;
        let texture = &self.textures[slot.texture];
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        Some(mesh.triangles[triangle].map(|v| slot.coordinate(set[v as usize]) * size))
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
    fn new(scene: &'a Scene, mesh: usize, triangle: usize, barycentric: Vec2) -> Self {
        Self { scene, mesh, triangle, barycentric, material: scene.material_of(mesh, triangle) }
    }

    /// Base colour (linear) and alpha, not clamped.
    fn base_color(&self) -> Vec4 {
        let factor = self.material.base_color.extend(self.material.alpha);
        let colors = &self.scene.meshes[self.mesh].colors;
        let vertex = if colors.is_empty() { Vec4::ONE } else { self.attribute(colors) };
        factor * vertex * self.color(&self.material.base_color_texture)
    }

    /// Share that is there, where the base colour's alpha is `alpha`.
    fn alpha(&self, alpha: f32) -> f32 {
        match self.material.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(alpha >= cutoff),
            AlphaMode::Blend => alpha.clamp(0.0, 1.0),
        }
    }

    /// Diffuse reflectance where the base colour is `color`.
    fn reflectance(&self, color: Vec4) -> Rgb {
        let diffuse = color.truncate() * ((1.0 - self.metallic()) * (1.0 - self.transmission()));
        diffuse.clamp(Rgb::ZERO, Rgb::splat(MAX_REFLECTANCE))
    }

    /// Share of light that goes straight through where the base colour is `color`.
    fn transmittance(&self, color: Vec4) -> Rgb {
        let alpha = self.alpha(color.w);
        let tint = color.truncate().clamp(Rgb::ZERO, Rgb::ONE);
        let beside = (1.0 - alpha) * (Rgb::splat(1.0 - alpha) + alpha * tint);
        if self.material.transmission <= 0.0 {
            return beside;
        }
        beside + tint * (alpha * self.transmission() * (1.0 - self.metallic()))
    }

    fn emission(&self) -> Rgb {
        if !self.material.emits() {
            return Rgb::ZERO;
        }
        self.material.emission * self.color(&self.material.emission_texture).truncate()
    }

    fn metallic(&self) -> f32 {
        self.material.metallic * self.data(&self.material.metallic_texture).z
    }

    fn transmission(&self) -> f32 {
        self.material.transmission * self.data(&self.material.transmission_texture).x
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
