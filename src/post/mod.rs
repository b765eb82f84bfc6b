//! From irradiance per texel to pages that can be shown: seams mended, empty texels around charts filled.

mod dilate;
mod edges;
mod holes;
mod least_squares;
mod seams;

pub use holes::fill_unusable;

use crate::atlas::{Atlas, PageImage, Texels};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::{Rgb, Scene};
use crate::units::Quantity;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What is done to the pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PostSettings {
    /// True: values on both sides of a chart edge are made to agree where the surface goes on smoothly.
    pub seams: bool,
    /// Least distance from a chart, in texels, within which empty texels are filled.
    pub dilation: u32,
}

impl Default for PostSettings {
    fn default() -> Self {
        Self { seams: true, dilation: 16 }
    }
}

impl PostSettings {
    /// Rings around charts that are filled.
    pub fn rings(&self, atlas: &Atlas) -> u32 {
        self.dilation.max(atlas.padding)
    }
}

/// Rings that bilinear lookups at a chart's edge can reach.
const LOOKUP_RINGS: u32 = 2;

/// Pages of irradiance from `values`, one per texel. Values are finite and not negative.
pub fn finish(
    atlas: &Atlas,
    texels: &Texels,
    scene: &Scene,
    values: &[Rgb],
    settings: &PostSettings,
    progress: &dyn Progress,
) -> Result<Vec<PageImage>, Cancelled> {
    let (mut pages, mut filled) = placed(atlas, texels, values, settings);
    if settings.seams {
        seams::mend(atlas, texels, scene, &mut pages, &mut filled, None, progress)?;
    }
    fill_borders(&mut pages, &mut filled, settings.rings(atlas), progress)?;
    progress.report(Stage::Post, 1.0);
    Ok(pages)
}

/// A part of the light of pages on the way to pages of its own.
pub struct Part {
    /// Irradiance, with nothing around charts but what mending seams has put there.
    pub pages: Vec<PageImage>,
    /// Per page: texels that have a value, valid or mended.
    pub filled: Vec<Vec<bool>>,
}

/// Pages of that `part` of the `whole` light, one value per texel each, which [`finish`] makes the same of: parts that
/// add up to the whole still do.
pub fn finish_part(
    atlas: &Atlas,
    texels: &Texels,
    scene: &Scene,
    (whole, part): (&[Rgb], &[Rgb]),
    settings: &PostSettings,
    progress: &dyn Progress,
) -> Result<Part, Cancelled> {
    let (mut pages, mut filled) = placed(atlas, texels, whole, settings);
    let (mut parts, _) = placed(atlas, texels, part, settings);
    if settings.seams {
        seams::mend(atlas, texels, scene, &mut pages, &mut filled, Some(&mut parts), progress)?;
    }
    Ok(Part { pages: parts, filled })
}

/// Fills the empty texels within `rings` of those that are `filled`, page by page.
pub fn fill_borders(
    pages: &mut [PageImage],
    filled: &mut [Vec<bool>],
    rings: u32,
    progress: &dyn Progress,
) -> Result<(), Cancelled> {
    for (page, filled) in pages.iter_mut().zip(filled) {
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
        dilate::dilate_from(page, filled, rings);
    }
    Ok(())
}

/// Fills the empty texels within `rings` of the valid ones.
pub fn fill_around(page: &mut PageImage, rings: u32) {
    dilate::dilate(page, rings);
}

/// Pages with the values of all texels, filled as far as lookups across seams reach, and which texels have values.
fn placed(atlas: &Atlas, texels: &Texels, values: &[Rgb], settings: &PostSettings) -> (Vec<PageImage>, Vec<Vec<bool>>) {
    let mut pages = place(atlas, texels, values);
    let filled = pages.iter().map(|p| p.valid.clone()).collect();
    if settings.seams {
        pages.iter_mut().for_each(|page| dilate::dilate(page, LOOKUP_RINGS));
    }
    (pages, filled)
}

/// Pages of `quantity` from pages of irradiance.
pub fn convert<'a>(
    irradiance: &'a [PageImage],
    atlas: &Atlas,
    texels: &Texels,
    quantity: Quantity,
    settings: &PostSettings,
) -> Cow<'a, [PageImage]> {
    match quantity {
        Quantity::Irradiance => Cow::Borrowed(irradiance),
        Quantity::Radiance => {
            let mut pages = irradiance.to_vec();
            pages.iter_mut().flat_map(|p| &mut p.rgb).for_each(|c| *c *= quantity.factor());
            Cow::Owned(pages)
        }
        Quantity::Radiosity => {
            let mut pages = place(atlas, texels, &texels.reflectance);
            for (page, irradiance) in pages.iter_mut().zip(irradiance) {
                dilate::dilate(page, settings.rings(atlas));
                page.rgb.iter_mut().zip(&irradiance.rgb).for_each(|(c, e)| *c *= *e);
            }
            Cow::Owned(pages)
        }
    }
}

/// Every texel's value on `pages`.
pub fn at_texels(atlas: &Atlas, texels: &Texels, pages: &[PageImage]) -> Vec<Rgb> {
    let value = |t: usize| {
        let page = &pages[atlas.charts[texels.chart[t] as usize].page];
        let [x, y] = texels.pixel[t].map(usize::from);
        page.rgb[y * page.width as usize + x]
    };
    (0..texels.len()).map(value).collect()
}

/// Pages with each texel's value at its place.
fn place(atlas: &Atlas, texels: &Texels, values: &[Rgb]) -> Vec<PageImage> {
    let mut pages: Vec<_> = atlas.pages.iter().map(|p| PageImage::black(p.width, p.height)).collect();
    for (t, value) in values.iter().enumerate() {
        let page = &mut pages[atlas.charts[texels.chart[t] as usize].page];
        let [x, y] = texels.pixel[t];
        let i = usize::from(y) * page.width as usize + usize::from(x);
        page.rgb[i] = *value;
        page.valid[i] = true;
    }
    pages
}
