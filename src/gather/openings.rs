//! Finds the openings through which closed places see the sky: rays from every neighbourhood → one portal for each.
//!
//! A neighbourhood is a cell of a coarse grid and a side that surfaces in it face. Its rays end on what encloses it; the
//! box around those ends has the openings in its faces, or near them, so that a pane in such a face looks the same way
//! from everywhere in the neighbourhood. What a portal misses is still met by rays that look all around.

use super::footprint::Footprint;
use super::lamp::{Lamp, Shape};
use super::portal::{MOST_PANES, Pane, Portal};
use crate::accel::{Accel, Ray, offset_origin};
use crate::atlas::SurfacePoint;
use crate::math::{Sequence, cosine_hemisphere, hash2};
use crate::progress::{Cancelled, Progress};
use crate::scene::{Group, Rgb};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Cells of the grid along the scene's longest side.
const CELLS: f32 = 8.0;
/// Rays of a neighbourhood, and how many of them tell that it is no closed place.
const RAYS: usize = 1024;
const TRIAL: usize = 128;
/// Share of rays to the sky from which on a place is not closed.
const OPEN: f32 = 0.35;
/// Rays to the sky by which openings are known well; a cell with fewer asks the cells around.
const ENOUGH: usize = 64;
/// Least margin around the rays of a pane, in sizes of the box: about half of what lies between neighbouring rays.
const MARGIN: f32 = 1.0 / 32.0;
/// Share of the ends of rays beyond each face of the box around a cell.
const BEYOND: f32 = 0.02;
/// Gap, in sizes of the box, across which rays still belong to one opening, unless that makes too many.
const GAP: f32 = 1.0 / 16.0;
/// Share of the view that panes fill from which on rays that look all around find the sky as well.
const WIDE: f32 = 0.5;
/// Texels from which that share is taken.
const ASKED: usize = 32;
/// Marks neighbourhoods without a portal.
const NONE: u32 = u32::MAX;

/// The portals of a scene.
#[derive(Default)]
pub struct Portals {
    grid: Grid,
    /// Portal of every neighbourhood.
    index: Vec<u32>,
    portals: Vec<Lamp>,
    /// Light group of the sky.
    sky: Group,
}

/// A grid over the scene.
#[derive(Clone, Copy, Default)]
struct Grid {
    low: Vec3,
    /// Side of a cell, metres.
    side: f32,
    count: [usize; 3],
}

impl Grid {
    fn new(low: Vec3, high: Vec3) -> Self {
        let size = high - low;
        let side = (size.max_element() / CELLS).max(f32::MIN_POSITIVE);
        Self { low, side, count: (size / side).to_array().map(|n| (n.ceil() as usize).max(1)) }
    }

    fn len(&self) -> usize {
        self.count.iter().product::<usize>() * 6
    }

    /// The cell of a point.
    fn cell(&self, position: Vec3) -> usize {
        let at = (position - self.low) / self.side;
        let [x, y, z] = std::array::from_fn(|i| (at[i].max(0.0) as usize).min(self.count[i] - 1));
        (z * self.count[1] + y) * self.count[0] + x
    }

    /// The neighbourhood of a surface point.
    fn neighbourhood(&self, position: Vec3, normal: Vec3) -> usize {
        let axis = normal.abs().max_position();
        self.cell(position) * 6 + 2 * axis + usize::from(normal[axis] < 0.0)
    }

    /// Place of a cell along each axis.
    fn place(&self, cell: usize) -> [usize; 3] {
        [cell % self.count[0], cell / self.count[0] % self.count[1], cell / self.count[0] / self.count[1]]
    }

    /// Cells between two, counted along the axis that has most.
    fn apart(&self, a: usize, b: usize) -> usize {
        let (a, b) = (self.place(a), self.place(b));
        (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0)
    }
}

/// What the rays of one neighbourhood met.
struct View {
    /// Bounds of the texels that they belong to.
    low: Vec3,
    high: Vec3,
    /// Where rays to the sky began, and where they went.
    escapes: Vec<(Vec3, Vec3)>,
    /// Where the others ended.
    ends: Vec<Vec3>,
}

