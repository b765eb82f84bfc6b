//! The same asset in every container that glTF has.

use crate::fixture::{Asset, assert_clean, file, warning};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use glam::Vec2;
use lightkiln::import::{ImportSettings, Imported, load};
use lightkiln::progress::Silent;
use serde_json::{Value, json};
use std::io::Cursor;

/// Two texels, red and green, in one of the formats.
fn picture(format: image::ImageFormat) -> Vec<u8> {
    let pixels = image::RgbImage::from_vec(2, 1, vec![255, 0, 0, 0, 255, 0]).unwrap();
    let mut out = Cursor::new(Vec::new());
    pixels.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// A triangle whose corners see the red texel.
fn textured(image: Value) -> Asset {
    let mut asset = Asset::triangle();
    let uv = asset.floats("VEC2", &[0.25, 0.5, 0.25, 0.5, 0.25, 0.5]);
    asset.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv.into();
    asset.push("images", image);
    asset.push("samplers", json!({"magFilter": 9728}));
    asset.push("textures", json!({"source": 0, "sampler": 0}));
    asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
    asset
}

fn check(imported: &Imported) {
    assert_clean(imported);
    assert_eq!(imported.scene.triangle_count(), 1);
    let reflectance = imported.scene.reflectance_at(0, 0, Vec2::splat(0.3));
    assert!((reflectance.x - 0.5).abs() < 0.02 && reflectance.y < 0.02, "{reflectance}");
}

#[test]
fn images_of_every_format_in_a_glb() {
    for format in [image::ImageFormat::Png, image::ImageFormat::WebP] {
        let mut asset = textured(json!({}));
        let view = asset.view(&picture(format));
        asset.json["images"][0] = json!({"bufferView": view, "mimeType": format.to_mime_type()});
        check(&asset.imported());
    }
    // JPEG shares colour between neighbours: one red block.
    let pixels = image::RgbImage::from_pixel(16, 16, image::Rgb([255, 0, 0]));
    let mut out = Cursor::new(Vec::new());
    pixels.write_to(&mut out, image::ImageFormat::Jpeg).unwrap();
    let mut asset = textured(json!({}));
    let view = asset.view(out.get_ref());
    asset.json["images"][0] = json!({"bufferView": view, "mimeType": "image/jpeg"});
    check(&asset.imported());
}

#[test]
fn external_files_with_escaped_names() {
    let asset = textured(json!({"uri": "a%20picture.png"}));
    let mut json = asset.json.clone();
    json["buffers"][0] = json!({"byteLength": asset.bin.len(), "uri": "its%20data.bin"});
    let (folder, path) = file("scene.gltf", json.to_string().as_bytes());
    std::fs::write(folder.path().join("its data.bin"), &asset.bin).unwrap();
    std::fs::write(folder.path().join("a picture.png"), picture(image::ImageFormat::Png)).unwrap();
    let imported = load(&path, &ImportSettings::default(), &Silent).unwrap();
    check(&imported);
    let external = &imported.document.external_files;
    assert_eq!((external.len(), external[0].pointer.as_str()), (1, "/images/0/uri"));
    assert_eq!(imported.document.json.pointer("/images/0/uri").unwrap(), "a%20picture.png");
    assert!(external[0].path.is_file());
    assert_eq!(imported.document.buffers[0], asset.bin);
}

#[test]
fn data_uris() {
    let png = format!("data:image/png;base64,{}", BASE64_STANDARD.encode(picture(image::ImageFormat::Png)));
    let asset = textured(json!({"uri": png}));
    let mut json = asset.json.clone();
    let uri = format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&asset.bin));
    json["buffers"][0] = json!({"byteLength": asset.bin.len(), "uri": uri});
    let (_folder, path) = file("scene.gltf", json.to_string().as_bytes());
    let imported = load(&path, &ImportSettings::default(), &Silent).unwrap();
    check(&imported);
    assert!(imported.document.external_files.is_empty());
}

