//! Origins of rays that start on a surface.

use glam::Vec3;

/// Distance to leave, as a share of the largest coordinate. A position that was interpolated or computed from `t` is off
/// its triangle by a few units in the last place of its coordinates (2⁻²³ relative); this is 84 of them.
const RELATIVE: f32 = 1e-5;
/// The coordinate from which on the distance grows, metres: near the world's origin surfaces are left by 10⁻⁵ m.
const NEAR: f32 = 1.0;

/// Moves a surface point along the unit `normal`, just so far that rays into that half space do not meet the surface they
/// start on: 10⁻⁵ · max(1, |x|, |y|, |z|) metres. With such an origin `t_min = 0` is right. Rays *to* a surface point should
/// end at its own offset position, so that both ends stay clear.
pub fn offset_origin(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * (RELATIVE * position.abs().max_element().max(NEAR))
}
