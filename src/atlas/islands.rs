//! UV islands: triangles that are connected through a shared edge of a texture coordinate set.

use crate::scene::Mesh;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// The islands of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Islands {
    /// Island of every triangle, numbered from 0 by first triangle.
    pub(super) of: Vec<u32>,
    /// How many there are.
    pub(super) count: usize,
}

/// The islands of a mesh in one of its texture coordinate sets.
///
/// Two triangles share an edge if both its ends agree exactly in `uv` (one per vertex) and in position; vertices that
/// were split for normals or other sets do not separate an island.
pub(super) fn islands(mesh: &Mesh, uv: &[Vec2]) -> Islands {
    let mut numbers = CornerNumbers::default();
    let corner: Vec<u32> = uv.iter().zip(&mesh.positions).map(|(&uv, &p)| numbers.number(uv, p)).collect();
    let mut sets = DisjointSets::new(mesh.triangles.len());
    let mut first_at = HashMap::with_capacity(mesh.triangles.len() * 2);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for edge in edges(triangle.map(|v| corner[v as usize])) {
            let first = *first_at.entry(edge).or_insert(t as u32);
            sets.union(first, t as u32);
        }
    }
    sets.numbered()
}

/// Numbers corners so that two have the same number exactly if they agree in texture coordinate and position.
#[derive(Default)]
pub(super) struct CornerNumbers {
    known: HashMap<[u32; 5], u32>,
}

impl CornerNumbers {
    /// Number of a corner.
    pub(super) fn number(&mut self, uv: Vec2, p: Vec3) -> u32 {
        let next = self.known.len() as u32;
        // Adding zero makes −0 and 0 the same.
        *self.known.entry([uv.x, uv.y, p.x, p.y, p.z].map(|c| (c + 0.0).to_bits())).or_insert(next)
    }
}

/// The three edges of a triangle, each with its smaller corner first.
pub(super) fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[from, to]| [from.min(to), from.max(to)])
}

/// Union-find over `0..n` (Tarjan 1975); the smallest member represents its set.
struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let grandparent = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = grandparent;
            i = grandparent;
        }
        i
    }

    fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Set number of every element, counted by smallest member.
    fn numbered(mut self) -> Islands {
        let mut number = vec![0; self.parent.len()];
        let mut count = 0;
        for i in 0..self.parent.len() as u32 {
            let root = self.find(i);
            if root == i {
                number[i as usize] = count;
                count += 1;
            } else {
                number[i as usize] = number[root as usize];
            }
        }
        Islands { of: number, count: count as usize }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of three quads, each a pair of triangles with vertices of its own.
    fn strip(uv_of: impl Fn(usize, Vec2) -> Vec2) -> (Mesh, Vec<Vec2>) {
        let mut mesh = Mesh::default();
        let mut uv = Vec::new();
        for quad in 0..3 {
            let base = mesh.positions.len() as u32;
            for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                let p = Vec2::new(quad as f32 + x, y);
                mesh.positions.push(p.extend(0.0));
                uv.push(uv_of(quad, p));
            }
            mesh.triangles.push([base, base + 1, base + 2]);
            mesh.triangles.push([base, base + 2, base + 3]);
        }
        (mesh, uv)
    }

    #[test]
    fn split_vertices_stay_connected_where_uv_and_position_agree() {
        let (mesh, uv) = strip(|_, p| p);
        assert_eq!(islands(&mesh, &uv), Islands { of: vec![0; 6], count: 1 });
    }

    #[test]
    fn a_gap_in_uv_separates() {
        let (mesh, uv) = strip(|quad, p| if quad == 1 { p + Vec2::Y } else { p });
        assert_eq!(islands(&mesh, &uv), Islands { of: vec![0, 0, 1, 1, 2, 2], count: 3 });
    }

    #[test]
    fn equal_uv_at_different_places_separates() {
        let (mesh, uv) = strip(|quad, p| p - Vec2::X * quad as f32);
        assert_eq!(islands(&mesh, &uv).count, 3);
    }

    #[test]
    fn no_triangles_have_no_island() {
        assert_eq!(islands(&Mesh::default(), &[]).count, 0);
    }
}
