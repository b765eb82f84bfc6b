//! What surfaces reflect, emit and cover.

use crate::fixture::{Asset, assert_clean, warning};
use glam::{Vec2, Vec3};
use lightkiln::import::{ImportSettings, Imported};
use lightkiln::scene::{AlphaMode, MAX_REFLECTANCE};
use lightkiln::units::LightUnits;
use serde_json::{Value, json};
use std::io::Cursor;

const MIDDLE: Vec2 = Vec2::splat(1.0 / 3.0);

/// A triangle with a material.
fn with(material: Value) -> Asset {
    let mut asset = Asset::triangle();
    asset.json["materials"][0] = material;
    asset
}

/// Adds a texture of the given RGBA texels in one row, and TEXCOORD_0 that runs over it along X.
fn texture(asset: &mut Asset, texels: &[[u8; 4]], sampler: Value) -> usize {
    let pixels = image::RgbaImage::from_vec(texels.len() as u32, 1, texels.as_flattened().to_vec()).unwrap();
    let mut png = Cursor::new(Vec::new());
    pixels.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let view = asset.view(png.get_ref());
    let image = asset.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    let sampler = asset.push("samplers", sampler);
    let attributes = &asset.json["meshes"][0]["primitives"][0]["attributes"];
    if attributes.get("TEXCOORD_0").is_none() {
        let uv = asset.floats("VEC2", &[0., 0., 1., 0., 0., 1.]);
        asset.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv.into();
    }
    asset.push("textures", json!({"source": image, "sampler": sampler}))
}

fn reflectance(imported: &Imported, u: f32) -> Vec3 {
    imported.scene.reflectance_at(0, 0, Vec2::new(u, 0.0))
}

fn near(value: Vec3, expected: Vec3) {
    assert!(value.distance(expected) < 1e-5, "{value} instead of {expected}");
}

#[test]
fn metal_and_glass_reflect_less() {
    let imported = with(json!({"name": "m", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}},
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": 0.25}}))
    .imported();
    assert_clean(&imported);
    near(reflectance(&imported, 0.0), Vec3::new(0.8, 0.4, 0.2) * 0.75 * 0.5);
}

#[test]
fn base_colour_textures_are_decoded_from_srgb_and_metallic_ones_are_not() {
    let mut asset = with(json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1]}}));
    let color = texture(&mut asset, &[[188, 188, 188, 255]], json!({}));
    let metal = texture(&mut asset, &[[255, 255, 51, 255]], json!({}));
    let pbr = &mut asset.json["materials"][0]["pbrMetallicRoughness"];
    pbr["baseColorTexture"] = json!({"index": color});
    pbr["metallicRoughnessTexture"] = json!({"index": metal});
    let imported = asset.imported();
    assert_clean(&imported);
    // sRGB 188 is 0.5029 linear; metallic is 51 / 255.
    near(reflectance(&imported, 0.2), Vec3::new(0.502887, 0.502887 * 0.5, 0.502887) * 0.8);
}

#[test]
fn wrap_and_filter_follow_the_sampler() {
    let texels = [[255, 0, 0, 255], [0, 0, 255, 255]];
    let sample = |sampler: Value, offset: f32, u: f32| {
        let mut asset = with(json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
        let index = texture(&mut asset, &texels, sampler);
        asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] =
            json!({"index": index, "extensions": {"KHR_texture_transform": {"offset": [offset, 0]}}});
        reflectance(&asset.imported(), u)
    };
    let (red, blue) = (Vec3::X * MAX_REFLECTANCE, Vec3::Z * MAX_REFLECTANCE);
    let nearest = |wrap: u32| json!({"magFilter": 9728, "wrapS": wrap});
    near(sample(nearest(10497), 1.0, 0.25), red);
    near(sample(nearest(33648), 1.0, 0.25), blue);
    near(sample(nearest(33071), 1.0, 0.25), blue);
    near(sample(nearest(10497), 0.0, 0.4), red);
    // Linear halfway between the texel centres, in linear light.
    near(sample(json!({"magFilter": 9729}), 0.0, 0.5), Vec3::new(0.5, 0.0, 0.5));
}

