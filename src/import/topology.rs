//! Whether a mesh encloses a volume: positions welded by value, then every edge checked.

use glam::Vec3;
use std::collections::HashMap;

/// True if every edge is used by exactly two triangles, once in each direction. Vertices at equal positions count as one.
pub(super) fn is_closed(positions: &[Vec3], triangles: &[[u32; 3]]) -> bool {
    if triangles.is_empty() {
        return false;
    }
    let mut welded = HashMap::with_capacity(positions.len());
    let weld: Vec<u32> = positions
        .iter()
        .enumerate()
        // Adding zero turns −0 into 0, so that both have the same bits.
        .map(|(i, p)| *welded.entry((*p + 0.0).to_array().map(f32::to_bits)).or_insert(i as u32))
        .collect();

    // Both directions of an edge have the same upper bits, so that sorting brings them together, forward first.
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(triangles.len() * 3);
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (weld[t[k] as usize], weld[t[(k + 1) % 3] as usize]);
            edges.push((a.min(b), a.max(b), a > b));
        }
    }
    edges.sort_unstable();
    let (pairs, rest) = edges.as_chunks::<2>();
    let opposite = |[first, second]: &[(u32, u32, bool); 2]| {
        (first.0, first.1) == (second.0, second.1) && !first.2 && second.2 && first.0 != first.1
    };
    // Four uses of an edge would pass as forward, forward, …: the pair test fails on them.
    rest.is_empty() && pairs.iter().all(opposite)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 4] = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_is_removed_or_turned() {
        assert!(is_closed(&CORNERS, &TETRAHEDRON));
        assert!(!is_closed(&CORNERS, &TETRAHEDRON[..3]));
        let mut turned = TETRAHEDRON;
        turned[3].swap(0, 1);
        assert!(!is_closed(&CORNERS, &turned));
        assert!(!is_closed(&[], &[]));
    }

    #[test]
    fn unshared_vertices_and_signed_zeros_are_welded() {
        let positions: Vec<Vec3> = TETRAHEDRON
            .iter()
            .enumerate()
            .flat_map(|(face, t)| t.map(|v| if face % 2 == 0 { CORNERS[v as usize] } else { -(-CORNERS[v as usize]) }))
            .map(|p| if p.x == 0.0 { Vec3::new(-0.0, p.y, p.z) } else { p })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert!(is_closed(&positions, &triangles));
    }

    #[test]
    fn two_solids_that_share_an_edge_are_not_closed() {
        let mut doubled = TETRAHEDRON.to_vec();
        doubled.extend(TETRAHEDRON);
        assert!(!is_closed(&CORNERS, &doubled));
    }
}
