//! Diffuse surfaces: what a face reflects, emits and lets through.

use super::{Filter, Rgb, Wrap};
use glam::{Affine2, Vec2};

/// How alpha is read.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// A surface where alpha is at least the cutoff, a hole elsewhere.
    Mask(f32),
    /// Partial coverage.
    Blend,
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Index into [`super::Scene::textures`].
    pub texture: usize,
    /// Which TEXCOORD_n.
    pub set: usize,
    /// KHR_texture_transform, identity without it.
    pub transform: Affine2,
    /// Wrap modes along u and v.
    pub wrap: [Wrap; 2],
    /// Magnification filter.
    pub filter: Filter,
}

impl TextureSlot {
    /// Texture coordinate after the slot's transform.
    pub fn coordinate(&self, uv: Vec2) -> Vec2 {
        self.transform.transform_point2(uv)
    }
}

/// A Lambertian surface.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in messages.
    pub name: String,
    /// Index of the material in the source file, none for glTF's default material.
    pub source: Option<usize>,
    /// Base colour factor, linear.
    pub base_color: Rgb,
    /// Alpha factor.
    pub alpha: f32,
    /// Multiplies base colour and alpha; sRGB-encoded.
    pub base_color_texture: Option<TextureSlot>,
    /// Share of the surface that is metal and reflects nothing diffusely.
    pub metallic: f32,
    /// Its blue channel (linear) multiplies `metallic`.
    pub metallic_texture: Option<TextureSlot>,
    /// Share of the diffuse part that is transmitted instead (KHR_materials_transmission).
    pub transmission: f32,
    /// Its red channel (linear) multiplies `transmission`.
    pub transmission_texture: Option<TextureSlot>,
    /// Radiance emitted, W/(m²·sr), factor × strength.
    pub emission: Rgb,
    /// Multiplies the emission; sRGB-encoded.
    pub emission_texture: Option<TextureSlot>,
    /// How alpha is read.
    pub alpha_mode: AlphaMode,
    /// True if both faces reflect and emit.
    pub double_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            source: None,
            base_color: Rgb::ONE,
            alpha: 1.0,
            base_color_texture: None,
            metallic: 0.0,
            metallic_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            emission: Rgb::ZERO,
            emission_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
        }
    }
}

/// Reflectance is capped here: a surface that returns all light has no finite radiosity solution.
pub const MAX_REFLECTANCE: f32 = 0.98;

impl Material {
    /// True if any point of the surface may emit.
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }

    /// True if the surface may have holes or let light through in part.
    pub fn lets_light_through(&self) -> bool {
        self.alpha_mode != AlphaMode::Opaque || self.transmission > 0.0
    }

    /// True if the surface may have holes.
    pub fn is_masked(&self) -> bool {
        matches!(self.alpha_mode, AlphaMode::Mask(_))
    }
}
