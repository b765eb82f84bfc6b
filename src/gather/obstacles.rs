//! What covers, crosses or parts a texel, or encloses it: found by short rays from the texel.

use super::inside::Insides;
use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::{Atlas, SurfacePoint, TexelSurface, Texels};
use crate::math::orthonormal_basis;
use glam::{Vec2, Vec3};

/// A texel's square is looked at on a grid of this many cells along a side.
pub(super) const GRID: u32 = 4;
/// Strip along a texel's border that no ray starts from, in texels.
pub(super) const MARGIN: f32 = 1e-3;
/// Cosine of the angle between normals of one texel from which on its surface counts as bent.
const COS_BENT: f32 = 0.999;

fn cell_centre(bit: u32) -> Vec2 {
    (Vec2::new((bit % GRID) as f32, (bit / GRID) as f32) + Vec2::splat(0.5)) / GRID as f32
}

/// The middles of a cell's quarters.
fn quarters(bit: u32) -> [Vec2; 4] {
    let shift = 0.25 / GRID as f32;
    [(-shift, -shift), (shift, -shift), (-shift, shift), (shift, shift)].map(|at| cell_centre(bit) + Vec2::from(at))
}

/// What is found out about one texel.
pub(super) struct Facts {
    /// Bit `y·4 + x`: some of the cell is covered by the chart and not inside other geometry.
    pub(super) cells: u16,
    /// The normal changes over the texel.
    pub(super) bent: bool,
    /// All of it lies inside other geometry.
    pub(super) hidden: bool,
    /// Share of it that the cells hold: the rest lies inside other geometry, where it is dark.
    pub(super) lit: f32,
    /// Share of it that nothing stands on.
    pub(super) open: f32,
    /// Geometry parts it from a neighbour on its chart.
    pub(super) parted: bool,
    /// Geometry crosses it.
    pub(super) crossed: bool,
}

/// The scene as one looks for what covers texels.
pub(super) struct View<'a> {
    accel: &'a Accel<'a>,
    atlas: &'a Atlas,
    texels: &'a Texels,
    insides: Insides<'a>,
}

impl<'a> View<'a> {
    pub(super) fn new(accel: &'a Accel<'a>, atlas: &'a Atlas, texels: &'a Texels) -> Self {
        Self { accel, atlas, texels, insides: Insides::new(accel) }
    }

    pub(super) fn facts(&self, texel: u32) -> Facts {
        let t = texel as usize;
        let (position, normal) = (self.texels.position[t], self.texels.geometric_normal[t]);
        let width = self.texels.area[t].sqrt();
        let surface = self.texels.surface(self.accel.scene(), self.atlas, texel);
        let (on_chart, bent) = self.outline(&surface, texel);
        let near = near_surface(self.accel, position, normal, width);
        let crossed = near && self.is_crossed(&surface, texel);
        let (mut cells, mut hidden, mut lit) = (on_chart, false, 1.0);
        if near || self.insides.shows_backs(position, normal) {
            let (free, share) = self.free_cells(texel, &surface, on_chart);
            hidden = on_chart != 0 && free == 0;
            (cells, lit) = if free == 0 { (on_chart, 1.0) } else { (free, share) };
        }
        if !near {
            let open = if is_covered(self.accel, position, normal, width) { 0.0 } else { 1.0 };
            return Facts { cells, bent, hidden, lit, open, parted: false, crossed };
        }
        let (open, parted) = (self.open_share(&surface, width), self.is_parted(texel));
        Facts { cells, bent, hidden, lit, open, parted, crossed }
    }

    /// What a look from the texel's middle tells: whether it lies inside other geometry.
    pub(super) fn glance(&self, texel: u32) -> Facts {
        let t = texel as usize;
        let (position, geometric_normal) = (self.texels.position[t], self.texels.geometric_normal[t]);
        let middle = SurfacePoint { position, geometric_normal, shading_normal: self.texels.shading_normal[t] };
        let hidden =
            self.insides.shows_backs(position, geometric_normal) && !self.insides.are_reached(&[middle], texel);
        let open = if hidden { 0.0 } else { 1.0 };
        Facts { cells: u16::MAX, bent: false, hidden, lit: 1.0, open, parted: false, crossed: false }
    }

    /// The cells that the chart covers, in part or wholly, and whether the surface bends over them.
    fn outline(&self, surface: &TexelSurface, texel: u32) -> (u16, bool) {
        let whole = self.texels.coverage[texel as usize] > 0.999;
        let middle = self.texels.shading_normal[texel as usize];
        // Cells are looked at at their corners and middles; of a wholly covered texel only its corners matter.
        let steps = if whole { 1 } else { 2 * GRID };
        let (mut cells, mut bent) = (0u16, false);
        for y in 0..=steps {
            for x in 0..=steps {
                let offset = Vec2::new(x as f32, y as f32) / steps as f32;
                let Some(point) = surface.sample(offset.clamp(Vec2::splat(MARGIN), Vec2::splat(1.0 - MARGIN))) else {
                    continue;
                };
                bent |= point.shading_normal.dot(middle) < COS_BENT;
                // A corner belongs to the four cells around it.
                for bit in
                    [(x, y), (x.wrapping_sub(1), y), (x, y.wrapping_sub(1)), (x.wrapping_sub(1), y.wrapping_sub(1))]
                {
                    let (cx, cy) = (bit.0 / 2, bit.1 / 2);
                    if cx < GRID && cy < GRID {
                        cells |= 1 << (cy * GRID + cx);
                    }
                }
            }
        }
        (if whole { u16::MAX } else { cells }, bent)
    }

