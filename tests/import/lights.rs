//! Lamps and environment, in the world and in radiometric units.

use crate::fixture::{Asset, assert_clean, warning};
use approx::assert_relative_eq;
use glam::Vec3;
use lightkiln::import::{ImportSettings, Imported};
use lightkiln::scene::{Environment, Falloff, Light, LightShape, spot_attenuation};
use lightkiln::units::LightUnits;
use serde_json::{Value, json};
use std::f32::consts::PI;

/// A triangle and a node `Lamp` with a light of an extension; `node` adds to the node.
fn lamp(extension: &str, light: Value, node: Value) -> Asset {
    let mut asset = Asset::triangle();
    asset.json["extensions"][extension] = json!({"lights": [light]});
    let mut lamp = json!({"name": "Lamp", "extensions": {extension: {"light": 0}}});
    for (key, value) in node.as_object().unwrap() {
        lamp[key] = value.clone();
    }
    asset.node(lamp);
    asset
}

fn own(light: Value) -> Asset {
    lamp("LIGHTKILN_scene", light, json!({}))
}

fn punctual(light: Value) -> Asset {
    lamp("KHR_lights_punctual", light, json!({}))
}

fn only_light(asset: &Asset) -> Light {
    let mut imported = asset.imported();
    assert_clean(&imported);
    assert_eq!(imported.scene.lights.len(), 1);
    imported.scene.lights.remove(0)
}

#[test]
fn every_type_of_the_contract() {
    let one = Vec3::new(1.0, 2.0, 3.0);
    let check = |light: Value, expected: LightShape| assert_eq!(only_light(&own(light)).shape, expected);
    let rgb = [1, 2, 3];
    check(
        json!({"type": "rect", "radiance": rgb, "size": [2, 3], "spread": 1.5}),
        LightShape::Rect { radiance: one, size: [2.0, 3.0], spread: 1.5 },
    );
    check(
        json!({"type": "disk", "radiance": rgb, "size": [2, 3]}),
        LightShape::Disk { radiance: one, size: [2.0, 3.0], spread: PI },
    );
    check(
        json!({"type": "point", "intensity": rgb, "radius": 0.05}),
        LightShape::Point { intensity: one, radius: 0.05 },
    );
    check(
        json!({"type": "spot", "intensity": rgb, "radius": 0.02, "outerConeAngle": 0.6, "blend": 0.15}),
        LightShape::Spot {
            intensity: one,
            radius: 0.02,
            outer_cone_angle: 0.6,
            blend: 0.15,
            falloff: Falloff::Smoothstep,
        },
    );
    check(
        json!({"type": "sun", "irradiance": rgb, "angle": 0.00918}),
        LightShape::Sun { irradiance: one, angle: 0.00918 },
    );
}

#[test]
fn sizes_follow_the_scale_of_the_node_and_axes_its_rotation() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let node = json!({"translation": [1, 2, 3], "rotation": [-half, 0, 0, half], "scale": [2, 3, -5]});
    let rect = only_light(&lamp(
        "LIGHTKILN_scene",
        json!({"type": "rect", "radiance": [1, 1, 1], "size": [1, 1]}),
        node.clone(),
    ));
    assert_eq!(rect.position, Vec3::new(1.0, 2.0, 3.0));
    // A quarter turn about −X takes +Z to +Y; the mirroring turns it to −Y.
    assert!(rect.axes[2].distance(Vec3::NEG_Y) < 1e-6, "{:?}", rect.axes);
    assert!(rect.axes[0].distance(Vec3::X) < 1e-6);
    let LightShape::Rect { size, .. } = rect.shape else { panic!("{:?}", rect.shape) };
    assert_relative_eq!(size[0], 2.0, epsilon = 1e-5);
    assert_relative_eq!(size[1], 3.0, epsilon = 1e-5);
    let point = only_light(&lamp("LIGHTKILN_scene", json!({"type": "point", "intensity": 1, "radius": 0.1}), node));
    let LightShape::Point { radius, .. } = point.shape else { panic!("{:?}", point.shape) };
    assert_relative_eq!(radius, 0.5, epsilon = 1e-6);
}

