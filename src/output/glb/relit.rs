//! A lit scene with other light: the lightmap textures inside a GLB are replaced, everything else stays as it is.

use super::materials::{MOZ_LIGHTMAP, encode, white};
use super::{GlbError, PageLink, index};
use crate::atlas::PageImage;
use serde_json::{Value, json};
use std::collections::HashMap;

/// Bytes before a GLB's first chunk, and before the content of each.
const HEADER: usize = 12;
const CHUNK: usize = 8;
/// What buffer views of a lit scene start at multiples of.
const ALIGNMENT: usize = 8;

/// `glb`, a lit scene, with the textures of `links` replaced by `pages` of irradiance. None if it is no GLB that shows
/// these pages.
pub fn relit_glb(glb: &[u8], pages: &[PageImage], links: &[PageLink]) -> Result<Option<Vec<u8>>, GlbError> {
    let Some((mut json, mut bin)) = parts(glb) else { return Ok(None) };
    let mut intensities = HashMap::new();
    for (page, link) in pages.iter().zip(links) {
        let Some(image) = image_of(&json, link) else { return Ok(None) };
        let scale = white(page);
        if replace(&mut json, &mut bin, image, encode(page, scale)?).is_none() {
            return Ok(None);
        }
        intensities.insert(image, scale);
    }
    set_intensities(&mut json, &intensities);
    container(json, bin).map(Some)
}

/// JSON and binary chunk.
fn parts(glb: &[u8]) -> Option<(Value, Vec<u8>)> {
    if glb.get(..4)? != b"glTF" {
        return None;
    }
    let chunk = |at: usize, kind: &[u8]| {
        let length = u32::from_le_bytes(glb.get(at..at + 4)?.try_into().ok()?) as usize;
        let content = glb.get(at + CHUNK..(at + CHUNK).checked_add(length)?)?;
        (glb.get(at + 4..at + CHUNK)? == kind).then_some(content)
    };
    let json = chunk(HEADER, b"JSON")?;
    let bin = chunk(HEADER + CHUNK + json.len(), b"BIN\0")?;
    Some((serde_json::from_slice(json).ok()?, bin.to_vec()))
}

/// The image that stands for a page.
fn image_of(json: &Value, link: &PageLink) -> Option<usize> {
    let images = json.get("images")?.as_array()?;
    images.iter().position(|image| image["extras"]["lightmap"]["uri"] == link.uri.as_str())
}

/// Puts `bytes` in the place of an image and moves what follows.
fn replace(json: &mut Value, bin: &mut Vec<u8>, image: usize, mut bytes: Vec<u8>) -> Option<()> {
    let view = index(&json["images"][image], "bufferView")?;
    let views = json.get_mut("bufferViews")?.as_array_mut()?;
    let start = index(views.get(view)?, "byteOffset").unwrap_or(0);
    let length = index(&views[view], "byteLength")?;
    let end = start.checked_add(length)?.next_multiple_of(ALIGNMENT).min(bin.len());
    if start > end {
        return None;
    }
    views[view]["byteLength"] = bytes.len().into();
    bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), 0);
    let moved = |offset: usize| if offset >= end { offset - end + start + bytes.len() } else { offset };
    for (i, view_json) in views.iter_mut().enumerate() {
        if i != view {
            move_view(view_json, &moved);
        }
        // Compressed copies of a view lie in the buffer, too.
        let extensions = view_json.get_mut("extensions").and_then(Value::as_object_mut);
        extensions.into_iter().flat_map(|e| e.values_mut()).for_each(|e| move_view(e, &moved));
    }
    bin.splice(start..end, bytes);
    Some(())
}

fn move_view(view: &mut Value, moved: &impl Fn(usize) -> usize) {
    if let Some(offset) = index(view, "byteOffset") {
        view["byteOffset"] = moved(offset).into();
    }
}

/// Lets the materials multiply their lightmap by what its white now stands for.
fn set_intensities(json: &mut Value, intensities: &HashMap<usize, f32>) {
    let sources: Vec<Option<usize>> =
        json["textures"].as_array().into_iter().flatten().map(|texture| index(texture, "source")).collect();
    for material in json["materials"].as_array_mut().into_iter().flatten() {
        let Some(lightmap) = material.pointer_mut(&format!("/extensions/{MOZ_LIGHTMAP}")) else { continue };
        let image = index(lightmap, "index").and_then(|texture| *sources.get(texture)?);
        if let Some(&intensity) = image.and_then(|image| intensities.get(&image)) {
            lightmap["intensity"] = json!(intensity);
        }
    }
}

fn container(mut json: Value, bin: Vec<u8>) -> Result<Vec<u8>, GlbError> {
    json["buffers"][0]["byteLength"] = bin.len().into();
    super::asset::glb(json.to_string().into_bytes(), bin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rgb;
    use crate::units::Quantity;

    #[test]
    fn what_follows_an_image_moves_with_it() {
        let page = |value: f32, side: u32| {
            let mut page = PageImage::black(side, side);
            page.valid.fill(true);
            page.rgb.fill(Rgb::splat(value));
            page
        };
        let old = encode(&page(1.0, 2), 1.0).expect("small images can be encoded");
        let mut bin = vec![7u8; 8];
        bin.extend(&old);
        bin.resize(bin.len().next_multiple_of(8), 0);
        let after = bin.len();
        bin.extend([9u8; 16]);
        let document = json!({
            "buffers": [{ "byteLength": bin.len() }],
            "bufferViews": [
                { "buffer": 0, "byteOffset": 0, "byteLength": 8 },
                { "buffer": 0, "byteOffset": 8, "byteLength": old.len() },
                { "buffer": 0, "byteOffset": after, "byteLength": 16 }],
            "images": [{ "bufferView": 1, "extras": { "lightmap": { "uri": "lightmap_0.exr" } } }],
            "textures": [{ "source": 0 }],
            "materials": [{ "extensions": { MOZ_LIGHTMAP: { "index": 0, "intensity": 1.0 } } }]
        });
        let glb = container(document, bin).expect("it is small");
        let links = [PageLink { uri: "lightmap_0.exr".into(), quantity: Quantity::Irradiance }];
        let new = page(2.5, 64);
        let relit =
            relit_glb(&glb, std::slice::from_ref(&new), &links).expect("it is small").expect("it is a lit scene");
        let (json, bin) = parts(&relit).expect("it is a GLB");
        let bytes = |view: usize| {
            let view = &json["bufferViews"][view];
            let start = index(view, "byteOffset").expect("it has one");
            &bin[start..start + index(view, "byteLength").expect("it has one")]
        };
        assert_eq!(bytes(0), [7; 8]);
        assert_eq!(bytes(1), encode(&new, 2.5).expect("it can be encoded"));
        assert_eq!(bytes(2), [9; 16]);
        assert_eq!(json["materials"][0]["extensions"][MOZ_LIGHTMAP]["intensity"], 2.5);
        assert_eq!(json["buffers"][0]["byteLength"], bin.len());
        assert!(relit_glb(b"glTF", &[], &[]).expect("no image fails").is_none());
    }
}
