//! Exact coverage: triangle in page coordinates → the texels it overlaps, with area and centroid of each overlap.
//!
//! The triangle is cut along texel rows, each strip along texel columns (Sutherland, Hodgman, "Reentrant Polygon
//! Clipping", 1974). Areas are in texels, so a wholly covered texel has area 1.

use glam::DVec2;
use std::ops::Range;

/// A texel that a triangle overlaps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overlap {
    /// Texel column.
    pub(super) x: u32,
    /// Texel row.
    pub(super) y: u32,
    /// Area of the overlap, 0..=1.
    pub(super) area: f64,
    /// Centroid of the overlap relative to the texel's corner, 0..=1.
    pub(super) centroid: DVec2,
}

/// Calls `emit` for every texel in columns `x` and rows `y` that the triangle overlaps with positive area, row by row.
/// Corners may lie anywhere and wind either way; non-finite ones overlap nothing.
pub(super) fn cover(corners: [DVec2; 3], x: &Range<u32>, y: &Range<u32>, mut emit: impl FnMut(Overlap)) {
    if x.is_empty() || y.is_empty() || !corners.iter().all(|c| c.is_finite()) {
        return;
    }
    let mut rest = Polygon::triangle(corners);
    rest = rest.split(1, f64::from(y.start)).1.split(1, f64::from(y.end)).0;
    rest = rest.split(0, f64::from(x.start)).1.split(0, f64::from(x.end)).0;
    if rest.len < 3 {
        return;
    }
    let (low, high) = rest.extent(1);
    for row in low.floor() as u32..(high.ceil() as u32).min(y.end) {
        let (strip, above) = rest.split(1, f64::from(row + 1));
        rest = above;
        cover_strip(strip, row, x.end, &mut emit);
    }
}

/// Covers the texels of one row with a polygon that lies within that row.
fn cover_strip(strip: Polygon, row: u32, columns_end: u32, emit: &mut impl FnMut(Overlap)) {
    if strip.len < 3 {
        return;
    }
    let (left, right) = strip.extent(0);
    let end = (right.ceil() as u32).min(columns_end);
    let mut column = left.floor() as u32;
    let whole = strip.whole_columns(row);
    let mut rest = strip;
    while column < end {
        if whole.contains(&column) {
            for x in whole.clone() {
                emit(Overlap { x, y: row, area: 1.0, centroid: DVec2::splat(0.5) });
            }
            rest = rest.split(0, f64::from(whole.end)).1;
            column = whole.end;
            continue;
        }
        let (cell, beyond) = rest.split(0, f64::from(column + 1));
        rest = beyond;
        let (area, centroid) = cell.area_and_centroid(DVec2::new(f64::from(column), f64::from(row)));
        if area > 0.0 {
            emit(Overlap { x: column, y: row, area: area.min(1.0), centroid });
        }
        column += 1;
    }
}

/// A convex polygon of at most eight corners: a triangle has three, and each of four cuts adds at most one.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec2; 8],
    len: usize,
}

impl Polygon {
    fn empty() -> Self {
        Self { corners: [DVec2::ZERO; 8], len: 0 }
    }

    fn triangle(corners: [DVec2; 3]) -> Self {
        let mut p = Self::empty();
        corners.into_iter().for_each(|c| p.push(c));
        p
    }

    fn push(&mut self, corner: DVec2) {
        // Rounding can add a corner to a sliver, never more than the array's slack; a sliver loses nothing by it.
        if self.len < self.corners.len() {
            self.corners[self.len] = corner;
            self.len += 1;
        }
    }

    fn corners(&self) -> &[DVec2] {
        &self.corners[..self.len]
    }