#[test]
fn the_name_of_the_file_does_not_matter_and_chunks_of_other_kinds_are_skipped() {
    let mut glb = Asset::triangle().glb();
    glb.extend([4, 0, 0, 0]);
    glb.extend(b"XTRA1234");
    let length = u32::try_from(glb.len()).unwrap();
    glb[8..12].copy_from_slice(&length.to_le_bytes());
    let (_folder, path) = file("scene.gltf", &glb);
    assert_clean(&load(&path, &ImportSettings::default(), &Silent).unwrap());
}

#[test]
fn the_document_keeps_what_is_not_understood() {
    let mut asset = Asset::triangle();
    asset.json["extras"] = json!({"z": 1, "a": [2, {"deep": true}]});
    asset.json["extensions"]["ACME_thing"] = json!({"answer": 42});
    asset.json["extensionsUsed"] = json!(["ACME_thing"]);
    asset.json["nodes"][0]["extensions"] = json!({"ACME_other": {"type": "unheard of"}});
    let imported = asset.imported();
    let mut expected = asset.json.clone();
    expected["buffers"][0]["byteLength"] = asset.bin.len().into();
    assert_eq!(imported.document.json, expected);
    assert_clean(&imported);
}

/// Eight by four texels, red left and blue right, as the Basis Universal encoder writes them in base64: UASTC in a
/// Zstandard frame.
pub(crate) const UASTC: &str = concat!(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAABAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAAAAAAAAC4AA",
    "AAAAAAACYAAAAAAAAAIAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AAAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFz",
    "aXMgVW5pdmVyc2FsIDIuNTAAACi1L/0gIO0AALj3HwDgH3oAFwDg/x8C4AEAAAAAAAAAAAEABTAC",
);

/// The same as ETC1S.
pub(crate) const ETC1S: &str = concat!(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAABAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAACwAAACUAAAAJAAAALgAAAAAAAAAggAAAAAAAAA6AQ",
    "AAAAAAAAEAAAAAAAAAAAAAAAAAAAAsAAAAAAAAAAIAKACjAQIAAwMAAAgAAAAAAAAAAAA/AAAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFz",
    "aXMgVW5pdmVyc2FsIDIuNTAAAAIAAQAqAAAABQAAACsAAAAAAAAAAAAAAAAAAAABAAAAAAAAAAAAAAAgwEQAAAAAAADiRAQwEQAAAAAAgCQgAE",
    "wACAAAAAAgBgATAAAAAAAACCasqqqqAgDBRAAAAAAAAPJfTQCYABAAAAAAQBQAJgAEAAAAABADgAkAAAAAAAAEEAAA",
);

/// The textured triangle with a Basis texture.
pub(crate) fn basis(ktx2: &str) -> Asset {
    let mut asset = textured(json!({"uri": format!("data:image/ktx2;base64,{ktx2}")}));
    asset.json["textures"][0] = json!({"sampler": 0, "extensions": {"KHR_texture_basisu": {"source": 0}}});
    asset.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    asset.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    asset
}

#[test]
fn basis_textures() {
    for ktx2 in [UASTC, ETC1S] {
        check(&basis(ktx2).imported());
    }
}

#[test]
fn ktx2_textures_of_other_formats_are_named() {
    let mut other = BASE64_STANDARD.decode(UASTC).expect("sound text");
    // VK_FORMAT_R8G8B8_UNORM.
    other[12..16].copy_from_slice(&23u32.to_le_bytes());
    let asset = basis(&BASE64_STANDARD.encode(other));
    let named = warning(&asset.imported(), "undecodable_image");
    assert!(named.contains("Vulkan format 23") && named.contains("Basis"), "{named}");
}

#[test]
fn damaged_basis_textures_never_panic() {
    let damaged = |bytes: &[u8]| {
        let asset = textured(json!({"uri": format!("data:image/ktx2;base64,{}", BASE64_STANDARD.encode(bytes))}));
        // Either the picture or a warning.
        asset.imported();
    };
    for ktx2 in [UASTC, ETC1S] {
        let data = BASE64_STANDARD.decode(ktx2).expect("sound text");
        for at in 12..data.len() {
            for value in [0, 0xff] {
                let mut bytes = data.clone();
                bytes[at] = value;
                damaged(&bytes);
            }
            damaged(&data[..at]);
        }
    }
}
