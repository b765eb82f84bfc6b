//! Options that several commands share, and what they mean.

use clap::{Args, ValueEnum};
use lightkiln::atlas::{AtlasSettings, Unwrapper, UvMode};
use lightkiln::audit::Effort;
use lightkiln::config::{ERROR_RANGE, LightPart, Settings};
use lightkiln::import::ImportSettings;
use lightkiln::output::{OutputSettings, Precision};
use lightkiln::units::{LightUnits, Quantity};
use std::time::Duration;

/// What the light depends on.
#[derive(Debug, Args)]
pub(crate) struct LightArguments {
    /// Error to aim for, as 2% or 0.02.
    #[arg(long, value_name = "ERROR", default_value = "2%", value_parser = parse_error)]
    error: f32,
    /// Lightmap density; 16 unless a resolution is given.
    #[arg(long, value_name = "X", value_parser = parse_positive)]
    texels_per_metre: Option<f32>,
    /// Width and height of every page; alone, it also decides the density.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=AtlasSettings::LARGEST_PAGE as i64))]
    resolution: Option<u32>,
    /// Where lightmap coordinates come from.
    #[arg(long, value_enum, default_value_t)]
    uv: UvChoice,
    /// What makes the charts.
    #[arg(long, value_enum, default_value_t)]
    unwrapper: UnwrapperChoice,
    /// Empty texels between charts.
    #[arg(long, value_name = "N")]
    padding: Option<u32>,
    /// Keep light groups apart: pages of each beside the whole, and what relighting needs.
    #[arg(long)]
    groups: bool,
    /// Which light to keep: all of it, what comes straight from lamps, or the rest.
    #[arg(long, value_enum, default_value_t, conflicts_with = "groups")]
    light: LightChoice,
    #[command(flatten)]
    source: SourceArguments,
}

/// What the pages look like.
#[derive(Debug, Args)]
pub(crate) struct FormArguments {
    /// What a texel means.
    #[arg(long, value_enum, default_value_t)]
    quantity: QuantityChoice,
    /// Write 32-bit floats instead of 16-bit ones.
    #[arg(long)]
    float: bool,
}

/// How many threads work.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct ThreadArguments {
    /// Threads to use [default: one per processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// How the scene file is read.
#[derive(Debug, Args)]
pub(crate) struct SourceArguments {
    /// Units of lights and emission [default: photometric, as in glTF; radiometric in files with LIGHTKILN_scene].
    #[arg(long, value_enum, value_name = "UNITS")]
    light_units: Option<LightUnitsChoice>,
    /// Scene of the file, by name or number [default: the file's own choice].
    #[arg(long = "scene", id = "scene-choice", value_name = "NAME|N")]
    scene_choice: Option<String>,
}

