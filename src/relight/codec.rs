//! Numbers as bytes that compress well: differences of neighbours, split into planes of bytes, as OpenEXR's ZIP does.

use half::f16;

/// Appends the four byte planes of the differences between numbers.
pub(super) fn put_integers(out: &mut Vec<u8>, values: impl Iterator<Item = u32> + Clone) {
    for byte in 0..4 {
        let mut last = 0u32;
        out.extend(values.clone().map(|v| {
            let difference = v.wrapping_sub(last).rotate_left(1);
            last = v;
            (difference >> (8 * byte)) as u8
        }));
    }
}

/// Appends the byte planes of the differences between half floats.
pub(super) fn put_halves(out: &mut Vec<u8>, values: impl Iterator<Item = f16> + Clone) {
    for byte in 0..2 {
        let mut last = 0u16;
        out.extend(values.clone().map(|v| {
            let difference = v.to_bits().wrapping_sub(last);
            last = v.to_bits();
            (difference >> (8 * byte)) as u8
        }));
    }
}

/// Appends the differences between bytes.
pub(super) fn put_bytes(out: &mut Vec<u8>, values: impl Iterator<Item = u8>) {
    let mut last = 0u8;
    out.extend(values.map(|v| {
        let difference = v.wrapping_sub(last);
        last = v;
        difference
    }));
}

/// Takes numbers out of what the functions above made. Fails if there are too few.
pub(super) struct Planes<'a>(pub(super) &'a [u8]);

impl<'a> Planes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub(super) fn integers(&mut self, count: usize) -> Option<Vec<u32>> {
        let planes = self.take(count.checked_mul(4)?)?;
        let mut last = 0u32;
        let value = |i: usize| {
            let difference = (0..4).fold(0, |sum, byte| sum | u32::from(planes[byte * count + i]) << (8 * byte));
            last = last.wrapping_add(difference.rotate_right(1));
            last
        };
        Some((0..count).map(value).collect())
    }

    pub(super) fn halves(&mut self, count: usize) -> Option<Vec<f16>> {
        let planes = self.take(count.checked_mul(2)?)?;
        let mut last = 0u16;
        let value = |i: usize| {
            last = last.wrapping_add(u16::from(planes[i]) | u16::from(planes[count + i]) << 8);
            f16::from_bits(last)
        };
        Some((0..count).map(value).collect())
    }

    pub(super) fn bytes(&mut self, count: usize) -> Option<Vec<u8>> {
        let mut last = 0u8;
        let value = |&difference: &u8| {
            last = last.wrapping_add(difference);
            last
        };
        Some(self.take(count)?.iter().map(value).collect())
    }

    /// True if nothing is left.
    pub(super) fn is_done(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        let integers = [5, 4, u32::MAX, 0, 1 << 31, 7];
        let halves = [1.0, -0.5, 65504.0, 0.0].map(f16::from_f32);
        let bytes = [0, 255, 3, 3];
        let mut out = Vec::new();
        put_integers(&mut out, integers.into_iter());
        put_halves(&mut out, halves.into_iter());
        put_bytes(&mut out, bytes.into_iter());
        let mut planes = Planes(&out);
        assert_eq!(planes.integers(6).as_deref(), Some(&integers[..]));
        assert_eq!(planes.halves(4).as_deref(), Some(&halves[..]));
        assert_eq!(planes.bytes(4).as_deref(), Some(&bytes[..]));
        assert!(planes.is_done() && planes.bytes(1).is_none());
    }
}
