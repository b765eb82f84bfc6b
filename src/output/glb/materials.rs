//! Lit materials: copies of the source's with `MOZ_lightmap`, one per page, and the lightmap textures that they show.

use super::asset::Asset;
use super::{GlbError, PageLink};
use crate::atlas::PageImage;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::{Map, Value, json};
use std::collections::HashMap;

/// The extension that readers know lightmaps by.
pub(super) const MOZ_LIGHTMAP: &str = "MOZ_lightmap";

/// What a lit material is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct MaterialKey {
    /// Material of the source, none for glTF's default.
    pub(super) source: Option<usize>,
    /// Page that it shows.
    pub(super) page: usize,
    /// Where the source's own TEXCOORD_1 went, if it has one.
    pub(super) moved_set: Option<usize>,
}

/// Lit materials so far.
pub(super) struct Materials {
    /// Texture and intensity of each page.
    pages: Vec<(usize, f32)>,
    made: HashMap<MaterialKey, usize>,
}

impl Materials {
    /// Adds the pages' textures to `asset`. `pages` hold irradiance.
    pub(super) fn new(asset: &mut Asset, pages: &[PageImage], links: &[PageLink]) -> Result<Self, GlbError> {
        // Mip levels would mix charts, so the lightmap is filtered linearly and never shrunk.
        let sampler =
            asset.push("samplers", json!({ "magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071 }));
        let mut textures = Vec::with_capacity(pages.len());
        for (i, (page, link)) in pages.iter().zip(links).enumerate() {
            let scale = white(page);
            let view = asset.push_view(&encode(page, scale)?, None, None);
            let name = format!("lightmap_{i}");
            let extras = json!({ "lightmap": { "uri": link.uri, "quantity": link.quantity.name(), "unit": link.quantity.unit() } });
            let image = json!({ "name": name, "bufferView": view, "mimeType": "image/png", "extras": extras });
            let image = asset.push("images", image);
            let texture = asset.push("textures", json!({ "name": name, "sampler": sampler, "source": image }));
            textures.push((texture, scale));
        }
        asset.use_extension(MOZ_LIGHTMAP);
        Ok(Self { pages: textures, made: HashMap::new() })
    }

    /// The lit material for `key`, made on first use.
    pub(super) fn lit(&mut self, asset: &mut Asset, key: MaterialKey) -> usize {
        if let Some(&material) = self.made.get(&key) {
            return material;
        }
        let source = key.source.and_then(|m| asset.array("materials").get(m).cloned());
        let mut material = source.filter(Value::is_object).unwrap_or_else(|| json!({}));
        if let Some(set) = key.moved_set {
            move_texcoord(&mut material, set);
        }
        let (texture, intensity) = self.pages[key.page];
        let extension = json!({ "index": texture, "texCoord": 1, "intensity": intensity });
        let extensions = material.as_object_mut().expect("only objects pass").entry("extensions");
        match extensions.or_insert_with(|| Value::Object(Map::new())) {
            Value::Object(extensions) => drop(extensions.insert(MOZ_LIGHTMAP.into(), extension)),
            other => *other = json!({ MOZ_LIGHTMAP: extension }),
        }
        let index = asset.push("materials", material);
        self.made.insert(key, index);
        index
    }
}

/// Lets every texture that used TEXCOORD_1 use TEXCOORD_`set`.
fn move_texcoord(value: &mut Value, set: usize) {
    match value {
        Value::Object(fields) => {
            for (name, field) in fields {
                if name == "texCoord" && *field == 1 {
                    *field = set.into();
                } else if name != "extras" && name != MOZ_LIGHTMAP {
                    move_texcoord(field, set);
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| move_texcoord(item, set)),
        _ => {}
    }
}

/// Share of the texels that may be brighter than white.
const CLIPPED: f64 = 1e-3;

/// Irradiance that the texture's white stands for: the largest, unless a few texels outshine all others by far.
pub(super) fn white(page: &PageImage) -> f32 {
    let mut values: Vec<f32> =
        page.rgb.iter().zip(&page.valid).filter(|(_, v)| **v).map(|(c, _)| c.max_element()).collect();
    let Some(last) = values.len().checked_sub(1) else { return 1.0 };
    let rank = last - (values.len() as f64 * CLIPPED) as usize;
    let (_, &mut high, brighter) = values.select_nth_unstable_by(rank, f32::total_cmp);
    let max = brighter.iter().copied().fold(high, f32::max);
    let white = if max <= 2.0 * high { max } else { high };
    if white > 0.0 { white } else { max.max(f32::MIN_POSITIVE) }
}

/// The page as an 8-bit PNG with linear values, `scale` as white. Browsers show no more bits than these.
pub(super) fn encode(page: &PageImage, scale: f32) -> Result<Vec<u8>, GlbError> {
    let code = |c: f32| (c / scale * 255.0).clamp(0.0, 255.0).round() as u8;
    let pixels: Vec<u8> = page.rgb.iter().flat_map(|c| c.to_array().map(code)).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(&pixels, page.width, page.height, ExtendedColorType::Rgb8)?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rgb;

    #[test]
    fn white_ignores_a_few_outliers() {
        let mut page = PageImage::black(100, 100);
        page.valid.fill(true);
        page.rgb.fill(Rgb::ONE);
        page.rgb[0] = Rgb::splat(1.5);
        assert_eq!(white(&page), 1.5);
        page.rgb[1] = Rgb::splat(1000.0);
        assert_eq!(white(&page), 1.0);
    }

    #[test]
    fn a_black_page_has_a_positive_white() {
        let mut page = PageImage::black(4, 4);
        assert_eq!(white(&page), 1.0);
        page.valid.fill(true);
        assert!(white(&page) > 0.0);
    }

    #[test]
    fn only_texture_references_move_to_another_set() {
        let mut material = json!({
            "occlusionTexture": { "index": 0, "texCoord": 1 },
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 } },
            "extras": { "texCoord": 1 }
        });
        move_texcoord(&mut material, 3);
        assert_eq!(material["occlusionTexture"]["texCoord"], 3);
        assert_eq!(material["extras"]["texCoord"], 1);
        assert_eq!(material["pbrMetallicRoughness"]["baseColorTexture"], json!({ "index": 1 }));
    }
}
