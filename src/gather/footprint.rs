//! Which part of every texel can be lit: covered by its chart and not inside other geometry.

use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::{Atlas, SurfacePoint, Texels};
use crate::math::orthonormal_basis;
use crate::progress::{Cancelled, Progress};
use crate::scene::Scene;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A texel's square is looked at on a grid of this many cells along a side.
const GRID: u32 = 4;
/// Texels per parallel task.
const CHUNK: usize = 4096;
/// Strip along a texel's border that no ray starts from, in texels.
const MARGIN: f32 = 1e-3;

/// The usable part of every texel, as a grid of cells.
pub struct Footprint<'a> {
    scene: &'a Scene,
    atlas: &'a Atlas,
    texels: &'a Texels,
    /// Bit `y·4 + x`: the cell's centre is covered and free.
    cells: Vec<u16>,
    /// Texels that lie wholly inside other geometry.
    hidden: Vec<bool>,
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
        let scene = accel.scene();
        let hideable = has_solids(scene);
        let mut cells = vec![0u16; texels.len()];
        let mut hidden = vec![false; texels.len()];
        cells.par_chunks_mut(CHUNK).zip(hidden.par_chunks_mut(CHUNK)).enumerate().try_for_each(
            |(chunk, (cells, hidden))| {
                for (i, (cell, hidden)) in cells.iter_mut().zip(hidden).enumerate() {
                    let texel = (chunk * CHUNK + i) as u32;
                    let covered = covered_cells(scene, atlas, texels, texel);
                    *cell = covered;
                    if hideable {
                        let free = free_cells(accel, atlas, texels, texel, covered);
                        *hidden = covered != 0 && free == 0;
                        *cell = if free == 0 { covered } else { free };
                    }
                }
                if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
            },
        )?;
        let open: Vec<f32> =
            (0..texels.len() as u32).into_par_iter().map(|t| open_share(accel, atlas, texels, t)).collect();
        let covered = open.iter().map(|&share| share == 0.0).collect();
        let crossed = (0..texels.len() as u32).into_par_iter().map(|t| is_crossed(accel, atlas, texels, t)).collect();
        let parted = (0..texels.len() as u32).into_par_iter().map(|t| is_parted(accel, atlas, texels, t)).collect();
        Ok(Self { scene, atlas, texels, cells, hidden, open, covered, parted, crossed })
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

    /// A point of the texel's usable part from `u` in the unit square; uniform over it.
    pub fn point(&self, texel: u32, u: Vec2) -> SurfacePoint {
        // Points on a chart's very border lie on the neighbouring surface as well.
        let u = u * (1.0 - 2.0 * MARGIN) + MARGIN;
        let mask = self.cells[texel as usize];
        let offset = if mask == u16::MAX {
            u
        } else if mask != 0 {
            // The u.x axis runs through the set cells, its remainder and u.y place the point in the cell.
            let count = mask.count_ones();
            let scaled = u.x * count as f32;
            let index = (scaled as u32).min(count - 1);
            let bit = nth_set_bit(mask, index);
            let corner = Vec2::new((bit % GRID) as f32, (bit / GRID) as f32);
            (corner + Vec2::new(scaled - index as f32, u.y)) / GRID as f32
        } else {
            return self.centre(texel);
        };
        self.texels.sample(self.scene, self.atlas, texel, offset).unwrap_or_else(|| self.centre(texel))
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

/// True if anything in the scene has an inside, or a back that is no surface.
fn has_solids(scene: &Scene) -> bool {
    scene.instances.iter().any(|i| {
        let mesh = &scene.meshes[i.mesh];
        mesh.closed || mesh.primitives.iter().any(|p| !scene.materials[p.material].double_sided)
    })
}

fn cell_centre(bit: u32) -> Vec2 {
    (Vec2::new((bit % GRID) as f32, (bit / GRID) as f32) + Vec2::splat(0.5)) / GRID as f32
}

fn covered_cells(scene: &Scene, atlas: &Atlas, texels: &Texels, texel: u32) -> u16 {
    if texels.coverage[texel as usize] > 0.999 {
        return u16::MAX;
    }
    (0..GRID * GRID)
        .filter(|&bit| texels.sample(scene, atlas, texel, cell_centre(bit)).is_some())
        .fold(0, |mask, bit| mask | 1 << bit)
}

/// The covered cells that are not inside other geometry. Cells are looked at only where the texel's centre, or what
/// is close to it, asks for it.
fn free_cells(accel: &Accel, atlas: &Atlas, texels: &Texels, texel: u32, covered: u16) -> u16 {
    let t = texel as usize;
    let (position, normal) = (texels.position[t], texels.geometric_normal[t]);
    let reach = texels.area[t].sqrt();
    if !near_surface(accel, position, normal, reach) && !is_inside(accel, position, normal) {
        return covered;
    }
    (0..GRID * GRID)
        .filter(|&bit| covered >> bit & 1 == 1)
        .filter(|&bit| {
            let point = texels.sample(accel.scene(), atlas, texel, cell_centre(bit));
            point.is_none_or(|p| !is_inside(accel, p.position, p.geometric_normal))
        })
        .fold(0, |mask, bit| mask | 1 << bit)
}

/// Share of a texel that nothing stands on. Cells are looked at where another surface crosses the texel.
fn open_share(accel: &Accel, atlas: &Atlas, texels: &Texels, texel: u32) -> f32 {
    let t = texel as usize;
    let width = texels.area[t].sqrt();
    let (position, normal) = (texels.position[t], texels.geometric_normal[t]);
    if !near_surface(accel, position, normal, width) {
        return if is_covered(accel, position, normal, width) { 0.0 } else { 1.0 };
    }
    let points: Vec<SurfacePoint> =
        (0..GRID * GRID).filter_map(|bit| texels.sample(accel.scene(), atlas, texel, cell_centre(bit))).collect();
    let covered = points.iter().filter(|p| is_covered(accel, p.position, p.geometric_normal, width / GRID as f32));
    1.0 - covered.count() as f32 / points.len().max(1) as f32
}

/// True if what lies straight above a point is a back face, or closer than `near`.
fn is_covered(accel: &Accel, position: Vec3, normal: Vec3, near: f32) -> bool {
    let ray = Ray { origin: offset_origin(position, normal), direction: normal, t_min: 0.0, t_max: f32::INFINITY };
    // What light passes through is no inside.
    accel
        .closest(&ray)
        .is_some_and(|hit| hit.t < near || hit.normal.dot(normal) > 0.0 && accel.transmission_at(&hit).is_none())
}

/// True if something lies between the texel and one of its four neighbours.
fn is_parted(accel: &Accel, atlas: &Atlas, texels: &Texels, texel: u32) -> bool {
    let t = texel as usize;
    let width = texels.area[t].sqrt();
    if !near_surface(accel, texels.position[t], texels.geometric_normal[t], width) {
        return false;
    }
    let chart = texels.chart[t] as usize;
    let page = &texels.pages[atlas.charts[chart].page];
    let centre = Vec2::new(texels.pixel[t][0] as f32, texels.pixel[t][1] as f32) + 0.5;
    let raised = |i: usize| offset_origin(texels.position[i], texels.geometric_normal[i]);
    [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y]
        .iter()
        .filter_map(|&step| page.at(centre + step))
        .any(|n| texels.chart[n as usize] as usize == chart && is_between(accel, raised(t), raised(n as usize)))
}

/// True if geometry stands between the texel's middle and its border.
fn is_crossed(accel: &Accel, atlas: &Atlas, texels: &Texels, texel: u32) -> bool {
    let t = texel as usize;
    let normal = texels.geometric_normal[t];
    if !near_surface(accel, texels.position[t], normal, 0.5 * texels.area[t].sqrt()) {
        return false;
    }
    let centre = offset_origin(texels.position[t], normal);
    [(0.02, 0.5), (0.98, 0.5), (0.5, 0.02), (0.5, 0.98)]
        .iter()
        .filter_map(|&(x, y)| texels.sample(accel.scene(), atlas, texel, Vec2::new(x, y)))
        .any(|p| is_between(accel, centre, offset_origin(p.position, p.geometric_normal)))
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

/// True if most of what is seen from the point is the back of a solid.
fn is_inside(accel: &Accel, position: Vec3, normal: Vec3) -> bool {
    let origin = offset_origin(position, normal);
    let sees_back = |direction: Vec3| {
        accel.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }).is_some_and(|hit| {
            let mesh = accel.scene().instances[hit.instance as usize].mesh;
            let solid = accel.scene().meshes[mesh].closed
                || !accel.scene().material_of(mesh, hit.triangle as usize).double_sided;
            solid && hit.normal.dot(direction) > 0.0 && accel.transmission_at(&hit).is_none()
        })
    };
    if !sees_back(normal) {
        return false;
    }
    let (x, y) = orthonormal_basis(normal);
    [x, -x, y, -y].iter().filter(|&&side| sees_back((normal + side).normalize())).count() >= 3
}

fn nth_set_bit(mut mask: u16, n: u32) -> u32 {
    for _ in 0..n {
        mask &= mask - 1;
    }
    mask.trailing_zeros()
}
