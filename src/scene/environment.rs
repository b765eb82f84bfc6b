//! Radiance that arrives from outside the scene.

use super::{Rgb, Sky};
use glam::Vec3;
use std::sync::Arc;

/// The sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Environment {
    /// Nothing arrives.
    #[default]
    Black,
    /// The same radiance from everywhere, W/(m²·sr).
    Constant(Rgb),
    /// Radiance that depends on the height of the direction.
    Gradient {
        /// Straight up.
        zenith: Rgb,
        /// At the horizon, from above.
        horizon: Rgb,
        /// Below the horizon.
        ground: Rgb,
    },
    /// A picture all around.
    Image(Arc<Sky>),
}

impl Environment {
    /// Radiance that arrives from unit direction `d` (pointing away from the receiver). Bright regions of a picture are
    /// not in it: they are lamps.
    pub fn radiance(&self, d: Vec3) -> Rgb {
        self.mean_radiance(d, 0.0)
    }

    /// As [`Environment::radiance`], averaged over directions around `d` for a ray that stands for `solid_angle` sr.
    pub fn mean_radiance(&self, d: Vec3, solid_angle: f32) -> Rgb {
        match *self {
            Environment::Image(ref sky) => sky.radiance(d, solid_angle),
            Environment::Black => Rgb::ZERO,
            Environment::Constant(l) => l,
            Environment::Gradient { zenith, horizon, ground } => {
                if d.y > 0.0 {
                    horizon + (zenith - horizon) * d.y
                } else {
                    ground
                }
            }
        }
    }

    /// True if no light comes from it.
    pub fn is_black(&self) -> bool {
        *self == Environment::Black
    }
}
