//! Takes apart charts that lie upon themselves, as folded parametrisations and mirrored texture coordinates do.

use super::coverage::cover;
use super::islands::CornerNumbers;
use glam::{DVec2, Vec2, Vec3};
use std::collections::{HashMap, VecDeque};

/// What rounding may add to a cell that is covered once.
const EXCESS: f32 = 1.0 + 1e-2;

/// Parts of a chart of which none lies upon itself, each a list of the chart's triangles, connected through edges. The
/// whole chart if it does not. Overlap is found on a grid finer than the chart's triangles.
pub(super) fn without_overlap(world: &[[Vec3; 3]], flat: &[[Vec2; 3]]) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..flat.len()).collect();
    if flat.len() == 1 {
        return vec![all];
    }
    let mut grid = Grid::new(flat);
    if all.iter().all(|&t| grid.try_add(t)) {
        return vec![all];
    }
    grid.clear();

    let neighbours = neighbours(world, flat);
    let mut taken = vec![false; flat.len()];
    let mut parts = Vec::new();
    for seed in 0..flat.len() {
        if taken[seed] {
            continue;
        }
        // Grow over edges; what would lie upon the part is left to a later one.
        let mut part = Vec::new();
        let mut queue = VecDeque::from([seed]);
        while let Some(t) = queue.pop_front() {
            if taken[t] || !(grid.try_add(t) || t == seed) {
                continue;
            }
            taken[t] = true;
            part.push(t);
            queue.extend(neighbours[t].iter().filter(|&&n| !taken[n]));
        }
        part.sort_unstable();
        parts.push(part);
        grid.clear();
    }
    parts
}

/// Triangles that share an edge with each triangle.
fn neighbours(world: &[[Vec3; 3]], flat: &[[Vec2; 3]]) -> Vec<Vec<usize>> {
    let mut numbers = CornerNumbers::default();
    let mut at_edge: HashMap<[u32; 2], Vec<usize>> = HashMap::new();
    for (t, (p, uv)) in world.iter().zip(flat).enumerate() {
        let corners = [0, 1, 2].map(|k| numbers.number(uv[k], p[k]));
        for edge in super::islands::edges(corners) {
            at_edge.entry(edge).or_default().push(t);
        }
    }
    let mut neighbours = vec![Vec::new(); flat.len()];
    for triangles in at_edge.values() {
        for &t in triangles {
            neighbours[t].extend(triangles.iter().filter(|&&n| n != t));
        }
    }
    // The map has no order, the result must.
    neighbours.iter_mut().for_each(|n| n.sort_unstable());
    neighbours
}

/// Coverage of the chart's bounding box in square cells.
struct Grid {
    corners: Vec<[DVec2; 3]>,
    width: u32,
    height: u32,
    coverage: Vec<f32>,
    touched: Vec<usize>,
    cells: Vec<(usize, f32)>,
}

impl Grid {
    fn new(flat: &[[Vec2; 3]]) -> Self {
        let all = || flat.iter().flatten();
        let low = all().fold(Vec2::INFINITY, |m, &c| m.min(c));
        let high = all().fold(Vec2::NEG_INFINITY, |m, &c| m.max(c));
        let extent = (high - low).as_dvec2().max(DVec2::splat(f64::MIN_POSITIVE));
        let side = (8.0 * (flat.len() as f64).sqrt()).clamp(32.0, 1024.0);
        // About side² cells, whatever the proportions.
        let ratio = (extent.x / extent.y).sqrt().clamp(1.0 / 32.0, 32.0);
        let cells = DVec2::new(side * ratio, side / ratio).ceil();
        let scale = cells / extent;
        Self {
            corners: flat.iter().map(|t| t.map(|c| (c - low).as_dvec2() * scale)).collect(),
            width: cells.x as u32,
            height: cells.y as u32,
            coverage: vec![0.0; (cells.x * cells.y) as usize],
            touched: Vec::new(),
            cells: Vec::new(),
        }
    }

    /// Adds a triangle unless it would cover a cell that is covered already.
    fn try_add(&mut self, triangle: usize) -> bool {
        let Self { corners, width, height, coverage, touched, cells } = self;
        cells.clear();
        let mut free = true;
        cover(corners[triangle], &(0..*width), &(0..*height), |o| {
            let at = (o.y * *width + o.x) as usize;
            free &= coverage[at] + o.area as f32 <= EXCESS;
            cells.push((at, o.area as f32));
        });
        if free {
            for &(at, area) in cells.iter() {
                coverage[at] += area;
                touched.push(at);
            }
        }
        free
    }

    fn clear(&mut self) {
        for at in self.touched.drain(..) {
            self.coverage[at] = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a strip of unit quads folded at x = 2: it runs to the right twice and back again.
    fn folded() -> (Vec<[Vec3; 3]>, Vec<[Vec2; 3]>) {
        let column = |i: usize| [0.0, 1.0, 2.0, 1.0, 0.0_f32][i];
        let (mut world, mut flat) = (Vec::new(), Vec::new());
        for i in 0..4 {
            let at = |i: usize, y: f32| (Vec3::new(i as f32, y, 0.0), Vec2::new(column(i), y));
            let quad = [at(i, 0.0), at(i + 1, 0.0), at(i + 1, 1.0), at(i, 1.0)];
            for t in [[0, 1, 2], [0, 2, 3]] {
                world.push(t.map(|k| quad[k].0));
                flat.push(t.map(|k| quad[k].1));
            }
        }
        (world, flat)
    }

    #[test]
    fn a_fold_is_cut() {
        let (world, flat) = folded();
        assert_eq!(without_overlap(&world, &flat), [vec![0, 1, 2, 3], vec![4, 5, 6, 7]]);
    }

    #[test]
    fn what_does_not_overlap_stays_whole() {
        let (world, flat) = folded();
        assert_eq!(without_overlap(&world[..4], &flat[..4]), [vec![0, 1, 2, 3]]);
        assert_eq!(without_overlap(&world[..1], &flat[..1]), [vec![0]]);
    }

    #[test]
    fn triangles_on_one_place_are_all_kept_apart() {
        let flat = vec![[Vec2::ZERO, Vec2::X, Vec2::Y]; 5];
        let world: Vec<_> = (0..5).map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * i as f32)).collect();
        assert_eq!(without_overlap(&world, &flat).len(), 5);
    }
}
