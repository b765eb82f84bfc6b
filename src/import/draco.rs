//! KHR_draco_mesh_compression undone: compressed primitives → plain accessors in a buffer of their own.

use super::{ImportError, extensions, json};
use draco_gltf::{DracoPrimitiveContract, DracoPrimitiveExtension, JsonValue, PackedGeometry, PrimitiveMode};
use rayon::prelude::*;
use serde_json::{Value, json};

/// The extension.
const NAME: &str = "KHR_draco_mesh_compression";

/// Decompresses all primitives and takes the extension out of `document`. The decoded data become a further buffer.
pub(super) fn decode(document: &mut Value, buffers: &mut Vec<Vec<u8>>) -> Result<(), ImportError> {
    let compressed = compressed_primitives(document);
    if compressed.is_empty() {
        return Ok(());
    }
    let decoded: Vec<PackedGeometry> = compressed
        .par_iter()
        .map(|place| {
            decode_primitive(document, place, buffers)
                .map_err(|fault| ImportError::invalid(format!("{} ({NAME})", place.label()), fault))
        })
        .collect::<Result<_, ImportError>>()?;

    let mut writer = Writer { document, buffer: buffers.len(), bytes: Vec::new() };
    for (place, geometry) in compressed.iter().zip(&decoded) {
        writer.replace(place, geometry);
    }
    let bytes = writer.bytes;
    push(document, "buffers", json!({"byteLength": bytes.len()}));
    buffers.push(bytes);
    extensions::undeclare(document, NAME);
    Ok(())
}

/// A primitive of the document.
struct Place {
    mesh: usize,
    primitive: usize,
}

impl Place {
    fn label(&self) -> String {
        format!("meshes[{}].primitives[{}]", self.mesh, self.primitive)
    }

    fn find<'a>(&self, document: &'a Value) -> &'a Value {
        &document["meshes"][self.mesh]["primitives"][self.primitive]
    }
}

fn compressed_primitives(document: &Value) -> Vec<Place> {
    let meshes = document.get("meshes").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let primitives = meshes.iter().enumerate().flat_map(|(mesh, value)| {
        let primitives = value.get("primitives").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        primitives.iter().enumerate().map(move |(primitive, value)| (Place { mesh, primitive }, value))
    });
    let compressed = primitives.filter(|(_, value)| value.get("extensions").and_then(|e| e.get(NAME)).is_some());
    compressed.map(|(place, _)| place).collect()
}

fn decode_primitive(document: &Value, place: &Place, buffers: &[Vec<u8>]) -> Result<PackedGeometry, String> {
    let primitive = place.find(document);
    let text = primitive["extensions"][NAME].to_string();
    let extension =
        DracoPrimitiveExtension::from_json(&JsonValue::parse(text.as_bytes())?).map_err(|e| e.to_string())?;

    let view = document.get("bufferViews").and_then(|views| views.get(extension.buffer_view()));
    let payload = view.and_then(|view| {
        let start = json::index(view, "byteOffset").unwrap_or(0);
        let end = start.checked_add(json::index(view, "byteLength")?)?;
        buffers.get(json::index(view, "buffer")?)?.get(start..end)
    });
    let payload = payload.ok_or("its buffer view does not exist or ends past its buffer")?;

    // Only what the stream holds is declared: other attributes are plain accessors and are checked as such.
    let mode = json::index(primitive, "mode").and_then(|mode| PrimitiveMode::from_gltf(u32::try_from(mode).ok()?));
    let mut contract = DracoPrimitiveContract::new().with_mode(mode.unwrap_or_default());
    for (semantic, _) in extension.attributes() {
        let accessor = accessor(document, primitive.get("attributes").and_then(|a| a.get(semantic)))
            .ok_or_else(|| format!("attribute {semantic} has no accessor"))?;
        let count = accessor.get("count").and_then(Value::as_u64).unwrap_or(0);
        contract = contract.with_attribute(semantic, count, json::boolean(accessor, "normalized").unwrap_or(false));
    }
    if let Some(count) = accessor(document, primitive.get("indices")).and_then(|a| a.get("count")?.as_u64()) {
        contract = contract.with_indices(count);
    }
    extension.decode(payload, &contract).map_err(|e| e.to_string())
}

fn accessor<'a>(document: &'a Value, index: Option<&Value>) -> Option<&'a Value> {
    document.get("accessors")?.get(usize::try_from(index?.as_u64()?).ok()?)
}

/// Appends to a top-level array and returns the index.
fn push(document: &mut Value, array: &str, value: Value) -> usize {
    let Some(root) = document.as_object_mut() else { return 0 };
    let entry = root.entry(array).or_insert_with(|| json!([]));
    if !entry.is_array() {
        *entry = json!([]);
    }
    let items = entry.as_array_mut().expect("it was made an array above");
    items.push(value);
    items.len() - 1
}

/// Puts decoded data in place of compressed ones.
struct Writer<'a> {
    document: &'a mut Value,
    /// Index that the new buffer gets.
    buffer: usize,
    bytes: Vec<u8>,
}

impl Writer<'_> {
    fn replace(&mut self, place: &Place, geometry: &PackedGeometry) {
        for attribute in geometry.attributes() {
            let index = place.find(self.document)["attributes"][attribute.semantic()].clone();
            let view = self.view(attribute.bytes());
            let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][usize::from(attribute.components()).clamp(1, 4) - 1];
            let component = attribute.component_type().to_gltf();
            self.fill(&index, view, component, kind, attribute.count());
        }
        let mut indices = place.find(self.document).get("indices").cloned();
        if let Some(packed) = geometry.indices() {
            let view = self.view(packed.bytes());
            let index = indices.get_or_insert_with(|| push(self.document, "accessors", json!({})).into()).clone();
            self.fill(&index, view, packed.component_type().to_gltf(), "SCALAR", packed.count());
        }
        let primitive = &mut self.document["meshes"][place.mesh]["primitives"][place.primitive];
        if let Some(indices) = indices {
            primitive["indices"] = indices;
        }
        // Whatever it was before compression, the stream holds a list.
        primitive["mode"] = geometry.mode().to_gltf().into();
        extensions::remove(primitive, NAME);
    }

    /// A view of `bytes`, aligned for every component type.
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        let view = json!({"buffer": self.buffer, "byteOffset": offset, "byteLength": bytes.len()});
        push(self.document, "bufferViews", view)
    }

    /// Points an accessor at decoded data; its name, bounds and extras stay.
    fn fill(&mut self, index: &Value, view: usize, component: u32, kind: &str, count: usize) {
        let index = index.as_u64().and_then(|index| usize::try_from(index).ok()).unwrap_or(usize::MAX);
        let Some(accessor) = self.document.get_mut("accessors").and_then(|a| a.get_mut(index)) else { return };
        let Some(accessor) = accessor.as_object_mut() else { return };
        accessor.shift_remove("byteOffset");
        accessor.shift_remove("sparse");
        accessor.insert("bufferView".into(), view.into());
        accessor.insert("componentType".into(), component.into());
        accessor.insert("type".into(), kind.into());
        accessor.insert("count".into(), count.into());
    }
}
