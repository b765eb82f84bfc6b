//! Photometric profiles on lamps, and what becomes of lamps whose profile is broken.

use crate::fixture::{Asset, assert_clean, warning};
use glam::Vec3;
use lightkiln::import::{ImportSettings, Imported, load};
use lightkiln::progress::Silent;
use lightkiln::scene::{Light, LightShape};
use serde_json::{Value, json};

/// 683 cd along the beam, 341.5 cd at 45°, none at 90°.
const PROFILE: &str = "IESNA:LM-63-2002\n[TEST] made for a test\nTILT=NONE\n\
                       1 1000 1 3 1 1 2 0 0 0\n1 1 60\n0 45 90\n0\n683 341.5 0\n";

fn with_light(extension: &str, light: Value, instance: Value) -> Asset {
    let mut asset = Asset::triangle();
    asset.json["extensions"][extension] = json!({"lights": [light]});
    asset.node(json!({"name": "Lamp", "extensions": {extension: instance}}));
    asset
}

fn own(ies: Value) -> Asset {
    let light = json!({"type": "point", "intensity": [2, 2, 2], "ies": ies});
    with_light("LIGHTKILN_scene", light, json!({"light": 0}))
}

fn data_uri(text: &str) -> Value {
    format!("data:,{}", text.replace('\n', "%0A")).into()
}

fn lamp(imported: &Imported) -> (&Light, Vec3) {
    let light = &imported.scene.lights[0];
    let LightShape::Point { intensity, .. } = light.shape else { panic!("{:?}", light.shape) };
    (light, intensity)
}

#[test]
fn a_profile_shapes_the_intensity_or_sets_it() {
    let relative = own(data_uri(PROFILE)).imported();
    assert_clean(&relative);
    let (light, intensity) = lamp(&relative);
    assert_eq!(intensity, Vec3::splat(2.0));
    let profile = light.profile.as_ref().expect("it has a profile");
    assert_eq!(profile.peak(), 683.0);
    assert!((profile.relative(Vec3::new(1.0, 0.0, -1.0).normalize()) - 0.5).abs() < 1e-5);

    let mut asset = own(json!({"absolute": true}));
    let view = asset.view(PROFILE.as_bytes());
    asset.json["extensions"]["LIGHTKILN_scene"]["lights"][0]["ies"]["bufferView"] = view.into();
    let absolute = asset.imported();
    assert_clean(&absolute);
    assert_eq!(lamp(&absolute).1, Vec3::splat(2.0));
}

#[test]
fn lights_of_the_extension_are_in_candela() {
    let instance = json!({"light": 0, "multiplier": 3.0, "color": [1, 0.5, 0]});
    let imported = with_light("EXT_lights_ies", json!({"uri": data_uri(PROFILE)}), instance).imported();
    assert_clean(&imported);
    let (light, intensity) = lamp(&imported);
    assert!(intensity.distance(Vec3::new(3.0, 1.5, 0.0)) < 1e-5, "{intensity}");
    assert!(light.profile.is_some());
}

#[test]
fn blender_counts_planes_another_way() {
    let mut asset = own(json!({"absolute": true, "frame": "blender"}));
    let view = asset.view(PROFILE.as_bytes());
    asset.json["extensions"]["LIGHTKILN_scene"]["lights"][0]["ies"]["bufferView"] = view.into();
    asset.json["extensions"]["LIGHTKILN_scene"]["lights"][0]["softFalloff"] = true.into();
    let imported = asset.imported();
    let light = lamp(&imported).0;
    assert_eq!(light.axes, [Vec3::NEG_Y, Vec3::NEG_X, Vec3::Z]);
    assert!(light.faces_receivers);
}

#[test]
fn profiles_lie_beside_the_file() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(folder.path().join("spot lamp.ies"), PROFILE).expect("the folder is writable");
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, own(json!("spot%20lamp.ies")).glb()).expect("the folder is writable");
    let imported = load(&path, &ImportSettings::default(), &Silent).expect("it loads");
    assert_clean(&imported);
    assert!(lamp(&imported).0.profile.is_some());
    assert_eq!(imported.document.external_files.len(), 1);
}

#[test]
fn broken_profiles_are_named_and_the_lamp_goes_on() {
    let check = |ies: Value, fault: &str| {
        let imported = own(ies).imported();
        let file = warning(&imported, "ies_profile");
        assert!(file.contains(fault) && file.contains("export"), "{file}");
        let lamp_warning = warning(&imported, "light_without_profile");
        assert!(lamp_warning.starts_with("`Lamp`") && lamp_warning.contains("shines without"), "{lamp_warning}");
        let (light, intensity) = lamp(&imported);
        assert!(light.profile.is_none() && intensity == Vec3::splat(2.0));
    };
    check(json!("missing.ies"), "missing.ies");
    check(json!({"bufferView": 99}), "buffer view");
    check(data_uri(&PROFILE[..PROFILE.len() - 8]), "truncated");
    check(data_uri(&PROFILE.replace("1 3 1 1 2", "1 3 1 3 2")), "type A");
    check(data_uri(&PROFILE.replace("0 45 90", "0 90 45")), "ascending");
}

#[test]
fn without_a_profile_candela_mean_nothing() {
    let imported = with_light("EXT_lights_ies", json!({"uri": "missing.ies"}), json!({"light": 0})).imported();
    assert!(imported.scene.lights.is_empty());
    assert!(warning(&imported, "light_without_profile").contains("skipped"));
    let area = json!({"type": "rect", "radiance": 1, "size": [1, 1], "ies": "a.ies"});
    let imported = with_light("LIGHTKILN_scene", area, json!({"light": 0})).imported();
    assert_eq!(imported.scene.lights.len(), 1);
    assert!(warning(&imported, "light_without_profile").contains("points and spots"));
}
