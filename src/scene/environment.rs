//! Radiance that arrives from outside the scene.

use super::Rgb;
use glam::Vec3;

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
}

impl Environment {
    /// Radiance that arrives from unit direction `d` (pointing away from the receiver).
    pub fn radiance(&self, d: Vec3) -> Rgb {
        match *self {
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
