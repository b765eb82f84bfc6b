//! Relighting without a ray: what a bake keeps of its solution, and pages of light from it after a change.
//!
//! Light is linear: pages of light groups recombine exactly, all bounces included. A change of reflectance is replayed over
//! the rays that the bake's elements cast; its effect on every patch scales the bounced light of the texels there.

mod changes;
mod codec;
mod combine;
mod file;
mod layout;
mod patches;
mod records;

pub use changes::{Assignment, ChangeError, Changes};
pub use combine::{Relit, relight};
pub use file::{SolutionError, SolutionReader, SolutionWriter, VERSION};
pub use layout::PageLayout;
pub use patches::{LitElements, Patches, Reflector};

use crate::scene::{Environment, LightGroups, LightShape, Rgb, Scene};
use crate::units::Quantity;
use crate::warning::Warning;
use half::f16;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What a solution says about itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Header {
    /// Version of the baker.
    pub version: String,
    /// Hash of the scene.
    pub scene_hash: String,
    /// Facts of the bake's report: `scene`, `settings`, `atlas`.
    pub report: Value,
    /// Settings of the bake.
    pub settings: Value,
    /// File name of the lit scene.
    pub lit_scene: String,
    /// What a texel of the pages means.
    pub quantity: Quantity,
    /// Rings around charts that are filled.
    pub rings: u32,
    /// What can be changed.
    pub known: Known,
}

/// The names that changes may refer to.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Known {
    /// Light groups, by number.
    pub groups: Vec<KnownGroup>,
    /// Lights with the number of their group.
    pub lights: Vec<(String, usize)>,
    /// Materials of the scene, by number.
    pub materials: Vec<KnownMaterial>,
    /// Lamps that gave no light and were left out.
    pub dark: Vec<String>,
}

/// A light group.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct KnownGroup {
    /// Its name.
    pub name: String,
    /// The colour of its lights, largest channel 1; none if they differ.
    pub color: Option<[f32; 3]>,
}

/// A material.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct KnownMaterial {
    /// Its name.
    pub name: String,
    /// Mean reflectance over the texels that show it.
    pub reflectance: [f32; 3],
}

/// The light of one group on one page, one entry per stored texel (see [`PageLayout`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupPage {
    /// Irradiance, W/m².
    pub irradiance: Vec<[f16; 3]>,
    /// Share of it per channel that came straight from lamps, in 255ths.
    pub direct: Vec<[u8; 3]>,
}

impl Known {
    /// Names of the lights in a group.
    pub fn lights_of(&self, group: usize) -> Vec<String> {
        self.lights.iter().filter(|(_, g)| *g == group).map(|(name, _)| name.clone()).collect()
    }

    /// What there is to change in a scene whose materials reflect `reflectance` on average. `warnings` tell of dark lamps.
    pub fn of(scene: &Scene, groups: &LightGroups, reflectance: &[Rgb], warnings: &[Warning]) -> Self {
        let mut lights: Vec<(String, usize)> = Vec::new();
        let mut colors: Vec<Vec<Option<Rgb>>> = vec![Vec::new(); groups.len()];
        let mut note = |name: String, group: usize, strength: Option<Rgb>| {
            colors[group].push(strength.map(|s| s / s.max_element().max(f32::MIN_POSITIVE)));
            if !lights.contains(&(name.clone(), group)) {
                lights.push((name, group));
            }
        };
        if scene.environment != Environment::Black {
            let color = if let Environment::Constant(radiance) = scene.environment { Some(radiance) } else { None };
            note(LightGroups::ENVIRONMENT.into(), groups.of_environment().into(), color);
        }
        for (i, light) in scene.lights.iter().enumerate() {
            note(light.name.clone(), groups.of_light(i).into(), Some(strength(&light.shape)));
        }
        for (i, instance) in scene.instances.iter().enumerate() {
            for (p, primitive) in scene.meshes[instance.mesh].primitives.iter().enumerate() {
                let material = &scene.materials[primitive.material];
                if material.emits() {
                    let plain = material.emission_texture.is_none().then_some(material.emission);
                    note(format!("material:{}", material.name), groups.of_emitter(i, p).into(), plain);
                }
            }
        }
        let groups = groups.names().iter().zip(&colors);
        let materials = scene.materials.iter().zip(reflectance);
        Self {
            groups: groups.map(|(name, c)| KnownGroup { name: name.clone(), color: common(c) }).collect(),
            lights,
            materials: materials
                .map(|(m, r)| KnownMaterial { name: m.name.clone(), reflectance: r.to_array() })
                .collect(),
            dark: warnings.iter().filter(|w| w.code == "dark_light").map(|w| w.place.clone()).collect(),
        }
    }
}

/// Radiance, intensity or irradiance.
fn strength(shape: &LightShape) -> Rgb {
    match *shape {
        LightShape::Rect { radiance, .. } | LightShape::Disk { radiance, .. } => radiance,
        LightShape::Point { intensity, .. } | LightShape::Spot { intensity, .. } => intensity,
        LightShape::Sun { irradiance, .. } => irradiance,
    }
}

/// The colour that all have.
fn common(colors: &[Option<Rgb>]) -> Option<[f32; 3]> {
    let first = (*colors.first()?)?;
    let same = |c: &Option<Rgb>| c.is_some_and(|c| (c - first).abs().max_element() < 1e-3);
    colors.iter().all(same).then(|| first.to_array())
}
