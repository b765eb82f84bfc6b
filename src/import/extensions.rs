//! Which required extensions a file may have, and how one is taken out of a document.

use super::ImportError;
use serde_json::Value;

/// Required extensions that are read, or that change nothing that a lightmap depends on.
const UNDERSTOOD: [&str; 28] = [
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
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MOZ_lightmap",
];

/// Fails on the first required extension that cannot be read.
pub(super) fn check_required(json: &Value) -> Result<(), ImportError> {
    let required = json.get("extensionsRequired").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for name in required.iter().filter_map(Value::as_str) {
        if UNDERSTOOD.contains(&name) {
            continue;
        }
        return Err(ImportError::RequiredExtension(name.into()));
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
