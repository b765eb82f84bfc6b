//! Final gather: irradiance per texel.

use crate::scene::Rgb;

/// Irradiance of every texel, W/m², split by how the light came.
#[derive(Clone, Debug, Default)]
pub struct Lightmap {
    /// Straight from lamps.
    pub direct: Vec<Rgb>,
    /// Everything: lamps, sky, emissive surfaces and all bounces.
    pub combined: Vec<Rgb>,
}
