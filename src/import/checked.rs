//! Core glTF as the `gltf` crate types it, checked so that none of its accessors can panic.
//!
//! Extensions and extras are read from the raw JSON and left out here: a vendor's mistake in them is no reason to
//! refuse a file.

use super::ImportError;
use crate::warning::Warning;
use gltf::json::validation::Checked;
use gltf::json::{Root, accessor, mesh};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::Path;

/// Parts of a document that an import looks at. Skins are read raw, animations and cameras not at all.
const ARRAYS: [&str; 8] = ["accessors", "buffers", "bufferViews", "materials", "meshes", "nodes", "samplers", "scenes"];

/// Most elements of an accessor without a buffer view: more is a damaged count and would exhaust the memory.
const MAX_UNBACKED: u64 = 1 << 28;

/// The typed document. `buffers` are the loaded buffers. Every index that an import may follow is in range.
pub(super) fn document(
    path: &Path,
    json: &Value,
    buffers: &[Vec<u8>],
    warnings: &mut Vec<Warning>,
) -> Result<gltf::Document, ImportError> {
    let mut core = Map::new();
    for key in ARRAYS.into_iter().chain(["asset", "scene", "textures"]) {
        if let Some(value) = json.get(key) {
            core.insert(key.into(), without_extensions(value));
        }
    }
    drop_missing_nodes(&mut core, warnings);
    let root = Root::deserialize(&Value::Object(core))
        .map_err(|e| ImportError::Json { path: path.into(), fault: e.to_string() })?;
    check(&root, buffers)?;
    Ok(gltf::Document::from_json_without_validation(root))
}

/// Takes children and roots that do not exist off their lists, with a warning each.
fn drop_missing_nodes(core: &mut Map<String, Value>, warnings: &mut Vec<Warning>) {
    let count = core.get("nodes").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    for (array, key) in [("nodes", "children"), ("scenes", "nodes")] {
        let entries = core.get_mut(array).and_then(Value::as_array_mut).into_iter().flatten();
        for (i, entry) in entries.enumerate() {
            let name = entry.get("name").and_then(Value::as_str).map_or_else(|| format!("{array}[{i}]"), str::to_owned);
            let Some(list) = entry.get_mut(key).and_then(Value::as_array_mut) else { continue };
            list.retain(|node| {
                let exists = node.as_u64().is_none_or(|node| node < count);
                if !exists {
                    let message =
                        format!("its {key} list node {node}, and there are only {count}; it is skipped, export again");
                    warnings.push(Warning::new("missing_node", name.as_str(), message));
                }
                exists
            });
        }
    }
}

/// A copy without `extensions`, `extras` and the references to parts that are left out.
fn without_extensions(value: &Value) -> Value {
    const LEFT_OUT: [&str; 4] = ["extensions", "extras", "camera", "skin"];
    match value {
        Value::Array(items) => Value::Array(items.iter().map(without_extensions).collect()),
        Value::Object(fields) => {
            let kept = fields.iter().filter(|(key, _)| !LEFT_OUT.contains(&key.as_str()));
            Value::Object(kept.map(|(key, value)| (key.clone(), without_extensions(value))).collect())
        }
        other => other.clone(),
    }
}

fn check(root: &Root, buffers: &[Vec<u8>]) -> Result<(), ImportError> {
    check_views(root, buffers)?;
    for (i, accessor) in root.accessors.iter().enumerate() {
        check_accessor(root, &format!("accessors[{i}]"), accessor)?;
    }
    check_materials(root)?;
    check_meshes(root)?;
    check_nodes(root)
}

fn in_range(index: usize, len: usize, place: impl Fn() -> String) -> Result<(), ImportError> {
    if index < len {
        return Ok(());
    }
    Err(ImportError::invalid(place(), format!("index {index} is out of range, there are {len}")))
}

fn valid<T>(value: &Checked<T>, place: impl Fn() -> String) -> Result<&T, ImportError> {
    match value {
        Checked::Valid(value) => Ok(value),
        Checked::Invalid => Err(ImportError::invalid(place(), "its value is none that glTF knows")),
    }
}

fn check_views(root: &Root, buffers: &[Vec<u8>]) -> Result<(), ImportError> {
    for (i, view) in root.buffer_views.iter().enumerate() {
        in_range(view.buffer.value(), buffers.len(), || format!("bufferViews[{i}].buffer"))?;
        let actual = buffers[view.buffer.value()].len() as u64;
        let end = view.byte_offset.unwrap_or_default().0.checked_add(view.byte_length.0);
        if end.is_none_or(|end| end > actual) {
            let fault = format!("it ends past its buffer, which has {actual} bytes");
            return Err(ImportError::invalid(format!("bufferViews[{i}]"), fault));
        }
    }
    Ok(())
}

