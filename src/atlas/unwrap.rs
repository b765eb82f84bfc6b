//! Charts in the plane: shapes → for every triangle a chart and its corners, in a scale that is the chart's own.

use super::islands::islands;
use super::shape::Shape;
use crate::scene::Scene;
use glam::Vec2;

/// Marks a triangle that the unwrapper left out.
pub(super) const NO_CHART: u32 = u32::MAX;

/// How one mesh is cut into charts.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Unwrapped {
    /// Chart per triangle of the mesh, any numbers, or [`NO_CHART`].
    pub(super) charts: Vec<u32>,
    /// Corners per triangle. Charts may lie upon each other and differ in scale along both axes.
    pub(super) corners: Vec<[Vec2; 3]>,
}

impl Unwrapped {
    /// No triangle has a chart.
    pub(super) fn none(triangles: usize) -> Self {
        Self { charts: vec![NO_CHART; triangles], corners: vec![[Vec2::ZERO; 3]; triangles] }
    }

    /// Gives a triangle its place.
    pub(super) fn set(&mut self, triangle: u32, chart: u32, corners: [Vec2; 3]) {
        self.charts[triangle as usize] = chart;
        self.corners[triangle as usize] = corners;
    }
}

/// The islands of the texture coordinates that the meshes bring: of `set(mesh)` each.
pub(super) fn existing(scene: &Scene, shapes: &[Shape], set: impl Fn(usize) -> Option<usize>) -> Vec<Unwrapped> {
    shapes
        .iter()
        .map(|shape| {
            let mesh = &scene.meshes[shape.mesh];
            let mut unwrapped = Unwrapped::none(mesh.triangles.len());
            let Some(uv) = set(shape.mesh).map(|set| &mesh.texcoords[set]) else { return unwrapped };
            let islands = islands(mesh, uv);
            for &t in &shape.triangles {
                let corners = mesh.triangles[t as usize].map(|v| uv[v as usize]);
                if corners.iter().all(|c| c.is_finite()) {
                    unwrapped.set(t, islands.of[t as usize], corners);
                }
            }
            unwrapped
        })
        .collect()
}
