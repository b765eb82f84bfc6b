//! The order of the stages: scene file and settings → results on the disk.

mod light;

pub use light::{Counts, light};
mod results;

use crate::accel::Accel;
use crate::atlas::{self, AtlasError};
use crate::audit::{self, AuditSettings};
use crate::config::Settings;
use crate::import::{self, ImportError};
use crate::output::glb::GlbError;
use crate::output::identity::scene_hash;
pub use crate::output::report::Report;
use crate::output::report::{SCHEMA, StageClock};
use crate::output::{OutputError, process};
use crate::post;
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::LightGroups;
use results::Results;
use std::path::Path;
use thiserror::Error;

/// Why a bake did not come to its end.
#[derive(Debug, Error)]
pub enum BakeError {
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The scene cannot be read.
    #[error(transparent)]
    Import(ImportError),
    /// There is no layout for it.
    #[error(transparent)]
    Atlas(AtlasError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The lit copy of the scene cannot be made.
    #[error("cannot write the lit scene")]
    Glb(#[from] GlbError),
}

impl From<ImportError> for BakeError {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Cancelled(c) => Self::Cancelled(c),
            other => Self::Import(other),
        }
    }
}

impl From<AtlasError> for BakeError {
    fn from(error: AtlasError) -> Self {
        match error {
            AtlasError::Cancelled(c) => Self::Cancelled(c),
            other => Self::Atlas(other),
        }
    }
}

impl BakeError {
    /// Stable, machine-readable kind.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cancelled(_) => "interrupted",
            Self::Import(_) => "import",
            Self::Atlas(_) => "atlas",
            Self::Output(e) => e.code(),
            Self::Glb(_) => "lit_scene",
        }
    }
}

/// Bakes the scene in `path` and writes the results.
pub fn bake(path: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report, BakeError> {
    let mut clock = StageClock::start();
    let mut results = Results::open(path, settings)?;

    let (mut imported, hash) = clock.measure(Stage::Import, || {
        let imported = import::load(path, &settings.import, progress)?;
        let hash = scene_hash(&imported.document);
        Ok::<_, ImportError>((imported, hash))
    })?;
    imported.warnings.iter().for_each(|w| progress.warn(w));
    let scene = &imported.scene;

    let (atlas, faults) = clock.measure(Stage::Atlas, || atlas::build(scene, &settings.atlas, progress))?;
    faults.iter().for_each(|w| progress.warn(w));
    imported.warnings.extend(faults);
    let texels = clock.measure(Stage::Texels, || atlas::rasterise(scene, &atlas, progress))?;

    let accel = clock.measure(Stage::Accel, || Accel::build(scene));
    let groups = if settings.output.groups { LightGroups::named(scene) } else { LightGroups::none(scene) };
    let (mut lightmap, counts) = light(&accel, &atlas, &texels, &groups, settings.error, &mut clock, progress)?;
    let irradiance = clock.measure(Stage::Post, || {
        post::fill_unusable(&atlas, &texels, &mut lightmap.combined, &lightmap.usable);
        post::finish(&atlas, &texels, scene, &lightmap.combined, &settings.post, progress)
    })?;

    let audit = match settings.audit.most_rays(counts.rays.values().sum()) {
        Some(most_rays) => clock.measure(Stage::Audit, || {
            let baked = post::at_texels(&atlas, &texels, &irradiance);
            let seed = u32::from_str_radix(hash.get(..8).unwrap_or_default(), 16).unwrap_or_default();
            let settings = AuditSettings { target: settings.error, most_rays, seed };
            audit::audit(&accel, &atlas, &texels, &lightmap.usable, &baked, &settings, progress)
        })?,
        None => None,
    };

    let pages = clock.measure(Stage::Output, || {
        results.write_pages(&mut imported, &hash, (&atlas, &texels), &irradiance, settings, progress)
    })?;
    let mut report = Report {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        scene: results::scene_facts(&imported, path, hash),
        settings: settings.facts(),
        stages: clock.stages().to_vec(),
        total: clock.total(),
        rays: counts.rays,
        solver: counts.solver,
        atlas: results::atlas_facts(&atlas, &texels, &pages),
        audit,
        memory_peak_bytes: process::peak_memory(),
        warnings: imported.warnings,
        outputs: Vec::new(),
    };
    results.finish(&mut report, &pages, progress)?;
    Ok(report)
}