/// What is shown.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct SpeechArguments {
    /// Print one JSON object per line on the standard output.
    #[arg(long)]
    pub(crate) json: bool,
    /// Show errors only.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// Show what the stages do.
    #[arg(short, long, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum AuditChoice {
    /// About a tenth of the bake's time.
    Auto,
    /// About as long as the bake.
    Thorough,
    /// Nothing: the error stays unknown.
    Off,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum UvChoice {
    /// Unwrap and pack.
    #[default]
    Auto,
    /// Use TEXCOORD_1 as it stands, on one page.
    Keep,
    /// Pack the islands of TEXCOORD_1 anew.
    Pack,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum UnwrapperChoice {
    /// Few charts with little distortion.
    #[default]
    Xatlas,
    /// Many times faster.
    Fast,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum LightChoice {
    /// All light.
    #[default]
    Combined,
    /// Straight from lamps: neither sky nor emissive surfaces, and no bounce.
    Direct,
    /// Sky, emissive surfaces and every bounce.
    Indirect,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum QuantityChoice {
    /// E, W/m²: three.js.
    #[default]
    Irradiance,
    /// E/π, W/(m²·sr): Bevy.
    Radiance,
    /// Reflectance times E, W/m²: Babylon.js.
    Radiosity,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LightUnitsChoice {
    /// Candela, lux and nits.
    Photometric,
    /// Watts.
    Radiometric,
}

impl LightArguments {
    /// `settings` with what the options mean.
    pub(crate) fn apply(&self, settings: Settings) -> Settings {
        let padding = self.padding.unwrap_or(settings.atlas.padding);
        Settings {
            import: self.source.settings(),
            atlas: AtlasSettings {
                uv: match self.uv {
                    UvChoice::Auto => UvMode::Auto,
                    UvChoice::Keep => UvMode::Keep,
                    UvChoice::Pack => UvMode::Pack,
                },
                unwrapper: match self.unwrapper {
                    UnwrapperChoice::Xatlas => Unwrapper::Xatlas,
                    UnwrapperChoice::Fast => Unwrapper::Fast,
                },
                texels_per_metre: self.texels_per_metre,
                resolution: self.resolution,
                padding,
                ..settings.atlas
            },
            output: OutputSettings { groups: self.groups, ..settings.output },
            light: match self.light {
                LightChoice::Combined => LightPart::Combined,
                LightChoice::Direct => LightPart::Direct,
                LightChoice::Indirect => LightPart::Indirect,
            },
            error: self.error,
            ..settings
        }
    }
}

impl FormArguments {
    /// What a texel means.
    pub(crate) fn quantity(&self) -> Quantity {
        match self.quantity {
            QuantityChoice::Irradiance => Quantity::Irradiance,
            QuantityChoice::Radiance => Quantity::Radiance,
            QuantityChoice::Radiosity => Quantity::Radiosity,
        }
    }

    /// How it is stored.
    pub(crate) fn precision(&self) -> Precision {
        if self.float { Precision::Float } else { Precision::Half }
    }
}

impl ThreadArguments {
    /// How many were asked for.
    pub(crate) fn count(self) -> Option<usize> {
        self.threads.map(usize::from)
    }
}

impl AuditChoice {
    /// What it means.
    pub(crate) fn effort(self) -> Effort {
        match self {
            Self::Auto => Effort::Auto,
            Self::Thorough => Effort::Thorough,
            Self::Off => Effort::Off,
        }
    }
}

impl SourceArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> ImportSettings {
        ImportSettings {
            light_units: self.light_units.map(|units| match units {
                LightUnitsChoice::Photometric => LightUnits::Photometric,
                LightUnitsChoice::Radiometric => LightUnits::Radiometric,
            }),
            scene: self.scene_choice.clone(),
        }
    }
}

/// `2%` or `0.02`, within [`ERROR_RANGE`].
fn parse_error(text: &str) -> Result<f32, String> {
    let number = |t: &str| t.trim().parse::<f32>().map_err(|_| format!("`{text}` is neither like 2% nor like 0.02"));
    let error = match text.trim().strip_suffix('%') {
        Some(percent) => number(percent)? / 100.0,
        None => number(text)?,
    };
    // Half a unit of the last digit of 0.1 % must not decide.
    let tolerance = 1e-6;
    if error < ERROR_RANGE.start() - tolerance {
        let least = ERROR_RANGE.start() * 100.0;
        return Err(format!("no lightmap is that exact: half floats alone are 0.03% off; ask for {least}% or more"));
    }
    if !(error >= ERROR_RANGE.start() - tolerance && error <= ERROR_RANGE.end() + tolerance) {
        return Err(format!("must lie between {}% and {}%", ERROR_RANGE.start() * 100.0, ERROR_RANGE.end() * 100.0));
    }
    Ok(error.clamp(*ERROR_RANGE.start(), *ERROR_RANGE.end()))
}

/// Seconds, or fractions of one.
pub(crate) fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    seconds.ok_or_else(|| "must be a number of seconds".into())
}

fn parse_positive(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("must be a positive number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_percentages_or_fractions() {
        assert_eq!(parse_error("2%"), Ok(0.02));
        assert_eq!(parse_error("0.02"), Ok(0.02));
        assert_eq!(parse_error("0.1 %"), Ok(0.001));
        assert_eq!(parse_error("50%"), Ok(0.5));
        for wrong in ["2", "0", "-1%", "51%", "0.05%", "NaN", "inf", "", "%", "two"] {
            assert!(parse_error(wrong).is_err(), "{wrong}");
        }
    }
}
