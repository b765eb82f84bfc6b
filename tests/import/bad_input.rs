//! Files that cannot be imported fail with a message that names place and remedy; what can be skipped is skipped.

use crate::fixture::{Asset, U16, file, warning};
use lightkiln::import::{ImportError, ImportSettings, load};
use lightkiln::progress::{Progress, Silent, Stage};
use serde_json::{Value, json};
use std::path::Path;

fn error_of(path: &Path) -> String {
    load(path, &ImportSettings::default(), &Silent).map(|_| ()).unwrap_err().to_string()
}

fn error_of_bytes(name: &str, bytes: &[u8]) -> String {
    let (_folder, path) = file(name, bytes);
    error_of(&path)
}

fn contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

/// The triangle after `change`.
fn broken(change: impl Fn(&mut Value)) -> Asset {
    let mut asset = Asset::triangle();
    change(&mut asset.json);
    asset
}

#[test]
fn files_that_are_no_gltf() {
    let folder = tempfile::tempdir().unwrap();
    contains(&error_of(&folder.path().join("no.glb")), &["no.glb", "does not exist", "check the path"]);
    contains(&error_of(folder.path()), &["is a folder", ".glb"]);
    contains(&error_of_bytes("a.glb", b""), &["a.glb", "empty"]);
    contains(&error_of_bytes("a.glb", b"solid cube"), &["not a glTF file", "export"]);
    contains(&error_of_bytes("a.gltf", b"{\"asset\": {\n  \"version\" \"2.0\"}}"), &["line 2", "column"]);
    contains(&error_of_bytes("a.gltf", b"{}"), &["no `asset`"]);
    contains(&error_of_bytes("a.gltf", b"{\"asset\": {\"version\": \"1.0\"}}"), &["glTF 1.0", "2.0"]);
    let mut glb = Asset::triangle().glb();
    glb[4] = 1;
    contains(&error_of_bytes("a.glb", &glb), &["glTF 1", "2.0"]);
}

#[test]
fn every_truncation_of_a_glb_is_an_error_and_no_panic() {
    let glb = Asset::triangle().glb();
    for length in 4..glb.len() {
        let text = error_of_bytes("a.glb", &glb[..length]);
        contains(&text, &["truncated", "a.glb"]);
    }
    // The same with the header's length brought into line, so that a chunk is what ends early.
    let mut cut = glb[..glb.len() - 8].to_vec();
    let length = u32::try_from(cut.len()).unwrap();
    cut[8..12].copy_from_slice(&length.to_le_bytes());
    contains(&error_of_bytes("a.glb", &cut), &["chunk", "truncated"]);
}

#[test]
fn random_damage_never_panics() {
    let glb = Asset::triangle().glb();
    let mut state = 1u64;
    for _ in 0..3000 {
        let mut damaged = glb.clone();
        for _ in 0..3 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = (state >> 33) as usize % damaged.len();
            damaged[at] = (state >> 24) as u8;
        }
        let (_folder, path) = file("a.glb", &damaged);
        // Either outcome is fine.
        let _ = load(&path, &ImportSettings::default(), &Silent);
    }
}

#[test]
fn numbers_of_the_wrong_kind_never_panic() {
    // Every number of the file in turn becomes something unlikely.
    let asset = Asset::triangle();
    let mut places = Vec::new();
    collect(&asset.json, String::new(), &mut places);
    for place in places {
        for value in [json!(-1), json!(4294967295u64), json!(1e308), json!("text"), json!(null), json!([]), json!({})] {
            let mut asset = Asset::triangle();
            *asset.json.pointer_mut(&place).unwrap() = value;
            let _ = asset.load();
        }
    }
}

fn collect(value: &Value, place: String, out: &mut Vec<String>) {
    match value {
        Value::Array(items) => items.iter().enumerate().for_each(|(i, v)| collect(v, format!("{place}/{i}"), out)),
        Value::Object(fields) => fields.iter().for_each(|(k, v)| collect(v, format!("{place}/{k}"), out)),
        _ if place.starts_with("/buffers/0/byteLength") => {}
        _ => out.push(place),
    }
}

