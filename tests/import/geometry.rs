//! Topologies, attributes and what is wrong with them.

use crate::fixture::{Asset, I8, U8, U16, assert_clean, warning};
use glam::{Vec2, Vec3};
use serde_json::json;

const SQUARE: [f32; 12] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.];

/// One mesh of the given positions and indices, without normals.
fn mesh(positions: &[f32], indices: Option<&[u32]>, mode: u32) -> Asset {
    let mut asset = Asset::empty();
    let positions = asset.floats("VEC3", positions);
    let mut primitive = json!({"attributes": {"POSITION": positions}, "mode": mode, "material": 0});
    if let Some(indices) = indices {
        primitive["indices"] = asset.indices(indices).into();
    }
    asset.push(
        "materials",
        json!({"pbrMetallicRoughness": {"metallicFactor": 0.0, "baseColorFactor": [0.5, 0.5, 0.5, 1]}}),
    );
    let mesh = asset.mesh(primitive);
    asset.node(json!({"name": "Kitchen", "children": [1]}));
    asset.push("nodes", json!({"name": "Table", "mesh": mesh}));
    asset
}

#[test]
fn strips_and_fans_face_one_way() {
    // The same square, as a strip and as a fan.
    let fan = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    for asset in [mesh(&SQUARE, None, 5), mesh(&fan, None, 6), mesh(&SQUARE, Some(&[0, 1, 2, 1, 3, 2]), 4)] {
        let imported = asset.imported();
        assert_clean(&imported);
        assert_eq!(imported.scene.triangle_count(), 2);
        for triangle in 0..2 {
            assert_eq!(imported.scene.geometric_normal(0, triangle), Vec3::Z);
        }
    }
}

#[test]
fn points_and_lines_are_skipped() {
    let mut asset = mesh(&SQUARE, None, 5);
    let line = json!({"attributes": {"POSITION": 0}, "mode": 1, "material": 0});
    asset.json["meshes"][0]["primitives"].as_array_mut().unwrap().insert(0, line);
    let imported = asset.imported();
    assert!(warning(&imported, "not_surfaces").contains("Kitchen/Table"));
    assert_eq!(imported.scene.meshes[0].primitives[0].source, 1);
    assert_eq!(imported.scene.triangle_count(), 2);
}

#[test]
fn missing_normals_are_flat_and_unshare_vertices() {
    let imported = mesh(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.], Some(&[0, 1, 2, 0, 2, 3]), 4).imported();
    let mesh = &imported.scene.meshes[0];
    assert_eq!(mesh.positions.len(), 6);
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::X, Vec3::X, Vec3::X]);
    assert_eq!(mesh.source_vertices, [0, 1, 2, 0, 2, 3]);
}

#[test]
fn zero_length_normals_are_replaced() {
    let mut asset = mesh(&SQUARE, None, 5);
    let normals = asset.floats("VEC3", &[0., 0., 2., 0., 0., 0., f32::NAN, 0., 1., 0., 1., 0.]);
    asset.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normals.into();
    let imported = asset.imported();
    assert_eq!(imported.scene.meshes[0].normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y]);
    assert!(warning(&imported, "zero_normals").contains("2 normals"));
}

#[test]
fn broken_triangles_are_skipped_and_counted() {
    let mut positions = SQUARE.to_vec();
    positions.extend([f32::NAN, 0., 0., f32::INFINITY, 0., 0., 0.5, 0., 0.]);
    let indices = [0, 1, 2, 0, 1, 9, 1, 2, 4, 3, 2, 5, 0, 1, 6, 1, 1, 2];
    let imported = mesh(&positions, Some(&indices), 4).imported();
    assert_eq!(imported.scene.triangle_count(), 1);
    // Vertices that are left over, among them the broken ones, are gone.
    assert_eq!(imported.scene.meshes[0].positions.len(), 3);
    let check = |code: &str, count: &str| {
        let text = warning(&imported, code);
        assert!(text.contains("`Kitchen/Table`") && text.contains(count), "{text}");
    };
    check("index_out_of_range", ": 1 triangles");
    check("not_finite", ": 2 triangles");
    check("degenerate_triangles", ": 2 zero-area");
}

#[test]
fn a_mesh_without_a_sound_triangle_is_named_in_the_error() {
    let error = mesh(&[0.; 9], None, 4).error();
    assert!(error.contains("no triangle") && error.contains("Kitchen/Table") && error.contains("zero-area"), "{error}");
}

#[test]
fn attributes_of_the_wrong_length_are_ignored() {
    let mut asset = mesh(&SQUARE, None, 5);
    let normals = asset.floats("VEC3", &[0., 0., 1.]);
    asset.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normals.into();
    let imported = asset.imported();
    warning(&imported, "attribute_length");
    assert_eq!(imported.scene.meshes[0].normals, [Vec3::Z; 6]);
}

