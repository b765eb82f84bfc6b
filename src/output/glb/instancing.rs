//! EXT_mesh_gpu_instancing written out: a node that places a mesh many times gets one child per place, because every
//! place has its own part of the lightmap.

use super::accessors::{component, component_count, component_size, pack};
use super::{GlbError, index};
use crate::document::Document;
use serde_json::{Map, Value, json};

/// The extension.
pub(super) const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// Nodes without a mesh for the places of `node`, in order; none if the node does not instance.
pub(super) fn places(document: &Document, node: usize) -> Result<Option<Vec<Map<String, Value>>>, GlbError> {
    let Some(extension) = document.extension("nodes", node, EXTENSION) else { return Ok(None) };
    let attributes = extension.get("attributes").and_then(Value::as_object).ok_or(GlbError::Attributes)?;
    let mut places: Vec<Map<String, Value>> = Vec::new();
    for (name, accessor) in attributes {
        let accessor = accessor.as_u64().ok_or(GlbError::Attributes)? as usize;
        let values = numbers(document, accessor)?;
        if places.is_empty() {
            places.resize(values.len(), Map::new());
        }
        for (place, value) in places.iter_mut().zip(values) {
            match name.as_str() {
                "TRANSLATION" => drop(place.insert("translation".into(), value.into())),
                "SCALE" => drop(place.insert("scale".into(), value.into())),
                "ROTATION" => drop(place.insert("rotation".into(), unit(value).into())),
                // Attributes of the application's own become extras.
                _ => {
                    let extras = place.entry("extras").or_insert_with(|| json!({}));
                    extras[name.as_str()] = value.into();
                }
            }
        }
    }
    Ok(Some(places))
}

/// Elements of an accessor, normalised integers as fractions.
fn numbers(document: &Document, accessor: usize) -> Result<Vec<Vec<f64>>, GlbError> {
    let json = document.array("accessors").get(accessor).ok_or(GlbError::Accessor(accessor))?;
    let packed = pack(document, accessor)?;
    let read = || {
        let kind = index(json, "componentType")?;
        let components = component_count(json.get("type")?.as_str()?)?;
        let normalized = json.get("normalized").and_then(Value::as_bool).unwrap_or(false);
        let unit = if normalized { largest(kind)? } else { 1.0 };
        let element = |e: &[u8]| (0..components).map(|c| Some((component(e, kind, c)? / unit).max(-1e38))).collect();
        packed.bytes.chunks_exact(packed.size).map(element).collect::<Option<Vec<Vec<f64>>>>()
    };
    read().ok_or(GlbError::Accessor(accessor))
}

/// Largest value of an integer component type.
fn largest(component_type: usize) -> Option<f64> {
    let bits = 8 * component_size(component_type)? as i32;
    match component_type {
        5120 | 5122 => Some(2f64.powi(bits - 1) - 1.0),
        5121 | 5123 => Some(2f64.powi(bits) - 1.0),
        _ => None,
    }
}

/// A rotation of length one, as glTF demands; quantised ones are only nearly so.
fn unit(q: Vec<f64>) -> Vec<f64> {
    let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length > 0.0 { q.into_iter().map(|c| c / length).collect() } else { vec![0.0, 0.0, 0.0, 1.0] }
}
