//! A lightmap page as pixels.

use crate::scene::Rgb;

/// One page, row 0 at v = 0 (the top, as in glTF).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageImage {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row-major values, finite and not negative.
    pub rgb: Vec<Rgb>,
    /// True where a chart covers the texel; elsewhere the value is dilated or zero.
    pub valid: Vec<bool>,
}

impl PageImage {
    /// A black page of which nothing is valid.
    pub fn black(width: u32, height: u32) -> Self {
        let n = width as usize * height as usize;
        Self { width, height, rgb: vec![Rgb::ZERO; n], valid: vec![false; n] }
    }
}
