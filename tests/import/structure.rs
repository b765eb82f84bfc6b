//! Scenes, node graphs, instances and the settings that nodes hand down.

use crate::fixture::{Asset, I8, assert_clean, warning};
use glam::Vec3;
use lightkiln::import::ImportSettings;
use lightkiln::scene::LightmapRequest;
use serde_json::json;

fn paths(asset: &Asset) -> Vec<String> {
    asset.imported().scene.instances.into_iter().map(|i| i.path).collect()
}

#[test]
fn paths_join_names_and_are_unique() {
    let mut asset = Asset::triangle();
    asset.node(json!({"name": "Room", "children": [2, 3, 4]}));
    asset.push("nodes", json!({"name": "Chair", "mesh": 0}));
    asset.push("nodes", json!({"name": "Chair", "mesh": 0}));
    asset.push("nodes", json!({"mesh": 0}));
    assert_eq!(paths(&asset), ["Triangle", "Room/Chair", "Room/Chair#2", "Room/node4"]);
    assert_eq!(asset.imported().scene.meshes.len(), 1);
}

#[test]
fn transforms_multiply_down_the_tree() {
    let mut asset = Asset::triangle();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    asset.json["nodes"][0] = json!({"name": "Root", "children": [1],
        "translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 1, 1]});
    asset.push(
        "nodes",
        json!({"name": "Leaf", "mesh": 0,
        "matrix": [1, 0, 0, 0, 0, -3, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]}),
    );
    let scene = asset.imported().scene;
    // Mesh X: scaled by 2, turned to +Y. Mesh Y: mirrored and scaled by −3, turned to +X.
    let [a, b, c] = scene.corners(0, 0);
    assert!(a.distance(Vec3::new(10.0, 0.0, 5.0)) < 1e-5);
    assert!((b - a).distance(Vec3::new(0.0, 2.0, 0.0)) < 1e-5);
    assert!((c - a).distance(Vec3::new(3.0, 0.0, 0.0)) < 1e-5);
    assert!(scene.instances[0].flips());
    // The front face stays in front although the winding turned over.
    assert!(scene.geometric_normal(0, 0).distance(Vec3::Z) < 1e-6);
}

#[test]
fn chains_of_nodes_may_be_long() {
    let mut asset = Asset::triangle();
    let length = 5_000;
    asset.json["nodes"][0]["children"] = json!([1]);
    for i in 1..length {
        let children = if i + 1 < length { json!([i + 1]) } else { json!([0]) };
        asset.push("nodes", json!({"name": "n", "children": children}));
    }
    asset.json["nodes"][length - 1] = json!({"name": "end", "mesh": 0, "translation": [0, 0, 0]});
    assert_eq!(asset.imported().scene.instances.len(), 2);
}

#[test]
fn thousands_of_equal_names_stay_unique() {
    let mut asset = Asset::triangle();
    for _ in 0..5000 {
        asset.node(json!({"name": "Triangle", "mesh": 0}));
    }
    let mut all = paths(&asset);
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 5001);
}

#[test]
fn one_of_several_scenes_is_chosen() {
    let mut asset = Asset::triangle();
    asset.json["scenes"][0]["name"] = "Day".into();
    let other = asset.push("nodes", json!({"name": "Other", "mesh": 0}));
    asset.push("scenes", json!({"name": "Night", "nodes": [other]}));
    let with = |scene: &str| asset.load_with(&ImportSettings { scene: Some(scene.into()), ..Default::default() });
    assert!(warning(&asset.imported(), "several_scenes").contains("`Night`"));
    for name in ["Night", "1"] {
        let imported = with(name).unwrap();
        assert_clean(&imported);
        assert_eq!(imported.scene.instances[0].path, "Other");
    }
    let error = with("Dusk").map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("Dusk") && error.contains("`Day`, `Night`"), "{error}");
}

#[test]
fn a_file_without_scenes_shows_its_roots() {
    let mut asset = Asset::triangle();
    let root = asset.json.as_object_mut().unwrap();
    root.remove("scenes");
    root.remove("scene");
    asset.push("nodes", json!({"name": "Parent", "children": [0]}));
    assert_eq!(paths(&asset), ["Parent/Triangle"]);
}

