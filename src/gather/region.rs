//! A bright region of the environment as a lamp at infinity: exact irradiance, and directions drawn by radiance.

use super::lamp::LampSample;
use crate::math::Distribution;
use crate::scene::{BrightRegion, Environment, Rgb};
use glam::{Quat, Vec2, Vec3};

/// A set of directions with their radiance.
#[derive(Clone, Debug)]
pub struct Region {
    source: BrightRegion,
    /// Draws cells by power.
    draw: Distribution,
    /// Direction and irradiance on a surface that faces it of every cell, in the world.
    cells: Vec<(Vec3, Rgb)>,
    /// Middle of a cone around all cells.
    axis: Vec3,
    /// Sine of its half angle; 1 if that is no less than 90°.
    sine: f32,
    /// Integral of radiance × direction per channel: what a surface receives that sees all of it.
    moment: [Vec3; 3],
}

/// The bright regions of the environment.
pub(super) fn regions(environment: &Environment) -> Vec<Region> {
    match environment {
        Environment::Image(sky) => sky.regions().iter().cloned().map(Region::new).collect(),
        _ => Vec::new(),
    }
}

impl Region {
    fn new(source: BrightRegion) -> Self {
        let rotation: Quat = source.rotation;
        let draw = Distribution::new(source.cells.iter().map(|c| c.power()));
        let mut moment = [glam::DVec3::ZERO; 3];
        for cell in &source.cells {
            let direction = rotation.as_dquat() * cell.cell.moment();
            (0..3).for_each(|c| moment[c] += direction * cell.radiance[c] as f64);
        }
        let cells: Vec<(Vec3, Rgb)> = source
            .cells
            .iter()
            .map(|c| {
                let moment = (rotation.as_dquat() * c.cell.moment()).as_vec3();
                (moment.normalize_or_zero(), c.radiance * moment.length())
            })
            .collect();
        let axis = (moment[0] + moment[1] + moment[2]).as_vec3().normalize_or_zero();
        // Corners of cells lie farther out than their middles.
        let corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let farthest = source
            .cells
            .iter()
            .flat_map(|c| corners.map(|u| (rotation * c.cell.direction(u)).dot(axis)))
            .fold(1.0, f32::min);
        let sine = if farthest > 0.0 { (1.0 - farthest * farthest).max(0.0).sqrt() } else { 1.0 };
        Self { source, draw, cells, axis, sine, moment: moment.map(|m| m.as_vec3()) }
    }

    /// Irradiance on a surface with unit normal `n` if nothing blocks, W/m².
    pub(super) fn unoccluded(&self, n: Vec3) -> Rgb {
        let cosine = n.dot(self.axis);
        if self.sine < 1.0 && cosine >= self.sine {
            return Rgb::from_array(self.moment.map(|m| n.dot(m)));
        }
        if self.sine < 1.0 && cosine <= -self.sine {
            return Rgb::ZERO;
        }
        self.cells.iter().map(|&(direction, facing)| facing * n.dot(direction).max(0.0)).sum()
    }

    /// A direction from `u` in the unit square, drawn by power; weight without the receiver's cosine.
    pub(super) fn sample(&self, u: Vec2) -> LampSample {
        let (i, within) = self.draw.draw(u.x);
        let cell = &self.source.cells[i];
        let direction = self.source.rotation * cell.cell.direction(Vec2::new(within, u.y));
        // Cells are drawn by power, so only hue is left of the radiance.
        let weight = cell.radiance * (3.0 / cell.radiance.element_sum().max(f32::MIN_POSITIVE));
        LampSample { direction, distance: f32::INFINITY, weight }
    }
}
