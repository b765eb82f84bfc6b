//! Small tone-mapped pictures of pages for the report.

use crate::atlas::PageImage;
use crate::scene::Rgb;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::io;

/// Longest side, pixels.
const SIDE: u32 = 384;

/// 8-bit sRGB.
pub(super) struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Texels of the page along the side of a pixel.
    pub(super) step: u32,
    /// Row by row.
    pub(super) pixels: Vec<[u8; 3]>,
}

/// A small picture of a page; texels that no chart covers stay dark.
pub(super) fn thumbnail(page: &PageImage) -> Picture {
    let step = page.width.max(page.height).div_ceil(SIDE).max(1);
    let (width, height) = (page.width.div_ceil(step).max(1), page.height.div_ceil(step).max(1));
    let key = middle(page);
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let block = block_mean(page, x * step, y * step, step);
            pixels.push(block.to_array().map(|c| tone_map(c / key)));
        }
    }
    Picture { width, height, step, pixels }
}

/// The picture as a PNG file.
pub(super) fn png(picture: &Picture) -> io::Result<Vec<u8>> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    let pixels = picture.pixels.as_flattened();
    encoder.write_image(pixels, picture.width, picture.height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    Ok(png)
}

/// Mean channel value of the valid texels, or one for a black page.
fn middle(page: &PageImage) -> f32 {
    let valid = || page.rgb.iter().zip(&page.valid).filter(|(_, v)| **v);
    let sum: f64 = valid().map(|(c, _)| f64::from(c.element_sum()) / 3.0).sum();
    let mean = (sum / valid().count().max(1) as f64) as f32;
    if mean > 0.0 { mean } else { 1.0 }
}

/// Mean of the valid texels in a square of `size`.
fn block_mean(page: &PageImage, x0: u32, y0: u32, size: u32) -> Rgb {
    let (mut sum, mut n) = (Rgb::ZERO, 0.0);
    for y in y0..(y0 + size).min(page.height) {
        for x in x0..(x0 + size).min(page.width) {
            let i = y as usize * page.width as usize + x as usize;
            if page.valid[i] {
                sum += page.rgb[i];
                n += 1.0;
            }
        }
    }
    sum / f32::max(n, 1.0)
}

/// Reinhard's curve and the sRGB transfer function.
fn tone_map(c: f32) -> u8 {
    let c = (c / (1.0 + c)).clamp(0.0, 1.0);
    let srgb = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thumbnail_is_small_and_ignores_invalid_texels() {
        let mut page = PageImage::black(1000, 500);
        page.rgb[0] = Rgb::splat(1e30);
        page.rgb[1] = Rgb::ONE;
        page.valid[1] = true;
        let png = image::load_from_memory(&png(&thumbnail(&page)).expect("memory takes everything"))
            .expect("a PNG")
            .into_rgb8();
        assert!(png.width() <= SIDE && png.height() <= SIDE);
        assert_eq!(png.get_pixel(0, 0).0, [tone_map(1.0); 3]);
    }
}
