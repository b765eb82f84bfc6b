//! The part of a texel's square that its value is the mean of: what the chart covers. What of it lies inside other
//! geometry is dark, as paths find out by themselves.

use crate::accel::Accel;
use crate::atlas::{Atlas, SurfacePoint, TexelSurface, Texels};
use crate::math::{hash2, unit_float};
use glam::Vec2;

/// Cells along a side of the square.
const GRID: u32 = 8;
/// Points along a side of a cell at which it is looked for the chart.
const POINTS: u32 = 3;
/// Draws for a point of a cell that the chart covers in part, before the middle of the texel takes its place.
const DRAWS: u32 = 64;

/// The part of one texel.
pub(super) struct Footprint<'a> {
    texels: &'a Texels,
    surface: TexelSurface<'a>,
    pub(super) texel: u32,
    /// Cells that the chart covers in part or wholly, row by row from 0.
    cells: Vec<u32>,
}

impl<'a> Footprint<'a> {
    pub(super) fn new(accel: &Accel<'a>, atlas: &'a Atlas, texels: &'a Texels, texel: u32) -> Self {
        let surface = texels.surface(accel.scene(), atlas, texel);
        let mut footprint = Self { texels, surface, texel, cells: Vec::new() };
        footprint.cells = (0..GRID * GRID).filter(|&cell| footprint.reaches(cell)).collect();
        footprint
    }

    /// A point of the part, uniform over it. `u` lies in the unit square, `seed` makes what else is drawn.
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

    /// True if the chart reaches into a cell.
    fn reaches(&self, cell: u32) -> bool {
        let place = |i: u32| Vec2::new((i % POINTS) as f32 + 0.5, (i / POINTS) as f32 + 0.5) / POINTS as f32;
        (0..POINTS * POINTS).any(|i| self.surface.sample((corner(cell) + place(i)) / GRID as f32).is_some())
    }
}

/// Lower corner of a cell in units of cells.
fn corner(cell: u32) -> Vec2 {
    Vec2::new((cell % GRID) as f32, (cell / GRID) as f32)
}
