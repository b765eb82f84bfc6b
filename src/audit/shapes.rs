//! Lamps of the scene as a path meets them: points drawn on them, and rays that cross them. Lamps block nothing.
//!
//! Based on: Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997 (densities per solid angle).

use crate::math::{orthonormal_basis, uniform_disk};
use crate::scene::{Light, LightShape, NARROWEST_SPREAD, Rgb, spot_attenuation, spread_attenuation_by_tangent};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// A direction in which a light was found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// Unit direction from the receiver.
    pub(super) direction: Vec3,
    /// Distance to the light, infinite for what is outside of the scene.
    pub(super) distance: f32,
    /// Radiance by density, W/m² once multiplied by the receiver's cosine.
    pub(super) weight: Rgb,
    /// Density per solid angle with which it was drawn, 1/sr; none if no ray can find it by chance.
    pub(super) density: Option<f32>,
}

/// Where a ray crosses a light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    pub(super) distance: f32,
    /// W/(m²·sr).
    pub(super) radiance: Rgb,
    /// Density with which [`sample`] would have drawn this direction, 1/sr.
    pub(super) density: f32,
}

/// Draws a point of the lamp as seen from `p` by `u` in the unit square.
pub(super) fn sample(light: &Light, p: Vec3, u: Vec2) -> Option<Found> {
    match light.shape {
        LightShape::Rect { radiance, .. } | LightShape::Disk { radiance, .. } => {
            let panel = Panel::new(light)?;
            let q = panel.draw(p, u)?;
            let v = q - p;
            let (distance, facing) = (v.length(), panel.facing(v));
            let density = panel.density(p)? * distance * distance / facing;
            let weight = radiance * (panel.beam(p, q) / density);
            (facing > 0.0).then(|| Found { direction: v / distance, distance, weight, density: Some(density) })
        }
        LightShape::Point { intensity, radius } => Some(sphere(light, intensity, radius, p, u)),
        LightShape::Spot { intensity, radius, outer_cone_angle, blend, falloff } => {
            let away = (p - light.position).normalize_or_zero();
            let beam = spot_attenuation(-light.axes[2].dot(away), outer_cone_angle, blend, falloff);
            (beam > 0.0).then(|| sphere(light, intensity * beam, radius, p, u))
        }
        LightShape::Sun { irradiance, angle } => {
            let (direction, share) = in_cone(light.axes[2], (0.5 * angle).sin(), u);
            Some(Found { direction, distance: f32::INFINITY, weight: irradiance * share, density: None })
        }
    }
}

/// Where the ray from `p` along unit `direction` crosses the lamp; none for lamps that are only ever drawn.
pub(super) fn crossing(light: &Light, p: Vec3, direction: Vec3) -> Option<Crossing> {
    let (LightShape::Rect { radiance, .. } | LightShape::Disk { radiance, .. }) = light.shape else {
        return None;
    };
    let panel = Panel::new(light)?;
    let facing = panel.facing(direction);
    let distance = (panel.centre - p).dot(panel.normal) / direction.dot(panel.normal);
    let q = p + direction * distance;
    let is_crossed = facing > 0.0 && distance > 0.0 && panel.holds(q);
    is_crossed.then_some(())?;
    let density = panel.density(p)? * distance * distance / facing;
    Some(Crossing { distance, radiance: radiance * panel.beam(p, q), density })
}

/// A flat lamp, one-sided.
struct Panel {
    centre: Vec3,
    /// Unit direction in which it shines.
    normal: Vec3,
    /// Unit axes and half sizes along them.
    axes: [Vec3; 2],
    half: Vec2,
    is_round: bool,
    spread: f32,
}

impl Panel {
    fn new(light: &Light) -> Option<Self> {
        let (size, spread, is_round) = match light.shape {
            LightShape::Rect { size, spread, .. } => (size, spread, false),
            LightShape::Disk { size, spread, .. } => (size, spread, true),
            _ => return None,
        };
        let [x, y, z] = light.axes;
        Some(Self {
            centre: light.position,
            normal: -z,
            axes: [x, y],
            half: Vec2::from_array(size) * 0.5,
            is_round,
            spread,
        })
    }