#[test]
fn punctual_lights_are_photometric_unless_told_otherwise() {
    let intensity = |asset: &Asset, units| {
        let settings = ImportSettings { light_units: units, ..Default::default() };
        match asset.load_with(&settings).unwrap().scene.lights[0].shape {
            LightShape::Point { intensity, .. } => intensity,
            LightShape::Sun { irradiance, .. } => irradiance,
            other => panic!("{other:?}"),
        }
    };
    for kind in ["point", "directional"] {
        let mut asset = punctual(json!({"type": kind, "color": [1, 0.5, 0], "intensity": 1366}));
        assert!(intensity(&asset, None).distance(Vec3::new(2.0, 1.0, 0.0)) < 1e-5);
        let radiometric = intensity(&asset, Some(LightUnits::Radiometric));
        assert_eq!(radiometric, Vec3::new(1366.0, 683.0, 0.0));
        asset.lightkiln(json!({"version": 1}));
        assert_eq!(intensity(&asset, None), radiometric);
    }
}

#[test]
fn the_cone_of_a_punctual_spot_is_exact() {
    let (inner, outer) = (0.3f32, 0.7f32);
    let light = only_light(&punctual(json!({"type": "spot", "intensity": 683,
        "spot": {"innerConeAngle": inner, "outerConeAngle": outer}})));
    let LightShape::Spot { outer_cone_angle, blend, falloff, .. } = light.shape else { panic!("{:?}", light.shape) };
    for angle in [0.0f32, 0.2, 0.3, 0.4, 0.5, 0.65, 0.69, 0.7, 0.9, 2.0] {
        // The formula that the extension recommends.
        let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
        let expected = ((angle.cos() - outer.cos()) * scale).clamp(0.0, 1.0).powi(2);
        let value = spot_attenuation(angle.cos(), outer_cone_angle, blend, falloff);
        assert_relative_eq!(value, expected, epsilon = 1e-5);
    }
}

#[test]
fn the_cone_of_our_spot_follows_blenders_curve() {
    let (half, blend) = (0.6f32, 0.15f32);
    for angle in [0.0f32, 0.5, 0.56, 0.58, 0.599, 0.61] {
        let x = ((angle.cos() - half.cos()) / ((1.0 - half.cos()) * blend)).clamp(0.0, 1.0);
        let value = spot_attenuation(angle.cos(), half, blend, Falloff::Smoothstep);
        assert_relative_eq!(value, x * x * (3.0 - 2.0 * x), epsilon = 1e-5);
    }
    // Without blend the edge is hard and nothing divides by zero.
    assert_eq!(spot_attenuation(0.61f32.cos(), half, 0.0, Falloff::Smoothstep), 0.0);
    assert_eq!(spot_attenuation(0.59f32.cos(), half, 0.0, Falloff::Smoothstep), 1.0);
}

#[test]
fn area_lights_of_the_draft() {
    let shape = |light: Value| only_light(&lamp("EXT_lights_area", light, json!({"scale": [1, 2, 1]}))).shape;
    let one = Vec3::ONE;
    assert_eq!(
        shape(json!({"type": "rect", "intensity": 683, "size": 2, "rect": {"aspect": 1.5}})),
        LightShape::Rect { radiance: one, size: [6.0, 4.0], spread: PI }
    );
    assert_eq!(
        shape(json!({"type": "disk", "intensity": 683, "color": [1, 1, 1]})),
        LightShape::Disk { radiance: one, size: [2.0, 2.0], spread: PI }
    );
}

#[test]
fn a_node_with_two_extensions_is_lit_once() {
    let mut asset = own(json!({"type": "point", "intensity": [1, 1, 1], "radius": 0.1}));
    asset.json["extensions"]["KHR_lights_punctual"] = json!({"lights": [{"type": "point"}]});
    asset.json["nodes"][1]["extensions"]["KHR_lights_punctual"] = json!({"light": 0});
    let LightShape::Point { radius, .. } = only_light(&asset).shape else { panic!() };
    assert_eq!(radius, 0.1);
}

