//! Lit meshes: copies of the source's primitives with the atlas's coordinates as TEXCOORD_1. Vertices are split where
//! the atlas splits them; strips and fans become triangles; every other attribute goes along bytewise.

use super::accessors::{Packed, component, component_count, pack};
use super::asset::{ARRAY_BUFFER, Asset, ELEMENT_ARRAY_BUFFER};
use super::materials::{MaterialKey, Materials};
use super::{GlbError, index};
use crate::atlas::{Atlas, Layout};
use crate::document::Document;
use crate::scene::{Mesh, Primitive};
use glam::Vec2;
use serde_json::{Map, Value, json};
use std::collections::HashMap;

/// Writes lit meshes, and shares what instances of one mesh have in common.
pub(super) struct Meshes<'a> {
    document: &'a Document,
    atlas: &'a Atlas,
    packed: HashMap<usize, Packed>,
    /// Accessor of the source and the vertices taken from it → accessor of the copy.
    gathered: HashMap<(usize, usize), usize>,
    /// Lists of source vertices → their number.
    lists: HashMap<Vec<u32>, usize>,
    /// Index lists → their accessor.
    indices: HashMap<Vec<u32>, usize>,
}

/// Triangles of one primitive on one page, as vertices of their own.
struct Unified {
    page: usize,
    /// Source vertex of each vertex.
    vertices: Vec<u32>,
    /// Lightmap coordinate of each vertex, in texels.
    coordinates: Vec<Vec2>,
    triangles: Vec<u32>,
}

impl<'a> Meshes<'a> {
    /// Starts with no mesh.
    pub(super) fn new(document: &'a Document, atlas: &'a Atlas) -> Self {
        Self {
            document,
            atlas,
            packed: HashMap::new(),
            gathered: HashMap::new(),
            lists: HashMap::new(),
            indices: HashMap::new(),
        }
    }

    /// The source's mesh with the coordinates of `layout`.
    pub(super) fn lit(
        &mut self,
        asset: &mut Asset,
        materials: &mut Materials,
        mesh: &Mesh,
        layout: &Layout,
    ) -> Result<Value, GlbError> {
        let source = self.document.array("meshes").get(mesh.source).ok_or(GlbError::Mesh(mesh.source))?;
        let mut lit = source.clone();
        let primitives = source.get("primitives").and_then(Value::as_array).ok_or(GlbError::Mesh(mesh.source))?;
        let mut out = Vec::with_capacity(primitives.len());
        for (i, json) in primitives.iter().enumerate() {
            match mesh.primitives.iter().find(|p| p.source == i) {
                Some(primitive) => {
                    for part in self.unify(mesh, primitive, layout) {
                        out.push(self.lit_primitive(asset, materials, json, &part)?);
                    }
                }
                // Points, lines and what the import skipped have no place in the atlas.
                None => out.push(json.clone()),
            }
        }
        lit["primitives"] = out.into();
        Ok(lit)
    }

    /// Vertices with equal source and equal coordinate become one. Pages come in the order in which they appear.
    fn unify(&self, mesh: &Mesh, primitive: &Primitive, layout: &Layout) -> Vec<Unified> {
        let mut parts: Vec<Unified> = Vec::new();
        let mut known: HashMap<(usize, u32, [u32; 2]), u32> = HashMap::new();
        for t in primitive.triangles.start as usize..primitive.triangles.end as usize {
            let page = self.atlas.charts[layout.charts[t] as usize].page;
            let number = parts.iter().position(|p| p.page == page).unwrap_or_else(|| {
                parts.push(Unified { page, vertices: Vec::new(), coordinates: Vec::new(), triangles: Vec::new() });
                parts.len() - 1
            });
            let part = &mut parts[number];
            for (corner, vertex) in layout.corners[t].iter().zip(mesh.triangles[t]) {
                let source = mesh.source_vertices[vertex as usize];
                let key = (page, source, corner.to_array().map(f32::to_bits));
                let vertex = *known.entry(key).or_insert_with(|| {
                    part.vertices.push(source);
                    part.coordinates.push(*corner);
                    part.vertices.len() as u32 - 1
                });
                part.triangles.push(vertex);
            }
        }
        parts
    }

