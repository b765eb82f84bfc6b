//! Environment pictures: OpenEXR and Radiance HDR, latitude-longitude → [`Panorama`].
//!
//! While a picture is read it takes 12 bytes per pixel.

use crate::scene::{Panorama, Rgb};
use exr::prelude::{ReadChannels, ReadLayers};
use image::ImageDecoder;
use std::io::Cursor;

/// Pictures with more pixels than 16384 × 8192 are refused.
const MOST_PIXELS: usize = 1 << 27;

/// What was read, and how much of it had to be mended.
pub(super) struct Picture {
    pub(super) panorama: Panorama,
    /// Pixels that were negative or no numbers, now black there.
    pub(super) negative: usize,
    /// Pixels that were infinite, now as bright as the brightest finite one.
    pub(super) infinite: usize,
}

/// Reads a file; which format it is, its first bytes tell. Fails with the reason.
pub(super) fn read(bytes: &[u8]) -> Result<Picture, String> {
    let panorama = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        read_exr(bytes)?
    } else if bytes.starts_with(b"#?") {
        read_hdr(bytes)?
    } else {
        return Err("it is neither OpenEXR nor Radiance HDR".into());
    };
    if panorama.pixels.is_empty() {
        return Err("it has no pixels".into());
    }
    Ok(mended(panorama))
}

fn check_size(width: usize, height: usize) -> Result<(), String> {
    match width.checked_mul(height) {
        Some(pixels) if pixels <= MOST_PIXELS => Ok(()),
        _ => Err(format!("its {width} × {height} pixels are more than 16384 × 8192")),
    }
}

fn read_exr(bytes: &[u8]) -> Result<Panorama, String> {
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    for header in &meta.headers {
        check_size(header.layer_size.width(), header.layer_size.height())?;
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| Panorama {
                width: size.width(),
                height: size.height(),
                pixels: vec![Rgb::ZERO; size.width() * size.height()],
            },
            |panorama: &mut Panorama, at, (r, g, b): (f32, f32, f32)| {
                panorama.pixels[at.y() * panorama.width + at.x()] = Rgb::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    Ok(image.layer_data.channel_data.pixels)
}

fn read_hdr(bytes: &[u8]) -> Result<Panorama, String> {
    let decoder = image::codecs::hdr::HdrDecoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size(width, height)?;
    let pixels = image::DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb32f();
    let pixels = pixels.as_raw().as_chunks::<3>().0.iter().map(|&p| Rgb::from_array(p)).collect();
    Ok(Panorama { width, height, pixels })
}

/// Makes every radiance finite and non-negative.
fn mended(mut panorama: Panorama) -> Picture {
    let finite = |c: &f32| c.is_finite();
    let brightest = panorama.pixels.iter().flat_map(|p| p.to_array()).filter(finite).fold(0.0, f32::max);
    let (mut negative, mut infinite) = (0, 0);
    for pixel in &mut panorama.pixels {
        if pixel.is_finite() && pixel.min_element() >= 0.0 {
            continue;
        }
        let sound = pixel.to_array().map(|c| if c == f32::INFINITY { brightest } else { c.max(0.0) });
        infinite += usize::from(pixel.to_array().contains(&f32::INFINITY));
        negative += usize::from(pixel.to_array().iter().any(|&c| c.is_nan() || c < 0.0));
        *pixel = Rgb::from_array(sound);
    }
    Picture { panorama, negative, infinite }
}