    /// The cells among `on_chart` of which some is not inside other geometry, and the share of the texel that they hold.
    fn free_cells(&self, texel: u32, surface: &TexelSurface, on_chart: u16) -> (u16, f32) {
        let is_free = |p: &SurfacePoint| !self.insides.shows_backs(p.position, p.geometric_normal);
        let bits = || (0..GRID * GRID).filter(|bit| on_chart >> bit & 1 == 1);
        let (mut free, mut suspects) = (0u16, Vec::new());
        for bit in bits() {
            match surface.sample(cell_centre(bit)) {
                Some(p) if !is_free(&p) => suspects.push(p),
                _ => free |= 1 << bit,
            }
        }
        if free == on_chart || self.insides.are_reached(&suspects, texel) {
            return (on_chart, 1.0);
        }
        // What is free of a cell is found by rays; here only whether to send any.
        let mut points = [0u32; (GRID * GRID) as usize];
        for bit in bits() {
            for p in quarters(bit).into_iter().filter_map(|at| surface.sample(at)) {
                points[bit as usize] += 1;
                if free >> bit & 1 == 0 && is_free(&p) {
                    free |= 1 << bit;
                }
            }
        }
        let held: u32 = bits().filter(|bit| free >> bit & 1 == 1).map(|bit| points[bit as usize]).sum();
        let all: u32 = points.iter().sum();
        (free, if all == 0 { 1.0 } else { held as f32 / all as f32 })
    }

    /// Share of a texel that nothing stands on.
    fn open_share(&self, surface: &TexelSurface, width: f32) -> f32 {
        let points: Vec<SurfacePoint> = (0..GRID * GRID).filter_map(|bit| surface.sample(cell_centre(bit))).collect();
        let is_covered =
            |p: &&SurfacePoint| is_covered(self.accel, p.position, p.geometric_normal, width / GRID as f32);
        1.0 - points.iter().filter(is_covered).count() as f32 / points.len().max(1) as f32
    }

    /// True if something lies between the texel and one of its four neighbours.
    fn is_parted(&self, texel: u32) -> bool {
        let texels = self.texels;
        let t = texel as usize;
        let chart = texels.chart[t] as usize;
        let page = &texels.pages[self.atlas.charts[chart].page];
        let centre = Vec2::new(texels.pixel[t][0] as f32, texels.pixel[t][1] as f32) + 0.5;
        let raised = |i: usize| offset_origin(texels.position[i], texels.geometric_normal[i]);
        [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y].iter().filter_map(|&step| page.at(centre + step)).any(|n| {
            texels.chart[n as usize] as usize == chart && is_between(self.accel, raised(t), raised(n as usize))
        })
    }

    /// True if geometry stands between the texel's middle and its border.
    fn is_crossed(&self, surface: &TexelSurface, texel: u32) -> bool {
        let t = texel as usize;
        let centre = offset_origin(self.texels.position[t], self.texels.geometric_normal[t]);
        [(0.02, 0.5), (0.98, 0.5), (0.5, 0.02), (0.5, 0.98)]
            .iter()
            .filter_map(|&(x, y)| surface.sample(Vec2::new(x, y)))
            .any(|p| is_between(self.accel, centre, offset_origin(p.position, p.geometric_normal)))
    }
}

/// True if what lies straight above a point is a back face, or closer than `near`.
fn is_covered(accel: &Accel, position: Vec3, normal: Vec3, near: f32) -> bool {
    let ray = Ray { origin: offset_origin(position, normal), direction: normal, t_min: 0.0, t_max: f32::INFINITY };
    // What light passes through is no inside.
    accel
        .closest(&ray)
        .is_some_and(|hit| hit.t < near || hit.normal.dot(normal) > 0.0 && accel.transmission_at(&hit).is_none())
}

/// True if something lies on the segment.
fn is_between(accel: &Accel, from: Vec3, to: Vec3) -> bool {
    let v = to - from;
    accel.occluded(&Ray { origin: from, direction: v.normalize_or_zero(), t_min: 0.0, t_max: v.length() })
}

/// True if something lies within `reach` across the surface.
fn near_surface(accel: &Accel, position: Vec3, normal: Vec3, reach: f32) -> bool {
    let (x, y) = orthonormal_basis(normal);
    let origin = offset_origin(position, normal);
    [x, -x, y, -y].iter().any(|&direction| accel.occluded(&Ray { origin, direction, t_min: 0.0, t_max: reach }))
}