    fn lit_primitive(
        &mut self,
        asset: &mut Asset,
        materials: &mut Materials,
        source: &Value,
        part: &Unified,
    ) -> Result<Value, GlbError> {
        let mut lit = source.clone();
        let list = self.number_of(&part.vertices);
        let own = source.get("attributes").and_then(Value::as_object).ok_or(GlbError::Attributes)?;
        let mut attributes = self.gather_all(asset, own, &part.vertices, list)?;
        let moved_set = self.add_lightmap_set(asset, &mut attributes, part);
        lit["attributes"] = attributes.into();
        if let Some(targets) = source.get("targets").and_then(Value::as_array) {
            let mut out = Vec::with_capacity(targets.len());
            for target in targets {
                let own = target.as_object().ok_or(GlbError::Attributes)?;
                out.push(Value::Object(self.gather_all(asset, own, &part.vertices, list)?));
            }
            lit["targets"] = out.into();
        }
        lit["indices"] = self.push_indices(asset, &part.triangles).into();
        lit["mode"] = 4.into();

        let mut lit_material =
            |asset: &mut Asset, source| materials.lit(asset, MaterialKey { source, page: part.page, moved_set });
        lit["material"] = lit_material(asset, index(source, "material")).into();
        if let Some(extensions) = lit.get_mut("extensions").and_then(Value::as_object_mut) {
            // The compressed copy has the old vertices.
            extensions.shift_remove("KHR_draco_mesh_compression");
            let variants = extensions.get_mut("KHR_materials_variants").and_then(|v| v.get_mut("mappings"));
            for mapping in variants.and_then(Value::as_array_mut).into_iter().flatten() {
                mapping["material"] = lit_material(asset, index(mapping, "material")).into();
            }
        }
        if lit.get("extensions").and_then(Value::as_object).is_some_and(Map::is_empty) {
            lit.as_object_mut().expect("it has a field").shift_remove("extensions");
        }
        Ok(lit)
    }

    /// Adds the lightmap coordinates as TEXCOORD_1. A TEXCOORD_1 that the source has for other purposes moves to a
    /// set of its own, which is returned.
    fn add_lightmap_set(
        &self,
        asset: &mut Asset,
        attributes: &mut Map<String, Value>,
        part: &Unified,
    ) -> Option<usize> {
        let page = self.atlas.pages[part.page];
        let size = Vec2::new(page.width as f32, page.height as f32);
        let bytes: Vec<u8> =
            part.coordinates.iter().flat_map(|c| (*c / size).to_array()).flat_map(f32::to_le_bytes).collect();
        let view = asset.push_view(&bytes, Some(ARRAY_BUFFER), Some(8));
        let count = part.coordinates.len();
        let accessor = json!({ "bufferView": view, "componentType": 5126, "count": count, "type": "VEC2" });
        let accessor = asset.push("accessors", accessor);
        let old = attributes.insert("TEXCOORD_1".into(), accessor.into());
        // Sets are numbered without gaps.
        attributes.entry("TEXCOORD_0").or_insert_with(|| accessor.into());
        // Coordinates that were kept are the source's own.
        let old = old.filter(|_| self.atlas.unwrapper != "keep")?;
        let set = (2..).find(|n| !attributes.contains_key(&format!("TEXCOORD_{n}"))).expect("there are finitely many");
        attributes.insert(format!("TEXCOORD_{set}"), old);
        Some(set)
    }

    /// Number of a list of vertices: equal lists have equal numbers.
    fn number_of(&mut self, vertices: &[u32]) -> usize {
        let next = self.lists.len();
        match self.lists.get(vertices) {
            Some(&number) => number,
            None => *self.lists.entry(vertices.to_vec()).or_insert(next),
        }
    }

