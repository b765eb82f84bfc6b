//! Which extensions are known and what becomes of them, and how one is taken out of a document.

use super::ImportError;
use serde_json::Value;

/// Extensions that are read, or that a lightmap may do without even where a file requires them.
const READ: [&str; 23] = [
    super::EXTENSION,
    "EXT_lights_area",
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MOZ_lightmap",
];

/// Extensions that change nothing about diffuse light at rest; a file that requires one asks for more than it is read for.
const WITHOUT_LIGHT: [&str; 7] = [
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_audio_emitter",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "EXT_mesh_features",
    "EXT_structural_metadata",
];

/// Extensions that change light and are left out: whether a file may require them, and what is done instead.
const LEFT_OUT: [(&str, bool, &str); 12] = [
    (
        "KHR_materials_clearcoat",
        true,
        "the coat is left out and the layer below is baked as if bare; darken its base colour",
    ),
    ("KHR_materials_sheen", true, "the sheen is left out; lighten the base colour if it matters"),
    ("KHR_materials_specular", true, "specular reflection is no part of a lightmap; the diffuse part is baked in full"),
    ("KHR_materials_iridescence", true, "the film is left out; only the base colour reflects"),
    ("KHR_materials_volume", true, "what the volume absorbs is left out; tint the base colour instead"),
    ("KHR_materials_volume_scatter", false, "scattering inside is left out; only the surface reflects"),
    (
        "KHR_materials_diffuse_transmission",
        false,
        "light scattered through the surface is left out; use KHR_materials_transmission",
    ),
    ("KHR_materials_subsurface", false, "scattering below the surface is left out; only the surface reflects"),
    ("KHR_materials_displacement", false, "the surface is baked flat; displace the mesh before the export"),
    ("EXT_lights_image_based", false, "its light is left out; give LIGHTKILN_scene an `environment` with an `image`"),
    ("MSFT_lod", false, "every level that the scene shows is baked; keep one"),
    ("KHR_physics_rigid_bodies", false, "bodies are baked where they stand; apply the simulation"),
];

/// What becomes of an extension in a lightmap.
pub(super) enum Fate {
    /// It is read, or changes nothing.
    Kept,
    /// It changes light and is left out; what is done instead.
    LeftOut(&'static str),
    /// Nobody here has heard of it.
    Unknown,
}

/// What becomes of the extension `name`.
pub(super) fn fate(name: &str) -> Fate {
    match LEFT_OUT.iter().find(|(known, ..)| *known == name) {
        Some((.., instead)) => Fate::LeftOut(instead),
        None if READ.contains(&name) || WITHOUT_LIGHT.contains(&name) => Fate::Kept,
        None => Fate::Unknown,
    }
}

/// Fails on the first required extension that cannot be read.
pub(super) fn check_required(json: &Value) -> Result<(), ImportError> {
    let required = json.get("extensionsRequired").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for name in required.iter().filter_map(Value::as_str) {
        let may_be_required = LEFT_OUT.iter().any(|&(known, required, _)| required && known == name);
        if !READ.contains(&name) && !may_be_required {
            return Err(ImportError::RequiredExtension(name.into()));
        }
    }
    Ok(())
}

/// Takes extension `name` from an object, and `extensions` with it if that is left empty.
pub(super) fn remove(object: &mut Value, name: &str) {
    let Some(fields) = object.as_object_mut() else { return };
    let Some(extensions) = fields.get_mut("extensions").and_then(Value::as_object_mut) else { return };
    extensions.shift_remove(name);
    if extensions.is_empty() {
        fields.shift_remove("extensions");
    }
}

/// Takes `name` from the lists of extensions that the document uses and requires.
pub(super) fn undeclare(document: &mut Value, name: &str) {
    let Some(fields) = document.as_object_mut() else { return };
    for key in ["extensionsUsed", "extensionsRequired"] {
        let Some(list) = fields.get_mut(key).and_then(Value::as_array_mut) else { continue };
        list.retain(|entry| entry.as_str() != Some(name));
        if list.is_empty() {
            fields.shift_remove(key);
        }
    }
}
