//! The order of the stages: scene file and settings → results on the disk.

mod effort;
mod elements;
mod groups;
mod keeper;
mod light;
mod merge;
mod observer;
mod part;
mod prepare;
mod preview;
mod refine;
mod relight;
mod results;
mod solve;
mod tiles;

pub use light::{Lighting, Lit, TexelPatches, light};
pub use merge::{MergeSettings, merge};
pub use observer::{Counts, Draft, Found, FoundSoFar, Observer, Refinement, Solution};
pub use preview::{Preview, preview};
pub use relight::{RelightSettings, relight};
pub use solve::{Solving, solve};
pub use tiles::{GatherSettings, GatheredTiles, TilesDone, gather_tiles, tiles_done};

use crate::accel::Accel;
use crate::atlas::AtlasError;
use crate::config::Settings;
use crate::import::ImportError;
use crate::output::checkpoint::{self, CheckpointError};
use crate::output::glb::GlbError;
pub use crate::output::report::Report;
use crate::output::report::StageClock;
use crate::output::{OutputError, PartError};
use crate::progress::{Cancelled, Progress, Stage};
use crate::relight::{ChangeError, SolutionError};
use crate::warning::Warning;
use groups::GroupedLight;
use keeper::{Keeper, Pace};
use light::Solved;
use prepare::{LaidOut, Loaded};
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
    /// A solution or tiles of it cannot be used.
    #[error(transparent)]
    Part(#[from] PartError),
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
            Self::Part(_) => "part",
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
    let results = Results::open(path, settings)?;
    let mut loaded = Loaded::read(path, settings, &clock, progress)?;
    if !settings.resume && checkpoint::exists(folder) {
        let message = "an interrupted bake has left it, and it is not used: --resume goes on from it";
        loaded.warn(Warning::new("checkpoint_unused", "checkpoint.lk", message), progress);
    }
    let key = loaded.key(settings);
    let before: Option<(u32, Found)> = if settings.resume { checkpoint::read(folder, &key)? } else { None };
    let laid_out = loaded.lay_out(settings, &clock, progress)?;
    let found = match before {
        Some((layout, _)) if layout != laid_out.fingerprint => {
            return Err(CheckpointError::Layout(checkpoint::path(folder)).into());
        }
        before => before.map(|(_, found)| found),
    };
    finish(path, settings, loaded, &laid_out, found, results, &clock, progress)
}

/// Lights a scene from what is `found` already, and writes the results.
fn finish(
    path: &Path,
    settings: &Settings,
    loaded: Loaded,
    laid_out: &LaidOut,
    found: Option<Found>,
    mut results: Results,
    clock: &StageClock,
    progress: &dyn Progress,
) -> Result<Report, BakeError> {
    let key = loaded.key(settings);
    let Loaded { scene, document, hash, groups, mut warnings } = loaded;
    let LaidOut { atlas, texels, fingerprint } = laid_out;
    let accel = clock.measure(Stage::Accel, || Accel::build(&scene));
    let subject = Subject {
        path,
        hash: &hash,
        document: &document,
        scene: &scene,
        atlas,
        texels,
        layout: *fingerprint,
        settings,
    };
    let mut keeper = Keeper {
        subject: &subject,
        results: &mut results,
        clock,
        progress,
        warnings: &mut warnings,
        before: found,
        states: settings.progressive.then(Pace::of_states),
        accel: &accel,
        judged: None,
        refinements: Vec::new(),
        checkpoints: settings.checkpoint.map(|every| (Pace::every(every), key)),
    };
    let Lit { mut lightmap, state, counts, patches } = if settings.preview {
        let Preview { lightmap, state, counts, .. } = preview(&accel, atlas, texels, &groups, clock, progress)?;
        // It is judged, if that is asked for, but stays what it is.
        keeper.judge(&lightmap, &[], &counts)?;
        keeper.refinements.clear();
        Lit { lightmap, state, counts, patches: None }
    } else {
        let first = keeper.first_look(&groups)?;
        let (groups, error, first) = (&groups, settings.error, first.as_ref());
        let lighting = Lighting { accel: &accel, atlas, texels, groups, error, first, clock, progress };
        light(&lighting, &mut keeper)?
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
    let report = results.publish(&subject, &irradiance, findings, grouped.as_ref(), clock, progress)?;
    if settings.checkpoint.is_some() {
        checkpoint::remove(&settings.output.folder);
    }
    Ok(report)
}
