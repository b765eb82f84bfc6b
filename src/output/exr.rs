//! Lightmap pages as OpenEXR: RGB scanlines, ZIP-compressed, linear Rec.709, row 0 at v = 0.
//!
//! The same page gives the same bytes on every run.

use super::{Precision, State};
use crate::atlas::PageImage;
use crate::scene::Rgb;
use crate::units::Quantity;
use exr::meta::attribute::Chromaticities;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, Text, Vec2, WritableImage, f16,
};
use std::io::{self, Cursor, Write};

/// What a page says about itself.
#[derive(Clone, Debug)]
pub struct PageAttributes {
    /// Meaning of the texels.
    pub quantity: Quantity,
    /// Texture coordinate set that addresses the page.
    pub uv_set: u32,
    /// Index of the page.
    pub page: usize,
    /// Hash of the scene file and all that it refers to.
    pub scene_hash: String,
    /// How far the bake had come.
    pub state: State,
    /// Light group that is shown, none for all light.
    pub group: Option<String>,
}

/// Largest value that a channel of `precision` holds.
fn largest(precision: Precision) -> f32 {
    match precision {
        Precision::Half => f16::MAX.to_f32(),
        Precision::Float => f32::MAX,
    }
}

/// Number of texels of `page` that `precision` cannot hold: they are written as its largest value.
pub fn clamped_texels(page: &PageImage, precision: Precision) -> usize {
    page.rgb.iter().filter(|c| !c.is_finite() || c.max_element() > largest(precision)).count()
}

/// Brings a value into 0..=`largest`; a NaN becomes zero.
fn storable(value: Rgb, largest: f32) -> Rgb {
    debug_assert!(value.is_finite(), "lightmap values are finite: {value}");
    // `max` returns the other operand for a NaN.
    Rgb::from(value.to_array().map(|c| c.max(0.0).min(largest)))
}

/// Writes `page` to `sink`.
pub fn write_page(
    sink: &mut dyn Write,
    page: &PageImage,
    precision: Precision,
    attributes: &PageAttributes,
) -> io::Result<()> {
    let mut bytes = encode(page, precision, attributes).map_err(into_io)?;
    sort_attributes(&mut bytes);
    sink.write_all(&bytes)
}

/// The file, with the crate's order of attributes.
fn encode(page: &PageImage, precision: Precision, attributes: &PageAttributes) -> exr::error::Result<Vec<u8>> {
    let largest = largest(precision);
    let channel = |name: &str, c: usize| {
        let values = page.rgb.iter().map(|v| storable(*v, largest)[c]);
        let samples = match precision {
            Precision::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
            Precision::Float => FlatSamples::F32(values.collect()),
        };
        AnyChannel::new(name, samples)
    };
    let channels = AnyChannels::sort([channel("R", 0), channel("G", 1), channel("B", 2)].into_iter().collect());
    let size = (page.width as usize, page.height as usize);
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let mut image = Image::from_layer(Layer::new(size, layer_attributes(attributes), encoding, channels));
    image.attributes.chromaticities = Some(rec709());
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}

fn layer_attributes(attributes: &PageAttributes) -> LayerAttributes {
    let version = env!("CARGO_PKG_VERSION");
    let text = |value: &str| AttributeValue::Text(Text::from(value));
    let mut layer =
        LayerAttributes { software_name: Some(format!("lightkiln {version}").as_str().into()), ..Default::default() };
    layer.other.extend([
        ("lightkiln:quantity".into(), text(attributes.quantity.name())),
        ("lightkiln:unit".into(), text(attributes.quantity.unit())),
        ("lightkiln:uvSet".into(), text(&format!("TEXCOORD_{}", attributes.uv_set))),
        ("lightkiln:page".into(), AttributeValue::I32(attributes.page as i32)),
        ("lightkiln:version".into(), text(version)),
        ("lightkiln:sceneHash".into(), text(&attributes.scene_hash)),
        ("lightkiln:state".into(), text(attributes.state.reached.name())),
        ("lightkiln:predictedError".into(), AttributeValue::F32(attributes.state.predicted_error as f32)),
    ]);
    layer.other.extend(attributes.group.as_ref().map(|group| ("lightkiln:group".into(), text(group))));
    layer
}

/// Primaries and white point of Rec.709 (and sRGB).
fn rec709() -> Chromaticities {
    Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    }
}

fn into_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(e) => e,
        other => io::Error::other(other.to_string()),
    }
}

/// Length of the magic number and the version field.
const PREFIX: usize = 8;

