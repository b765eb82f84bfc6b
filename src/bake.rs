//! The order of the stages: scene file and settings → results on the disk.

mod keeper;
mod light;
mod observer;
mod preview;
mod refine;
mod results;

pub use light::light;
pub use observer::{Counts, Draft, Found, FoundSoFar, Observer, Refinement, Solution};
pub use preview::{Preview, preview};

use crate::accel::Accel;
use crate::atlas::{self, AtlasError};
use crate::config::Settings;
use crate::import::{self, ImportError, Imported};
use crate::output::OutputError;
use crate::output::checkpoint::{self, CheckpointError, Key};
use crate::output::glb::GlbError;
use crate::output::identity::scene_hash;
pub use crate::output::report::Report;
use crate::output::report::StageClock;
use crate::progress::{Cancelled, Progress, Stage};
use crate::warning::Warning;
use keeper::{Keeper, Pace};
use results::{Findings, Results, Subject};
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
    /// A checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
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
            Self::Checkpoint(_) => "checkpoint",
            Self::Output(e) => e.code(),
            Self::Glb(_) => "lit_scene",
        }
    }
}

/// Bakes the scene in `path` and writes the results.
pub fn bake(path: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report, BakeError> {
    let clock = StageClock::start();
    let folder = &settings.output.folder;
    let mut results = Results::open(path, settings)?;

    let (Imported { scene, document, mut warnings }, hash) = clock.measure(Stage::Import, || {
        let imported = import::load(path, &settings.import, progress)?;
        let hash = scene_hash(&imported.document);
        Ok::<_, ImportError>((imported, hash))
    })?;
    if !settings.resume && checkpoint::exists(folder) {
        let message = "an interrupted bake has left it, and it is not used: --resume goes on from it";
        warnings.push(Warning::new("checkpoint_unused", "checkpoint.lk", message));
    }
    warnings.iter().for_each(|w| progress.warn(w));
    let key = Key::new(&hash, settings.of_light());
    let before: Option<(u32, Found)> = if settings.resume { checkpoint::read(folder, &key)? } else { None };

    let (atlas, faults) = clock.measure(Stage::Atlas, || atlas::build(&scene, &settings.atlas, progress))?;
    faults.iter().for_each(|w| progress.warn(w));
    warnings.extend(faults);
    let texels = clock.measure(Stage::Texels, || atlas::rasterise(&scene, &atlas, progress))?;
    let accel = clock.measure(Stage::Accel, || Accel::build(&scene));

    let subject = Subject {
        path,
        hash: &hash,
        document: &document,
        scene: &scene,
        atlas: &atlas,
        texels: &texels,
        layout: texels.fingerprint(),
        settings,
    };
    if before.as_ref().is_some_and(|(layout, _)| *layout != subject.layout) {
        return Err(CheckpointError::Layout(checkpoint::path(folder)).into());
    }
    let mut keeper = Keeper {
        subject: &subject,
        results: &mut results,
        clock: &clock,
        progress,
        warnings: &mut warnings,
        before: before.map(|(_, found)| found),
        states: settings.progressive.then(Pace::of_states),
        accel: &accel,
        judged: None,
        refinements: Vec::new(),
        checkpoints: settings.checkpoint.map(|every| (Pace::every(every), key)),
    };
    let (lightmap, state, counts) = if settings.preview {
        let Preview { lightmap, state, counts, .. } = preview(&accel, &atlas, &texels, &clock, progress)?;
        // It is judged, if that is asked for, but stays what it is.
        keeper.judge(&lightmap, &[], &counts)?;
        keeper.refinements.clear();
        (lightmap, state, counts)
    } else {
        let first = keeper.first_look()?;
        light(&accel, &atlas, &texels, settings.error, first.as_ref(), &mut keeper, &clock, progress)?
    };
    let (irradiance, audit) = match keeper.judged.take() {
        Some(judged) => judged,
        None => (keeper.finish(&lightmap)?, None),
    };
    let refinements = keeper.refinements;
    let findings = Findings { state, counts, audit, refinements, warnings };
    let report = results.publish(&subject, &irradiance, findings, &clock, progress)?;
    if settings.checkpoint.is_some() {
        checkpoint::remove(folder);
    }
    Ok(report)
}
