//! The room that all scenes share: lit by an area lamp below its ceiling and by a sky through a window.

use crate::faces::{Face, Object, block, flat};
use crate::layout::place;
use glam::{Vec3, vec3};

/// Width, height and depth, metres.
pub(crate) const SIZE: Vec3 = vec3(6.0, 3.0, 4.0);
/// Corners of the window in the wall z = SIZE.z.
const WINDOW: [[f32; 2]; 2] = [[2.2, 0.9], [3.8, 2.1]];

/// The room with furniture, as fine as `side`² cells allow.
pub(crate) fn furnished(side: u32) -> Vec<Object> {
    let at = |density: f32| shell(density).into_iter().chain(furniture(density)).collect::<Vec<_>>();
    // The whole page as one wall would hold this many cells per metre.
    let most = side as f32 / SIZE.x;
    let densities = (1..100).map(|percent| most * (1.0 - 0.01 * percent as f32));
    let fits = |objects: &Vec<Object>| place(objects, side).is_some();
    densities.map(at).find(fits).unwrap_or_else(|| at(0.0))
}

/// Floor, ceiling and walls with `density` cells per metre, seen from inside.
pub(crate) fn shell(density: f32) -> Vec<Object> {
    let Vec3 { x, y, z } = SIZE;
    let [x, y, z] = [Vec3::X * x, Vec3::Y * y, Vec3::Z * z];
    let object = |name: &str, reflectance, faces| Object { name: name.into(), faces, reflectance, has_lightmap: true };
    vec![
        object("floor", [0.45, 0.35, 0.25], vec![flat(z, x, -z, density)]),
        object("ceiling", [0.8; 3], vec![flat(y, x, z, density)]),
        object("back", [0.7, 0.7, 0.65], vec![flat(Vec3::ZERO, x, y, density)]),
        object("left", [0.7, 0.35, 0.3], vec![flat(z, -z, y, density)]),
        object("right", [0.3, 0.45, 0.7], vec![flat(x, z, y, density)]),
        object("front", [0.7, 0.7, 0.65], front(density)),
    ]
}

/// The wall around the window.
fn front(density: f32) -> Vec<Face> {
    let [[left, sill], [right, head]] = WINDOW;
    let piece = |[x0, y0]: [f32; 2], [x1, y1]: [f32; 2]| {
        flat(vec3(x1, y0, SIZE.z), vec3(x0 - x1, 0.0, 0.0), vec3(0.0, y1 - y0, 0.0), density)
    };
    vec![
        piece([0.0, 0.0], [left, SIZE.y]),
        piece([right, 0.0], [SIZE.x, SIZE.y]),
        piece([left, 0.0], [right, sill]),
        piece([left, head], [right, SIZE.y]),
    ]
}

/// A table, a cupboard, a bed and a bookcase with books.
fn furniture(density: f32) -> Vec<Object> {
    let object = |name: &str, reflectance, boxes: &[[Vec3; 2]]| Object {
        name: name.into(),
        faces: boxes.iter().flat_map(|&[low, high]| block(low, high, density)).collect(),
        reflectance,
        has_lightmap: true,
    };
    let leg = |x: f32, z: f32| [vec3(x, 0.0, z), vec3(x + 0.08, 0.7, z + 0.08)];
    let table = [
        [vec3(2.2, 0.7, 2.2), vec3(3.8, 0.76, 3.0)],
        leg(2.25, 2.25),
        leg(3.67, 2.25),
        leg(2.25, 2.87),
        leg(3.67, 2.87),
    ];
    let bed = [
        [vec3(0.0, 0.0, 0.6), vec3(0.08, 0.9, 1.6)],
        [vec3(0.12, 0.2, 0.65), vec3(2.0, 0.5, 1.55)],
        [vec3(0.2, 0.52, 0.75), vec3(0.6, 0.62, 1.45)],
    ];
    let board = |y: f32| [vec3(5.6, y, 0.9), vec3(5.98, y + 0.04, 2.5)];
    let side = |z: f32| [vec3(5.6, 0.0, z), vec3(5.98, 1.9, z + 0.05)];
    let bookcase = [board(0.1), board(0.55), board(1.0), board(1.45), side(0.84), side(2.51)];
    let book = |i: usize| {
        let (shelf, place) = (i % 3, i / 3);
        let foot = vec3(5.7, 0.14 + 0.45 * shelf as f32, 1.0 + 0.17 * place as f32);
        [foot, foot + vec3(0.24, 0.26 + 0.02 * (i % 4) as f32, 0.07 + 0.02 * (i % 3) as f32)]
    };
    let books: Vec<_> = (0..24).map(book).collect();
    vec![
        object("table", [0.5, 0.35, 0.2], &table),
        object("cupboard", [0.6, 0.55, 0.5], &[[vec3(0.4, 0.0, 3.4), vec3(1.8, 1.8, 3.95)]]),
        object("bed", [0.75, 0.75, 0.8], &bed),
        object("bookcase", [0.45, 0.3, 0.2], &bookcase),
        object("books", [0.5, 0.2, 0.2], &books),
    ]
}
