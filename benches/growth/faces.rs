//! Pieces of surface that scenes are put together from: grids of points with a place on the lightmap. Metres.

use glam::Vec3;

/// A grid of (divisions + 1)² points, row by row; its front is where it turns counter-clockwise from row to column.
pub(crate) struct Face {
    pub(crate) points: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) divisions: usize,
    /// Width and height of its rectangle on the lightmap, in cells of the page.
    pub(crate) cells: [u32; 2],
}

/// Faces of one colour with one node in the scene.
pub(crate) struct Object {
    pub(crate) name: String,
    pub(crate) faces: Vec<Face>,
    pub(crate) reflectance: [f32; 3],
    /// False for what only blocks and reflects.
    pub(crate) has_lightmap: bool,
}

/// The parallelogram at `origin`, which faces `along` × `up`, with `density` cells of the page per metre.
pub(crate) fn flat(origin: Vec3, along: Vec3, up: Vec3, density: f32) -> Face {
    let cells = [along, up].map(|edge| (edge.length() * density).round().max(1.0) as u32);
    let points = vec![origin, origin + along, origin + up, origin + along + up];
    Face { points, normals: vec![along.cross(up).normalize(); 4], divisions: 1, cells }
}

/// The outsides of the box from `low` to `high`. What stands on the floor has no underside.
pub(crate) fn block(low: Vec3, high: Vec3, density: f32) -> Vec<Face> {
    let size = high - low;
    let [x, y, z] = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
    let mut faces = vec![
        flat(low + z, x, y, density),
        flat(low + x, -x, y, density),
        flat(low + x + z, -z, y, density),
        flat(low, z, y, density),
        flat(low + y + z, x, -z, density),
    ];
    if low.y > 0.0 {
        faces.push(flat(low, x, z, density));
    }
    faces
}

/// A ball of six faces with `divisions`² × 2 triangles and `cells`² cells each.
pub(crate) fn ball(centre: Vec3, radius: f32, divisions: usize, cells: u32) -> Vec<Face> {
    let sides = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    let face = |axis: Vec3| {
        let along = Vec3::new(axis.y, axis.z, axis.x);
        let up = axis.cross(along);
        // Equal angles make cells of about equal size.
        let tangent = |i: usize| ((i as f32 / divisions as f32 - 0.5) * std::f32::consts::FRAC_PI_2).tan();
        let grid = (0..=divisions).flat_map(|j| (0..=divisions).map(move |i| (i, j)));
        let normals: Vec<Vec3> = grid.map(|(i, j)| (axis + along * tangent(i) + up * tangent(j)).normalize()).collect();
        let points = normals.iter().map(|&n| centre + n * radius).collect();
        Face { points, normals, divisions, cells: [cells, cells] }
    };
    sides.map(face).into()
}
