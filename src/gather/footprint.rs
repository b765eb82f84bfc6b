//! Which part of every texel can be lit: covered by its chart and not inside other geometry.

use super::obstacles::{Facts, GRID, MARGIN, View};
use crate::accel::Accel;
use crate::atlas::{Atlas, SurfacePoint, TexelSurface, Texels};
use crate::math::shifted;
use crate::progress::{Cancelled, Progress};
use crate::scene::Scene;
use glam::Vec2;
use half::f16;
use rayon::prelude::*;

/// Tries to find a point of a cell that the chart covers in part.
const TRIES: u32 = 8;

/// The usable part of every texel, as a grid of cells.
pub struct Footprint<'a> {
    scene: &'a Scene,
    atlas: &'a Atlas,
    texels: &'a Texels,
    /// Bit `y·4 + x`: some of the cell is covered and free.
    cells: Vec<u16>,
    /// Texels over which the normal changes.
    bent: Vec<bool>,
    /// Texels that lie wholly inside other geometry.
    hidden: Vec<bool>,
    /// Share of each texel that its cells hold.
    lit: Vec<f16>,
    /// Share of each texel that nothing stands on.
    open: Vec<f32>,
    /// Texels of which nothing is open.
    covered: Vec<bool>,
    /// Texels that geometry parts from a neighbour on their chart.
    parted: Vec<bool>,
    /// Texels that geometry crosses, so that their two sides see different light.
    crossed: Vec<bool>,
}

impl<'a> Footprint<'a> {
    /// Tests every texel: against its chart by sampling, against other geometry by rays.
    pub fn new(
        accel: &Accel<'a>,
        atlas: &'a Atlas,
        texels: &'a Texels,
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let view = View::new(accel, atlas, texels);
        Self::collect(accel.scene(), atlas, texels, |t| view.facts(t), progress)
    }

    /// Looks at the middle of every texel only, and there only for what encloses it.
    pub fn rough(
        accel: &Accel<'a>,
        atlas: &'a Atlas,
        texels: &'a Texels,
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let view = View::new(accel, atlas, texels);
        Self::collect(accel.scene(), atlas, texels, |t| view.glance(t), progress)
    }

    /// The footprint that `facts` tells of.
    fn collect(
        scene: &'a Scene,
        atlas: &'a Atlas,
        texels: &'a Texels,
        facts: impl Fn(u32) -> Facts + Sync,
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let facts: Vec<Facts> = (0..texels.len() as u32)
            .into_par_iter()
            .map(|t| if progress.is_cancelled() { Err(Cancelled) } else { Ok(facts(t)) })
            .collect::<Result<_, Cancelled>>()?;
        Ok(Self {
            scene,
            atlas,
            texels,
            cells: facts.iter().map(|f| f.cells).collect(),
            bent: facts.iter().map(|f| f.bent).collect(),
            hidden: facts.iter().map(|f| f.hidden).collect(),
            lit: facts.iter().map(|f| f16::from_f32(f.lit)).collect(),
            open: facts.iter().map(|f| f.open).collect(),
            covered: facts.iter().map(|f| f.open == 0.0).collect(),
            parted: facts.iter().map(|f| f.parted).collect(),
            crossed: facts.iter().map(|f| f.crossed).collect(),
        })
    }

    /// True if all of the texel lies inside other geometry.
    pub fn is_hidden(&self, texel: u32) -> bool {
        self.hidden[texel as usize]
    }

    /// Per texel: true if something stands on it, so that it shares no light with what lies around.
    pub fn covered(&self) -> &[bool] {
        &self.covered
    }

    /// The texel that shows what is to be seen at page coordinate `p` inside `texel`: itself, or where geometry crosses
    /// it the neighbour on the same side.
    pub fn seen_at(&self, texel: u32, p: Vec2) -> u32 {
        let t = texel as usize;
        if !self.crossed[t] {
            return texel;
        }
        let chart = self.texels.chart[t];
        let page = &self.texels.pages[self.atlas.charts[chart as usize].page];
        let centre = Vec2::new(self.texels.pixel[t][0] as f32, self.texels.pixel[t][1] as f32) + 0.5;
        let steps = [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y].map(|step| (step.dot(p - centre), step));
        let neighbours = steps.iter().filter(|(along, _)| *along > 0.0).filter_map(|&(along, step)| {
            let n = page.at(centre + step)?;
            (self.texels.chart[n as usize] == chart && !self.crossed[n as usize]).then_some((along, n))
        });
        neighbours.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(texel, |(_, n)| n)
    }

