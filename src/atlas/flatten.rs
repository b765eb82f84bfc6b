//! Charts to scale: what an unwrapper left → charts in the shape's own unit of length, none lying upon itself.

use super::overlap::without_overlap;
use super::shape::{Shape, triangle_area};
use super::unwrap::{NO_CHART, Unwrapped};
use crate::scene::Mesh;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::collections::BTreeMap;

/// A chart in the plane, in the shape's unit of length, wider than high.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FlatChart {
    /// Triangles of the mesh.
    pub(super) triangles: Vec<u32>,
    /// Their corners, from (0, 0) to `size`.
    pub(super) corners: Vec<[Vec2; 3]>,
    /// Extent.
    pub(super) size: Vec2,
}

/// The charts of one shape, by first triangle. Triangles that the unwrapper left out get charts of their own.
pub(super) fn flatten(mesh: &Mesh, shape: &Shape, unwrapped: &Unwrapped) -> Vec<FlatChart> {
    let mut members: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let mut lone = Vec::new();
    for &t in &shape.triangles {
        match unwrapped.charts[t as usize] {
            NO_CHART => lone.push(t),
            chart => members.entry(chart).or_default().push(t),
        }
    }
    let mut charts = Vec::new();
    for triangles in members.into_values() {
        let world: Vec<[Vec3; 3]> = triangles.iter().map(|&t| shape.corners(mesh, t)).collect();
        let flat: Vec<[Vec2; 3]> = triangles.iter().map(|&t| unwrapped.corners[t as usize]).collect();
        let Some(scale) = scale_to_world(&world, &flat) else {
            lone.extend(triangles);
            continue;
        };
        let mut parts = Vec::new();
        for part in without_overlap(&world, &flat) {
            let corners: Vec<[Vec2; 3]> = part.iter().map(|&i| flat[i].map(|c| c * scale)).collect();
            // A triangle that the unwrapper squeezed to a line would get no texels.
            let (kept, squeezed): (Vec<usize>, Vec<usize>) =
                (0..part.len()).partition(|&k| !is_squeezed(world[part[k]], corners[k]));
            lone.extend(squeezed.into_iter().map(|k| triangles[part[k]]));
            if !kept.is_empty() {
                let members = kept.iter().map(|&k| triangles[part[k]]).collect();
                parts.push(at_origin(members, kept.iter().map(|&k| corners[k]).collect()));
            }
        }
        charts.append(&mut parts);
    }
    charts.extend(lone.into_iter().map(|t| at_origin(vec![t], vec![laid_flat(shape.corners(mesh, t))])));
    charts.sort_by_key(|c| c.triangles.first().copied());
    charts
}

/// Factors along x and y that give a chart the proportions and the area of its surface, on average. None if it has no
/// area.
fn scale_to_world(world: &[[Vec3; 3]], flat: &[[Vec2; 3]]) -> Option<Vec2> {
    // Narrower than this, a triangle says more about rounding than about stretch.
    const NARROW: f64 = 1e-4;
    let (mut squares, mut weight) = (DVec2::ZERO, 0.0);
    let (mut world_area, mut flat_area) = (0.0, 0.0);
    for (&[a, b, c], &[p, q, r]) in world.iter().zip(flat) {
        let (e1, e2) = ((b - a).as_dvec3(), (c - a).as_dvec3());
        let (d1, d2) = ((q - p).as_dvec2(), (r - p).as_dvec2());
        let doubled = d1.perp_dot(d2);
        world_area += e1.cross(e2).length();
        flat_area += doubled.abs();
        if doubled.abs() <= NARROW * (d1.length_squared() + d2.length_squared()) {
            continue;
        }
        // Tangents of the surface along the chart's axes.
        let (along_x, along_y) = ((e1 * d2.y - e2 * d1.y) / doubled, (e2 * d1.x - e1 * d2.x) / doubled);
        squares += DVec2::new(along_x.length_squared(), along_y.length_squared()) * doubled.abs();
        weight += doubled.abs();
    }
    let stretch = if weight > 0.0 { (squares / weight).map(f64::sqrt) } else { DVec2::ONE };
    let to_area = (world_area / (flat_area * stretch.x * stretch.y)).sqrt();
    let scale = (stretch * to_area).as_vec2();
    (scale.is_finite() && scale.min_element() > 0.0).then_some(scale)
}

/// True if a triangle got less than a millionth of its area.
fn is_squeezed(world: [Vec3; 3], [a, b, c]: [Vec2; 3]) -> bool {
    let flat = f64::from((b - a).perp_dot(c - a).abs()) / 2.0;
    flat < 1e-6 * triangle_area(world) || flat == 0.0
}

/// A triangle in its own plane, its longest side along x.
fn laid_flat(corners: [Vec3; 3]) -> [Vec2; 3] {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).length_squared();
    let first = (0..3).max_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap_or(0);
    let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3].as_dvec3());
    let x = (b - a).normalize_or(DVec3::X);
    let (along, across) = ((c - a).dot(x), (c - a).cross(x).length());
    let mut flat = [Vec2::ZERO; 3];
    flat[(first + 1) % 3] = Vec2::new((b - a).length() as f32, 0.0);
    flat[(first + 2) % 3] = DVec2::new(along, across).as_vec2();
    flat
}

/// Moves a chart to the origin and lays it on its longer side.
fn at_origin(triangles: Vec<u32>, mut corners: Vec<[Vec2; 3]>) -> FlatChart {
    let all = || corners.iter().flatten();
    let low = all().fold(Vec2::INFINITY, |m, &c| m.min(c));
    let high = all().fold(Vec2::NEG_INFINITY, |m, &c| m.max(c));
    let size = high - low;
    let upright = size.y > size.x;
    for c in corners.iter_mut().flatten() {
        *c -= low;
        if upright {
            *c = Vec2::new(c.y, c.x);
        }
    }
    FlatChart { triangles, corners, size: if upright { Vec2::new(size.y, size.x) } else { size } }
}