    fn gather_all(
        &mut self,
        asset: &mut Asset,
        attributes: &Map<String, Value>,
        vertices: &[u32],
        list: usize,
    ) -> Result<Map<String, Value>, GlbError> {
        let mut out = Map::new();
        for (name, accessor) in attributes {
            let accessor = accessor.as_u64().ok_or(GlbError::Attributes)? as usize;
            out.insert(name.clone(), self.gather(asset, accessor, vertices, list)?.into());
        }
        Ok(out)
    }

    /// An accessor with the elements of `accessor` at `vertices`, which are list number `list`.
    fn gather(&mut self, asset: &mut Asset, accessor: usize, vertices: &[u32], list: usize) -> Result<usize, GlbError> {
        if let Some(&copy) = self.gathered.get(&(accessor, list)) {
            return Ok(copy);
        }
        if !self.packed.contains_key(&accessor) {
            self.packed.insert(accessor, pack(self.document, accessor)?);
        }
        let packed = &self.packed[&accessor];
        // Vertex attributes start at multiples of four bytes.
        let stride = packed.size.next_multiple_of(4);
        let mut bytes = Vec::with_capacity(vertices.len() * stride);
        for &v in vertices {
            bytes.extend_from_slice(packed.element(v as usize).ok_or(GlbError::Accessor(accessor))?);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        let mut copy = self.document.array("accessors")[accessor].clone();
        copy["bufferView"] = asset.push_view(&bytes, Some(ARRAY_BUFFER), Some(stride)).into();
        copy["count"] = vertices.len().into();
        let fields = copy.as_object_mut().ok_or(GlbError::Accessor(accessor))?;
        fields.shift_remove("byteOffset");
        fields.shift_remove("sparse");
        if fields.contains_key("min") || fields.contains_key("max") {
            let [min, max] = bounds(fields, &bytes, stride).ok_or(GlbError::Accessor(accessor))?;
            fields.insert("min".into(), min.into());
            fields.insert("max".into(), max.into());
        }
        let copy = asset.push("accessors", copy);
        self.gathered.insert((accessor, list), copy);
        Ok(copy)
    }

    fn push_indices(&mut self, asset: &mut Asset, triangles: &[u32]) -> usize {
        if let Some(&accessor) = self.indices.get(triangles) {
            return accessor;
        }
        let largest = triangles.iter().copied().max().unwrap_or(0);
        // The largest number of a type restarts strips and may not be an index.
        let short = largest < u32::from(u16::MAX);
        let bytes: Vec<u8> = if short {
            triangles.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect()
        } else {
            triangles.iter().flat_map(|i| i.to_le_bytes()).collect()
        };
        let view = asset.push_view(&bytes, Some(ELEMENT_ARRAY_BUFFER), None);
        let component = if short { 5123 } else { 5125 };
        let accessor =
            json!({ "bufferView": view, "componentType": component, "count": triangles.len(), "type": "SCALAR" });
        let accessor = asset.push("accessors", accessor);
        self.indices.insert(triangles.to_vec(), accessor);
        accessor
    }
}

/// Least and largest value of every component.
fn bounds(accessor: &Map<String, Value>, bytes: &[u8], stride: usize) -> Option<[Vec<Value>; 2]> {
    let kind = accessor.get("componentType")?.as_u64()? as usize;
    let components = component_count(accessor.get("type")?.as_str()?)?;
    let mut min = vec![f64::INFINITY; components];
    let mut max = vec![f64::NEG_INFINITY; components];
    for element in bytes.chunks(stride) {
        for c in 0..components {
            let value = component(element, kind, c)?;
            min[c] = min[c].min(value);
            max[c] = max[c].max(value);
        }
    }
    let numbers = |values: Vec<f64>| values.into_iter().map(|v| number(v, kind)).collect();
    Some([numbers(min), numbers(max)])
}

/// Integers are written without a point.
fn number(value: f64, component_type: usize) -> Value {
    if component_type == 5126 { value.into() } else { (value as i64).into() }
}
