//! Textures that materials use: sampler and transform per use, and each image decoded once.

use super::source::Source;
use super::{ImportError, files, json, ktx2};
use crate::document::Document;
use crate::progress::Counter;
use crate::scene::{Filter, Material, Texture, TextureSlot, Wrap};
use crate::warning::Warning;
use glam::{Affine2, Mat2, Vec2};
use gltf::texture::{MagFilter, WrappingMode};
use rayon::prelude::*;
use serde_json::Value;
use std::collections::HashMap;

/// Memory that decoding one image may take: a 16k × 16k RGBA image of 16 bits per channel, which is 2 GiB, passes.
const MAX_DECODED_BYTES: u64 = 4 << 30;

/// Collects the images that materials refer to, numbering them in the order of their first use.
#[derive(Default)]
pub(super) struct TextureSlots {
    /// glTF images.
    images: Vec<usize>,
    /// Position in `images`.
    number: HashMap<usize, usize>,
}

impl TextureSlots {
    /// The use of a texture that a glTF `textureInfo` describes. Its `texture` becomes valid for a scene after
    /// [`TextureSlots::decode`].
    pub(super) fn slot(
        &mut self,
        source: &Source,
        info: Option<&Value>,
        material: &str,
        warnings: &mut Vec<Warning>,
    ) -> Option<TextureSlot> {
        let info = info?;
        let document = &source.document;
        let mut missing = |fault: String| {
            let message = format!("material: {fault}; the factor is used alone, export the texture as PNG or JPEG");
            warnings.push(Warning::new("missing_texture", material, message));
        };
        let index = json::index(info, "index").unwrap_or(usize::MAX);
        let (Some(raw), Some(texture)) = (document.array("textures").get(index), source.gltf.textures().nth(index))
        else {
            missing("it refers to a texture that does not exist".into());
            return None;
        };
        let Some(image) = image_of(raw) else {
            missing(format!("texture {index} has no image in a format that is read"));
            return None;
        };
        if image >= document.array("images").len() {
            missing(format!("texture {index} refers to image {image}, which does not exist"));
            return None;
        }
        let next = self.images.len();
        let number = *self.number.entry(image).or_insert(next);
        if number == next {
            self.images.push(image);
        }

        let transform = info.get("extensions").and_then(|e| e.get("KHR_texture_transform"));
        let set = transform.and_then(|t| json::index(t, "texCoord")).or_else(|| json::index(info, "texCoord"));
        let sampler = texture.sampler();
        Some(TextureSlot {
            texture: number,
            set: set.unwrap_or(0),
            transform: transform.map_or(Affine2::IDENTITY, texture_transform),
            wrap: [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())],
            filter: match sampler.mag_filter() {
                Some(MagFilter::Nearest) => Filter::Nearest,
                _ => Filter::Linear,
            },
        })
    }

    /// Number of images to decode.
    pub(super) fn len(&self) -> usize {
        self.images.len()
    }

    /// Decodes the images and makes the slots of `materials` refer to the result. Slots whose image is missing or
    /// damaged are emptied, with one warning per image.
    pub(super) fn decode(
        self,
        document: &Document,
        materials: &mut [Material],
        counter: &Counter,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<Texture>, ImportError> {
        let decoded: Vec<Result<Texture, Warning>> = self
            .images
            .par_iter()
            .map(|&image| {
                counter.advance(1)?;
                Ok(decode(document, image))
            })
            .collect::<Result<_, ImportError>>()?;

        let mut textures = Vec::new();
        let mut placed = Vec::with_capacity(decoded.len());
        for result in decoded {
            match result {
                Ok(texture) => {
                    placed.push(Some(textures.len()));
                    textures.push(texture);
                }
                Err(warning) => {
                    placed.push(None);
                    warnings.push(warning);
                }
            }
        }
        for material in materials {
            let slots = [
                &mut material.base_color_texture,
                &mut material.metallic_texture,
                &mut material.transmission_texture,
                &mut material.emission_texture,
            ];
            for slot in slots {
                *slot = slot.and_then(|s| placed[s.texture].map(|texture| TextureSlot { texture, ..s }));
            }
        }
        Ok(textures)
    }
}

/// The image of a texture: PNG or JPEG where a file offers them, and else what stands in for them.
fn image_of(texture: &Value) -> Option<usize> {
    let alternative = |name| json::index(texture.get("extensions")?.get(name)?, "source");
    json::index(texture, "source")
        .or_else(|| alternative("EXT_texture_webp"))
        .or_else(|| alternative("KHR_texture_basisu"))
}

fn wrap(mode: WrappingMode) -> Wrap {
    match mode {
        WrappingMode::Repeat => Wrap::Repeat,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::ClampToEdge => Wrap::Clamp,
    }
}

/// KHR_texture_transform: scale, then rotation, then offset. The rotation is counter-clockwise as one sees the texture,
/// whose v axis points down; so its matrix is that of a clockwise rotation in (u, v).
fn texture_transform(transform: &Value) -> Affine2 {
    let offset = json::numbers(transform, "offset").map_or(Vec2::ZERO, Vec2::from_array);
    let scale = json::numbers(transform, "scale").map_or(Vec2::ONE, Vec2::from_array);
    let rotation = Mat2::from_angle(-json::number(transform, "rotation").unwrap_or(0.0));
    let matrix = Affine2::from_mat2_translation(rotation * Mat2::from_diagonal(scale), offset);
    if matrix.is_finite() { matrix } else { Affine2::IDENTITY }
}

fn decode(document: &Document, image: usize) -> Result<Texture, Warning> {
    let raw = &document.array("images")[image];
    let uri = json::string(raw, "uri");
    let named = json::string(raw, "name").filter(|name| !name.is_empty());
    // A data URI is no name that anyone wants to read.
    let name = named.or(uri.filter(|u| !u.starts_with("data:"))).map_or_else(|| format!("image{image}"), str::to_owned);
    let warn = |code, fault: String| {
        let message = format!("image: {fault}; the factor is used alone, export it as PNG, JPEG or WebP");
        Warning::new(code, name.as_str(), message)
    };

    let bytes = files::bytes(document, raw).map_err(|fault| warn("missing_texture", fault))?;
    let decoded = if ktx2::is_ktx2(&bytes) { ktx2::decode(&bytes, MAX_DECODED_BYTES) } else { decode_picture(&bytes) };
    let (width, height, texels) =
        decoded.map_err(|fault| warn("undecodable_image", format!("it cannot be decoded ({fault})")))?;
    Ok(Texture { name: name.clone(), width, height, texels })
}

/// Width, height and texels of a PNG, JPEG or WebP file.
fn decode_picture(bytes: &[u8]) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    let mut reader =
        image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    reader.limits(limits);
    let pixels = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    let (width, height) = pixels.dimensions();
    Ok((width, height, pixels.as_raw().as_chunks::<4>().0.to_vec()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn texture_transforms_scale_then_rotate_then_shift() {
        let quarter = std::f32::consts::FRAC_PI_2;
        let t = texture_transform(&json!({"offset": [0.5, 0.25], "rotation": quarter, "scale": [2.0, 3.0]}));
        let check = |uv: Vec2, expected: Vec2| assert!(t.transform_point2(uv).distance(expected) < 1e-6);
        check(Vec2::ZERO, Vec2::new(0.5, 0.25));
        // Counter-clockwise with v down: +u turns to −v.
        check(Vec2::X, Vec2::new(0.5, 0.25 - 2.0));
        check(Vec2::Y, Vec2::new(0.5 + 3.0, 0.25));
    }
}