fn check_accessor(root: &Root, place: &str, accessor: &accessor::Accessor) -> Result<(), ImportError> {
    let component = valid(&accessor.component_type, || format!("{place}.componentType"))?.0;
    let kind = valid(&accessor.type_, || format!("{place}.type"))?;
    let size = component.size() as u64 * kind.multiplicity() as u64;
    let count = accessor.count.0;
    // An empty accessor is read as no elements.
    if count == 0 {
        return Ok(());
    }
    match accessor.buffer_view {
        Some(view) => {
            let run = Run { offset: accessor.byte_offset.unwrap_or_default().0, count, size };
            check_run(root, place, view.value(), run)?;
        }
        // Values that no byte of the file backs: only the sparse entries differ from zero.
        None if count > MAX_UNBACKED => {
            return Err(ImportError::invalid(format!("{place}.count"), format!("{count} is too many")));
        }
        None => {}
    }
    let Some(sparse) = &accessor.sparse else { return Ok(()) };
    let index_size =
        valid(&sparse.indices.component_type, || format!("{place}.sparse.indices.componentType"))?.0.size();
    if sparse.count.0 == 0 || sparse.count.0 > count {
        return Err(ImportError::invalid(format!("{place}.sparse.count"), format!("it is not within 1 to {count}")));
    }
    let indices = Run { offset: sparse.indices.byte_offset.0, count: sparse.count.0, size: index_size as u64 };
    check_run(root, &format!("{place}.sparse.indices"), sparse.indices.buffer_view.value(), indices)?;
    let values = Run { offset: sparse.values.byte_offset.0, count: sparse.count.0, size };
    check_run(root, &format!("{place}.sparse.values"), sparse.values.buffer_view.value(), values)
}

/// Elements within a buffer view, in bytes.
struct Run {
    offset: u64,
    count: u64,
    size: u64,
}

/// Requires that `run` lies within buffer view `view`.
fn check_run(root: &Root, place: &str, view: usize, run: Run) -> Result<(), ImportError> {
    in_range(view, root.buffer_views.len(), || format!("{place}.bufferView"))?;
    let view = &root.buffer_views[view];
    let stride = match view.byte_stride {
        None => run.size,
        Some(stride) if stride.0 == 0 => run.size,
        Some(stride) if (stride.0 as u64) < run.size => {
            let fault = format!("its byteStride of {} is less than the {} bytes of an element", stride.0, run.size);
            return Err(ImportError::invalid(place, fault));
        }
        Some(stride) => stride.0 as u64,
    };
    let end = (run.count - 1).checked_mul(stride).and_then(|n| n.checked_add(run.size)?.checked_add(run.offset));
    if end.is_none_or(|end| end > view.byte_length.0) {
        let fault = format!("its {} elements end past its buffer view of {} bytes", run.count, view.byte_length.0);
        return Err(ImportError::invalid(place, fault));
    }
    Ok(())
}

fn check_materials(root: &Root) -> Result<(), ImportError> {
    for (i, material) in root.materials.iter().enumerate() {
        valid(&material.alpha_mode, || format!("materials[{i}].alphaMode"))?;
        let pbr = &material.pbr_metallic_roughness;
        let used = [&pbr.base_color_texture, &pbr.metallic_roughness_texture, &material.emissive_texture];
        for texture in used.into_iter().flatten() {
            in_range(texture.index.value(), root.textures.len(), || format!("materials[{i}], index of a texture"))?;
        }
    }
    for (i, texture) in root.textures.iter().enumerate() {
        if let Some(sampler) = texture.sampler {
            in_range(sampler.value(), root.samplers.len(), || format!("textures[{i}].sampler"))?;
        }
    }
    for (i, sampler) in root.samplers.iter().enumerate() {
        valid(&sampler.wrap_s, || format!("samplers[{i}].wrapS"))?;
        valid(&sampler.wrap_t, || format!("samplers[{i}].wrapT"))?;
        if let Some(filter) = &sampler.mag_filter {
            valid(filter, || format!("samplers[{i}].magFilter"))?;
        }
    }
    Ok(())
}

fn check_meshes(root: &Root) -> Result<(), ImportError> {
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            check_primitive(root, &format!("meshes[{i}].primitives[{k}]"), primitive)?;
        }
    }
    Ok(())
}

fn check_primitive(root: &Root, place: &str, primitive: &mesh::Primitive) -> Result<(), ImportError> {
    valid(&primitive.mode, || format!("{place}.mode"))?;
    let accessors = root.accessors.len();
    for index in primitive.attributes.values().chain(&primitive.indices) {
        in_range(index.value(), accessors, || format!("{place}, index of an accessor"))?;
    }
    for target in primitive.targets.iter().flatten() {
        for index in [target.positions, target.normals].into_iter().flatten() {
            in_range(index.value(), accessors, || format!("{place}.targets, index of an accessor"))?;
        }
    }
    if let Some(material) = primitive.material {
        in_range(material.value(), root.materials.len(), || format!("{place}.material"))?;
    }
    Ok(())
}

fn check_nodes(root: &Root) -> Result<(), ImportError> {
    for (i, node) in root.nodes.iter().enumerate() {
        let label = || format!("nodes[{i}] (`{}`)", node.name.as_deref().unwrap_or(""));
        if let Some(mesh) = node.mesh {
            in_range(mesh.value(), root.meshes.len(), || format!("{}.mesh", label()))?;
        }
        for child in node.children.iter().flatten() {
            in_range(child.value(), root.nodes.len(), || format!("{}.children", label()))?;
        }
    }
    for (i, scene) in root.scenes.iter().enumerate() {
        for node in &scene.nodes {
            in_range(node.value(), root.nodes.len(), || format!("scenes[{i}].nodes"))?;
        }
    }
    if let Some(scene) = root.scene {
        in_range(scene.value(), root.scenes.len(), || "scene".into())?;
    }
    Ok(())
}
