//! Environment pictures: formats, places, faults.

use crate::fixture::{Asset, assert_clean, warning};
use glam::Vec3;
use lightkiln::import::{ImportSettings, Imported, load};
use lightkiln::progress::Silent;
use lightkiln::scene::Environment;
use serde_json::{Value, json};
use std::io::Cursor;

/// An 8 × 4 picture, red on top, blue below.
fn exr(pixel: impl Fn(usize, usize) -> (f32, f32, f32) + Sync) -> Vec<u8> {
    use exr::prelude::*;
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| pixel(at.x(), at.y()));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_channels((8, 4), channels).write().to_buffered(&mut bytes).expect("the picture can be written");
    bytes.into_inner()
}

fn two_colours(_: usize, y: usize) -> (f32, f32, f32) {
    if y < 2 { (2.0, 0.0, 0.0) } else { (0.0, 0.0, 2.0) }
}

fn with_environment(environment: Value) -> Asset {
    let mut asset = Asset::triangle();
    asset.lightkiln(json!({"version": 1, "environment": environment}));
    asset
}

fn embedded(bytes: &[u8], more: Value) -> Imported {
    let mut asset = with_environment(more);
    let view = asset.view(bytes);
    asset.json["extensions"]["LIGHTKILN_scene"]["environment"]["image"] = json!({"bufferView": view});
    asset.imported()
}

fn near(imported: &Imported, direction: Vec3, expected: Vec3) {
    let got = imported.scene.environment.radiance(direction);
    assert!(got.distance(expected) < 0.01, "{got} instead of {expected}");
}

#[test]
fn both_formats_light_from_the_right_side() {
    let mut hdr = Vec::new();
    let rows: Vec<image::Rgb<f32>> =
        (0..32).map(|i| two_colours(0, i / 8)).map(|(r, g, b)| image::Rgb([r, g, b])).collect();
    image::codecs::hdr::HdrEncoder::new(&mut hdr).encode(&rows, 8, 4).expect("the picture can be written");
    for bytes in [exr(two_colours), hdr] {
        let imported = embedded(&bytes, json!({"strength": 3.0}));
        assert_clean(&imported);
        near(&imported, Vec3::Y, Vec3::X * 6.0);
        near(&imported, Vec3::NEG_Y, Vec3::Z * 6.0);
        // Half a turn about X.
        let turned = embedded(&bytes, json!({"rotation": [1, 0, 0, 0]}));
        near(&turned, Vec3::Y, Vec3::Z * 2.0);
    }
}

#[test]
fn pictures_lie_beside_the_file() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(folder.path().join("sky.exr"), exr(two_colours)).expect("the folder is writable");
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, with_environment(json!({"image": "sky.exr"})).glb()).expect("the folder is writable");
    let imported = load(&path, &ImportSettings::default(), &Silent).expect("it loads");
    assert_clean(&imported);
    near(&imported, Vec3::Y, Vec3::X * 2.0);
    assert_eq!(imported.document.external_files[0].path, folder.path().join("sky.exr"));
}

#[test]
fn broken_pictures_are_named_with_what_stands_in() {
    let black = with_environment(json!({"image": "missing.exr"})).imported();
    let text = warning(&black, "environment_image");
    assert!(text.contains("missing.exr") && text.contains("black"), "{text}");
    assert!(black.scene.environment.is_black());
    let bytes = exr(two_colours);
    let half = embedded(&bytes[..bytes.len() / 2], json!({"radiance": [1, 1, 1]}));
    assert!(warning(&half, "environment_image").contains("`radiance` is used"));
    assert_eq!(half.scene.environment, Environment::Constant(Vec3::ONE));
    let other = embedded(b"\x89PNG\r\n", json!({}));
    assert!(warning(&other, "environment_image").contains("neither"));
}

#[test]
fn bad_pixels_are_counted_and_mended() {
    let imported = embedded(
        &exr(|x, y| match (x, y) {
            (0, 0) => (-1.0, 1.0, 1.0),
            (1, 0) => (f32::NAN, 1.0, 1.0),
            (2, 0) => (f32::INFINITY, 1.0, 1.0),
            _ => (1.0, 1.0, 1.0),
        }),
        json!({}),
    );
    let text = warning(&imported, "environment_pixels");
    assert!(text.contains("2 pixels") && text.contains("1 are infinite"), "{text}");
    near(&imported, Vec3::NEG_Y, Vec3::ONE);
    let odd = embedded(&exr(two_colours), json!({"strength": -1.0}));
    assert!(warning(&odd, "environment").contains("strength") && odd.scene.environment.is_black());
}
