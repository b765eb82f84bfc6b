//! Lays out the atlas: scene and settings → pages, charts and where every triangle lies.

use super::{Atlas, keep, place};
use crate::progress::{Cancelled, Progress};
use crate::scene::Scene;
use crate::warning::Warning;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Where lightmap coordinates come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum UvMode {
    /// Charts are made and packed.
    #[default]
    Auto,
    /// TEXCOORD_1 as it stands; all instances share one page.
    Keep,
    /// The islands of TEXCOORD_1, or of TEXCOORD_0 without it, are scaled to the density and packed anew.
    Pack,
}

/// The tool that makes charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Unwrapper {
    /// xatlas: few charts with little distortion.
    #[default]
    Xatlas,
    /// uvunwrap: many times faster.
    Fast,
}

/// How the atlas is laid out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtlasSettings {
    /// Where lightmap coordinates come from.
    pub uv: UvMode,
    /// Texels per metre in the world; [`AtlasSettings::DENSITY`] if neither this nor a resolution is given.
    pub texels_per_metre: Option<f32>,
    /// Width and height of every page. Alone it also decides the density: everything fits one page.
    pub resolution: Option<u32>,
    /// Pages that choose their own size do not grow beyond this.
    pub max_page: u32,
    /// Empty texels kept between any two charts, and half of it to the page's border.
    pub padding: u32,
    /// The tool that makes charts.
    pub unwrapper: Unwrapper,
}

impl AtlasSettings {
    /// Texels per metre if nothing else is asked for.
    pub const DENSITY: f32 = 16.0;
    /// Texel positions are stored in 16 bits.
    pub const LARGEST_PAGE: u32 = 1 << 15;
}

impl Default for AtlasSettings {
    fn default() -> Self {
        Self {
            uv: UvMode::default(),
            texels_per_metre: None,
            resolution: None,
            max_page: 4096,
            padding: 2,
            unwrapper: Unwrapper::default(),
        }
    }
}

/// Why there is no atlas.
#[derive(Debug, Error)]
pub enum AtlasError {
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A setting is out of its range.
    #[error("{setting} must be {requirement}")]
    InvalidSetting {
        /// The setting.
        setting: &'static str,
        /// What it must satisfy.
        requirement: String,
    },
    /// Meshes lack the texture coordinates that the mode needs.
    #[error("no {set} on {}; give them one, or unwrap with `--uv auto`", listed(nodes))]
    MissingTexcoords {
        /// The missing set.
        set: &'static str,
        /// Paths of the nodes.
        nodes: Vec<String>,
    },
    /// The density asks for more than can be held.
    #[error(
        "the scene needs {texels:.2e} texels at this density, {most:.2e} are possible: \
         lower `--texels-per-metre`, or give `--resolution` alone; also check the scene's scale"
    )]
    TooManyTexels {
        /// Texels that the surfaces would cover.
        texels: f64,
        /// The most that is possible.
        most: f64,
    },
    /// The tool that makes charts failed.
    #[error("{tool} could not unwrap the scene: {reason}; try `--unwrapper fast` or `--uv pack`")]
    Unwrapper {
        /// Name of the tool.
        tool: &'static str,
        /// What it said.
        reason: String,
    },
}

/// Lays out a lightmap for every instance that wants one. Defects of single meshes are warnings.
pub fn build(
    scene: &Scene,
    settings: &AtlasSettings,
    progress: &dyn Progress,
) -> Result<(Atlas, Vec<Warning>), AtlasError> {
    check(settings)?;
    match settings.uv {
        UvMode::Keep => keep::build(scene, settings, progress),
        UvMode::Auto | UvMode::Pack => place::build(scene, settings, progress),
    }
}

/// Rejects settings that no atlas can satisfy.
fn check(settings: &AtlasSettings) -> Result<(), AtlasError> {
    let invalid = |setting, requirement: String| Err(AtlasError::InvalidSetting { setting, requirement });
    if settings.texels_per_metre.is_some_and(|d| !(d > 0.0 && d.is_finite())) {
        return invalid("texels per metre", "a positive number".into());
    }
    let largest = AtlasSettings::LARGEST_PAGE;
    if settings.resolution.is_some_and(|r| r == 0 || r > largest) {
        return invalid("resolution", format!("1 to {largest}"));
    }
    if settings.max_page == 0 || settings.max_page > largest {
        return invalid("largest page", format!("1 to {largest}"));
    }
    let page = settings.resolution.unwrap_or(settings.max_page);
    if settings.uv != UvMode::Keep && settings.padding >= page / 2 {
        return invalid("padding", format!("less than half of the page, which is {page}"));
    }
    Ok(())
}

/// The first few names of a list, quoted, and how many more there are.
pub(super) fn listed(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let mut text = names.iter().take(SHOWN).map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN {
        text += &format!(" and {} more", names.len() - SHOWN);
    }
    text
}
