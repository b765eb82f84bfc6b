//! Axis-aligned boxes and the boxed references that builders sort.

use glam::{Vec3, Vec4, Vec4Swizzles};

/// Marks the reference of an instance of a shared structure; the other bits are its index. Without it they name a triangle.
pub(super) const INSTANCE: u32 = 1 << 31;

/// Rounding in the triangle test shifts corners by a few units in the last place of their coordinates; boxes grow by
/// this share of the largest coordinate so that no ray that meets the shifted triangle misses its box.
pub(super) const PADDING: f32 = 4.0 * f32::EPSILON;

/// An axis-aligned box. Empty if `min > max`. The fourth lanes mean nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) min: Vec4,
    pub(super) max: Vec4,
}

impl Bounds {
    pub(super) const EMPTY: Self = Self { min: Vec4::INFINITY, max: Vec4::NEG_INFINITY };

    /// Smallest box around `points`.
    pub(super) fn of_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points
            .into_iter()
            .fold(Self::EMPTY, |b, p| Self { min: b.min.min(p.extend(0.0)), max: b.max.max(p.extend(0.0)) })
    }

    /// Smallest box around both.
    #[inline]
    pub(super) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Half of the surface area; zero if empty. At most `f32::MAX`, so that huge boxes still compare.
    #[inline]
    pub(super) fn half_area(&self) -> f32 {
        let d = (self.max - self.min).max(Vec4::ZERO);
        (d.x * d.y + d.y * d.z + d.z * d.x).min(f32::MAX)
    }

    /// The box grown by the triangle test's rounding error.
    pub(super) fn padded(self) -> Self {
        let reach = self.min.xyz().abs().max(self.max.xyz().abs()).max_element();
        let pad = Vec4::splat(reach * PADDING);
        Self { min: self.min - pad, max: self.max + pad }
    }

    /// False for empty boxes too.
    pub(super) fn is_finite(&self) -> bool {
        self.min.truncate().is_finite() && self.max.truncate().is_finite()
    }

    /// The eight corners.
    pub(super) fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }
}

/// A box and what is in it, in 32 bytes: the fourth lane of `min` carries the id.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    min: Vec4,
    max: Vec4,
}

impl Reference {
    pub(super) fn new(bounds: Bounds, id: u32) -> Self {
        Self { min: bounds.min.xyz().extend(f32::from_bits(id)), max: bounds.max }
    }

    #[inline]
    pub(super) fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max }
    }

    #[inline]
    pub(super) fn id(&self) -> u32 {
        self.min.w.to_bits()
    }

    /// Twice the box's centre; the fourth lane means nothing.
    #[inline]
    pub(super) fn centre2(&self) -> Vec4 {
        self.min + self.max
    }
}
