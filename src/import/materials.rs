//! glTF materials → Lambertian surfaces.
//!
//! The metallic share reflects nothing diffusely, the transmitted share passes, and what is left is base colour.
//! Unlit materials have no defined reflectance; their colour is taken for one.

use super::json;
use super::textures::TextureSlots;
use crate::document::Document;
use crate::scene::{AlphaMode, MAX_REFLECTANCE, Material, Rgb};
use crate::units::LightUnits;
use crate::warning::Warning;
use gltf::material::AlphaMode as SourceAlpha;
use serde_json::Value;

/// The material of glTF index `source`, or the default for primitives that have none.
///
/// `painted`: vertex colours multiply it somewhere.
pub(super) fn load(
    gltf: &gltf::Document,
    document: &Document,
    source: Option<usize>,
    painted: bool,
    units: LightUnits,
    slots: &mut TextureSlots,
    warnings: &mut Vec<Warning>,
) -> Material {
    let Some(material) = source.and_then(|i| gltf.materials().nth(i)) else {
        let message = "some primitives have no material: they are baked as white and diffuse; assign one";
        warnings.push(Warning::new("no_material", "default", message));
        return Material::default();
    };
    let index = source.unwrap_or_default();
    let name = material.name().map_or_else(|| format!("material{index}"), str::to_owned);
    let raw = &document.array("materials")[index];
    let extension = |name: &str| raw.get("extensions").and_then(|e| e.get(name));
    let mut slot = |info: Option<&Value>| slots.slot(document, gltf, info, &name, warnings);

    let raw_pbr = raw.get("pbrMetallicRoughness");
    let transmission = extension("KHR_materials_transmission");
    let base_color_texture = slot(raw_pbr.and_then(|p| p.get("baseColorTexture")));
    let metallic_texture = slot(raw_pbr.and_then(|p| p.get("metallicRoughnessTexture")));
    let transmission_texture = slot(transmission.and_then(|t| t.get("transmissionTexture")));
    let emission_texture = slot(raw.get("emissiveTexture"));

    let pbr = material.pbr_metallic_roughness();
    let [r, g, b, alpha] = pbr.base_color_factor();
    let strength = extension("KHR_materials_emissive_strength").and_then(|e| json::number(e, "emissiveStrength"));
    let unlit = extension("KHR_materials_unlit").is_some();
    let mut faults = Vec::new();
    let out = Material {
        source,
        base_color: sound(Rgb::new(r, g, b), "baseColorFactor", &mut faults),
        alpha: if alpha.is_finite() { alpha } else { 1.0 },
        base_color_texture,
        metallic: if unlit { 0.0 } else { share(pbr.metallic_factor()) },
        metallic_texture: metallic_texture.filter(|_| !unlit),
        transmission: share(transmission.and_then(|t| json::number(t, "transmissionFactor")).unwrap_or(0.0)),
        transmission_texture,
        emission: sound(
            Rgb::from_array(material.emissive_factor()) * strength.unwrap_or(1.0) * units.to_radiometric(),
            "emission",
            &mut faults,
        ),
        emission_texture,
        alpha_mode: match material.alpha_mode() {
            SourceAlpha::Opaque => AlphaMode::Opaque,
            SourceAlpha::Mask => AlphaMode::Mask(material.alpha_cutoff().unwrap_or(0.5)),
            SourceAlpha::Blend => AlphaMode::Blend,
        },
        double_sided: material.double_sided(),
        name: name.clone(),
    };
    let mut warn = |code, message: String| warnings.push(Warning::new(code, name.as_str(), message));
    for fault in faults {
        warn(
            "material_value",
            format!("material: {fault} is negative or not finite and taken as 0; mend the material"),
        );
    }
    if unlit {
        let message =
            "material: unlit; its colour is taken for the diffuse reflectance, and it emits nothing by itself";
        warn("unlit", message.into());
    }
    let defaulted_metal = raw_pbr.is_none_or(|p| p.get("metallicFactor").is_none()) && out.metallic_texture.is_none();
    if defaulted_metal && !unlit {
        let message = "material: no metallicFactor, which makes it a metal without diffuse reflection; \
                       set it to 0 if it is not (in Blender, use the Principled BSDF)";
        warn("metal_by_default", message.into());
    }
    let reflectance = out.base_color.max_element() * (1.0 - out.metallic) * (1.0 - out.transmission);
    // A texture or vertex colours usually bring a factor of one down: then only a factor above one is suspect.
    let limit = if out.base_color_texture.is_some() || painted { 1.0 } else { MAX_REFLECTANCE };
    if reflectance > limit {
        let message = format!(
            "material: its reflectance of {reflectance:.3} is capped at {MAX_REFLECTANCE}, or light would never be \
             absorbed; lower the base colour"
        );
        warn("reflectance_capped", message);
    }
    out
}

/// `value` with negative and non-finite channels set to zero, noting `what` if there were any.
fn sound(value: Rgb, what: &'static str, faults: &mut Vec<&'static str>) -> Rgb {
    let fixed = Rgb::from_array(value.to_array().map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 }));
    if fixed != value {
        faults.push(what);
    }
    fixed
}

/// A factor within 0..=1.
fn share(value: f32) -> f32 {
    if value.is_finite() { value.clamp(0.0, 1.0) } else { 0.0 }
}
