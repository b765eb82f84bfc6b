//! The scene as light falls on it, and which of its texels receive apart from their element.

use super::direct::Direct;
use super::emitters::Emission;
use super::footprint::Footprint;
use super::tally::Grouped;
use super::visibility::Lamps;
use crate::accel::{Accel, Hit};
use crate::atlas::Atlas;
use crate::hierarchy::{Hierarchy, Side, Surfels};
use crate::scene::{Group, LightGroups, Rgb};
use rayon::prelude::*;

/// Everything that says what leaves the scene's surfaces, but for the irradiance of elements.
#[derive(Clone, Copy)]
pub struct LitScene<'a> {
    /// Ray queries.
    pub accel: &'a Accel<'a>,
    /// Where texels lie.
    pub atlas: &'a Atlas,
    /// Texels and patches without a lightmap.
    pub surfels: &'a Surfels<'a>,
    /// Elements and their clusters.
    pub hierarchy: &'a Hierarchy,
    /// Which emission rays meet.
    pub emission: &'a Emission,
    /// Which part of texels is open.
    pub footprint: &'a Footprint<'a>,
    /// What sends light to single points.
    pub lamps: &'a Lamps<'a>,
    /// Light straight from lamps per texel.
    pub direct: &'a Direct,
    /// Irradiance of every element straight from lamps, W/m².
    pub element_direct: &'a [Rgb],
    /// The same by light group.
    pub element_direct_groups: &'a Grouped,
    /// Groups by which light is kept apart.
    pub groups: &'a LightGroups,
    /// Texels that something stands on while their element lies partly open, ascending: they do not share in what the
    /// element receives and are receivers of their own, numbered on from the elements.
    pub shut: &'a [u32],
}

/// The shut texels of a scene.
pub fn shut_texels(surfels: &Surfels, hierarchy: &Hierarchy) -> Vec<u32> {
    let is_shut = |&s: &u32| {
        surfels.is_covered(s) && hierarchy.element_of(s, Side::Front).is_some_and(|e| hierarchy.is_open(surfels, e))
    };
    (0..surfels.texels.len() as u32).into_par_iter().filter(is_shut).collect()
}

impl LitScene<'_> {
    /// Light group of what the surface at a hit emits.
    pub(super) fn emitter_group(&self, hit: &Hit) -> Group {
        let scene = self.accel.scene();
        let instance = hit.instance as usize;
        let mesh = &scene.meshes[scene.instances[instance].mesh];
        self.groups.of_emitter(instance, mesh.primitive_index(hit.triangle as usize))
    }

    /// The receiver of a shut texel.
    pub(super) fn shut_receiver(&self, surfel: u32) -> Option<u32> {
        if !self.surfels.is_covered(surfel) {
            return None;
        }
        let index = self.shut.binary_search(&surfel).ok()?;
        Some((self.hierarchy.elements.len() + index) as u32)
    }
}
