//! glTF materials → Lambertian surfaces.
//!
//! The metallic share reflects nothing diffusely, the transmitted share passes, and what is left is base colour.
//! Unlit materials have no defined reflectance: their colour is taken for one, and as in core glTF's rule for them they
//! do not emit.

use super::json;
use super::meshes::UsedMaterial;
use super::source::Source;
use super::textures::TextureSlots;
use crate::scene::{AlphaMode, MAX_REFLECTANCE, Material, Rgb, TextureSlot};
use crate::units::LightUnits;
use crate::warning::Warning;
use gltf::material::AlphaMode as SourceAlpha;
use serde_json::Value;

/// The surface of a glTF material, with emission in W/(m²·sr). Its textures become slots of `slots`.
pub(super) fn load(
    source: &Source,
    used: &UsedMaterial,
    units: LightUnits,
    slots: &mut TextureSlots,
    warnings: &mut Vec<Warning>,
) -> Material {
    let Some((index, core)) = used.source.and_then(|i| Some((i, source.gltf.materials().nth(i)?))) else {
        let message = "it or other objects have faces without a material: they are baked white and diffuse; assign one";
        warnings.push(Warning::new("no_material", used.path.as_str(), message));
        return Material::default();
    };
    let name = core.name().map_or_else(|| format!("material{index}"), str::to_owned);
    let raw = &source.document.array("materials")[index];
    let mut texture = |info: Option<&Value>| slots.slot(source, info, &name, warnings);
    let mut faults = Faults::default();
    let reflection = Reflection::read(&core, raw, &mut texture, &mut faults);

    let unlit = extension(raw, "KHR_materials_unlit").is_some();
    let strength = extension(raw, "KHR_materials_emissive_strength").and_then(|e| json::number(e, "emissiveStrength"));
    let emission = Rgb::from_array(core.emissive_factor()) * strength.unwrap_or(1.0) * units.to_radiometric();
    let emission = if unlit { Rgb::ZERO } else { faults.sound(emission, "emission") };
    let transmission = extension(raw, "KHR_materials_transmission");
    let out = Material {
        source: Some(index),
        base_color: reflection.base_color,
        alpha: reflection.alpha,
        base_color_texture: reflection.base_color_texture,
        metallic: if unlit { 0.0 } else { reflection.metallic },
        metallic_texture: reflection.metallic_texture,
        transmission: share(transmission.and_then(|t| json::number(t, "transmissionFactor")).unwrap_or(0.0)),
        transmission_texture: texture(transmission.and_then(|t| t.get("transmissionTexture"))),
        emission,
        // Without emission there is no need to keep the picture in memory.
        emission_texture: if emission == Rgb::ZERO { None } else { texture(raw.get("emissiveTexture")) },
        alpha_mode: match core.alpha_mode() {
            SourceAlpha::Opaque => AlphaMode::Opaque,
            SourceAlpha::Mask => AlphaMode::Mask(core.alpha_cutoff().unwrap_or(0.5)),
            SourceAlpha::Blend => AlphaMode::Blend,
        },
        double_sided: core.double_sided(),
        name,
    };
    faults.check_cap(&out, used.painted);
    if unlit {
        let message = "unlit; its colour is taken for the diffuse reflectance, and it does not emit: use an emissive \
                       material if it should";
        faults.note("unlit", message.into());
    } else if reflection.metallic_by_default {
        let message = "no metallicFactor, which makes it a metal without diffuse reflection: set it to 0 if it is not \
                       one (in Blender, use the Principled BSDF)";
        faults.note("metal_by_default", message.into());
    }
    let found = faults.0.into_iter();
    warnings.extend(found.map(|(code, text)| Warning::new(code, out.name.as_str(), format!("material: {text}"))));
    out
}

fn extension<'a>(material: &'a Value, name: &str) -> Option<&'a Value> {
    material.get("extensions")?.get(name)
}

/// The part of a material that decides what it reflects.
struct Reflection {
    base_color: Rgb,
    alpha: f32,
    base_color_texture: Option<TextureSlot>,
    metallic: f32,
    metallic_texture: Option<TextureSlot>,
    /// The file does not say that it is a metal, only glTF's default does.
    metallic_by_default: bool,
}

impl Reflection {
    fn read(
        core: &gltf::Material,
        raw: &Value,
        texture: &mut dyn FnMut(Option<&Value>) -> Option<TextureSlot>,
        faults: &mut Faults,
    ) -> Self {
        // The archived predecessor of metallic and roughness still stands in old files, often without a fallback.
        if let Some(old) = extension(raw, "KHR_materials_pbrSpecularGlossiness") {
            let [r, g, b, alpha] = json::numbers(old, "diffuseFactor").unwrap_or([1.0; 4]);
            return Self {
                base_color: faults.sound(Rgb::new(r, g, b), "diffuseFactor"),
                alpha: share(alpha),
                base_color_texture: texture(old.get("diffuseTexture")),
                metallic: 0.0,
                metallic_texture: None,
                metallic_by_default: false,
            };
        }
        let pbr = core.pbr_metallic_roughness();
        let raw = raw.get("pbrMetallicRoughness");
        let [r, g, b, alpha] = pbr.base_color_factor();
        let metallic = share(pbr.metallic_factor());
        let metallic_info = raw.and_then(|p| p.get("metallicRoughnessTexture"));
        Self {
            base_color: faults.sound(Rgb::new(r, g, b), "baseColorFactor"),
            alpha: share(alpha),
            base_color_texture: texture(raw.and_then(|p| p.get("baseColorTexture"))),
            metallic,
            metallic_texture: if metallic > 0.0 { texture(metallic_info) } else { None },
            metallic_by_default: metallic_info.is_none() && raw.is_none_or(|p| p.get("metallicFactor").is_none()),
        }
    }
}

/// Code and text of what is wrong with a material.
#[derive(Default)]
struct Faults(Vec<(&'static str, String)>);

impl Faults {
    fn note(&mut self, code: &'static str, text: String) {
        self.0.push((code, text));
    }

    /// `value` with negative and non-finite channels set to zero.
    fn sound(&mut self, value: Rgb, what: &str) -> Rgb {
        let fixed = Rgb::from_array(value.to_array().map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 }));
        if fixed != value {
            self.note("material_value", format!("{what} is negative or not finite and taken as 0; correct it"));
        }
        fixed
    }

    fn check_cap(&mut self, material: &Material, painted: bool) {
        let reflectance = material.base_color.max_element() * (1.0 - material.metallic) * (1.0 - material.transmission);
        // Textures and vertex colours usually bring a factor of one down: then only a factor above one is suspect.
        let limit = if material.base_color_texture.is_some() || painted { 1.0 } else { MAX_REFLECTANCE };
        if reflectance > limit {
            let text = format!(
                "its reflectance of {reflectance:.3} is capped at {MAX_REFLECTANCE}, or light would never be absorbed; \
                 lower the base colour"
            );
            self.note("reflectance_capped", text);
        }
    }
}

/// A factor within 0..=1, 0 if it is not finite.
fn share(value: f32) -> f32 {
    if value.is_finite() { value.clamp(0.0, 1.0) } else { 0.0 }
}