/// A triangle with quantised attributes.
pub(crate) fn quantised() -> Asset {
    let mut asset = Asset::empty();
    let positions: Vec<u8> =
        [[0i8, 0, 0, 0], [127, 0, 0, 0], [0, 127, 0, 0]].concat().iter().map(|v| *v as u8).collect();
    let positions = asset.accessor(&positions, I8, "VEC3", 3);
    asset.json["accessors"][positions]["normalized"] = true.into();
    asset.json["bufferViews"][0]["byteStride"] = 4.into();
    let uv: Vec<u8> = [0u16, 0, 65535, 0, 0, 32768].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uv = asset.accessor(&uv, U16, "VEC2", 3);
    asset.json["accessors"][uv]["normalized"] = true.into();
    let colors = asset.accessor(&[255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255], U8, "VEC4", 3);
    asset.json["accessors"][colors]["normalized"] = true.into();
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uv, "COLOR_0": colors});
    asset.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0.0}}));
    let mesh = asset.mesh(json!({"attributes": attributes, "material": 0}));
    asset.node(json!({"mesh": mesh}));
    asset.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    asset.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    asset
}

#[test]
fn quantised_attributes_are_read() {
    let imported = quantised().imported();
    assert_clean(&imported);
    let mesh = &imported.scene.meshes[0];
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert!(mesh.texcoords[0][2].distance(Vec2::new(0.0, 0.5)) < 1e-4);
    // Vertex colours multiply the base colour, and interpolate.
    let middle = imported.scene.reflectance_at(0, 0, Vec2::splat(1.0 / 3.0));
    assert!(middle.distance(Vec3::splat(1.0 / 3.0)) < 1e-6, "{middle}");
}

#[test]
fn sparse_accessors_override_their_base() {
    let mut asset = mesh(&SQUARE, None, 5);
    let indices = asset.view(&[3, 0]);
    let values = asset.view(&[2f32, 2., 0.].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    asset.json["accessors"][0]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": indices, "componentType": U16}, "values": {"bufferView": values}});
    assert_eq!(asset.imported().scene.corners(0, 1)[2], Vec3::new(2.0, 2.0, 0.0));
}

#[test]
fn closed_meshes_are_recognised() {
    let corners = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
    let closed = |indices: &[u32]| mesh(&corners, Some(indices), 4).imported().scene.meshes[0].closed;
    assert!(closed(&[0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]));
    assert!(!closed(&[0, 2, 1, 0, 1, 3, 0, 3, 2]));
}

#[test]
fn morph_targets_apply_at_their_default_weights() {
    let mut asset = mesh(&SQUARE, None, 5);
    let shift = asset.floats("VEC3", &[0., 0., 2., 0., 0., 2., 0., 0., 2., 0., 0., 2.]);
    asset.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": shift}]);
    asset.json["meshes"][0]["weights"] = json!([0.5]);
    asset.node(json!({"name": "Own", "mesh": 0, "weights": [1.0]}));
    let imported = asset.imported();
    assert_eq!(imported.scene.corners(0, 0)[0].z, 1.0);
    assert_eq!(imported.scene.corners(1, 0)[0].z, 2.0);
    assert_eq!(imported.warnings.iter().filter(|w| w.code == "morph_rest_pose").count(), 2);
}

#[test]
fn skins_follow_their_joints_and_not_their_node() {
    let mut asset = mesh(&SQUARE, None, 5);
    let joints = asset.accessor(&[0; 16], U8, "VEC4", 4);
    let weights = asset.floats("VEC4", &[1., 0., 0., 0.].repeat(4));
    let mut bind = [0f32; 16];
    for i in 0..4 {
        bind[5 * i] = 1.0;
    }
    bind[12] = -1.0;
    let bind = asset.floats("MAT4", &bind);
    let attributes = &mut asset.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    asset.json["nodes"][1]["skin"] = 0.into();
    asset.json["nodes"][0]["translation"] = json!([50, 0, 0]);
    let joint = asset.node(json!({"name": "Bone", "translation": [0, 3, 0]}));
    asset.push("skins", json!({"joints": [joint], "inverseBindMatrices": bind}));
    let imported = asset.imported();
    assert_eq!(imported.scene.corners(0, 0)[0], Vec3::new(-1.0, 3.0, 0.0));
    assert!(warning(&imported, "skin_rest_pose").contains("Kitchen/Table"));
}

#[test]
fn a_large_grid_keeps_its_triangles() {
    const N: u32 = 300;
    let positions: Vec<f32> = (0..N * N).flat_map(|i| [(i % N) as f32, (i / N) as f32, 0.0]).collect();
    let cell = |i: u32| [i, i + 1, i + N, i + 1, i + N + 1, i + N];
    let indices: Vec<u32> = (0..N * (N - 1)).filter(|i| i % N != N - 1).flat_map(cell).collect();
    let imported = mesh(&positions, Some(&indices), 4).imported();
    assert_clean(&imported);
    assert_eq!(imported.scene.triangle_count(), 2 * (N as usize - 1).pow(2));
}
