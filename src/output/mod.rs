//! Writing what was baked: EXR pages, the lit GLB and the report, all or none of them.

pub mod exr;
pub mod files;
pub mod glb;
mod heat;
pub mod html;
pub mod identity;
pub mod process;
pub mod report;
mod thumbnail;

pub use files::{OutputError, OutputSet, open_result, read_result};
pub use report::Report;

use crate::units::Quantity;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

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