#[test]
fn groups_and_shadows_come_from_the_node_or_the_light() {
    let mut asset =
        own(json!({"name": "Key", "type": "point", "intensity": [1, 1, 1], "group": "a", "castsShadows": false}));
    let light = only_light(&asset);
    assert_eq!((light.name.as_str(), light.path.as_str()), ("Key", "Lamp"));
    assert_eq!((light.group.as_deref(), light.casts_shadows), (Some("a"), false));
    asset.json["nodes"][1]["extensions"]["LIGHTKILN_scene"] = json!({"light": 0, "group": "b", "castsShadows": true});
    let light = only_light(&asset);
    assert_eq!((light.group.as_deref(), light.casts_shadows), (Some("b"), true));
}

#[test]
fn faulty_lamps_are_named_and_the_rest_goes_on() {
    let check = |asset: &Asset, code: &str, text: &str, lights: usize| {
        let imported = asset.imported();
        let found = imported.warnings.iter().find(|w| w.code == code);
        let found = found.unwrap_or_else(|| panic!("no {code} in {:?}", imported.warnings)).to_string();
        assert!(found.starts_with("`Lamp`") && found.contains(text), "{found}");
        assert_eq!(imported.scene.lights.len(), lights);
    };
    check(&own(json!({"type": "laser"})), "unknown_light", "laser", 0);
    check(&own(json!({"type": "point", "intensity": [0, 0, 0]})), "dark_light", "strength", 0);
    check(&own(json!({"type": "point", "intensity": [-1, 1, 1]})), "light_value", "negative", 1);
    check(&own(json!({"type": "point", "intensity": [1e300, 1, 1]})), "light_value", "not finite", 1);
    check(&own(json!({"type": "point"})), "light_value", "missing", 0);
    check(&own(json!({"type": "rect", "radiance": [1, 1, 1], "size": [0, 1]})), "dark_light", "size", 0);
    check(&own(json!({"type": "rect", "radiance": [1, 1, 1]})), "light_value", "size is missing", 1);
    check(&own(json!({"type": "point", "intensity": [1, 1, 1], "radius": -1})), "light_value", "radius", 1);
    check(&own(json!({"type": "spot", "intensity": 1, "outerConeAngle": 3.0})), "light_value", "outerConeAngle", 1);
    check(&punctual(json!({"type": "point", "intensity": -5})), "light_value", "negative", 0);
    let rect = json!({"type": "rect", "radiance": [1, 1, 1], "size": [1, 1]});
    check(&lamp("LIGHTKILN_scene", rect, json!({"scale": [0, 0, 0]})), "dark_light", "size", 0);
    let mut missing = own(json!({"type": "point", "intensity": 1}));
    missing.json["nodes"][1]["extensions"]["LIGHTKILN_scene"]["light"] = 7.into();
    check(&missing, "missing_light", "7", 0);
}

fn environment(value: Value) -> Imported {
    let mut asset = Asset::triangle();
    asset.lightkiln(json!({"version": 1, "environment": value}));
    asset.imported()
}

#[test]
fn environments() {
    let constant = environment(json!({"radiance": [1, 2, 3]}));
    assert!(constant.warnings.is_empty());
    assert_eq!(constant.scene.environment, Environment::Constant(Vec3::new(1.0, 2.0, 3.0)));
    let gradient = environment(json!({"gradient": {"zenith": [1, 1, 1], "horizon": [2, 2, 2], "ground": [3, 3, 3]}}));
    let sky = &gradient.scene.environment;
    assert_eq!(sky.radiance(Vec3::Y), Vec3::ONE);
    assert_eq!(sky.radiance(Vec3::new(0.8, 0.6, 0.0)), Vec3::splat(1.4));
    assert_eq!(sky.radiance(Vec3::NEG_Y), Vec3::splat(3.0));
    assert!(environment(json!({"radiance": [0, 0, 0]})).scene.environment.is_black());
}

#[test]
fn environments_that_cannot_be_lit_are_named() {
    let negative = environment(json!({"radiance": [-1, 1, 1]}));
    warning(&negative, "environment");
    assert_eq!(negative.scene.environment, Environment::Constant(Vec3::new(0.0, 1.0, 1.0)));
}

#[test]
fn a_scene_without_light_is_noticed() {
    assert!(warning(&Asset::triangle().imported(), "no_light").contains("black"));
    assert!(own(json!({"type": "point", "intensity": [1, 1, 1]})).imported().warnings.is_empty());
}