    /// Smallest and largest coordinate on `axis`.
    fn extent(&self, axis: usize) -> (f64, f64) {
        self.corners().iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), c| (lo.min(c[axis]), hi.max(c[axis])))
    }

    /// The parts at or below and at or above `at` on `axis`. Cut corners lie exactly at `at`.
    fn split(&self, axis: usize, at: f64) -> (Self, Self) {
        let (mut below, mut above) = (Self::empty(), Self::empty());
        for (i, &a) in self.corners().iter().enumerate() {
            let b = self.corners[(i + 1) % self.len];
            let (da, db) = (a[axis] - at, b[axis] - at);
            if da <= 0.0 {
                below.push(a);
            }
            if da >= 0.0 {
                above.push(a);
            }
            if (da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0) {
                let mut cut = a + (b - a) * (da / (da - db));
                cut[axis] = at;
                below.push(cut);
                above.push(cut);
            }
        }
        (below, above)
    }

    /// Columns whose square in `row` lies wholly inside; the polygon is a strip within that row.
    fn whole_columns(&self, row: u32) -> Range<u32> {
        // A convex polygon holds a square if it holds the square's lower and upper side.
        let side = |y: f64| {
            self.corners()
                .iter()
                .filter(|c| c.y == y)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), c| (lo.min(c.x), hi.max(c.x)))
        };
        let (lower, upper) = (side(f64::from(row)), side(f64::from(row + 1)));
        let (start, end) = (lower.0.max(upper.0).ceil(), lower.1.min(upper.1).floor());
        if start < end { start as u32..end as u32 } else { 0..0 }
    }

    /// Area, and centroid relative to `origin`.
    fn area_and_centroid(&self, origin: DVec2) -> (f64, DVec2) {
        if self.len < 3 {
            return (0.0, DVec2::ZERO);
        }
        // Fan of triangles around the first corner; doubled areas are summed.
        let (mut area, mut moment) = (0.0, DVec2::ZERO);
        let first = self.corners[0] - origin;
        for pair in self.corners()[1..].windows(2) {
            let (a, b) = (pair[0] - origin, pair[1] - origin);
            let doubled = (a - first).perp_dot(b - first).abs();
            area += doubled;
            moment += (first + a + b) / 3.0 * doubled;
        }
        if area <= 0.0 {
            return (0.0, DVec2::ZERO);
        }
        (area * 0.5, (moment / area).clamp(DVec2::ZERO, DVec2::ONE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Overlaps of a triangle with a 16 × 16 page.
    fn overlaps(corners: [(f64, f64); 3]) -> Vec<Overlap> {
        let mut all = Vec::new();
        cover(corners.map(|(x, y)| DVec2::new(x, y)), &(0..16), &(0..16), |o| all.push(o));
        all
    }

    fn area(overlaps: &[Overlap]) -> f64 {
        overlaps.iter().map(|o| o.area).sum()
    }

    #[test]
    fn areas_add_up_to_the_triangle_whichever_way_it_winds() {
        let t = [(1.3, 2.1), (14.7, 5.9), (3.3, 15.2)];
        let exact = 0.5 * ((14.7 - 1.3) * (15.2 - 2.1) - (5.9 - 2.1) * (3.3 - 1.3_f64)).abs();
        assert!((area(&overlaps(t)) - exact).abs() < 1e-9);
        assert!((area(&overlaps([t[0], t[2], t[1]])) - exact).abs() < 1e-9);
    }

    #[test]
    fn centroids_add_up_to_the_triangle_s() {
        let t = [(0.2, 0.7), (9.1, 3.3), (4.4, 12.8)];
        let all = overlaps(t);
        let sum =
            all.iter().fold(DVec2::ZERO, |s, o| s + (DVec2::new(f64::from(o.x), f64::from(o.y)) + o.centroid) * o.area);
        let exact = DVec2::new((0.2 + 9.1 + 4.4) / 3.0, (0.7 + 3.3 + 12.8) / 3.0);
        assert!((sum / area(&all) - exact).length() < 1e-9);
    }

    #[test]
    fn a_right_triangle_on_the_grid_covers_each_texel_once() {
        let all = overlaps([(2.0, 2.0), (6.0, 2.0), (2.0, 6.0)]);
        assert_eq!(all.len(), 10);
        assert_eq!(all.iter().filter(|o| o.area == 1.0).count(), 6);
        assert!(all.iter().all(|o| o.area >= 0.5 - 1e-12));
    }

    #[test]
    fn only_the_part_inside_the_window_counts() {
        assert!((area(&overlaps([(-100.0, -100.0), (1e6, -100.0), (-100.0, 1e6)])) - 256.0).abs() < 1e-6);
        assert!(overlaps([(-3.0, 0.0), (-1.0, 0.0), (-1.0, 5.0)]).is_empty());
        assert!(overlaps([(f64::NAN, 0.0), (1.0, 0.0), (1.0, 5.0)]).is_empty());
        assert!(overlaps([(1.0, 1.0), (5.0, 5.0), (9.0, 9.0)]).is_empty());
    }
}
