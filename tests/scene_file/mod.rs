//! Writes small glTF files for the tests of the output and of the command line.

// Each test program uses the parts that it needs.
#![allow(dead_code)]

use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// A glTF file in the making.
pub(crate) struct SceneFile {
    /// The document; buffer 0 is added when it is written.
    pub(crate) json: Value,
    bin: Vec<u8>,
}

impl SceneFile {
    /// An empty scene.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "materials": [], "accessors": [], "bufferViews": []
        });
        Self { json, bin: Vec::new() }
    }

    /// Adds an entry to a top-level array and returns its index.
    pub(crate) fn push(&mut self, array: &str, value: Value) -> usize {
        if self.json.get(array).is_none() {
            self.json[array] = json!([]);
        }
        let entries = self.json[array].as_array_mut().expect("top-level names are arrays");
        entries.push(value);
        entries.len() - 1
    }

    /// Adds a node to the scene.
    pub(crate) fn push_root(&mut self, node: Value) -> usize {
        let node = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().expect("the scene lists its nodes").push(node.into());
        node
    }

    /// A buffer view with `bytes`.
    pub(crate) fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    /// An accessor of floats; `kind` is its type, such as `VEC3`.
    pub(crate) fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N).map(|c| values.iter().map(|v| v[c]).reduce(pick).expect("there are values")).collect()
        };
        self.push(
            "accessors",
            json!({
                "bufferView": view, "componentType": 5126, "count": values.len(), "type": kind,
                "min": bound(f32::min), "max": bound(f32::max)
            }),
        )
    }

    /// An accessor of bytes, one to a vertex, each at a multiple of four.
    pub(crate) fn padded_bytes(&mut self, values: &[u8]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|&v| [v, 0, 0, 0]).collect();
        let view = self.view(&bytes, Some(4));
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": 5121, "count": values.len(), "type": "SCALAR" }),
        )
    }

    /// An index accessor of bytes.
    pub(crate) fn indices(&mut self, values: &[u8]) -> usize {
        let view = self.view(values, None);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": 5121, "count": values.len(), "type": "SCALAR" }),
        )
    }

    /// Writes a binary glTF file.
    pub(crate) fn write(&self, path: &Path) -> PathBuf {
        let mut json = self.json.clone();
        if !self.bin.is_empty() {
            json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend(((12 + 8 + text.len() + 8 + bin.len()) as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        fs::write(path, glb).expect("the test's folder is writable");
        path.to_path_buf()
    }
}

/// A square of 1 m in x and z around the origin, facing up, under a constant sky of radiance 1.
pub(crate) fn lit_square() -> SceneFile {
    let mut file = SceneFile::new();
    file.json["extensionsUsed"] = json!(["LIGHTKILN_scene"]);
    file.json["extensions"] =
        json!({ "LIGHTKILN_scene": { "version": 1, "environment": { "radiance": [1.0, 1.0, 1.0] } } });
    let positions = file.floats("VEC3", &[[-0.5, 0.0, -0.5], [-0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.0, -0.5]]);
    let normals = file.floats("VEC3", &[[0.0, 1.0, 0.0]; 4]);
    let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
    let material = file.push(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0 } }),
    );
    let mesh = json!({ "name": "square", "primitives": [
        { "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices, "material": material }
    ] });
    let mesh = file.push("meshes", mesh);
    file.push_root(json!({ "name": "square", "mesh": mesh }));
    file
}