    /// Per texel: true if geometry crosses it.
    pub fn crossed(&self) -> &[bool] {
        &self.crossed
    }

    /// Per texel: true if geometry parts it from a neighbour on its chart, as a wall does that stands on a floor.
    pub fn parted(&self) -> &[bool] {
        &self.parted
    }

    /// Per texel: the share of it that nothing stands on, 0..=1. Only that part is seen by others.
    pub fn open(&self) -> &[f32] {
        &self.open
    }

    /// True if geometry may hide a lamp from a small part of the texel without that its neighbours tell.
    pub fn is_touched(&self, texel: u32) -> bool {
        let t = texel as usize;
        self.crossed[t] || self.parted[t] || self.open[t] > 0.0 && self.open[t] < 1.0 || self.lit(texel) < 1.0
    }

    /// Share of a texel that its [usable part](Self::usable) holds, 0..=1: the rest lies inside other geometry and is
    /// dark. That of a hidden texel is one, for its value is no mean.
    pub fn lit(&self, texel: u32) -> f32 {
        self.lit[texel as usize].to_f32()
    }

    /// The usable part of a texel.
    pub fn usable(&self, texel: u32) -> Usable<'_> {
        let mask = self.cells[texel as usize];
        let surface = (mask != 0).then(|| self.texels.surface(self.scene, self.atlas, texel));
        Usable { mask, surface, centre: self.centre(texel), is_bent: self.is_bent(texel) }
    }

    /// True if the surface bends within the texel, so that its middle does not stand for all of it.
    pub fn is_bent(&self, texel: u32) -> bool {
        self.bent[texel as usize]
    }

    /// The texel's centroid.
    pub fn centre(&self, texel: u32) -> SurfacePoint {
        let t = texel as usize;
        SurfacePoint {
            position: self.texels.position[t],
            geometric_normal: self.texels.geometric_normal[t],
            shading_normal: self.texels.shading_normal[t],
        }
    }
}

/// The part of a texel that can be lit.
pub struct Usable<'a> {
    /// Its cells.
    mask: u16,
    surface: Option<TexelSurface<'a>>,
    /// The texel's centroid.
    pub(super) centre: SurfacePoint,
    /// Whether the surface bends within the texel.
    pub(super) is_bent: bool,
}

impl Usable<'_> {
    /// A point from `u` in the unit square, uniform over the part.
    pub fn point(&self, u: Vec2) -> SurfacePoint {
        let Some(surface) = &self.surface else { return self.centre };
        // Points on a chart's very border lie on the neighbouring surface as well.
        let u = u * (1.0 - 2.0 * MARGIN) + MARGIN;
        let place = |u: Vec2| {
            // The u.x axis runs through the set cells, its remainder and u.y place the point in the cell.
            let count = self.mask.count_ones();
            let scaled = u.x * count as f32;
            let index = (scaled as u32).min(count - 1);
            let bit = nth_set_bit(self.mask, index);
            let corner = Vec2::new((bit % GRID) as f32, (bit / GRID) as f32);
            (corner + Vec2::new(scaled - index as f32, u.y)) / GRID as f32
        };
        let on_chart = |u: Vec2| surface.sample(if self.mask == u16::MAX { u } else { place(u) });
        // Where the chart's border cuts a cell, points beyond it are drawn again, by a low-discrepancy shift.
        (0..TRIES).find_map(|i| on_chart(shifted(u, i))).unwrap_or(self.centre)
    }
}

fn nth_set_bit(mut mask: u16, n: u32) -> u32 {
    for _ in 0..n {
        mask &= mask - 1;
    }
    mask.trailing_zeros()
}