    fn area(&self) -> f32 {
        self.half.x * self.half.y * if self.is_round { PI } else { 4.0 }
    }

    /// Cosine at the lamp of the ray along `v` that comes towards it.
    fn facing(&self, v: Vec3) -> f32 {
        -self.normal.dot(v.normalize_or_zero())
    }

    /// Where on the lamp's plane `p` lies, in metres along the axes.
    fn place(&self, p: Vec3) -> Vec2 {
        Vec2::new(self.axes[0].dot(p - self.centre), self.axes[1].dot(p - self.centre))
    }

    fn holds(&self, q: Vec3) -> bool {
        let s = self.place(q) / self.half;
        if self.is_round { s.length_squared() <= 1.0 } else { s.abs().max_element() <= 1.0 }
    }

    /// What the beam leaves of the radiance from `q` towards `p`.
    fn beam(&self, p: Vec3, q: Vec3) -> f32 {
        let height = (p - self.centre).dot(self.normal);
        spread_attenuation_by_tangent(f64::from((self.place(q) - self.place(p)).length() / height), self.spread)
    }

    /// Radius on the lamp's plane, around the foot of `p`, from which its beam reaches `p`; infinite without a beam.
    fn reach(&self, p: Vec3) -> f32 {
        if self.spread >= PI {
            return f32::INFINITY;
        }
        (p - self.centre).dot(self.normal) * (0.5 * self.spread.max(NARROWEST_SPREAD as f32)).tan()
    }

    /// Density per area of the points that are drawn for `p`: over the lamp, or over the beam's circle where that is
    /// smaller. None where nothing is drawn.
    fn density(&self, p: Vec3) -> Option<f32> {
        let reach = self.reach(p);
        let area = (PI * reach * reach).min(self.area());
        (reach > 0.0 && area > 0.0).then(|| 1.0 / area)
    }

    fn draw(&self, p: Vec3, u: Vec2) -> Option<Vec3> {
        let reach = self.reach(p);
        let place = if PI * reach * reach < self.area() {
            self.place(p) + uniform_disk(u) * reach
        } else if self.is_round {
            uniform_disk(u) * self.half
        } else {
            (u * 2.0 - Vec2::ONE) * self.half
        };
        let q = self.centre + self.axes[0] * place.x + self.axes[1] * place.y;
        (reach > 0.0 && self.holds(q)).then_some(q)
    }
}

/// A point of a spherical lamp, or of the disk that faces every receiver. `intensity` holds for the receiver's direction.
fn sphere(light: &Light, intensity: Rgb, radius: f32, p: Vec3, u: Vec2) -> Found {
    let v = light.position - p;
    let centre = v.length().max(1e-6);
    let axis = v / centre;
    let web = light
        .profile
        .as_ref()
        .map_or(1.0, |profile| profile.relative(Vec3::from_array(light.axes.map(|a| a.dot(-axis)))));
    let apparent = if light.faces_receivers { centre.hypot(radius) } else { centre };
    let (direction, share) = in_cone(axis, (radius / apparent).min(1.0), u);
    // The near side of the sphere, or the plane of the disk.
    let cosine = direction.dot(axis);
    let inside = (radius * radius - centre * centre * (1.0 - cosine * cosine)).max(0.0).sqrt();
    let distance = if light.faces_receivers { centre / cosine.max(1e-3) } else { (centre * cosine - inside).max(0.0) };
    let weight = intensity * (web * share / (apparent * apparent));
    Found { direction, distance, weight, density: None }
}

/// Direction in the cone around `axis` with the given sine, uniform in solid angle, and its solid angle as a share of
/// what projects to the same disk, π·sine².
fn in_cone(axis: Vec3, sine: f32, u: Vec2) -> (Vec3, f32) {
    let share = 2.0 / (1.0 + (1.0 - sine * sine).max(0.0).sqrt());
    // One less the cosine, from the disk's radius: without the cancellation of small angles.
    let disk = uniform_disk(u);
    let height = 0.5 * disk.length_squared() * sine * sine * share;
    let radius = (height * (2.0 - height)).max(0.0).sqrt();
    let (x, y) = orthonormal_basis(axis);
    let around = disk.normalize_or_zero() * radius;
    (x * around.x + y * around.y + axis * (1.0 - height), share)
}
