//! Which texels of a page a solution stores, and to which chart and patch they belong.

use crate::atlas::{Atlas, NO_TEXEL, PageImage, Texels};
use crate::scene::{Rgb, Scene};

/// Marks stored texels that belong to no patch.
pub(super) const NO_PATCH: u32 = u32::MAX;

/// The stored texels of a page: those with a value of their own, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageLayout {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Positions on the page, ascending: y · width + x.
    pub places: Vec<u32>,
    /// True where a chart covers the texel, false where mending seams gave a texel beside one a value.
    pub valid: Vec<bool>,
    /// Chart, or that of a neighbour.
    pub chart: Vec<u32>,
    /// Patch of the texel or of a neighbour.
    pub patch: Vec<u32>,
    /// Material of the texel, with `reflectance` for pages of radiosity; else empty.
    pub material: Vec<u32>,
    /// Mean reflectance of the texel; zero where no chart covers it.
    pub reflectance: Vec<Rgb>,
}

impl PageLayout {
    /// The layout of page `page`, of which the texels `filled` have values. `patch_of` tells the patch of a texel.
    pub fn new(
        atlas: &Atlas,
        texels: &Texels,
        page: usize,
        filled: &[bool],
        patch_of: impl Fn(u32) -> Option<u32>,
    ) -> Self {
        let places: Vec<u32> = (0..filled.len() as u32).filter(|&i| filled[i as usize]).collect();
        let map = &texels.pages[page].texel;
        let (width, height) = (atlas.pages[page].width, atlas.pages[page].height);
        let texel: Vec<Option<u32>> = places.iter().map(|&i| Self::nearest(map, width, height, i)).collect();
        Self {
            width,
            height,
            valid: places.iter().map(|&i| map[i as usize] != NO_TEXEL).collect(),
            chart: texel.iter().map(|t| t.map_or(0, |t| texels.chart[t as usize])).collect(),
            patch: texel.iter().map(|t| t.and_then(&patch_of).unwrap_or(NO_PATCH)).collect(),
            places,
            ..Self::default()
        }
    }

    /// The texel at place `i` of a page with `map` from places to texels, or else one beside it.
    pub fn nearest(map: &[u32], width: u32, height: u32, i: u32) -> Option<u32> {
        let (x, y) = (i % width, i / width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let mut around = (y.saturating_sub(1)..(y + 2).min(height))
            .flat_map(|y| columns.clone().map(move |x| map[(y * width + x) as usize]));
        match map[i as usize] {
            NO_TEXEL => around.find(|&t| t != NO_TEXEL),
            own => Some(own),
        }
    }

    /// The same with what the texels reflect.
    pub fn with_reflectance(mut self, scene: &Scene, atlas: &Atlas, texels: &Texels, page: usize) -> Self {
        let material = |t: u32| texels.material(scene, atlas, t) as u32;
        let map = &texels.pages[page].texel;
        let texel = |&i: &u32| Some(map[i as usize]).filter(|&t| t != NO_TEXEL);
        self.material = self.places.iter().map(|i| texel(i).map_or(0, material)).collect();
        let reflectance = |i: &u32| texel(i).map_or(Rgb::ZERO, |t| texels.reflectance[t as usize]);
        self.reflectance = self.places.iter().map(reflectance).collect();
        self
    }

    /// A black page on which the covered texels are valid, and the texels that have values of their own.
    pub fn black(&self) -> (PageImage, Vec<bool>) {
        let mut image = PageImage::black(self.width, self.height);
        let mut filled = vec![false; image.rgb.len()];
        for (&place, &valid) in self.places.iter().zip(&self.valid) {
            image.valid[place as usize] = valid;
            filled[place as usize] = true;
        }
        (image, filled)
    }

    /// True if every number is within its bounds, with so many `patches`.
    pub(super) fn is_sound(&self, patches: usize) -> bool {
        let size = u64::from(self.width) * u64::from(self.height);
        let ascending = self.places.windows(2).all(|pair| pair[0] < pair[1]);
        let within = self.places.last().is_none_or(|&last| u64::from(last) < size);
        ascending && within && self.patch.iter().all(|&p| p == NO_PATCH || (p as usize) < patches)
    }
}
