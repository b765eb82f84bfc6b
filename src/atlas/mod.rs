//! Where every surface point lies in the lightmap: scene → pages, charts, texels.
//!
//! Page coordinates are in texels, x to the right and y down (glTF's UV origin); the texel (x, y) covers the square
//! from (x, y) to (x+1, y+1).

mod appearance;
mod build;
mod coverage;
mod flatten;
mod image;
mod islands;
mod keep;
mod overlap;
mod pack;
mod place;
mod rasterise;
mod shape;
mod surface;

mod texels;
mod unwrap;
mod uvunwrap;
mod xatlas;

pub use build::{AtlasError, AtlasSettings, Unwrapper, UvMode, build};
pub use image::PageImage;
pub use rasterise::rasterise;
pub use texels::{NO_TEXEL, PageTexels, SurfacePoint, TexelSurface, Texels};

use glam::Vec2;
use std::ops::Range;

/// The layout of all charts on all pages.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// Page sizes.
    pub pages: Vec<Page>,
    /// Charts, ordered by page, then instance.
    pub charts: Vec<Chart>,
    /// Per scene instance: where its triangles lie, or none if it has no lightmap.
    pub layouts: Vec<Option<Layout>>,
    /// Empty texels kept around every chart.
    pub padding: u32,
    /// Where the charts come from: `xatlas`, `uvunwrap`, `pack` or `keep`.
    pub unwrapper: &'static str,
}

/// Size of a lightmap page in texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
}

/// Triangles of one instance that are connected in the atlas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chart {
    /// Scene instance.
    pub instance: usize,
    /// Page.
    pub page: usize,
    /// First and one-past-last texel column and row that the chart covers.
    pub x: Range<u32>,
    /// Rows.
    pub y: Range<u32>,
}

/// Where the triangles of an instance lie.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Corner positions in page coordinates, per triangle of the instance's mesh.
    pub corners: Vec<[Vec2; 3]>,
    /// Index into [`Atlas::charts`] per triangle.
    pub charts: Vec<u32>,
}

impl Atlas {
    /// Page and page coordinate of a surface point, given by barycentrics of its triangle's 2nd and 3rd corner.
    /// None if the instance has no lightmap or no such triangle.
    pub fn locate(&self, instance: usize, triangle: usize, barycentric: Vec2) -> Option<(usize, Vec2)> {
        let layout = self.layouts.get(instance)?.as_ref()?;
        let [a, b, c] = *layout.corners.get(triangle)?;
        let chart = &self.charts[layout.charts[triangle] as usize];
        Some((chart.page, a + (b - a) * barycentric.x + (c - a) * barycentric.y))
    }

    /// Texels of all pages, covered or not.
    pub fn page_texels(&self) -> u64 {
        self.pages.iter().map(|p| u64::from(p.width) * u64::from(p.height)).sum()
    }
}
