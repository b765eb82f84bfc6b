//! The surface of an instance as its lightmap sees it: page coordinate ↔ triangle and barycentrics → surface point.

use super::{Atlas, Layout, SurfacePoint};
use crate::scene::{Mesh, Scene};
use glam::{Mat3, Vec2, Vec3};
use std::ops::{Add, Mul};

/// A point this far (texels) outside a triangle still counts as on it, so that rounding opens no gap between two.
const EDGE_TOLERANCE: f32 = 1e-3;

/// One instance with its place in the atlas.
pub(super) struct Surface<'a> {
    pub(super) scene: &'a Scene,
    pub(super) instance: usize,
    pub(super) mesh: &'a Mesh,
    pub(super) layout: &'a Layout,
    flips: bool,
    /// Turns mesh-space normals into world space, up to length and sign.
    cofactor: Mat3,
}

impl<'a> Surface<'a> {
    /// The surface of `instance`, none if it has no lightmap.
    pub(super) fn new(scene: &'a Scene, atlas: &'a Atlas, instance: usize) -> Option<Self> {
        let layout = atlas.layouts.get(instance)?.as_ref()?;
        let placed = &scene.instances[instance];
        let m = Mat3::from(placed.transform.matrix3);
        let cofactor = Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        let mesh = &scene.meshes[placed.mesh];
        Some(Self { scene, instance, mesh, layout, flips: placed.flips(), cofactor })
    }

    /// Barycentrics (of the 2nd and 3rd corner) of page coordinate `p` in a triangle, none if it lies outside.
    pub(super) fn barycentric(&self, triangle: u32, p: Vec2) -> Option<Vec2> {
        barycentric(self.layout.corners[triangle as usize], p)
    }

    /// Barycentrics of `p`, moved inside the triangle if it lies slightly outside; its middle if it has no area.
    pub(super) fn nearest(&self, triangle: u32, p: Vec2) -> Vec2 {
        let corners = self.layout.corners[triangle as usize].map(|q| q - p);
        normalised(corner_areas(corners)).unwrap_or(Vec2::splat(1.0 / 3.0))
    }

    /// Change of the barycentrics per texel along x and along y; zero for a triangle without area on its page.
    pub(super) fn barycentric_gradient(&self, triangle: u32) -> [Vec2; 2] {
        let [a, b, c] = self.layout.corners[triangle as usize];
        let (u, v) = (b - a, c - a);
        let doubled = u.perp_dot(v);
        if doubled == 0.0 {
            return [Vec2::ZERO; 2];
        }
        [Vec2::new(v.y, -u.y) / doubled, Vec2::new(-v.x, u.x) / doubled]
    }

    /// World area (m²) of the triangle's surface in one texel's square; zero if it has no area on its page.
    pub(super) fn area_per_texel(&self, triangle: u32) -> f32 {
        let [a, b, c] = self.layout.corners[triangle as usize].map(|q| q.as_dvec2());
        let texels = (b - a).perp_dot(c - a).abs();
        let [a, b, c] = self.scene.corners(self.instance, triangle as usize);
        let world = f64::from((b - a).cross(c - a).length());
        if texels > 0.0 { (world / texels) as f32 } else { 0.0 }
    }

    /// The surface point at barycentrics of the 2nd and 3rd corner.
    pub(super) fn point(&self, triangle: u32, barycentric: Vec2) -> SurfacePoint {
        self.face(triangle).point(barycentric)
    }

    /// A triangle with all that its points need.
    pub(super) fn face(&self, triangle: u32) -> Face {
        let corners = self.scene.corners(self.instance, triangle as usize);
        Face {
            outline: self.layout.corners[triangle as usize],
            corners,
            normals: self.mesh.triangles[triangle as usize].map(|v| self.mesh.normals[v as usize]),
            geometric_normal: self.front(corners),
            cofactor: self.cofactor,
        }
    }

    /// Unit normal of the front face of a triangle with world-space corners in mesh order, zero if it is degenerate.
    fn front(&self, [a, b, c]: [Vec3; 3]) -> Vec3 {
        let n = (b - a).cross(c - a).normalize_or_zero();
        if self.flips { -n } else { n }
    }
}

/// One triangle of a surface.
pub(super) struct Face {
    /// Page coordinates of its corners.
    outline: [Vec2; 3],
    /// World-space corners.
    corners: [Vec3; 3],
    /// Mesh-space normals.
    normals: [Vec3; 3],
    geometric_normal: Vec3,
    cofactor: Mat3,
}

impl Face {
    /// Its point at page coordinate `p`, none if that lies outside.
    pub(super) fn at(&self, p: Vec2) -> Option<SurfacePoint> {
        barycentric(self.outline, p).map(|b| self.point(b))
    }

    /// Its point at barycentrics of the 2nd and 3rd corner.
    fn point(&self, barycentric: Vec2) -> SurfacePoint {
        SurfacePoint {
            position: weighted(self.corners, barycentric),
            geometric_normal: self.geometric_normal,
            shading_normal: on_side_of(self.geometric_normal, self.cofactor * weighted(self.normals, barycentric)),
        }
    }
}

/// The mean of three by barycentrics of the 2nd and 3rd.
fn weighted<T: Copy + Mul<f32, Output = T> + Add<Output = T>>([a, b, c]: [T; 3], barycentric: Vec2) -> T {
    a * (1.0 - barycentric.x - barycentric.y) + b * barycentric.x + c * barycentric.y
}

/// Barycentrics (of the 2nd and 3rd corner) of `p` in a triangle, none if it lies outside.
fn barycentric(outline: [Vec2; 3], p: Vec2) -> Option<Vec2> {
    let corners = outline.map(|q| q - p);
    let areas = corner_areas(corners);
    for (i, area) in areas.into_iter().enumerate() {
        let side = corners[(i + 2) % 3] - corners[(i + 1) % 3];
        if area < 0.0 && area * area > EDGE_TOLERANCE * EDGE_TOLERANCE * side.length_squared() {
            return None;
        }
    }
    normalised(areas)
}

/// `n` as a unit vector on the side of unit vector `side`; `side` itself where `n` is tangential or zero.
pub(super) fn on_side_of(side: Vec3, n: Vec3) -> Vec3 {
    let n = n.normalize_or_zero();
    let cos = n.dot(side);
    if cos.abs() < 1e-4 {
        side
    } else if cos < 0.0 {
        -n
    } else {
        n
    }
}

/// Doubled areas of the triangles that the origin forms with the side opposite to each corner: all positive if the
/// origin lies inside, whichever way the corners wind.
fn corner_areas([a, b, c]: [Vec2; 3]) -> [f32; 3] {
    let sign = (b - a).perp_dot(c - a).signum();
    [b.perp_dot(c) * sign, c.perp_dot(a) * sign, a.perp_dot(b) * sign]
}

/// Barycentrics of the 2nd and 3rd corner from areas, the negative ones taken as zero.
fn normalised(areas: [f32; 3]) -> Option<Vec2> {
    let [a, b, c] = areas.map(|w| w.max(0.0));
    let sum = a + b + c;
    (sum > 0.0).then(|| Vec2::new(b, c) / sum)
}
