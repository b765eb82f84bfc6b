//! Decoded 8-bit textures and their lookup.

use glam::{Vec2, Vec4};
use std::sync::LazyLock;

/// What lies outside 0..1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The texture repeats.
    #[default]
    Repeat,
    /// It repeats mirrored.
    Mirror,
    /// Its border goes on.
    Clamp,
}

/// How a lookup between texels is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Filter {
    /// Bilinear.
    #[default]
    Linear,
    /// The nearest texel.
    Nearest,
}

/// An RGBA picture, 8 bits per channel, row 0 at v = 0.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name in messages.
    pub name: String,
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// `width × height` straight-alpha texels.
    pub texels: Vec<[u8; 4]>,
}

/// Linear value of every sRGB code.
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f32 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
});

impl Texture {
    /// Linear RGB (decoded from sRGB) and alpha of one texel.
    pub fn texel(&self, x: u32, y: u32) -> Vec4 {
        let t = self.texels[y as usize * self.width as usize + x as usize];
        Vec4::new(SRGB[t[0] as usize], SRGB[t[1] as usize], SRGB[t[2] as usize], t[3] as f32 / 255.0)
    }

    /// One texel whose channels hold data and not colour: codes divided by 255.
    pub fn data_texel(&self, x: u32, y: u32) -> Vec4 {
        let t = self.texels[y as usize * self.width as usize + x as usize];
        Vec4::from_array(t.map(f32::from)) / 255.0
    }

    /// Linear RGB and alpha at texture coordinate `uv` (v down, as in glTF).
    pub fn sample(&self, uv: Vec2, wrap: [Wrap; 2], filter: Filter) -> Vec4 {
        self.filtered(uv, wrap, filter, |x, y| self.texel(x, y))
    }

    /// As [`Texture::sample`], of channels that hold data (see [`Texture::data_texel`]).
    pub fn sample_data(&self, uv: Vec2, wrap: [Wrap; 2], filter: Filter) -> Vec4 {
        self.filtered(uv, wrap, filter, |x, y| self.data_texel(x, y))
    }

    /// `texel` interpolated at `uv`.
    fn filtered(&self, uv: Vec2, wrap: [Wrap; 2], filter: Filter, texel: impl Fn(u32, u32) -> Vec4) -> Vec4 {
        // Beyond 2³⁰ texels f32 has no fraction left; the bound keeps the neighbour's index in range.
        let bounded = |t: f32| t.clamp(-1_073_741_824.0, 1_073_741_824.0);
        let x = bounded(uv.x * self.width as f32);
        let y = bounded(uv.y * self.height as f32);
        let at = |x: i64, y: i64| texel(wrapped(x, self.width, wrap[0]), wrapped(y, self.height, wrap[1]));
        match filter {
            Filter::Nearest => at(x.floor() as i64, y.floor() as i64),
            Filter::Linear => {
                let (x, y) = (x - 0.5, y - 0.5);
                let (x0, y0) = (x.floor(), y.floor());
                let (fx, fy) = (x - x0, y - y0);
                let (x0, y0) = (x0 as i64, y0 as i64);
                let top = at(x0, y0).lerp(at(x0 + 1, y0), fx);
                let bottom = at(x0, y0 + 1).lerp(at(x0 + 1, y0 + 1), fx);
                top.lerp(bottom, fy)
            }
        }
    }
}

/// Texel index of position `i` on an axis of `n` texels.
fn wrapped(i: i64, n: u32, wrap: Wrap) -> u32 {
    let n = n as i64;
    let i = match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Clamp => i.clamp(0, n - 1),
        Wrap::Mirror => {
            let m = i.rem_euclid(2 * n);
            if m < n { m } else { 2 * n - 1 - m }
        }
    };
    i as u32
}
