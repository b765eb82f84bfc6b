//! Draco and meshopt: compressed files give the same scene, and a document without a trace of compression.

use crate::fixture::{Asset, F32, assert_clean};
use draco_gltf::{
    ComponentType, CompressionOptions, DracoPrimitiveEncoding, PackedAttribute, PackedGeometry, PackedIndices,
    PrimitiveMode,
};
use glam::Vec3;
use serde_json::{Value, json};

/// Corners and triangles of a bumpy grid of quads.
fn grid(n: u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    let corner = |i: u32| [(i % n) as f32, (i / n) as f32, ((i * 7) % 5) as f32 * 0.1];
    let cell = |i: u32| [i, i + 1, i + n, i + 1, i + n + 1, i + n];
    let cells = (0..n * (n - 1)).filter(|i| i % n != n - 1);
    ((0..n * n).map(corner).collect(), cells.flat_map(cell).collect())
}

fn bytes<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// An asset whose mesh is the Draco stream of the grid, with normals.
pub(crate) fn draco() -> Asset {
    let (positions, indices) = grid(12);
    let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
    let attribute = |name: &str, values: &[[f32; 3]]| {
        PackedAttribute::new(name, values.len(), 3, ComponentType::F32, false, bytes(values)).unwrap()
    };
    let index_bytes = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
    let geometry = PackedGeometry::new(
        PrimitiveMode::Triangles,
        vec![attribute("POSITION", &positions), attribute("NORMAL", &normals)],
        Some(PackedIndices::new(indices.len(), ComponentType::U32, index_bytes).unwrap()),
    )
    .unwrap();
    let encoded = DracoPrimitiveEncoding::encode(&geometry, &CompressionOptions::default()).unwrap();

    let mut asset = Asset::triangle();
    let view = asset.view(encoded.bytes());
    let accessor = |asset: &mut Asset, kind: &str, component: u32, count: usize| -> usize {
        asset.push("accessors", json!({"name": kind, "componentType": component, "type": kind, "count": count}))
    };
    let mut attributes = json!({});
    for declared in encoded.accessors() {
        attributes[declared.semantic()] = accessor(&mut asset, "VEC3", F32, declared.count()).into();
    }
    let indices = accessor(&mut asset, "SCALAR", 5125, encoded.index_count());
    let extension: Value = serde_json::from_slice(&encoded.extension(view).to_json().to_vec()).unwrap();
    asset.json["meshes"][0]["primitives"][0] = json!({"attributes": attributes, "indices": indices, "material": 0,
        "extensions": {"KHR_draco_mesh_compression": extension, "ACME_other": {}}});
    for list in ["extensionsUsed", "extensionsRequired"] {
        asset.json[list] = json!(["KHR_draco_mesh_compression", "KHR_mesh_quantization"]);
    }
    asset
}

#[test]
fn draco_meshes_are_decoded() {
    let imported = draco().imported();
    assert_clean(&imported);
    let mesh = &imported.scene.meshes[0];
    let (positions, indices) = grid(12);
    assert_eq!(mesh.triangles.len(), indices.len() / 3);
    // Draco renumbers vertices and quantises them: every corner is near one of the grid's.
    for p in &mesh.positions {
        let nearest = positions.iter().map(|q| Vec3::from_array(*q).distance(*p)).fold(f32::INFINITY, f32::min);
        assert!(nearest < 0.01, "{p} is {nearest} away");
    }
    for triangle in 0..mesh.triangles.len() {
        assert!(imported.scene.geometric_normal(0, triangle).z > 0.5);
    }
}

#[test]
fn a_decoded_document_has_no_draco_left() {
    let document = draco().imported().document;
    assert_eq!(document.json["extensionsRequired"], json!(["KHR_mesh_quantization"]));
    let primitive = &document.json["meshes"][0]["primitives"][0];
    assert_eq!(primitive["extensions"], json!({"ACME_other": {}}));
    let accessor = &document.json["accessors"][primitive["indices"].as_u64().unwrap() as usize];
    assert_eq!(accessor["name"], "SCALAR");
    let view = &document.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let buffer = view["buffer"].as_u64().unwrap() as usize;
    assert_eq!(document.json["buffers"][buffer]["byteLength"], document.buffers[buffer].len());
}

#[test]
fn damaged_draco_streams_are_errors_that_name_the_primitive() {
    let check = |change: &dyn Fn(&mut Asset)| {
        let mut asset = draco();
        change(&mut asset);
        let error = asset.error();
        assert!(error.contains("meshes[0].primitives[0] (KHR_draco_mesh_compression)"), "{error}");
    };
    let extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    check(&|a| a.json.pointer_mut(extension).unwrap()["bufferView"] = 99.into());
    check(&|a| *a.json.pointer_mut(extension).unwrap() = json!([]));
    check(&|a| a.json.pointer_mut(extension).unwrap()["attributes"] = json!({"POSITION": 77}));
    check(&|a| a.json["bufferViews"].as_array_mut().unwrap().last_mut().unwrap()["byteLength"] = 20.into());
    check(&|a| a.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 1000.into());
}