#[test]
fn texture_transforms_may_choose_another_coordinate_set() {
    let mut asset = with(json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    let index = texture(&mut asset, &[[255, 0, 0, 255], [0, 0, 255, 255]], json!({"magFilter": 9728}));
    let uv = asset.floats("VEC2", &[0.75, 0., 0.75, 0., 0.75, 0.]);
    asset.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = uv.into();
    asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] =
        json!({"index": index, "texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}});
    near(reflectance(&asset.imported(), 0.1), Vec3::Z * MAX_REFLECTANCE);
}

#[test]
fn images_are_decoded_once() {
    let mut asset = with(json!({"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"metallicFactor": 0}}));
    let index = texture(&mut asset, &[[9, 9, 9, 255]], json!({}));
    let other = asset.push("textures", json!({"source": 0}));
    asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": index});
    asset.json["materials"][0]["emissiveTexture"] = json!({"index": other});
    assert_eq!(asset.imported().scene.textures.len(), 1);
}

#[test]
fn emission_is_factor_times_strength_times_texture_in_the_right_units() {
    let mut asset = with(json!({"emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 683}},
        "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0, 0, 0, 1]}}));
    let index = texture(&mut asset, &[[188, 188, 188, 255]], json!({}));
    asset.json["materials"][0]["emissiveTexture"] = json!({"index": index});
    let emission = |asset: &Asset, units: Option<LightUnits>| {
        let imported = asset.load_with(&ImportSettings { light_units: units, ..Default::default() }).unwrap();
        assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
        imported.scene.emission_at(0, 0, MIDDLE)
    };
    let photometric = Vec3::new(1.0, 0.5, 0.0) * 0.502887;
    near(emission(&asset, None), photometric);
    near(emission(&asset, Some(LightUnits::Radiometric)) / 683.0, photometric);
    asset.lightkiln(json!({"version": 1}));
    near(emission(&asset, None) / 683.0, photometric);
    near(emission(&asset, Some(LightUnits::Photometric)), photometric);
}

#[test]
fn alpha_modes() {
    let alpha = |mode: Value, texel: u8| {
        let mut asset = with(json!({"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [1, 1, 1, 0.5]}}));
        for (key, value) in mode.as_object().unwrap() {
            asset.json["materials"][0][key] = value.clone();
        }
        let index = texture(&mut asset, &[[255, 255, 255, texel]], json!({}));
        asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": index});
        asset.imported().scene.alpha_at(0, 0, MIDDLE)
    };
    assert_eq!(alpha(json!({}), 0), 1.0);
    assert_eq!(alpha(json!({"alphaMode": "MASK"}), 255), 1.0);
    assert_eq!(alpha(json!({"alphaMode": "MASK"}), 200), 0.0);
    assert_eq!(alpha(json!({"alphaMode": "MASK", "alphaCutoff": 0.3}), 200), 1.0);
    assert!((alpha(json!({"alphaMode": "BLEND"}), 102) - 0.2).abs() < 1e-5);
    let imported = with(json!({"alphaMode": "MASK", "pbrMetallicRoughness": {"metallicFactor": 0}})).imported();
    assert_eq!(imported.scene.materials[0].alpha_mode, AlphaMode::Mask(0.5));
}

#[test]
fn too_bright_a_reflectance_is_capped_with_a_warning() {
    let imported = with(json!({"name": "snow", "pbrMetallicRoughness": {"metallicFactor": 0}})).imported();
    assert!(warning(&imported, "reflectance_capped").contains("snow"));
    near(reflectance(&imported, 0.0), Vec3::splat(MAX_REFLECTANCE));
}

#[test]
fn metal_that_nobody_asked_for_is_named() {
    let imported =
        with(json!({"name": "tin", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}})).imported();
    assert!(warning(&imported, "metal_by_default").contains("tin"));
    near(reflectance(&imported, 0.0), Vec3::ZERO);
}

#[test]
fn unlit_materials_are_diffuse_and_dark() {
    let imported = with(json!({"name": "flat", "emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}},
        "pbrMetallicRoughness": {"baseColorFactor": [0.3, 0.3, 0.3, 1]}}))
    .imported();
    warning(&imported, "unlit");
    near(reflectance(&imported, 0.0), Vec3::splat(0.3));
    near(imported.scene.emission_at(0, 0, MIDDLE), Vec3::ZERO);
}

#[test]
fn specular_glossiness_gives_its_diffuse_colour() {
    let imported = with(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness":
        {"diffuseFactor": [0.2, 0.3, 0.4, 1]}}}))
    .imported();
    assert_clean(&imported);
    near(reflectance(&imported, 0.0), Vec3::new(0.2, 0.3, 0.4));
}

#[test]
fn missing_and_broken_textures_leave_the_factor() {
    let check = |image: Value, code: &str| {
        let mut asset = with(json!({"pbrMetallicRoughness": {"metallicFactor": 0,
            "baseColorFactor": [0.5, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}}));
        let view = asset.view(b"\x89PNG\r\n\x1a\nbut not for long");
        asset.push("images", image);
        asset.push("textures", json!({"source": 0}));
        if code == "undecodable_image" {
            asset.json["images"][0]["bufferView"] = view.into();
        }
        let imported = asset.imported();
        let text = warning(&imported, code);
        assert!(text.contains("factor is used alone"), "{text}");
        near(reflectance(&imported, 0.0), Vec3::splat(0.5));
    };
    check(json!({"uri": "nowhere.png"}), "missing_texture");
    check(json!({"uri": "https://example.org/picture.png"}), "missing_texture");
    check(json!({"uri": "data:image/png;base64,AAAA"}), "undecodable_image");
    check(json!({"bufferView": 99}), "missing_texture");
    check(json!({"mimeType": "image/png"}), "undecodable_image");
}

#[test]
fn a_primitive_without_material_is_white() {
    let mut asset = Asset::triangle();
    asset.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("material");
    let imported = asset.imported();
    assert!(warning(&imported, "no_material").contains("`Triangle`"));
    assert_eq!(imported.scene.materials[0].source, None);
    near(reflectance(&imported, 0.0), Vec3::splat(MAX_REFLECTANCE));
}

#[test]
fn textures_of_every_size() {
    for width in [1, 16384] {
        let texels: Vec<[u8; 4]> = (0..width).map(|i| [(i % 256) as u8, 99, 99, 255]).collect();
        let mut asset = with(json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
        let index = texture(&mut asset, &texels, json!({"magFilter": 9728}));
        asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": index});
        let imported = asset.imported();
        assert_clean(&imported);
        assert_eq!(imported.scene.textures[0].width, width);
        let last = imported.scene.textures[0].texel(width - 1, 0).x.min(MAX_REFLECTANCE);
        near(reflectance(&imported, 1.0 - 0.5 / width as f32), Vec3::new(last, 0.124772, 0.124772));
    }
}

#[test]
fn textures_that_cannot_be_placed_or_are_capped_are_named() {
    let mut asset = with(json!({"name": "m", "pbrMetallicRoughness": {"metallicFactor": 0}}));
    let index = texture(&mut asset, &[[255; 4]], json!({}));
    asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": index});
    let capped = warning(&asset.imported(), "reflectance_capped");
    assert!(capped.contains("100 %") && capped.contains("darken"), "{capped}");
    asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 3.into();
    let missing = warning(&asset.imported(), "no_texcoords");
    assert!(missing.contains("TEXCOORD_3") && missing.contains("unwrap"), "{missing}");
}
