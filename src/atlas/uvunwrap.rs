//! Charts by uvunwrap: shapes → for every triangle a chart and its corners in the plane.

use super::build::AtlasError;
use super::shape::Shape;
use super::unwrap::{NO_CHART, Unwrapped};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::{Mesh, Scene};
use ::uvunwrap::{Density, Error, MeshInput, Options, Packing, generate_with_progress};
use glam::Vec2;
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Texels along the side of an average triangle in uvunwrap's own packing, which is thrown away.
const TEXELS_PER_TRIANGLE: f64 = 4.0;

/// Unwraps every shape.
pub(super) fn unwrap(scene: &Scene, shapes: &[Shape], progress: &dyn Progress) -> Result<Vec<Unwrapped>, AtlasError> {
    let counter = Counter::new(progress, Stage::Atlas, shapes.iter().map(|s| s.triangles.len()).sum());
    shapes
        .par_iter()
        .map(|shape| {
            let unwrapped = unwrap_shape(&scene.meshes[shape.mesh], shape, progress)?;
            counter.advance(shape.triangles.len())?;
            Ok(unwrapped)
        })
        .collect()
}

fn unwrap_shape(mesh: &Mesh, shape: &Shape, progress: &dyn Progress) -> Result<Unwrapped, AtlasError> {
    let mut unwrapped = Unwrapped::none(mesh.triangles.len());
    if shape.triangles.is_empty() {
        return Ok(unwrapped);
    }
    let positions: Vec<[f32; 3]> = shape.positions.iter().map(|p| p.to_array()).collect();
    let indices: Vec<u32> = shape.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    let side = (shape.area(mesh) / shape.triangles.len() as f64).sqrt();
    let density = Density::Fixed { texels_per_unit: (TEXELS_PER_TRIANGLE / side) as f32, page_size: None };
    let options = Options { density, packing: Packing::Fast, padding: 1, ..Options::default() };
    let input = MeshInput::new(&positions, &indices);
    let failed =
        |reason: String| AtlasError::Unwrapper { tool: "uvunwrap", reason: format!("mesh `{}`: {reason}", mesh.name) };
    // A defect of the library on one odd mesh must not end the program without a message.
    let generate = || generate_with_progress(&[input], &options, |_| !progress.is_cancelled());
    let atlas = match catch_unwind(AssertUnwindSafe(generate)) {
        Ok(Ok(atlas)) => atlas,
        Ok(Err(Error::Cancelled)) => return Err(Cancelled.into()),
        Ok(Err(e)) => return Err(failed(e.to_string())),
        Err(_) => return Err(failed("it stopped unexpectedly".into())),
    };

    let size = Vec2::new(atlas.width as f32, atlas.height as f32);
    for output in &atlas.meshes {
        for (corners, &triangle) in output.indices.chunks_exact(3).zip(&shape.triangles) {
            let vertices = [corners[0], corners[1], corners[2]].map(|v| &output.vertices[v as usize]);
            // A degenerate triangle borrows vertices of several charts.
            let chart = vertices[0].chart.filter(|_| vertices.iter().all(|v| v.chart == vertices[0].chart));
            unwrapped.set(triangle, chart.unwrap_or(NO_CHART), vertices.map(|v| Vec2::from(v.uv) * size));
        }
    }
    Ok(unwrapped)
}
