//! Where the atlas cuts a surface that goes on smoothly: pairs of page segments that show the same edge.

use crate::atlas::Atlas;
use crate::scene::{Mesh, Scene};
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, HashMap};

/// Cosine of the largest angle between the shading normals of two sides that count as one surface, about 3.6°.
/// Beyond it, light differs rightly from side to side.
const SMOOTH: f32 = 0.998;

/// Edges that more triangles meet in are knots of a defective mesh.
const MAX_TRIANGLES: usize = 8;

/// Coordinates that differ by less, in texels, are the same place.
const SAME_PLACE: f32 = 1e-3;

/// An edge as one of its triangles shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Side {
    /// Page.
    pub(super) page: usize,
    /// Chart.
    pub(super) chart: u32,
    /// Ends, in texels, in an order that both sides share.
    pub(super) ends: [Vec2; 2],
}

/// Two places of the atlas that show the same edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seam {
    /// Both places.
    pub(super) sides: [Side; 2],
}

/// One triangle at an edge.
struct Corner {
    side: Side,
    normals: [Vec3; 2],
}

/// Seams of `instance`, in an order that depends on the mesh only.
pub(super) fn seams(scene: &Scene, atlas: &Atlas, instance: usize) -> Vec<Seam> {
    let Some(layout) = &atlas.layouts[instance] else { return Vec::new() };
    let mesh = &scene.meshes[scene.instances[instance].mesh];
    let places = welded(mesh);
    let mut edges: BTreeMap<[u32; 2], Vec<Corner>> = BTreeMap::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let chart = layout.charts[t];
        let Some(page) = atlas.charts.get(chart as usize).map(|c| c.page) else { continue };
        for k in 0..3 {
            let mut ends = [k, (k + 1) % 3];
            let place = |corner: usize| places[triangle[corner] as usize];
            if place(ends[0]) > place(ends[1]) {
                ends.reverse();
            }
            let side = Side { page, chart, ends: ends.map(|c| layout.corners[t][c]) };
            let normals = ends.map(|c| mesh.normals[triangle[c] as usize]);
            edges.entry(ends.map(place)).or_default().push(Corner { side, normals });
        }
    }
    edges.values().filter(|corners| corners.len() <= MAX_TRIANGLES).flat_map(|corners| cut_pairs(corners)).collect()
}

/// Pairs at one edge that belong to one surface and lie in different places.
fn cut_pairs(corners: &[Corner]) -> Vec<Seam> {
    let mut seams = Vec::new();
    for (i, a) in corners.iter().enumerate() {
        for b in &corners[i + 1..] {
            let smooth = a.normals.iter().zip(b.normals).all(|(n, m)| n.dot(m) >= SMOOTH);
            if smooth && !same_place(&a.side, &b.side) {
                seams.push(Seam { sides: [a.side, b.side] });
            }
        }
    }
    seams
}

fn same_place(a: &Side, b: &Side) -> bool {
    a.page == b.page && a.ends.iter().zip(b.ends).all(|(p, q)| p.distance(q) < SAME_PLACE)
}

/// A number per vertex that vertices at the same position share.
fn welded(mesh: &Mesh) -> Vec<u32> {
    let mut known = HashMap::new();
    let number = |p: &Vec3| {
        let next = known.len() as u32;
        // Adding zero turns −0 into 0.
        *known.entry((*p + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert(next)
    };
    mesh.positions.iter().map(number).collect()
}
