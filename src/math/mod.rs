//! Arithmetic shared by every stage: hashing, low-discrepancy points, directions. Leaf module.

mod direction;
mod distribution;
mod plane;
mod sequence;
mod spherical_rect;
mod subdivision;

pub use direction::{cosine_hemisphere, octahedral, orthonormal_basis, uniform_disk};
pub use distribution::Distribution;
pub use plane::{Known, PlaneFit, nearness};
pub use sequence::{Sequence, hash2, hash3, shifted, shuffled, unit_float};
pub use spherical_rect::SphericalRect;
pub use subdivision::triangle_middles;
