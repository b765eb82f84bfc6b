//! What a bake is asked to do: the settings of all stages together.

use crate::atlas::AtlasSettings;
use crate::import::ImportSettings;
use crate::output::OutputSettings;
use crate::post::PostSettings;
use std::ops::RangeInclusive;

/// Errors that can be aimed for, as a share.
pub const ERROR_RANGE: RangeInclusive<f32> = 0.001..=0.5;

/// Settings of a bake.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How the scene file is read.
    pub import: ImportSettings,
    /// How the lightmap is laid out.
    pub atlas: AtlasSettings,
    /// How seams and borders are treated.
    pub post: PostSettings,
    /// Where results go and in which form.
    pub output: OutputSettings,
    /// Relative error to aim for, within [`ERROR_RANGE`].
    pub error: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            import: ImportSettings::default(),
            atlas: AtlasSettings::default(),
            post: PostSettings::default(),
            output: OutputSettings::default(),
            error: 0.02,
        }
    }
}
