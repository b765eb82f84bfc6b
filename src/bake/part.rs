//! The part of a lightmap that is wanted: all light, what came straight from lamps, or the rest.

use crate::config::LightPart;
use crate::gather::Grouped;
use crate::scene::{LightGroups, Rgb};

impl LightPart {
    /// True if nothing is left out.
    pub(super) fn is_all(self) -> bool {
        self == Self::Combined
    }

    /// Leaves of all light, W/m² per texel, what belongs to this part. `direct` is what came straight from every group of
    /// [`LightGroups::of_lamps`].
    pub(super) fn keep(self, combined: &mut [Rgb], direct: &Grouped) {
        if self.is_all() {
            return;
        }
        for (texel, all) in combined.iter_mut().enumerate() {
            let lamps = direct.of(texel)[usize::from(LightGroups::LAMPS)];
            *all = match self {
                Self::Combined => *all,
                Self::Direct => lamps,
                // The two were added up in another order.
                Self::Indirect => (*all - lamps).max(Rgb::ZERO),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_add_up() {
        let direct = Grouped::from_groups(&[vec![Rgb::splat(2.0)], vec![Rgb::splat(1.0)]]);
        let of = |part: LightPart| {
            let mut light = vec![Rgb::splat(5.0)];
            part.keep(&mut light, &direct);
            light[0].x
        };
        assert_eq!([LightPart::Combined, LightPart::Direct, LightPart::Indirect].map(of), [5.0, 2.0, 3.0]);
    }
}
