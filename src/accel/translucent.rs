//! Surfaces that light goes straight through in part: what of it passes, and how a ray goes on behind them.

use super::{Accel, Hit, Ray};
use crate::scene::{AlphaMode, Rgb, Scene};

/// Surfaces closer to each other than this share of their distance from the ray's origin count as one.
const APART: f32 = 4e-6;

/// True if light goes through any surface in part.
pub(super) fn any(scene: &Scene) -> bool {
    scene.materials.iter().any(|m| m.alpha_mode == AlphaMode::Blend || m.transmission > 0.0)
}

impl Accel<'_> {
    /// Translucent surfaces in a row from which on a ray need not be followed.
    pub const MOST_LAYERS: u32 = 16;

    /// Share of light, per channel, that travels the whole segment: 0 or 1 but for translucent surfaces, see
    /// [`Accel::transmittance`].
    pub fn visibility(&self, ray: &Ray) -> Rgb {
        if self.translucent {
            self.transmittance(ray)
        } else if self.occluded(ray) {
            Rgb::ZERO
        } else {
            Rgb::ONE
        }
    }

    /// Share of light, per channel, that goes straight through the surface at `hit`; none if it is opaque.
    pub fn transmission_at(&self, hit: &Hit) -> Option<Rgb> {
        if !self.translucent {
            return None;
        }
        let (mesh, triangle) = (self.scene.instances[hit.instance as usize].mesh, hit.triangle as usize);
        let material = self.scene.material_of(mesh, triangle);
        let passes = material.alpha_mode == AlphaMode::Blend || material.transmission > 0.0;
        passes.then(|| self.scene.transmittance_at(mesh, triangle, hit.barycentric))
    }

    /// What is left of `ray` behind `hit`.
    pub fn behind(&self, ray: &Ray, hit: &Hit) -> Ray {
        Ray { t_min: hit.t * (1.0 + APART), ..*ray }
    }
}