#[test]
fn settings_are_inherited_and_overridden() {
    let mut asset = Asset::triangle();
    let own = |settings: serde_json::Value| json!({"LIGHTKILN_scene": settings});
    asset.node(json!({"name": "Lamp", "mesh": 0, "children": [2, 3],
        "extensions": own(json!({"group": "lamps", "castsShadows": false, "lightmap": {"texelsPerMetre": 8.0}}))}));
    asset.push("nodes", json!({"name": "Shade", "mesh": 0}));
    asset.push(
        "nodes",
        json!({"name": "Foot", "mesh": 0,
        "extensions": own(json!({"castsShadows": true, "lightmap": {"resolution": 64}}))}),
    );
    asset.node(json!({"name": "Wire", "mesh": 0, "extensions": own(json!({"lightmap": false}))}));
    let imported = asset.imported();
    assert_clean(&imported);
    let find = |path: &str| imported.scene.instances.iter().find(|i| i.path == path).unwrap();
    let shade = find("Lamp/Shade");
    assert_eq!((shade.group.as_deref(), shade.casts_shadows), (Some("lamps"), false));
    assert_eq!(shade.lightmap, LightmapRequest::TexelsPerMetre(8.0));
    let foot = find("Lamp/Foot");
    assert_eq!((foot.group.as_deref(), foot.casts_shadows), (Some("lamps"), true));
    assert_eq!(foot.lightmap, LightmapRequest::Resolution(64));
    assert_eq!(find("Wire").lightmap, LightmapRequest::None);
    assert_eq!(find("Triangle").lightmap, LightmapRequest::Default);
}

#[test]
fn a_lightmap_setting_that_is_not_understood_is_named() {
    let mut asset = Asset::triangle();
    asset.json["nodes"][0]["extensions"] = json!({"LIGHTKILN_scene": {"lightmap": {"texelsPerMetre": -1}}});
    assert!(warning(&asset.imported(), "lightmap_setting").contains("Triangle"));
}

#[test]
fn gpu_instances_are_expanded() {
    let mut asset = Asset::triangle();
    let translation = asset.floats("VEC3", &[0., 0., 0., 4., 0., 0.]);
    // A quarter turn about Z as normalised bytes.
    let rotation = asset.accessor(&[0, 0, 0, 127, 0, 0, 90, 90], I8, "VEC4", 2);
    asset.json["accessors"][rotation]["normalized"] = true.into();
    let scale = asset.floats("VEC3", &[1., 1., 1., 2., 2., 2.]);
    asset.json["nodes"][0]["translation"] = json!([0, 7, 0]);
    asset.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes":
        {"TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale}}});
    asset.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let imported = asset.imported();
    assert_clean(&imported);
    let instances = &imported.scene.instances;
    assert_eq!(instances.iter().map(|i| i.path.as_str()).collect::<Vec<_>>(), ["Triangle[0]", "Triangle[1]"]);
    assert_eq!(instances[1].gpu_instance, Some(1));
    assert!(imported.scene.corners(1, 0)[1].distance(Vec3::new(4.0, 9.0, 0.0)) < 1e-5);
}

#[test]
fn gpu_instances_of_uneven_counts_are_refused() {
    let mut asset = Asset::triangle();
    let translation = asset.floats("VEC3", &[0., 0., 0., 4., 0., 0.]);
    let scale = asset.floats("VEC3", &[1., 1., 1.]);
    asset.json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translation, "SCALE": scale}}});
    assert!(asset.error().contains("Triangle"));
}

#[test]
fn invisible_nodes_are_left_out_and_named() {
    let mut asset = Asset::triangle();
    asset.node(json!({"name": "Hidden", "children": [2],
        "extensions": {"KHR_node_visibility": {"visible": false}}}));
    asset.push("nodes", json!({"name": "Child", "mesh": 0}));
    assert_eq!(paths(&asset), ["Triangle"]);
    assert!(warning(&asset.imported(), "invisible").contains("Hidden"));
}
