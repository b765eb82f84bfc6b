//! glTF assets made in code.

use lightkiln::import::{ImportError, ImportSettings, Imported, load};
use lightkiln::progress::Silent;
use serde_json::{Value, json};
use std::path::PathBuf;
use tempfile::TempDir;

pub(crate) const U8: u32 = 5121;
pub(crate) const I8: u32 = 5120;
pub(crate) const U16: u32 = 5123;
pub(crate) const U32: u32 = 5125;
pub(crate) const F32: u32 = 5126;

/// An asset with one buffer and one scene.
pub(crate) struct Asset {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Asset {
    /// Nothing but an empty scene.
    pub(crate) fn empty() -> Self {
        let json = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [], "meshes": [], "materials": [], "accessors": [], "bufferViews": [],
            "buffers": [{"byteLength": 0}]
        });
        Self { json, bin: Vec::new() }
    }

    /// A unit right triangle in the XY plane under a node `Triangle`, with a matt grey material.
    pub(crate) fn triangle() -> Self {
        let mut asset = Self::empty();
        let positions = asset.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
        let normals = asset.floats("VEC3", &[0., 0., 1., 0., 0., 1., 0., 0., 1.]);
        asset.push(
            "materials",
            json!({"name": "grey", "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0}}),
        );
        let mesh = asset.mesh(json!({"attributes": {"POSITION": positions, "NORMAL": normals}, "material": 0}));
        asset.node(json!({"name": "Triangle", "mesh": mesh}));
        asset
    }

    /// Appends to a top-level array.
    pub(crate) fn push(&mut self, array: &str, value: Value) -> usize {
        let root = self.json.as_object_mut().unwrap();
        let array = root.entry(array).or_insert_with(|| json!([])).as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    /// A buffer view of `bytes`.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub(crate) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({"bufferView": view, "componentType": component, "type": kind, "count": count}))
    }

    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, F32, kind, values.len() / width)
    }

    pub(crate) fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, U32, "SCALAR", values.len())
    }

    /// A mesh of one primitive.
    pub(crate) fn mesh(&mut self, primitive: Value) -> usize {
        self.push("meshes", json!({"primitives": [primitive]}))
    }

    /// A root node.
    pub(crate) fn node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(index.into());
        index
    }

    /// The LIGHTKILN_scene extension of the asset.
    pub(crate) fn lightkiln(&mut self, extension: Value) {
        self.json["extensions"]["LIGHTKILN_scene"] = extension;
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = self.bin.len().into();
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let word = |value: usize| u32::try_from(value).unwrap().to_le_bytes();
        let mut out = Vec::new();
        out.extend(b"glTF");
        out.extend(word(2));
        out.extend(word(12 + 8 + text.len() + 8 + bin.len()));
        out.extend(word(text.len()));
        out.extend(b"JSON");
        out.extend(text);
        out.extend(word(bin.len()));
        out.extend(b"BIN\0");
        out.extend(bin);
        out
    }

    pub(crate) fn load(&self) -> Result<Imported, ImportError> {
        self.load_with(&ImportSettings::default())
    }

    pub(crate) fn load_with(&self, settings: &ImportSettings) -> Result<Imported, ImportError> {
        let (_folder, path) = file("scene.glb", &self.glb());
        load(&path, settings, &Silent)
    }

    /// The imported asset, which must load.
    pub(crate) fn imported(&self) -> Imported {
        self.load().unwrap_or_else(|e| panic!("{e}"))
    }

    /// Text of the error with which the import must fail.
    pub(crate) fn error(&self) -> String {
        self.load().map(|_| ()).expect_err("the import should fail").to_string()
    }
}

/// A file with the given content in a folder of its own.
pub(crate) fn file(name: &str, content: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    (folder, path)
}

/// The one warning with that code.
pub(crate) fn warning(imported: &Imported, code: &str) -> String {
    let found: Vec<_> = imported.warnings.iter().filter(|w| w.code == code).collect();
    assert_eq!(found.len(), 1, "warnings: {:?}", imported.warnings);
    found[0].to_string()
}

/// Asserts that there is no warning but for the lack of light and for extensions that tests make up.
pub(crate) fn assert_clean(imported: &Imported) {
    let expected = |w: &lightkiln::warning::Warning| w.code == "no_light" || w.message.contains("ACME_");
    let others: Vec<_> = imported.warnings.iter().filter(|w| !expected(w)).collect();
    assert!(others.is_empty(), "warnings: {others:?}");
}
