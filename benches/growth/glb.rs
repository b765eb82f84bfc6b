//! Objects, the lamp and the sky as a binary glTF file with TEXCOORD_1.

use crate::faces::{Face, Object};
use crate::layout::place;
use anyhow::{Context, Result};
use glam::Vec3;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// The buffer views, in the order of the buffer: attributes of all objects one after the other.
#[derive(Default)]
struct Buffers {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    texcoords: Vec<[f32; 2]>,
    indices: Vec<u32>,
}

/// Writes `objects` to `path`, with their lightmap on a page of `side`² cells.
pub(crate) fn write(path: &Path, objects: &[Object], side: u32) -> Result<()> {
    let places = place(objects, side).with_context(|| format!("the scene needs more than {side}² cells"))?;
    let mut places = places.into_iter();
    let mut buffers = Buffers::default();
    let mut document = frame();
    for (index, object) in objects.iter().enumerate() {
        let attributes = buffers.add(object, side, &mut places, &mut document);
        push(
            &mut document,
            "materials",
            json!({ "pbrMetallicRoughness": {
            "baseColorFactor": [object.reflectance[0], object.reflectance[1], object.reflectance[2], 1.0],
            "metallicFactor": 0.0 } }),
        );
        push(
            &mut document,
            "meshes",
            json!({ "primitives": [{ "material": index, "mode": 4,
            "attributes": attributes["attributes"], "indices": attributes["indices"] }] }),
        );
        let mut node = json!({ "name": object.name, "mesh": index });
        if !object.has_lightmap {
            node["extensions"] = json!({ "LIGHTKILN_scene": { "lightmap": false } });
        }
        push(&mut document, "nodes", node);
    }
    let nodes = document["nodes"].as_array().map_or(0, Vec::len);
    document["scenes"] = json!([{ "nodes": (0..nodes).collect::<Vec<_>>() }]);
    fs::write(path, buffers.file(document)).with_context(|| format!("writing {}", path.display()))
}

/// The document with the lamp and the sky only.
fn frame() -> Value {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "extensionsUsed": ["LIGHTKILN_scene"],
        "extensions": { "LIGHTKILN_scene": { "version": 1,
            "lights": [{ "name": "lamp", "type": "rect", "radiance": [12.0, 11.0, 9.0], "size": [1.2, 0.4] }],
            "environment": { "gradient": {
                "zenith": [2.0, 4.0, 7.0], "horizon": [6.0, 7.0, 8.0], "ground": [1.0, 1.0, 1.0] } } } },
        "nodes": [{ "name": "lamp", "translation": [3.0, 2.95, 2.0], "rotation": [-half, 0.0, 0.0, half],
            "extensions": { "LIGHTKILN_scene": { "light": 0 } } }],
        "materials": [], "meshes": [], "accessors": []
    })
}

/// Adds an entry to a top-level array and returns its index.
fn push(document: &mut Value, array: &str, value: Value) -> usize {
    let entries = document[array].as_array_mut().expect("the frame has the array");
    entries.push(value);
    entries.len() - 1
}

impl Buffers {
    /// Appends an object; returns its attributes and indices as accessors of `document`.
    fn add(
        &mut self,
        object: &Object,
        side: u32,
        places: &mut impl Iterator<Item = [u32; 2]>,
        document: &mut Value,
    ) -> Value {
        let (first, first_texcoord, first_index) = (self.positions.len(), self.texcoords.len(), self.indices.len());
        for face in &object.faces {
            let base = (self.positions.len() - first) as u32;
            self.positions.extend(face.points.iter().map(Vec3::to_array));
            self.normals.extend(face.normals.iter().map(Vec3::to_array));
            self.indices.extend(indices(face).map(|i| base + i));
            if object.has_lightmap {
                let corner = places.next().expect("every face with a lightmap was placed");
                self.texcoords.extend(texcoords(face, corner, side));
            }
        }
        let points = &self.positions[first..];
        let bound = |pick: fn(f32, f32) -> f32| {
            [0, 1, 2].map(|c| points.iter().map(|p| p[c]).reduce(pick).expect("objects have points"))
        };
        let mut accessor = |view: usize, offset: usize, count: usize, kind: (u32, &str), range: Value| {
            let mut value = json!({ "bufferView": view, "byteOffset": offset, "count": count,
                "componentType": kind.0, "type": kind.1 });
            if range.is_array() {
                (value["min"], value["max"]) = (range[0].clone(), range[1].clone());
            }
            push(document, "accessors", value)
        };
        let count = points.len();
        let range = json!([bound(f32::min), bound(f32::max)]);
        let mut attributes = json!({
            "POSITION": accessor(0, 12 * first, count, (5126, "VEC3"), range),
            "NORMAL": accessor(1, 12 * first, count, (5126, "VEC3"), Value::Null),
        });
        if object.has_lightmap {
            attributes["TEXCOORD_1"] = accessor(2, 8 * first_texcoord, count, (5126, "VEC2"), Value::Null).into();
        }
        let indices = self.indices.len() - first_index;
        let indices = accessor(3, 4 * first_index, indices, (5125, "SCALAR"), Value::Null);
        json!({ "attributes": attributes, "indices": indices })
    }

    /// The file: header, `document`, and all that was appended.
    fn file(&self, mut document: Value) -> Vec<u8> {
        let parts: [&[u8]; 4] = [
            bytemuck::cast_slice(&self.positions),
            bytemuck::cast_slice(&self.normals),
            bytemuck::cast_slice(&self.texcoords),
            bytemuck::cast_slice(&self.indices),
        ];
        let binary = parts.concat();
        let starts = parts.iter().scan(0, |start, part| Some(std::mem::replace(start, *start + part.len())));
        let view =
            |(part, start): (&&[u8], usize)| json!({ "buffer": 0, "byteOffset": start, "byteLength": part.len() });
        document["bufferViews"] = parts.iter().zip(starts).map(view).collect();
        document["buffers"] = json!([{ "byteLength": binary.len() }]);
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut file = b"glTF\x02\0\0\0".to_vec();
        file.extend(((12 + 8 + text.len() + 8 + binary.len()) as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &binary)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }
}

/// Two triangles per cell of the grid.
fn indices(face: &Face) -> impl Iterator<Item = u32> {
    let n = face.divisions as u32;
    let quad = move |i: u32, j: u32| {
        let [a, c] = [j, j + 1].map(|row| row * (n + 1) + i);
        [a, a + 1, c, a + 1, c + 1, c]
    };
    (0..n).flat_map(move |j| (0..n).flat_map(move |i| quad(i, j)))
}

/// The grid stretched over its cells, which begin at `corner`.
fn texcoords(face: &Face, corner: [u32; 2], side: u32) -> impl Iterator<Item = [f32; 2]> {
    let (n, cells) = (face.divisions, face.cells);
    let at = move |c: usize, i: usize| (corner[c] as f32 + cells[c] as f32 * i as f32 / n as f32) / side as f32;
    (0..=n).flat_map(move |j| (0..=n).map(move |i| [at(0, i), at(1, j)]))
}
