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
use std::time::Duration;

/// Errors that can be aimed for, as a share.
pub const ERROR_RANGE: RangeInclusive<f32> = 0.001..=0.5;

/// Which light a lightmap holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightPart {
    /// All light.
    #[default]
    Combined,
    /// Light straight from lamps: neither sky nor emissive surfaces, and no bounce.
    Direct,
    /// All other light: sky, emissive surfaces, and every bounce.
    Indirect,
}

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
    /// Which light is kept.
    #[serde(default)]
    pub light: LightPart,
    /// Relative error of all light to aim for, within [`ERROR_RANGE`].
    pub error: f32,
    /// True: a rough lightmap within seconds; the error is what it comes to.
    pub preview: bool,
    /// True: states of the running bake are shown in place of the results.
    pub progressive: bool,
    /// Time between checkpoints; none if there are none.
    pub checkpoint: Option<Duration>,
    /// True: the bake goes on from a checkpoint, if there is one.
    pub resume: bool,
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
            light: LightPart::default(),
            error: 0.02,
            preview: false,
            progressive: false,
            checkpoint: None,
            resume: false,
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
            ("preview", json!(self.preview)),
            ("audit", json!(self.audit)),
            ("uv", json!(format!("{:?}", atlas.uv).to_lowercase())),
            ("unwrapper", json!(format!("{:?}", atlas.unwrapper).to_lowercase())),
            ("texels-per-metre", json!(atlas.texels_per_metre)),
            ("resolution", json!(atlas.resolution)),
            ("padding", json!(atlas.padding)),
            ("groups", json!(output.groups)),
            ("light", json!(self.light)),
            ("quantity", json!(output.quantity)),
            ("precision", json!(output.precision)),
        ];
        facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// The settings that the light depends on, by the names of their options.
    pub fn of_light(&self) -> BTreeMap<String, Value> {
        let mut facts = self.facts();
        facts.retain(|name, _| !["audit", "quantity", "precision"].contains(&name.as_str()));
        facts.insert("light-units".into(), json!(self.import.light_units.map(|units| format!("{units:?}"))));
        facts.insert("reflectance".into(), json!(self.reflectance));
        facts.insert("scene".into(), json!(self.import.scene));
        facts
    }
}