impl Portals {
    /// Looks for openings around the texels of the scene. `sky` is the light group of what they show.
    pub fn find(
        accel: &Accel,
        footprint: &Footprint,
        texels: u32,
        sky: Group,
        progress: &dyn Progress,
    ) -> Result<Self, Cancelled> {
        let environment = &accel.scene().environment;
        if environment.is_black() || texels == 0 {
            return Ok(Self::default());
        }
        let centre = |t: u32| footprint.centre(t);
        let (low, high) = (0..texels)
            .into_par_iter()
            .map(|t| (centre(t).position, centre(t).position))
            .reduce(|| (Vec3::INFINITY, Vec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let grid = Grid::new(low, high);
        let mut members: Vec<(usize, u32)> = (0..texels)
            .into_par_iter()
            .filter(|&t| !footprint.is_hidden(t))
            .map(|t| (grid.neighbourhood(centre(t).position, centre(t).geometric_normal), t))
            .collect();
        members.par_sort_unstable();
        let groups: Vec<&[(usize, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        let views: Vec<Option<View>> = groups
            .par_iter()
            .map(|group| {
                if progress.is_cancelled() {
                    return Err(Cancelled);
                }
                Ok(View::of_closed(accel, group[0].0 as u32, group.len(), |i| centre(group[i].1)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let closed: Vec<(usize, &View)> =
            groups.iter().zip(&views).filter_map(|(group, view)| Some((group[0].0, view.as_ref()?))).collect();
        let texels_of = groups.iter().zip(&views).filter(|(_, view)| view.is_some()).map(|(group, _)| *group);
        let texels_of: Vec<&[(usize, u32)]> = texels_of.collect();
        let panes: Vec<Vec<Pane>> = closed
            .par_iter()
            .zip(&texels_of)
            .map(|(&(n, view), texels)| {
                let panes = panes(&grid, &closed, n / 6, view);
                let asked = texels.iter().step_by(texels.len().div_ceil(ASKED)).map(|&(_, t)| centre(t));
                if fill(&panes, asked) > WIDE { Vec::new() } else { panes }
            })
            .collect();
        let mut index = vec![NONE; grid.len()];
        let mut portals = Vec::new();
        for ((neighbourhood, _), panes) in closed.into_iter().zip(panes) {
            if panes.is_empty() {
                continue;
            }
            index[neighbourhood] = portals.len() as u32;
            let portal = Portal { panes, environment: environment.clone() };
            portals.push(Lamp { shape: Shape::Portal(portal), casts_shadows: true, group: sky });
        }
        Ok(Self { grid, index, portals, sky })
    }

    /// Light group of what they show.
    pub(super) fn group(&self) -> Group {
        self.sky
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.portals.is_empty()
    }

    /// The portal that lights a surface point with unit normal `normal`, if there is one.
    pub fn at(&self, position: Vec3, normal: Vec3) -> Option<&Lamp> {
        if self.portals.is_empty() {
            return None;
        }
        let i = self.index[self.grid.neighbourhood(position, normal)];
        (i != NONE).then(|| &self.portals[i as usize])
    }
}

/// The panes through which a closed neighbourhood sees the sky: from all rays of its cell or, if few of them reach the
/// sky, of the cells around.
fn panes(grid: &Grid, closed: &[(usize, &View)], cell: usize, own: &View) -> Vec<Pane> {
    let most = grid.count.into_iter().max().unwrap_or(0);
    let mut view = View { escapes: Vec::new(), ends: Vec::new(), ..*own };
    for radius in 0..most {
        for (_, other) in closed.iter().filter(|(n, _)| grid.apart(n / 6, cell) == radius) {
            view.escapes.extend(&other.escapes);
            view.ends.extend(&other.ends);
        }
        if view.escapes.len() >= ENOUGH {
            break;
        }
    }
    let (low, high) = view.enclosure();
    // Wider panes waste rays, missing ones lose light to chance.
    let mut gap = GAP;
    loop {
        let panes = view.panes(low, high, gap);
        if panes.len() <= MOST_PANES {
            return panes;
        }
        gap *= 2.0;
    }
}

/// Share of the view, weighted by the cosine, that panes fill as seen from `points`: the mean.
fn fill(panes: &[Pane], points: impl ExactSizeIterator<Item = SurfacePoint>) -> f32 {
    let count = points.len() as f32;
    let share = |p: SurfacePoint| panes.iter().map(|pane| pane.fill(p.position, p.shading_normal)).sum::<f32>();
    points.map(share).sum::<f32>() / count
}

impl View {
    /// The view from a neighbourhood of `count` texels with these centres, if that is a closed place.
    fn of_closed(accel: &Accel, seed: u32, count: usize, centre: impl Fn(usize) -> SurfacePoint) -> Option<Self> {
        let sequence = Sequence::new(hash2(seed, 0x90a7));
        let low = (0..count).fold(Vec3::INFINITY, |low, i| low.min(centre(i).position));
        let high = (0..count).fold(Vec3::NEG_INFINITY, |high, i| high.max(centre(i).position));
        let mut view = View { low, high, escapes: Vec::new(), ends: Vec::new() };
        for i in 0..RAYS {
            // In an order that spreads the trial over all of them.
            let p = centre(i * 797 % RAYS * count / RAYS);
            let direction = cosine_hemisphere(p.shading_normal, sequence.first(i as u32));
            view.look(accel, &p, direction);
            if (i + 1 == TRIAL || i + 1 == RAYS) && view.escapes.len() as f32 > OPEN * (i + 1) as f32 {
                return None;
            }
        }
        Some(view)
    }

    /// Follows one ray; what is translucent does not stop it.
    fn look(&mut self, accel: &Accel, from: &SurfacePoint, direction: Vec3) {
        if direction.dot(from.geometric_normal) <= 0.0 {
            return;
        }
        let origin = offset_origin(from.position, from.geometric_normal);
        let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        for _ in 0..Accel::MOST_LAYERS {
            let Some(hit) = accel.closest(&ray) else { return self.escapes.push((origin, direction)) };
            if accel.transmission_at(&hit).is_none_or(|through| through == Rgb::ZERO) {
                return self.ends.push(origin + direction * hit.t);
            }
            ray = accel.behind(&ray, &hit);
        }
    }

    /// The box around most ends of rays and all texels.
    fn enclosure(&mut self) -> (Vec3, Vec3) {
        let (mut low, mut high) = (self.low, self.high);
        let skip = (BEYOND * self.ends.len() as f32) as usize;
        for axis in 0..3 {
            self.ends.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
            if let (Some(first), Some(last)) = (self.ends.get(skip), self.ends.iter().rev().nth(skip)) {
                low[axis] = low[axis].min(first[axis]);
                high[axis] = high[axis].max(last[axis]);
            }
        }
        (low, high)
    }

    /// Disjoint panes around the rays that leave the box; one pane where rays are no more than `gap` apart, in sizes of
    /// the box. No more than one to a face if that is 1.
    fn panes(&self, low: Vec3, high: Vec3, gap: f32) -> Vec<Pane> {
        let mut panes = Vec::new();
        for (axis, outward) in (0..3).flat_map(|axis| [(axis, -1.0), (axis, 1.0)]) {
            let plane = if outward < 0.0 { low[axis] } else { high[axis] };
            let (from, to) = (Pane::across(axis, low), Pane::across(axis, high));
            let exits: Vec<Vec2> =
                self.escapes.iter().filter_map(|&(o, d)| exit(o, d, axis, outward, plane, from, to)).collect();
            let clusters = merge(exits.into_iter().map(|p| (p, p, 1)).collect(), gap * (to - from));
            let grown = clusters
                .into_iter()
                .map(|(a, b, hits)| {
                    // As much again as lies between neighbouring rays on either side.
                    let margin = (2.0 * (b - a) / (hits as f32).sqrt()).max(MARGIN * (to - from));
                    ((a - margin).max(from), (b + margin).min(to), hits)
                })
                .collect();
            let disjoint = merge(grown, Vec2::ZERO);
            panes.extend(disjoint.into_iter().map(|(low, high, _)| Pane { axis, outward, plane, low, high }));
        }
        panes
    }
}

/// Where a ray leaves the box, if it does so through that face.
fn exit(o: Vec3, d: Vec3, axis: usize, outward: f32, plane: f32, low: Vec2, high: Vec2) -> Option<Vec2> {
    let slope = d[axis] * outward;
    let depth = (plane - o[axis]) * outward;
    if slope <= 0.0 || depth < 0.0 {
        return None;
    }
    let at = Pane::across(axis, o + d * (depth / slope));
    (at.cmpge(low).all() && at.cmple(high).all()).then_some(at)
}

/// Joins rectangles (with counts) that are no more than `gap` apart, until there are none.
fn merge(mut rects: Vec<(Vec2, Vec2, usize)>, gap: Vec2) -> Vec<(Vec2, Vec2, usize)> {
    let mut i = 0;
    while i < rects.len() {
        let (low, high, hits) = rects[i];
        let touches = |r: &(Vec2, Vec2, usize)| (r.0 - gap).cmple(high).all() && (r.1 + gap).cmpge(low).all();
        match (i + 1..rects.len()).find(|&j| touches(&rects[j])) {
            Some(j) => {
                let other = rects.swap_remove(j);
                rects[i] = (low.min(other.0), high.max(other.1), hits + other.2);
                // What it did not touch before it may touch now.
                i = 0;
            }
            None => i += 1,
        }
    }
    rects
}
