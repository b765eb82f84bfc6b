//! From the scene file to what is lit: scene, light groups, layout, texels.

use super::BakeError;
use super::groups::too_many;
use crate::atlas::{self, Atlas, Texels};
use crate::config::Settings;
use crate::document::Document;
use crate::import::{self, ImportError};
use crate::output::checkpoint::Key;
use crate::output::identity::scene_hash;
use crate::output::report::StageClock;
use crate::progress::{Progress, Stage};
use crate::scene::{LightGroups, Rgb, Scene};
use crate::warning::Warning;
use std::path::Path;

/// A scene as it is to be lit.
pub(super) struct Loaded {
    pub(super) scene: Scene,
    /// The file, for the lit copy.
    pub(super) document: Document,
    /// Hash of the file and of all that it refers to.
    pub(super) hash: String,
    /// Groups by which its light is kept apart.
    pub(super) groups: LightGroups,
    /// Faults that the bake goes on after.
    pub(super) warnings: Vec<Warning>,
}

/// Where its texels lie.
pub(super) struct LaidOut {
    pub(super) atlas: Atlas,
    pub(super) texels: Texels,
    /// Tells layouts apart.
    pub(super) fingerprint: u32,
}

impl Loaded {
    /// Reads the scene in `path`.
    pub(super) fn read(
        path: &Path,
        settings: &Settings,
        clock: &StageClock,
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let (imported, hash) = clock.measure(Stage::Import, || {
            let imported = import::load(path, &settings.import, progress)?;
            let hash = scene_hash(&imported.document);
            Ok::<_, ImportError>((imported, hash))
        })?;
        let (mut scene, document, mut warnings) = (imported.scene, imported.document, imported.warnings);
        let groups = match (settings.output.groups, settings.light.is_all()) {
            (true, _) => LightGroups::named(&scene),
            (false, true) => LightGroups::none(&scene),
            (false, false) => LightGroups::of_lamps(&scene),
        };
        warnings.extend(too_many(&groups));
        warnings.iter().for_each(|w| progress.warn(w));
        for material in &mut scene.materials {
            if let Some(&factor) = settings.reflectance.get(&material.name) {
                material.base_color *= Rgb::from_array(factor);
            }
        }
        Ok(Self { scene, document, hash, groups, warnings })
    }

    /// What light found in it belongs to.
    pub(super) fn key(&self, settings: &Settings) -> Key {
        Key::new(&self.hash, settings.of_light())
    }

    /// Says that something is not as it should be.
    pub(super) fn warn(&mut self, warning: Warning, progress: &dyn Progress) {
        progress.warn(&warning);
        self.warnings.push(warning);
    }

    /// Lays out its lightmap.
    pub(super) fn lay_out(
        &mut self,
        settings: &Settings,
        clock: &StageClock,
        progress: &dyn Progress,
    ) -> Result<LaidOut, BakeError> {
        let (atlas, faults) = clock.measure(Stage::Atlas, || atlas::build(&self.scene, &settings.atlas, progress))?;
        faults.into_iter().for_each(|fault| self.warn(fault, progress));
        let texels = clock.measure(Stage::Texels, || atlas::rasterise(&self.scene, &atlas, progress))?;
        let fingerprint = texels.fingerprint();
        Ok(LaidOut { atlas, texels, fingerprint })
    }
}
