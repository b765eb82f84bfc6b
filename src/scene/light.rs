//! Lamps, as the LIGHTKILN_scene contract defines them.

use super::{Profile, Rgb};
use glam::Vec3;
use std::f32::consts::PI;
use std::sync::Arc;

/// Spread below which an area lamp is taken for this wide, radians: its light is a pencil that widens by half a
/// millimetre in a metre.
pub const NARROWEST_SPREAD: f64 = 1e-3;

/// A lamp placed in the world. It shines along `-axes[2]` and occludes nothing.
#[derive(Clone, Debug)]
pub struct Light {
    /// Name of the lamp.
    pub name: String,
    /// Path of its node.
    pub path: String,
    /// Light group.
    pub group: Option<String>,
    /// False: its light passes through everything.
    pub casts_shadows: bool,
    /// Centre, metres.
    pub position: Vec3,
    /// Orthonormal frame X, Y, Z in world space.
    pub axes: [Vec3; 3],
    /// Size and strength.
    pub shape: LightShape,
    /// Measured distribution of a point or spot: its intensity is then that of the strongest direction.
    pub profile: Option<Arc<Profile>>,
    /// The sphere of a point or spot is a disk that faces every receiver, as with Blender's soft falloff.
    pub faces_receivers: bool,
}

/// Shape and radiometric strength. Sizes are in metres in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightShape {
    /// One-sided rectangle spanning X (width) and Y (height).
    Rect {
        /// W/(m²·sr).
        radiance: Rgb,
        /// Width and height.
        size: [f32; 2],
        /// Full angle of the beam, π for Lambertian.
        spread: f32,
    },
    /// One-sided ellipse with diameters along X and Y.
    Disk {
        /// W/(m²·sr).
        radiance: Rgb,
        /// Diameters.
        size: [f32; 2],
        /// Full angle of the beam, π for Lambertian.
        spread: f32,
    },
    /// A sphere, or a point if the radius is zero.
    Point {
        /// W/sr.
        intensity: Rgb,
        /// Radius of the sphere.
        radius: f32,
    },
    /// A sphere whose intensity falls to zero towards the cone's edge.
    Spot {
        /// W/sr on the axis.
        intensity: Rgb,
        /// Radius of the sphere.
        radius: f32,
        /// Half angle of the cone.
        outer_cone_angle: f32,
        /// Share of `1 − cos outer_cone_angle` over which it fades.
        blend: f32,
        /// How it fades.
        falloff: Falloff,
    },
    /// A far disc.
    Sun {
        /// W/m² on a surface that faces it.
        irradiance: Rgb,
        /// Full angle of the disc, radians.
        angle: f32,
    },
}

/// Curve of a spot's intensity from the cone's edge (0) to where the fade ends (1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Falloff {
    /// `3x² − 2x³`, as in Blender and LIGHTKILN_scene.
    #[default]
    Smoothstep,
    /// `x²`, as KHR_lights_punctual recommends.
    Square,
}

/// Radiance of an area lamp at an angle of cosine `cos_theta` to its axis, relative to the same power without a beam:
/// what a grid of slats in front of it lets through. `spread` is the beam's full angle, radians.
pub fn spread_attenuation(cos_theta: f32, spread: f32) -> f32 {
    if spread >= PI {
        return 1.0;
    }
    let cosine = (cos_theta as f64).clamp(1e-9, 1.0);
    spread_attenuation_by_tangent((1.0 - cosine * cosine).sqrt() / cosine, spread)
}

/// As [`spread_attenuation`], by the tangent of the angle to the axis: cosines cannot tell the angles of the narrowest
/// beams apart.
pub fn spread_attenuation_by_tangent(tangent: f64, spread: f32) -> f32 {
    if spread >= PI {
        return 1.0;
    }
    // The denominator is of third order in the spread: it needs more digits than f32 has.
    let half = 0.5 * (spread as f64).max(NARROWEST_SPREAD);
    ((half.tan() - tangent) / (half.tan() - half)).max(0.0) as f32
}

/// Share of a spot's axial intensity that leaves at an angle of cosine `cos_theta` to its axis.
pub fn spot_attenuation(cos_theta: f32, outer_cone_angle: f32, blend: f32, falloff: Falloff) -> f32 {
    let height = cos_theta - outer_cone_angle.cos();
    let range = (1.0 - outer_cone_angle.cos()) * blend;
    if height <= 0.0 {
        return 0.0;
    }
    // A hard edge divides by zero; everything inside it is in full light.
    let x = if height >= range { 1.0 } else { height / range };
    match falloff {
        Falloff::Smoothstep => x * x * (3.0 - 2.0 * x),
        Falloff::Square => x * x,
    }
}
