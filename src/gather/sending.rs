//! Gathers from secondary sources: rays from a texel to points drawn on them.

use super::footprint::Usable;
use super::lit_scene::LitScene;
use super::secondary::Receiver;
use super::source::Source;
use super::tally::Sums;
use crate::accel::{Ray, offset_origin};
use crate::hierarchy::Side;
use crate::math::{Sequence, hash2};
use crate::scene::Rgb;

/// Bounds of the rays of a texel to secondary sources.
const FEWEST_SENT: u32 = 4;
const MOST_SENT: u32 = 256;

/// What secondary sources bring.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arrived {
    /// W/m².
    pub irradiance: Rgb,
    /// Standard error of its mean channel, W/m².
    pub error: f32,
    /// Rays cast.
    pub rays: u32,
}

impl Source<'_> {
    /// What secondary sources bring to a texel: to within about `tolerance`, W/m². Texels of one `set` draw
    /// alike. `groups` gets the same by light group,
    /// and is empty if light is not kept apart.
    pub fn sent_to(&self, usable: &Usable, set: u32, tolerance: f32, groups: &mut [Rgb]) -> Arrived {
        let LitScene { accel, surfels, hierarchy, .. } = self.lit;
        let Some(secondary) = &self.secondary else { return Arrived::default() };
        // The normals of a bent texel are not known one by one: it may see all around.
        let bend = if usable.is_bent { 1.0 } else { 0.0 };
        let receiver = Receiver { position: usable.centre.position, normal: usable.centre.shading_normal, bend };
        let senders = secondary.senders(receiver);
        let total = senders.total();
        if total <= 0.0 {
            return Arrived::default();
        }
        // The error of stratified visibility falls as n^(−3/4).
        let wanted = (0.5 * total / tolerance.max(f32::MIN_POSITIVE)).powf(4.0 / 3.0);
        let (mut sum, mut open, mut blocked) = (Rgb::ZERO, 0, 0);
        // Only of fronts is more known than the element's mean.
        let own = |surfel, side| (side == Side::Front).then_some(surfel);
        let level =
            |surfel, side, element| self.sent(own(surfel, side), element, Rgb::ONE, &mut ()).element_sum() / 3.0;
        let sequence = Sequence::new(hash2(set, 0x5ec0));
        let cast = |i: u32| {
            let Some(sender) = senders.draw(hierarchy, surfels, level, sequence.first(i).x) else { return };
            let from = usable.point(sequence.second(i));
            let normal = hierarchy.normal(surfels, sender.surfel, sender.side);
            let to = offset_origin(surfels.position(sender.surfel), normal);
            let origin = offset_origin(from.position, from.geometric_normal);
            let v = to - origin;
            let distance = v.length();
            let direction = v / distance;
            let (receives, sends) = (from.shading_normal.dot(direction), -normal.dot(direction));
            if receives <= 0.0 || sends <= 0.0 || from.geometric_normal.dot(direction) <= 0.0 {
                return;
            }
            let passed = accel.visibility(&Ray { origin, direction, t_min: 0.0, t_max: distance });
            if passed == Rgb::ZERO {
                blocked += 1;
                return;
            }
            open += 1;
            let factor = receives * sends * sender.area / (distance * distance);
            let surfel = own(sender.surfel, sender.side);
            let radiance = self.sent(surfel, sender.element, passed * factor, &mut Sums(groups));
            sum += passed * radiance * factor;
        };
        let rays = (wanted as u32).clamp(FEWEST_SENT, MOST_SENT);
        (0..rays).for_each(cast);
        groups.iter_mut().for_each(|sum| *sum /= rays as f32);
        let error = if open > 0 && blocked > 0 { 0.5 * total * (rays as f32).powf(-0.75) } else { 0.0 };
        Arrived { irradiance: sum / rays as f32, error, rays }
    }
}
