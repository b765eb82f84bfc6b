//! What surfaces reflect, kept apart by light group: the same as [`super::source::Source`] holds of the whole.

use super::lit_scene::LitScene;
use super::source::{open_part, reflected};
use super::tally::Grouped;
use crate::hierarchy::Side;
use crate::scene::Rgb;
use half::f16;
use rayon::prelude::*;

/// Reflected radiance by light group, W/(m²·sr); groups stand side by side.
#[derive(Default)]
pub(super) struct Parts {
    groups: usize,
    front: Vec<[f16; 3]>,
    elements: Vec<[f16; 3]>,
}

impl Parts {
    /// `rest` is the irradiance of every receiver from everything but lamps, W/m².
    pub(super) fn new(lit: &LitScene, rest: &Grouped) -> Self {
        let LitScene { surfels, hierarchy, footprint, .. } = *lit;
        let groups = lit.groups.len();
        if groups == 0 {
            return Self::default();
        }
        let half = |v: Rgb| v.to_array().map(f16::from_f32);
        let mut front = vec![[f16::ZERO; 3]; surfels.len() * groups];
        front.par_chunks_mut(groups).enumerate().for_each(|(s, row)| {
            let Some(e) = hierarchy.element_of(s as u32, Side::Front) else { return };
            let (own, share) = match lit.direct.irradiance.get(s) {
                Some(_) => (lit.direct.groups.of(s), 1.0 / open_part(footprint.open()[s])),
                None => (lit.element_direct_groups.of(e as usize), 1.0),
            };
            let receiver = lit.shut_receiver(s as u32).unwrap_or(e);
            for ((out, &own), &rest) in row.iter_mut().zip(own).zip(rest.of(receiver as usize)) {
                *out = half(reflected(surfels, s as u32, own * share + rest));
            }
        });
        let mut elements = vec![[f16::ZERO; 3]; hierarchy.elements.len() * groups];
        elements.par_chunks_mut(groups).zip(&hierarchy.elements).enumerate().for_each(|(i, (row, element))| {
            let area: f32 = element.surfels.clone().map(|s| surfels.area(s)).sum();
            for (g, out) in row.iter_mut().enumerate() {
                let own = lit.element_direct_groups.of(i)[g] + rest.of(i)[g];
                let sent = |s: u32| match element.side {
                    Side::Front => Rgb::from_array(front[s as usize * groups + g].map(f16::to_f32)),
                    Side::Back => reflected(surfels, s, own),
                };
                let sum: Rgb = element.surfels.clone().map(|s| sent(s) * surfels.area(s)).sum();
                *out = half(sum / area.max(f32::MIN_POSITIVE));
            }
        });
        Self { groups, front, elements }
    }

    /// Of the front of a surfel.
    pub(super) fn front(&self, surfel: u32) -> &[[f16; 3]] {
        &self.front[surfel as usize * self.groups..(surfel as usize + 1) * self.groups]
    }

    /// Of an element.
    pub(super) fn element(&self, element: u32) -> &[[f16; 3]] {
        &self.elements[element as usize * self.groups..(element as usize + 1) * self.groups]
    }
}
