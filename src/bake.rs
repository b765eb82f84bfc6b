//! The order of the stages: scene file and settings → results on the disk.

mod groups;
mod keeper;
mod light;
mod observer;
mod part;
mod preview;
mod refine;
mod relight;
mod results;

pub use light::{Lit, TexelPatches, light};
pub use observer::{Counts, Draft, Found, FoundSoFar, Observer, Refinement, Solution};
pub use preview::{Preview, preview};
pub use relight::{RelightSettings, relight};

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
use crate::relight::{ChangeError, SolutionError};
use crate::scene::{LightGroups, Rgb};
use crate::warning::Warning;
use groups::GroupedLight;
use keeper::{Keeper, Pace};
use results::{Findings, Results, Subject};
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
    /// A checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
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
            Self::Checkpoint(_) => "checkpoint",
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
    let clock = StageClock::start();
    let folder = &settings.output.folder;
    let mut results = Results::open(path, settings)?;

    let (Imported { mut scene, document, mut warnings }, hash) = clock.measure(Stage::Import, || {
        let imported = import::load(path, &settings.import, progress)?;
        let hash = scene_hash(&imported.document);
        Ok::<_, ImportError>((imported, hash))
    })?;
    if !settings.resume && checkpoint::exists(folder) {
        let message = "an interrupted bake has left it, and it is not used: --resume goes on from it";
        warnings.push(Warning::new("checkpoint_unused", "checkpoint.lk", message));
    }
    let groups = match (settings.output.groups, settings.light.is_all()) {
        (true, _) => LightGroups::named(&scene),
        (false, true) => LightGroups::none(&scene),
        (false, false) => LightGroups::of_lamps(&scene),
    };
    warnings.extend(groups::too_many(&groups));
    warnings.iter().for_each(|w| progress.warn(w));
    for material in &mut scene.materials {
        if let Some(&factor) = settings.reflectance.get(&material.name) {
            material.base_color *= Rgb::from_array(factor);
        }
    }
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
    let Lit { mut lightmap, state, counts, patches } = if settings.preview {
        let Preview { lightmap, state, counts, .. } = preview(&accel, &atlas, &texels, &groups, &clock, progress)?;
        // It is judged, if that is asked for, but stays what it is.
        keeper.judge(&lightmap, &[], &counts)?;
        keeper.refinements.clear();
        Lit { lightmap, state, counts, patches: None }
    } else {
        let first = keeper.first_look(&groups)?;
        light(&accel, &atlas, &texels, &groups, settings.error, first.as_ref(), &mut keeper, &clock, progress)?
    };
    let (irradiance, audit) = match keeper.judged.take() {
        Some(judged) if settings.light.is_all() => judged,
        judged => {
            settings.light.keep(&mut lightmap.combined, &lightmap.direct_groups);
            (keeper.finish(&lightmap)?, judged.and_then(|(_, audit)| audit))
        }
    };
    let refinements = keeper.refinements;
    let findings = Findings { state, counts, audit, refinements, warnings };
    let grouped = patches.as_ref().filter(|_| settings.output.groups).map(|patches| GroupedLight {
        subject: &subject,
        groups: &groups,
        lightmap: &lightmap,
        patches,
    });
    let report = results.publish(&subject, &irradiance, findings, grouped.as_ref(), &clock, progress)?;
    if settings.checkpoint.is_some() {
        checkpoint::remove(folder);
    }
    Ok(report)
}
