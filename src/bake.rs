//! The order of the stages: scene file and settings → results on the disk.

mod groups;
mod light;
mod relight;
mod results;

pub use light::{Counts, TexelPatches, light};
pub use relight::{RelightSettings, relight};

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
use crate::relight::{ChangeError, SolutionError};
use crate::scene::{LightGroups, Rgb};
use groups::GroupedLight;
use results::Results;
use std::path::{Path, PathBuf};
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
    /// What should be relit was baked without what that needs.
    #[error("there is no `{}`; bake the scene with --groups to relight it", .0.display())]
    NoSolution(PathBuf),
    /// What a bake kept cannot be used.
    #[error("cannot use `{}`", .path.display())]
    Solution {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: SolutionError,
    },
    /// A change that cannot be made.
    #[error(transparent)]
    Change(#[from] ChangeError),
    /// The scene to refine has changed since it was baked.
    #[error("`{}` is not the scene that was baked; bake it again, or name the right file with --scene", .0.display())]
    OtherScene(PathBuf),
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

impl From<SolutionError> for BakeError {
    fn from(source: SolutionError) -> Self {
        Self::Solution { path: PathBuf::new(), source }
    }
}

impl BakeError {
    /// The same with the file that it is about.
    fn at(self, file: &Path) -> Self {
        match self {
            Self::Solution { source, .. } => Self::Solution { path: file.to_path_buf(), source },
            other => other,
        }
    }

    /// Stable, machine-readable kind.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cancelled(_) => "interrupted",
            Self::Import(_) => "import",
            Self::Atlas(_) => "atlas",
            Self::Output(e) => e.code(),
            Self::NoSolution(_) | Self::Solution { .. } => "solution",
            Self::Change(_) => "change",
            Self::OtherScene(_) => "other_scene",
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
    for material in &mut imported.scene.materials {
        if let Some(&factor) = settings.reflectance.get(&material.name) {
            material.base_color *= Rgb::from_array(factor);
        }
    }
    let scene = &imported.scene;

    let (atlas, faults) = clock.measure(Stage::Atlas, || atlas::build(scene, &settings.atlas, progress))?;
    faults.iter().for_each(|w| progress.warn(w));
    imported.warnings.extend(faults);
    let texels = clock.measure(Stage::Texels, || atlas::rasterise(scene, &atlas, progress))?;

    let accel = clock.measure(Stage::Accel, || Accel::build(scene));
    let groups = if settings.output.groups { LightGroups::named(scene) } else { LightGroups::none(scene) };
    let too_many = groups::too_many(&groups);
    too_many.iter().for_each(|w| progress.warn(w));
    imported.warnings.extend(too_many);
    let (mut lightmap, counts, patches) =
        light(&accel, &atlas, &texels, &groups, settings.error, &mut clock, progress)?;
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
        groups: Vec::new(),
        relight: None,
        audit,
        memory_peak_bytes: process::peak_memory(),
        warnings: imported.warnings.clone(),
        outputs: Vec::new(),
    };
    if let Some(patches) = &patches {
        let (scene, atlas, texels, groups) = (&imported.scene, &atlas, &texels, &groups);
        let light = GroupedLight { scene, atlas, texels, groups, lightmap: &lightmap, patches };
        clock.measure(Stage::Output, || light.write(&mut results, &mut report, settings, progress))?;
    }
    results.finish(&mut report, &pages, progress)?;
    Ok(report)
}
