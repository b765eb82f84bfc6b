//! Balls spread through the room: what scenes that grow in surfaces are filled with.
//!
//! Their area and how much of the light they block stay the same however many there are, so that only the number of
//! surfaces grows.

use crate::faces::{Object, ball};
use crate::room::SIZE;
use glam::Vec3;

/// Number of balls at the start of every family.
pub(crate) const FIRST: usize = 21;
/// Divisions of their faces there.
pub(crate) const COARSEST: usize = 2;
/// Cells along their faces there.
pub(crate) const CELLS: u32 = 16;
/// Their radius there, metres.
const RADIUS: f32 = 0.3;
/// More nodes than this measure the reading of JSON: balls share them then.
const MOST_NODES: usize = 4096;

/// `count` balls of `divisions` with `cells` along each of their faces, or without a lightmap if that is zero.
pub(crate) fn balls(count: usize, divisions: usize, cells: u32) -> Vec<Object> {
    let radius = RADIUS * (FIRST as f32 / count as f32).sqrt();
    let placed = |i: usize| ball(place(i, radius), radius, divisions, cells);
    let all: Vec<usize> = (0..count).collect();
    let object = |(k, run): (usize, &[usize])| Object {
        name: format!("balls {k}"),
        faces: run.iter().flat_map(|&i| placed(i)).collect(),
        reflectance: [[0.7, 0.3, 0.2], [0.3, 0.6, 0.3], [0.6, 0.6, 0.6]][k % 3],
        has_lightmap: cells > 0,
    };
    all.chunks(count.div_ceil(MOST_NODES)).enumerate().map(object).collect()
}

/// The i-th point of an even sequence in the room, a radius off its walls (Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018).
fn place(i: usize, radius: f32) -> Vec3 {
    // The real root of x⁴ = x + 1.
    let root = 1.220_744_084_605_76_f64;
    let margin = Vec3::splat(radius * 1.01);
    let even = |k: i32| ((i + 1) as f64 * root.powi(-k)).fract() as f32;
    margin + (SIZE - 2.0 * margin) * Vec3::new(even(1), even(2), even(3))
}