/// The vertex codec of meshopt, version 0, with every byte group stored in full.
fn encode_meshopt(data: &[u8], stride: usize) -> Vec<u8> {
    let count = data.len() / stride;
    assert!(count <= ((8192 / stride) & !15).min(256), "one block is enough here");
    let mut out = vec![0xa0];
    let mut last = data[..stride].to_vec();
    for byte in 0..stride {
        let groups = count.div_ceil(16);
        // Two bits per group, four groups per header byte: 3 means eight bits per value.
        out.extend(vec![0xff; groups.div_ceil(4)]);
        for i in 0..groups * 16 {
            let value = if i < count { data[i * stride + byte] } else { last[byte] };
            let delta = value.wrapping_sub(last[byte]) as i8;
            out.push(((delta << 1) ^ (delta >> 7)) as u8);
            last[byte] = value;
        }
    }
    // The tail holds the first vertex, padded at the front to 32 bytes.
    out.extend(vec![0; 32usize.saturating_sub(stride)]);
    out.extend(&data[..stride]);
    out
}

/// An asset whose positions are a meshopt view.
pub(crate) fn meshopt(name: &str) -> Asset {
    let (positions, indices) = grid(9);
    let plain = bytes(&positions);
    let mut asset = Asset::triangle();
    let packed = encode_meshopt(&plain, 12);
    let offset = asset.bin.len().next_multiple_of(4);
    asset.view(&packed);
    asset.json["bufferViews"].as_array_mut().unwrap().pop();
    let fallback =
        asset.push("buffers", json!({"byteLength": plain.len() + 8, "extensions": {name: {"fallback": true}}}));
    let view = asset.push(
        "bufferViews",
        json!({"buffer": fallback, "byteOffset": 8, "byteLength": plain.len(), "byteStride": 12, "extensions": {name:
            {"buffer": 0, "byteOffset": offset, "byteLength": packed.len(), "byteStride": 12,
             "count": positions.len(), "mode": "ATTRIBUTES"}}}),
    );
    let accessor = asset
        .push("accessors", json!({"bufferView": view, "componentType": F32, "type": "VEC3", "count": positions.len()}));
    let indices = asset.indices(&indices);
    asset.json["meshes"][0]["primitives"][0] =
        json!({"attributes": {"POSITION": accessor}, "indices": indices, "material": 0});
    asset.json["extensionsUsed"] = json!([name]);
    asset.json["extensionsRequired"] = json!([name]);
    asset
}

#[test]
fn meshopt_views_are_decoded_in_place() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let imported = meshopt(name).imported();
        assert_clean(&imported);
        let (positions, indices) = grid(9);
        let scene = &imported.scene;
        assert_eq!(scene.meshes[0].triangles.len(), indices.len() / 3);
        assert_eq!(scene.corners(0, 5)[1].to_array(), positions[indices[16] as usize]);
        let json = imported.document.json.to_string();
        assert!(!json.contains("meshopt"), "{json}");
    }
}

#[test]
fn damaged_meshopt_views_are_errors_that_name_the_view() {
    let name = "EXT_meshopt_compression";
    let check = |change: &dyn Fn(&mut Value)| {
        let mut asset = meshopt(name);
        let view = asset.json["bufferViews"].as_array().unwrap().iter().position(|v| v.get("extensions").is_some());
        let view = view.unwrap();
        change(&mut asset.json["bufferViews"][view]);
        let error = asset.error();
        assert!(error.contains(&format!("bufferViews[{view}].{name}")), "{error}");
    };
    check(&|v| v["extensions"][name]["count"] = 3.into());
    check(&|v| v["extensions"][name]["byteStride"] = 0.into());
    check(&|v| v["extensions"][name]["byteLength"] = 40.into());
    check(&|v| v["extensions"][name]["byteOffset"] = u64::MAX.into());
    check(&|v| v["extensions"][name]["buffer"] = 7.into());
    check(&|v| v["extensions"][name]["mode"] = "NEWEST".into());
    check(&|v| v["extensions"][name]["filter"] = "SEPIA".into());
    check(&|v| v["byteLength"] = 1_000_000.into());
    let mut asset = meshopt(name);
    asset.json["buffers"][1]["byteLength"] = (1u64 << 50).into();
    assert!(asset.error().contains("buffers[1].byteLength"));
}