#[test]
fn buffers_that_are_missing_or_short() {
    let asset = Asset::triangle();
    let gltf = |buffer: Value| {
        let mut json = asset.json.clone();
        json["buffers"][0] = buffer;
        error_of_bytes("a.gltf", json.to_string().as_bytes())
    };
    contains(&gltf(json!({"byteLength": 4, "uri": "gone.bin"})), &["buffers[0]", "gone.bin", "put the file"]);
    contains(&gltf(json!({"byteLength": 4})), &["buffers[0]", "neither a URI"]);
    contains(&gltf(json!({"byteLength": 400, "uri": "data:;base64,AAAA"})), &["buffers[0]", "400", "3 are there"]);
    contains(&gltf(json!({"byteLength": 4, "uri": "data:;base64,A*A"})), &["buffers[0].uri", "base64"]);
    contains(&gltf(json!({"byteLength": 4, "uri": "http://example.org/a.bin"})), &["not fetched"]);
    contains(&gltf(json!({"byteLength": 4, "uri": "data:;base64,AAAAAA"})), &["bufferViews", "past its buffer"]);
}

#[test]
fn references_out_of_range_name_their_place() {
    let check = |change: fn(&mut Value), parts: &[&str]| contains(&broken(change).error(), parts);
    check(|j| j["nodes"][0]["mesh"] = 5.into(), &["nodes[0]", "Triangle", "index 5", "there are 1"]);
    check(|j| j["scene"] = 4.into(), &["scene", "index 4"]);
    check(|j| j["meshes"][0]["primitives"][0]["material"] = 8.into(), &["meshes[0].primitives[0].material", "index 8"]);
    check(|j| j["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 8.into(), &["meshes[0].primitives[0]", "8"]);
    check(|j| j["meshes"][0]["primitives"][0]["indices"] = 8.into(), &["meshes[0].primitives[0]", "8"]);
    check(|j| j["meshes"][0]["primitives"][0]["mode"] = 12.into(), &["mode"]);
    check(|j| j["materials"][0]["emissiveTexture"] = json!({"index": 2}), &["materials[0]", "index 2"]);
    check(|j| j["accessors"][0]["bufferView"] = 7.into(), &["accessors[0].bufferView", "7"]);
    check(|j| j["bufferViews"][0]["buffer"] = 7.into(), &["bufferViews[0].buffer", "7"]);
}

#[test]
fn missing_nodes_are_skipped() {
    let check = |change: fn(&mut Value), parts: &[&str]| {
        let imported = broken(change).imported();
        assert_eq!(imported.scene.instances.len(), 1);
        contains(&warning(&imported, "missing_node"), parts);
    };
    check(|j| j["nodes"][0]["children"] = json!([9]), &["Triangle", "children", "node 9", "skipped"]);
    check(|j| j["scenes"][0]["nodes"] = json!([3, 0]), &["scenes[0]", "node 3", "skipped"]);
}

#[test]
fn what_is_left_out_is_named() {
    let check = |change: fn(&mut Value), code: &str, parts: &[&str]| {
        contains(&warning(&broken(change).imported(), code), parts);
    };
    check(
        |j| {
            j["materials"][0]["extensions"] =
                json!({"KHR_materials_sheen": {"sheenColorTexture": {"index": 0}}, "KHR_materials_ior": {}});
        },
        "extension",
        &["grey", "KHR_materials_sheen", "left out"],
    );
    check(
        |j| j["nodes"][0]["extensions"] = json!({"ACME_glow": {}}),
        "extension",
        &["Triangle", "ACME_glow", "not known"],
    );
    check(
        |j| j["extensions"] = json!({"EXT_lights_image_based": {"lights": []}}),
        "extension",
        &["EXT_lights_image_based", "environment"],
    );
    check(
        |j| j["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"name": "Bulb", "range": 3}]}}),
        "light_range",
        &["Bulb", "left out"],
    );
    check(|j| j["animations"] = json!([{"name": "Walk"}]), "animation", &["Walk", "pose"]);
    let twice = broken(|j| {
        j["meshes"][0]["extensions"] = json!({"ACME_glow": {}});
        j["nodes"][0]["extensions"] = json!({"ACME_glow": {}});
    });
    contains(&warning(&twice.imported(), "extension"), &["1 other places"]);
}

#[test]
fn accessors_past_their_end() {
    let check = |change: fn(&mut Value), parts: &[&str]| contains(&broken(change).error(), parts);
    check(|j| j["accessors"][0]["count"] = 4.into(), &["accessors[0]", "4 elements", "36 bytes"]);
    check(|j| j["accessors"][0]["byteOffset"] = 4.into(), &["accessors[0]", "past its buffer view"]);
    check(|j| j["accessors"][0]["count"] = u64::MAX.into(), &["accessors[0]"]);
    check(|j| j["accessors"][0]["byteOffset"] = u64::MAX.into(), &["accessors[0]"]);
    check(|j| j["bufferViews"][0]["byteLength"] = 99999.into(), &["bufferViews[0]", "past its buffer"]);
    check(|j| j["bufferViews"][0]["byteOffset"] = u64::MAX.into(), &["bufferViews[0]"]);
    check(|j| j["bufferViews"][0]["byteStride"] = 4.into(), &["accessors[0]", "byteStride of 4"]);
    check(|j| j["accessors"][0]["componentType"] = 1.into(), &["accessors[0].componentType"]);
    check(|j| j["accessors"][0]["type"] = "VEC9".into(), &["accessors[0].type"]);
    check(|j| j["accessors"][0]["type"] = "VEC2".into(), &["accessors[0].type", "Vec3 is needed"]);
    let sparse = |indices: Value| {
        let mut asset = Asset::triangle();
        asset.json["accessors"][0]["sparse"] = json!({"count": 2, "indices": indices, "values": {"bufferView": 0}});
        asset.error()
    };
    contains(
        &sparse(json!({"bufferView": 0, "componentType": U16, "byteOffset": 34})),
        &["accessors[0].sparse.indices"],
    );
    contains(&sparse(json!({"bufferView": 50, "componentType": U16})), &["accessors[0].sparse.indices", "50"]);
}

#[test]
fn counts_that_no_memory_holds() {
    let asset = broken(|j| j["accessors"][0] = json!({"componentType": 5126, "type": "VEC3", "count": 1u64 << 40}));
    contains(&asset.error(), &["accessors[0].count", "too many"]);
}

#[test]
fn cycles_and_shared_children() {
    let mut asset = Asset::triangle();
    asset.json["nodes"][0]["children"] = json!([1]);
    asset.push("nodes", json!({"name": "Loop", "children": [0]}));
    let imported = asset.imported();
    assert_eq!(imported.scene.instances.len(), 1);
    contains(&warning(&imported, "cyclic_node"), &["Triangle", "its own ancestor", "remove"]);

    let mut asset = Asset::triangle();
    asset.node(json!({"name": "Second", "children": [0]}));
    let imported = asset.imported();
    assert_eq!(imported.scene.instances.len(), 1);
    contains(&warning(&imported, "shared_node"), &["Triangle", "two parents"]);
}

#[test]
fn nothing_to_bake() {
    contains(&Asset::empty().error(), &["no triangle to bake", "check"]);
}

#[test]
fn required_extensions() {
    let error = |name: &str| broken(|j| j["extensionsRequired"] = json!([name])).error();
    contains(&error("ACME_holograms"), &["ACME_holograms", "export"]);
    broken(|j| j["extensionsRequired"] = json!(["KHR_texture_transform", "KHR_mesh_quantization"])).imported();
}

#[test]
fn transforms_without_surface_are_skipped() {
    let check = |node: Value, code: &str| {
        let mut asset = Asset::triangle();
        asset.node(node);
        let imported = asset.imported();
        assert_eq!(imported.scene.instances.len(), 1);
        contains(&warning(&imported, code), &["Flat"]);
    };
    check(json!({"name": "Flat", "mesh": 0, "scale": [1, 0, 1]}), "zero_scale");
    check(json!({"name": "Flat", "mesh": 0, "scale": [0, 0, 0]}), "zero_scale");
    check(json!({"name": "Flat", "mesh": 0, "scale": [1e-30, 1e-30, 1e-30]}), "zero_scale");
    check(json!({"name": "Flat", "mesh": 0, "translation": [1e300, 0, 0]}), "transform");
    check(json!({"name": "Flat", "mesh": 0, "scale": [1e300, 1, 1]}), "transform");
}

#[test]
fn sizes_that_do_not_match() {
    let mut asset = Asset::triangle();
    asset.node(json!({"name": "Speck", "mesh": 0, "scale": [1e-7, 1e-7, 1e-7]}));
    contains(&warning(&asset.imported(), "scale_mismatch"), &["Speck", "Triangle", "scale"]);
    let mut asset = Asset::triangle();
    asset.json["nodes"][0]["scale"] = json!([1e9, 1e9, 1e9]);
    contains(&warning(&asset.imported(), "huge_scale"), &["Triangle", "scale it down"]);
}

#[test]
fn cancelling_stops_the_import() {
    struct Stop;
    impl Progress for Stop {
        fn report(&self, stage: Stage, done: f64) {
            assert_eq!(stage, Stage::Import);
            assert!((0.0..=1.0).contains(&done));
        }
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let (_folder, path) = file("a.glb", &Asset::triangle().glb());
    assert!(matches!(load(&path, &ImportSettings::default(), &Stop), Err(ImportError::Cancelled(_))));
}
