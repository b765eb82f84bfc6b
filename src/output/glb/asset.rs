//! The lit copy while it grows: JSON plus one binary buffer, and its container.

use super::{GlbError, index};
use crate::document::Document;
use serde_json::{Map, Value, json};

/// A vertex buffer view's target.
pub(super) const ARRAY_BUFFER: u32 = 34962;
/// An index buffer view's target.
pub(super) const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// A glTF asset whose buffers are joined to one.
pub(super) struct Asset {
    /// The document.
    pub(super) json: Map<String, Value>,
    /// The only buffer.
    bin: Vec<u8>,
}

impl Asset {
    /// A copy of `document` with its buffers joined.
    pub(super) fn copy(document: &Document) -> Result<Self, GlbError> {
        let Value::Object(json) = document.json.clone() else { return Err(GlbError::NotAnObject) };
        let mut asset = Self { json, bin: Vec::new() };
        let mut starts = Vec::with_capacity(document.buffers.len());
        for buffer in &document.buffers {
            starts.push(asset.append(buffer));
        }
        for view in asset.array("bufferViews") {
            move_to_joined(view, &starts);
            let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
            // Compressed copies of a view name a buffer of their own.
            extensions.into_iter().flat_map(Map::values_mut).for_each(|e| move_to_joined(e, &starts));
        }
        Ok(asset)
    }

    /// The entries of a top-level array, which is made if there is none.
    pub(super) fn array(&mut self, name: &str) -> &mut Vec<Value> {
        let entry = self.json.entry(name).or_insert_with(|| Value::Array(Vec::new()));
        if !entry.is_array() {
            *entry = Value::Array(Vec::new());
        }
        entry.as_array_mut().expect("it was made an array if it was none")
    }

    /// Adds an entry to a top-level array and returns its index.
    pub(super) fn push(&mut self, array: &str, value: Value) -> usize {
        let entries = self.array(array);
        entries.push(value);
        entries.len() - 1
    }

    /// Adds a buffer view with a copy of `bytes`.
    pub(super) fn push_view(&mut self, bytes: &[u8], target: Option<u32>, stride: Option<usize>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.append(bytes), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.push("bufferViews", view)
    }

    /// Makes the URI at a JSON pointer refer to a buffer view: `uri` of an object, with its
    /// MIME type if the object wants one, or a string that stands for one.
    pub(super) fn refer_to_view(&mut self, pointer: &str, view: usize, mime_type: Option<&str>) {
        let mut root = Value::Object(std::mem::take(&mut self.json));
        let parent = pointer.strip_suffix("/uri");
        if let Some(target) = root.pointer_mut(parent.unwrap_or(pointer)) {
            if let (Some(_), Some(object)) = (parent, target.as_object_mut()) {
                object.shift_remove("uri");
                object.insert("bufferView".into(), view.into());
                if let Some(mime_type) = mime_type {
                    object.insert("mimeType".into(), mime_type.into());
                }
            } else {
                *target = json!({ "bufferView": view, "name": target });
            }
        }
        if let Value::Object(json) = root {
            self.json = json;
        }
    }

    /// Appends to the buffer, aligned for every component type, and returns where.
    fn append(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(8), 0);
        let start = self.bin.len();
        self.bin.extend_from_slice(bytes);
        start
    }

    /// Lists `name` among the extensions in use.
    pub(super) fn use_extension(&mut self, name: &str) {
        let used = self.array("extensionsUsed");
        if !used.iter().any(|e| e == name) {
            used.push(name.into());
        }
    }

    /// Takes `name` off the lists of extensions.
    pub(super) fn drop_extension(&mut self, name: &str) {
        for list in ["extensionsUsed", "extensionsRequired"] {
            if self.json.contains_key(list) {
                let entries = self.array(list);
                entries.retain(|e| e != name);
                if entries.is_empty() {
                    self.json.shift_remove(list);
                }
            }
        }
    }

    /// The asset as a binary glTF file.
    pub(super) fn into_glb(mut self) -> Result<Vec<u8>, GlbError> {
        if self.bin.is_empty() {
            self.json.shift_remove("buffers");
        } else {
            self.json.insert("buffers".into(), json!([{ "byteLength": self.bin.len() }]));
        }
        glb(Value::Object(self.json).to_string().into_bytes(), self.bin)
    }
}

/// A binary glTF file from its JSON and its buffer.
pub(super) fn glb(mut text: Vec<u8>, mut bin: Vec<u8>) -> Result<Vec<u8>, GlbError> {
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);

    let chunks = [(b"JSON", text), (b"BIN\0", bin)];
    let chunks: Vec<_> = chunks.into_iter().filter(|(_, content)| !content.is_empty()).collect();
    let length = 12 + chunks.iter().map(|(_, content)| 8 + content.len()).sum::<usize>();
    let length = u32::try_from(length).map_err(|_| GlbError::TooLarge)?;
    let mut glb = Vec::with_capacity(length as usize);
    glb.extend_from_slice(b"glTF");
    glb.extend_from_slice(&2u32.to_le_bytes());
    glb.extend_from_slice(&length.to_le_bytes());
    for (kind, content) in chunks {
        glb.extend_from_slice(&(content.len() as u32).to_le_bytes());
        glb.extend_from_slice(kind);
        glb.extend_from_slice(&content);
    }
    Ok(glb)
}

/// Turns a reference into buffer `i` into one into the joined buffer, where it starts at `starts[i]`.
fn move_to_joined(view: &mut Value, starts: &[usize]) {
    let Some(&start) = index(view, "buffer").and_then(|b| starts.get(b)) else { return };
    view["byteOffset"] = (start + index(view, "byteOffset").unwrap_or(0)).into();
    view["buffer"] = 0.into();
}
