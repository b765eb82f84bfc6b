//! The part of a texel's square that its value is the mean of: covered by the chart, and not inside other geometry.

use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::{Atlas, SurfacePoint, TexelSurface, Texels};
use crate::math::{hash2, orthonormal_basis, unit_float};
use glam::{Vec2, Vec3};

/// Cells along a side of the square.
const GRID: u32 = 8;
/// Points along a side of a cell at which it is looked for the chart.
const POINTS: u32 = 3;
/// Draws for a point of a cell that the chart covers in part, before the middle of the texel takes its place.
const DRAWS: u32 = 64;
/// Tilted rays beside the one straight up that tell whether a point lies inside, and how many of them must agree.
const AROUND: usize = 8;
const MOST_OF_THEM: usize = 6;

/// The usable part of one texel.
pub(super) struct Footprint<'a> {
    texels: &'a Texels,
    surface: TexelSurface<'a>,
    pub(super) texel: u32,
    /// Usable cells, row by row from 0.
    cells: Vec<u32>,
}

impl<'a> Footprint<'a> {
    pub(super) fn new(accel: &Accel<'a>, atlas: &'a Atlas, texels: &'a Texels, texel: u32) -> Self {
        let surface = texels.surface(accel.scene(), atlas, texel);
        let mut footprint = Self { texels, surface, texel, cells: Vec::new() };
        let covered: Vec<(u32, SurfacePoint)> =
            (0..GRID * GRID).filter_map(|cell| footprint.inside_cell(cell).map(|point| (cell, point))).collect();
        let free = covered.iter().filter(|(_, point)| !is_inside(accel, point)).map(|&(cell, _)| cell);
        footprint.cells = free.collect();
        if footprint.cells.is_empty() {
            footprint.cells = covered.into_iter().map(|(cell, _)| cell).collect();
        }
        footprint
    }

    /// A point of the usable part, uniform over it. `u` lies in the unit square, `seed` makes what else is drawn.
    pub(super) fn point(&self, mut u: Vec2, seed: u32) -> SurfacePoint {
        let count = self.cells.len();
        for draw in 0..DRAWS {
            if count == 0 {
                break;
            }
            let along = u.x * count as f32;
            let index = (along as usize).min(count - 1);
            let inside = Vec2::new((along - index as f32).min(1.0), u.y);
            if let Some(point) = self.surface.sample((corner(self.cells[index]) + inside) / GRID as f32) {
                return point;
            }
            u = Vec2::new(unit_float(hash2(seed, 2 * draw)), unit_float(hash2(seed, 2 * draw + 1)));
        }
        let t = self.texel as usize;
        SurfacePoint {
            position: self.texels.position[t],
            geometric_normal: self.texels.geometric_normal[t],
            shading_normal: self.texels.shading_normal[t],
        }
    }

    /// The chart's point nearest to the middle of a cell, none if the chart does not reach into it.
    fn inside_cell(&self, cell: u32) -> Option<SurfacePoint> {
        let middle = (corner(cell) + 0.5) / GRID as f32;
        self.surface.sample(middle).or_else(|| {
            let place = |i: u32| Vec2::new((i % POINTS) as f32 + 0.5, (i / POINTS) as f32 + 0.5) / POINTS as f32;
            (0..POINTS * POINTS).find_map(|i| self.surface.sample((corner(cell) + place(i)) / GRID as f32))
        })
    }
}

/// Lower corner of a cell in units of cells.
fn corner(cell: u32) -> Vec2 {
    Vec2::new((cell % GRID) as f32, (cell / GRID) as f32)
}

/// True if a point lies inside other geometry: what it sees straight above and most of what it sees around are backs of
/// solids.
fn is_inside(accel: &Accel, point: &SurfacePoint) -> bool {
    let normal = point.geometric_normal;
    let origin = offset_origin(point.position, normal);
    let sees_back = |direction: Vec3| {
        accel.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }).is_some_and(|hit| {
            let scene = accel.scene();
            let mesh = scene.instances[hit.instance as usize].mesh;
            let is_solid = scene.meshes[mesh].closed || !scene.material_of(mesh, hit.triangle as usize).double_sided;
            is_solid && hit.normal.dot(direction) > 0.0 && accel.transmission_at(&hit).is_none()
        })
    };
    if !sees_back(normal) {
        return false;
    }
    let (x, y) = orthonormal_basis(normal);
    let tilted = (0..AROUND).map(|i| {
        let (sine, cosine) = (i as f32 * std::f32::consts::TAU / AROUND as f32).sin_cos();
        (normal + x * cosine + y * sine).normalize()
    });
    tilted.filter(|&direction| sees_back(direction)).count() >= MOST_OF_THEM
}