/// Orders the header's attributes by name. The crate keeps some in a hash map, whose order differs between runs. An
/// attribute is `name\0 type\0 size value`; the header ends with a zero byte and keeps its length, so the offset
/// table that follows stays right.
fn sort_attributes(file: &mut [u8]) {
    let mut attributes: Vec<Vec<u8>> = Vec::new();
    let mut at = PREFIX;
    while file[at] != 0 {
        let string_end =
            |from: usize| from + file[from..].iter().position(|&b| b == 0).expect("names end with zero") + 1;
        let size_at = string_end(string_end(at));
        let size = i32::from_le_bytes(file[size_at..size_at + 4].try_into().expect("four bytes")) as usize;
        let end = size_at + 4 + size;
        attributes.push(file[at..end].to_vec());
        at = end;
    }
    attributes.sort();
    file[PREFIX..at].copy_from_slice(&attributes.concat());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Milestone;
    use exr::prelude::{ReadChannels, ReadLayers};

    fn attributes() -> PageAttributes {
        let state = State { reached: Milestone::Preview, predicted_error: 0.125 };
        PageAttributes {
            quantity: Quantity::Radiance,
            uv_set: 1,
            page: 3,
            scene_hash: "abc".into(),
            state,
            group: Some("Key".into()),
        }
    }

    fn gradient() -> PageImage {
        let mut page = PageImage::black(37, 21);
        for (i, c) in page.rgb.iter_mut().enumerate() {
            *c = Rgb::new(i as f32 / 7.0, 0.25, 1e-3 * i as f32);
        }
        page
    }

    fn written(page: &PageImage, precision: Precision) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_page(&mut bytes, page, precision, &attributes()).expect("memory takes everything");
        bytes
    }

    fn read(bytes: &[u8]) -> Image<Layer<AnyChannels<FlatSamples>>> {
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let reader = reader.first_valid_layer().all_attributes();
        reader.from_buffered(Cursor::new(bytes)).expect("a file that this module wrote")
    }

    fn pixels(bytes: &[u8]) -> Vec<Rgb> {
        let channels = read(bytes).layer_data.channel_data.list;
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R"]);
        let [b, g, r] = [0, 1, 2].map(|c| channels[c].sample_data.values_as_f32().collect::<Vec<_>>());
        (0..r.len()).map(|i| Rgb::new(r[i], g[i], b[i])).collect()
    }

    #[test]
    fn float_pages_come_back_exactly() {
        let page = gradient();
        assert_eq!(pixels(&written(&page, Precision::Float)), page.rgb);
    }

    #[test]
    fn half_pages_come_back_to_half_precision() {
        let page = gradient();
        for (a, b) in pixels(&written(&page, Precision::Half)).iter().zip(&page.rgb) {
            assert!((*a - *b).abs().max_element() <= b.max_element() / 2048.0 + 1e-7, "{a} for {b}");
        }
    }

    #[test]
    fn attributes_name_quantity_unit_and_source() {
        let image = read(&written(&gradient(), Precision::Half));
        let other = &image.layer_data.attributes.other;
        let text = |name: &str| match &other[&Text::from(name)] {
            AttributeValue::Text(t) => t.to_string(),
            other => panic!("{name} is {other:?}"),
        };
        assert_eq!(text("lightkiln:quantity"), "radiance");
        assert_eq!(text("lightkiln:unit"), "W/(m^2*sr)");
        assert_eq!(text("lightkiln:uvSet"), "TEXCOORD_1");
        assert_eq!(text("lightkiln:sceneHash"), "abc");
        assert_eq!(text("lightkiln:state"), "preview");
        assert_eq!(other[&Text::from("lightkiln:predictedError")], AttributeValue::F32(0.125));
        assert_eq!(text("lightkiln:group"), "Key");
        assert_eq!(other[&Text::from("lightkiln:page")], AttributeValue::I32(3));
        assert_eq!(image.attributes.chromaticities, Some(rec709()));
    }

    #[test]
    fn the_same_page_gives_the_same_bytes() {
        assert_eq!(written(&gradient(), Precision::Half), written(&gradient(), Precision::Half));
    }

    #[test]
    fn values_beyond_half_become_the_largest_half() {
        let mut page = gradient();
        page.rgb[5] = Rgb::new(1e6, 1.0, 65504.0);
        assert_eq!(clamped_texels(&page, Precision::Half), 1);
        assert_eq!(clamped_texels(&page, Precision::Float), 0);
        assert_eq!(pixels(&written(&page, Precision::Half))[5], Rgb::new(65504.0, 1.0, 65504.0));
    }
}
