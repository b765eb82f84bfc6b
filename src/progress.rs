//! How far the bake is, and whether it should go on. Stages report here; the binary decides what to show.

use crate::warning::Warning;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use thiserror::Error;

/// The user asked the bake to stop. The only way in which arithmetic can fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A part of the bake that is long enough to be watched, in the order in which they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Reading the scene and its textures.
    Import,
    /// Unwrapping and packing charts.
    Atlas,
    /// Rasterising charts to texels.
    Texels,
    /// Building the ray acceleration structure.
    Accel,
    /// A first look, where states of the bake are shown.
    Preview,
    /// Light that comes straight from lamps.
    Direct,
    /// Link refinement and the radiosity solution.
    Solve,
    /// Final gather.
    Gather,
    /// Seams and dilation.
    Post,
    /// Comparing texels with independent paths.
    Audit,
    /// Writing files.
    Output,
}

impl Stage {
    /// Name in progress lines and in the report.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Import => "import",
            Stage::Atlas => "atlas",
            Stage::Texels => "texels",
            Stage::Accel => "accel",
            Stage::Preview => "preview",
            Stage::Direct => "direct",
            Stage::Solve => "solve",
            Stage::Gather => "gather",
            Stage::Post => "post",
            Stage::Audit => "audit",
            Stage::Output => "output",
        }
    }
}

/// Receives progress. Called from any thread, often: implementations limit their own rate.
pub trait Progress: Sync {
    /// `done` of `stage`, 0..=1.
    fn report(&self, stage: Stage, done: f64);
    /// A fault of the asset, as soon as it is known. The report lists it, too.
    fn warn(&self, _warning: &Warning) {}
    /// A running bake has left results that show what it has `reached`, with the relative error to expect of them.
    fn improved(&self, _reached: &str, _predicted_error: f64, _files: &[PathBuf]) {}
    /// It has left a checkpoint, from which it can go on if it is interrupted.
    fn kept(&self, _checkpoint: &Path) {}
    /// True once the user asked to stop; stays true.
    fn is_cancelled(&self) -> bool;
}

/// Ignores progress and never cancels.
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: Stage, _: f64) {}
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Passes on nothing but the wish to stop: for work that is not a stage of its own.
pub struct Quiet<'a>(pub &'a dyn Progress);

impl Progress for Quiet<'_> {
    fn report(&self, _: Stage, _: f64) {}
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Counts finished items of one stage from many threads and reports the share.
pub struct Counter<'a> {
    progress: &'a dyn Progress,
    stage: Stage,
    total: u64,
    done: AtomicU64,
    stopped: AtomicBool,
}

impl<'a> Counter<'a> {
    /// Starts `stage` with `total` items to do.
    pub fn new(progress: &'a dyn Progress, stage: Stage, total: usize) -> Self {
        progress.report(stage, 0.0);
        Self { progress, stage, total: total.max(1) as u64, done: AtomicU64::new(0), stopped: AtomicBool::new(false) }
    }

    /// Marks `items` as done; fails once the user has cancelled.
    pub fn advance(&self, items: usize) -> Result<(), Cancelled> {
        let done = self.done.fetch_add(items as u64, Ordering::Relaxed) + items as u64;
        if self.stopped.load(Ordering::Relaxed) || self.progress.is_cancelled() {
            self.stopped.store(true, Ordering::Relaxed);
            return Err(Cancelled);
        }
        self.progress.report(self.stage, done.min(self.total) as f64 / self.total as f64);
        Ok(())
    }
}
