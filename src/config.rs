//! What a bake is asked to do: the settings of all stages together.

use crate::atlas::AtlasSettings;
use crate::audit::Effort;
use crate::import::ImportSettings;
use crate::output::OutputSettings;
use crate::post::PostSettings;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Errors that can be aimed for, as a share.
pub const ERROR_RANGE: RangeInclusive<f32> = 0.001..=0.5;

/// Settings of a bake.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Settings {
    /// How the scene file is read.
    pub import: ImportSettings,
    /// How the lightmap is laid out.
    pub atlas: AtlasSettings,
    /// How seams and borders are treated.
    pub post: PostSettings,
    /// Where results go and in which form.
    pub output: OutputSettings,
    /// By what the reflectance of materials is multiplied, by name.
    pub reflectance: BTreeMap<String, [f32; 3]>,
    /// Relative error to aim for, within [`ERROR_RANGE`].
    pub error: f32,
    /// How much may be spent on finding out whether it was met.
    pub audit: Effort,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            import: ImportSettings::default(),
            atlas: AtlasSettings::default(),
            post: PostSettings::default(),
            output: OutputSettings::default(),
            reflectance: BTreeMap::new(),
            error: 0.02,
            audit: Effort::default(),
        }
    }
}

impl Settings {
    /// The settings that decide what a lightmap looks like, by the names of their options, for the report.
    pub fn facts(&self) -> BTreeMap<String, Value> {
        let Settings { atlas, output, .. } = self;
        let facts = [
            // Through text, so that 0.02 does not become 0.019999999552965164.
            ("error", json!(self.error.to_string().parse::<f64>().ok())),
            ("audit", json!(self.audit)),
            ("uv", json!(format!("{:?}", atlas.uv).to_lowercase())),
            ("unwrapper", json!(format!("{:?}", atlas.unwrapper).to_lowercase())),
            ("texels-per-metre", json!(atlas.texels_per_metre)),
            ("resolution", json!(atlas.resolution)),
            ("padding", json!(atlas.padding)),
            ("groups", json!(output.groups)),
            ("quantity", json!(output.quantity)),
            ("precision", json!(output.precision)),
        ];
        facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }
}
