//! Writing what was baked: EXR pages, the lit GLB and the report, all or none of them.

pub mod checkpoint;
pub mod exr;
pub mod files;
pub mod glb;
mod heat;
pub mod html;
pub mod identity;
mod part_error;
pub mod process;
pub mod report;
mod sealed;
pub mod solved;
mod thumbnail;
mod tile_set;

pub use checkpoint::CheckpointError;
pub use files::{OutputError, OutputSet, open_result, read_result};
pub use part_error::PartError;
pub use report::Report;
pub use tile_set::TileSet;

use crate::units::Quantity;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Bits per channel of the EXR pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Half floats: 11 significant bits, up to 65504.
    #[default]
    Half,
    /// Single floats.
    Float,
}

/// How good the lightmap is that a set of results holds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What the bake has reached.
    pub reached: Milestone,
    /// Relative error that the bake itself expects. It knows of noise and interpolation; an audit finds the rest.
    pub predicted_error: f64,
}

/// What a bake can have reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Milestone {
    /// All light, roughly.
    Preview,
    /// Light from lamps in full, the rest as in the preview.
    Direct,
    /// The rest as the radiosity solution has it.
    Solution,
    /// Part of the final gather.
    Gather,
    /// Everything.
    Final,
}

impl Milestone {
    /// Name in reports, events and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Preview => "preview",
            Self::Direct => "direct",
            Self::Solution => "solution",
            Self::Gather => "gather",
            Self::Final => "final",
        }
    }
}

/// Where the results go and in which form.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputSettings {
    /// Folder of the results; created if it does not exist.
    pub folder: PathBuf,
    /// True: results of an earlier bake in the folder are replaced.
    pub force: bool,
    /// What a texel of the EXR pages means.
    pub quantity: Quantity,
    /// True: a page for every light group, too, and what relighting needs.
    pub groups: bool,
    /// How it is stored.
    pub precision: Precision,
}

impl OutputSettings {
    /// Where the results of a scene go if nothing is said: `lightmaps/<stem>` in the current folder.
    pub fn default_folder(scene: &Path) -> PathBuf {
        Path::new("lightmaps").join(scene.file_stem().unwrap_or(scene.as_os_str()))
    }
}
