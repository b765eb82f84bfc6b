//! Index lists → triangles, without those that cannot be baked, and the account of what was left out.

use crate::warning::Warning;
use glam::Vec3;
use gltf::mesh::Mode;

/// A triangle is degenerate if its height is below this share of its longest edge: f32 positions carry no more.
const DEGENERATE: f64 = 1e-7;

/// What was wrong with a mesh, counted over its primitives.
#[derive(Default)]
pub(super) struct Faults {
    pub(super) not_surfaces: usize,
    pub(super) without_positions: usize,
    pub(super) out_of_range: usize,
    pub(super) not_finite: usize,
    pub(super) zero_area: usize,
    pub(super) bad_normals: usize,
    pub(super) bad_texcoords: usize,
    pub(super) bad_lengths: usize,
}

impl Faults {
    /// Empties `values` if they are not one per vertex.
    pub(super) fn check_length<T>(&mut self, values: &mut Vec<T>, vertices: usize) {
        if !values.is_empty() && values.len() != vertices {
            self.bad_lengths += 1;
            values.clear();
        }
    }

    /// One warning per kind of fault. `path` is the node that shows the mesh.
    pub(super) fn warnings(&self, path: &str, mesh: &str) -> Vec<Warning> {
        let kinds = [
            (self.not_surfaces, "not_surfaces", "primitives of points or lines skipped: convert them to faces"),
            (self.without_positions, "no_positions", "primitives without POSITION skipped: export the mesh again"),
            (self.out_of_range, "index_out_of_range", "triangles with indices out of range skipped: export it again"),
            (self.not_finite, "not_finite", "triangles with NaN or infinite vertices skipped: repair the mesh"),
            (self.zero_area, "degenerate_triangles", "zero-area triangles skipped: merge vertices by distance"),
            (self.bad_normals, "zero_normals", "normals without direction replaced by flat ones: recalculate normals"),
            (self.bad_texcoords, "bad_texcoords", "NaN or infinite texture coordinates set to 0: unwrap it again"),
            (self.bad_lengths, "attribute_length", "attributes not of one value per vertex ignored: export it again"),
        ];
        let found = kinds.into_iter().filter(|(count, ..)| *count > 0);
        found.map(|(count, code, text)| Warning::new(code, path, format!("mesh `{mesh}`: {count} {text}"))).collect()
    }
}

/// Triangles of an index list in its topology, with the winding of the first one. Those that exist only to join strips
/// are left out.
pub(super) fn corners(indices: &[u32], mode: Mode) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, t): (usize, [u32; 3])| if i % 2 == 0 { t } else { [t[1], t[0], t[2]] };
            let all = indices.array_windows::<3>().copied().enumerate().map(turned);
            all.filter(|[a, b, c]| a != b && b != c && c != a).collect()
        }
        Mode::TriangleFan => match indices {
            [centre, rim @ ..] => rim.array_windows::<2>().map(|&[b, c]| [*centre, b, c]).collect(),
            [] => Vec::new(),
        },
        _ => indices.as_chunks::<3>().0.to_vec(),
    }
}

/// The triangles that have three finite corners and an area.
pub(super) fn keep_sound(triangles: Vec<[u32; 3]>, positions: &[Vec3], faults: &mut Faults) -> Vec<[u32; 3]> {
    let mut kept = triangles;
    kept.retain(|t| {
        if t.iter().any(|&v| v as usize >= positions.len()) {
            faults.out_of_range += 1;
            return false;
        }
        let corners = t.map(|v| positions[v as usize]);
        if !corners.iter().all(|p| p.is_finite()) {
            faults.not_finite += 1;
            return false;
        }
        if is_degenerate(corners) {
            faults.zero_area += 1;
            return false;
        }
        true
    });
    kept
}

fn is_degenerate(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).cross(c - a).length() <= DEGENERATE * longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_alternate_their_winding_and_drop_joints() {
        assert_eq!(corners(&[0, 1, 2, 3], Mode::TriangleStrip), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(corners(&[0, 1, 2, 2, 3, 3, 4, 5], Mode::TriangleStrip), [[0, 1, 2], [4, 3, 5]]);
    }

    #[test]
    fn fans_share_their_first_vertex() {
        assert_eq!(corners(&[7, 1, 2, 3], Mode::TriangleFan), [[7, 1, 2], [7, 2, 3]]);
        assert!(corners(&[], Mode::TriangleFan).is_empty());
    }

    #[test]
    fn a_short_list_gives_whole_triangles_only() {
        assert_eq!(corners(&[0, 1, 2, 3, 4], Mode::Triangles), [[0, 1, 2]]);
    }

    #[test]
    fn degeneracy_is_relative_to_size() {
        let check = |scale: f32, height: f32, expected: bool| {
            let corners = [Vec3::ZERO, Vec3::X * scale, Vec3::new(0.5, height, 0.0) * scale];
            assert_eq!(is_degenerate(corners), expected, "scale {scale}, height {height}");
        };
        for scale in [1e-9, 1.0, 1e9] {
            check(scale, 1.0, false);
            check(scale, 1e-5, false);
            check(scale, 1e-9, true);
            check(scale, 0.0, true);
        }
    }
}
