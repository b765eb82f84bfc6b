//! What was typed. What it means is [`lightkiln::config::Settings`].

use clap::{Args, Parser, Subcommand, ValueEnum};
use lightkiln::atlas::{AtlasSettings, Unwrapper, UvMode};
use lightkiln::audit::Effort;
use lightkiln::bake::RelightSettings;
use lightkiln::config::{ERROR_RANGE, LightPart, Settings};
use lightkiln::import::ImportSettings;
use lightkiln::output::{OutputSettings, Precision};
use lightkiln::relight::Assignment;
use lightkiln::units::{LightUnits, Quantity};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time between checkpoints unless it is said.
const CHECKPOINT: Duration = Duration::from_secs(60);

/// Bakes noise-free lightmaps with clustering hierarchical radiosity.
#[derive(Debug, Parser)]
#[command(name = "lightkiln", version, arg_required_else_help = true, disable_help_subcommand = true)]
pub(crate) struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Bake lightmaps for a glTF scene.
    Bake(Box<BakeArguments>),
    /// Change lamps, emission, sky and reflectances of a bake without casting a ray.
    Relight(RelightArguments),
    /// Show what a glTF scene holds.
    Info(InfoArguments),
}

/// `lightkiln bake`.
#[derive(Debug, Args)]
pub(crate) struct BakeArguments {
    /// Scene, .glb or .gltf.
    pub(crate) scene: PathBuf,
    /// Folder for the results [default: lightmaps/<name of the scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Error to aim for, as 2% or 0.02.
    #[arg(long, value_name = "ERROR", default_value = "2%", value_parser = parse_error)]
    error: f32,
    /// Bake roughly, within seconds; the error is not aimed for.
    #[arg(long, conflicts_with_all = ["progressive", "checkpoint", "resume"])]
    preview: bool,
    /// Show states of the running bake in place of the results: a preview first, then better ones.
    #[arg(long)]
    progressive: bool,
    /// Keep a checkpoint, at most every so many seconds.
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, require_equals = true, default_missing_value = "60", value_parser = parse_seconds)]
    checkpoint: Option<Duration>,
    /// Go on from the checkpoint that an interrupted bake has left, if there is one, and keep checkpoints.
    #[arg(long)]
    resume: bool,
    /// How much to spend on finding out whether the error was met.
    /// [default: auto; off for previews].
    #[arg(long, value_enum)]
    audit: Option<AuditChoice>,
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
    #[arg(long, conflicts_with = "preview")]
    groups: bool,
    /// Which light to keep: all of it, what comes straight from lamps, or the rest [default: combined].
    #[arg(long, value_enum, conflicts_with = "groups")]
    light: Option<LightChoice>,
    /// What a texel means.
    #[arg(long, value_enum, default_value_t)]
    quantity: QuantityChoice,
    /// Write 32-bit floats instead of 16-bit ones.
    #[arg(long)]
    float: bool,
    #[command(flatten)]
    source: SourceArguments,
    /// Threads to use [default: one per processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Replace results that exist.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    pub(crate) speech: SpeechArguments,
}

/// `lightkiln relight`.
#[derive(Debug, Args)]
pub(crate) struct RelightArguments {
    /// Folder of a bake with --groups.
    folder: PathBuf,
    /// A change, relative to the bake: NAME=2 or NAME=r,g,b multiplies a lamp, a light group, `environment` or
    /// `material:NAME`; NAME.color=r,g,b; material:NAME.reflectance=r,g,b.
    #[arg(long = "set", value_name = "NAME=VALUE", required = true)]
    changes: Vec<Assignment>,
    /// Folder for the results [default: that of the bake, which takes --force].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Bake again if changed reflectances make the expected error exceed that of the bake.
    #[arg(long)]
    refine: bool,
    /// Scene to bake again, if it is no longer where it was.
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Threads to use [default: one per processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Replace results that exist.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    speech: SpeechArguments,
}

/// `lightkiln info`.
#[derive(Debug, Args)]
pub(crate) struct InfoArguments {
    /// Scene, .glb or .gltf.
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArguments,
    #[command(flatten)]
    pub(crate) speech: SpeechArguments,
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
enum AuditChoice {
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

impl Command {
    /// What is shown.
    pub(crate) fn speech(&self) -> SpeechArguments {
        match self {
            Command::Bake(bake) => bake.speech,
            Command::Relight(relight) => relight.speech,
            Command::Info(info) => info.speech,
        }
    }

    /// Threads that were asked for.
    pub(crate) fn threads(&self) -> Option<usize> {
        match self {
            Command::Bake(bake) => bake.threads.map(usize::from),
            Command::Relight(relight) => relight.threads.map(usize::from),
            Command::Info(_) => None,
        }
    }
}

impl BakeArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> Settings {
        let defaults = Settings::default();
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
                padding: self.padding.unwrap_or(defaults.atlas.padding),
                ..defaults.atlas
            },
            output: OutputSettings {
                folder: self.out.clone().unwrap_or_else(|| default_folder(&self.scene)),
                force: self.force,
                groups: self.groups,
                quantity: match self.quantity {
                    QuantityChoice::Irradiance => Quantity::Irradiance,
                    QuantityChoice::Radiance => Quantity::Radiance,
                    QuantityChoice::Radiosity => Quantity::Radiosity,
                },
                precision: if self.float { Precision::Float } else { Precision::Half },
            },
            light: match self.light.unwrap_or_default() {
                LightChoice::Combined => LightPart::Combined,
                LightChoice::Direct => LightPart::Direct,
                LightChoice::Indirect => LightPart::Indirect,
            },
            error: self.error,
            preview: self.preview,
            progressive: self.progressive,
            checkpoint: self.checkpoint.or(self.resume.then_some(CHECKPOINT)),
            resume: self.resume,
            audit: match self.audit {
                None if self.preview => Effort::Off,
                None | Some(AuditChoice::Auto) => Effort::Auto,
                Some(AuditChoice::Thorough) => Effort::Thorough,
                Some(AuditChoice::Off) => Effort::Off,
            },
            ..defaults
        }
    }
}

impl RelightArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> RelightSettings {
        RelightSettings {
            folder: self.folder.clone(),
            changes: self.changes.clone(),
            out: self.out.clone(),
            force: self.force,
            refine: self.refine,
            scene: self.scene.clone(),
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

/// `lightmaps/<stem>` in the current folder.
fn default_folder(scene: &Path) -> PathBuf {
    Path::new("lightmaps").join(scene.file_stem().unwrap_or(scene.as_os_str()))
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
fn parse_seconds(text: &str) -> Result<Duration, String> {
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
    use clap::CommandFactory;

    fn settings(options: &[&str]) -> Settings {
        let typed = ["lightkiln", "bake", "rooms/hall.glb"].iter().chain(options);
        match Arguments::try_parse_from(typed).expect("valid options").command {
            Command::Bake(bake) => bake.settings(),
            Command::Relight(_) | Command::Info(_) => panic!("bake was typed"),
        }
    }

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }

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

    #[test]
    fn the_folder_follows_the_scenes_name() {
        assert_eq!(settings(&[]).output.folder, Path::new("lightmaps/hall"));
        assert_eq!(settings(&["--out", "x"]).output.folder, Path::new("x"));
    }

    #[test]
    fn options_reach_the_settings() {
        let s = settings(&["--uv", "keep", "--resolution", "256", "--quantity", "radiance", "--float", "--scene", "2"]);
        assert_eq!(s.atlas.uv, UvMode::Keep);
        assert_eq!(s.atlas.resolution, Some(256));
        assert_eq!(s.output.quantity, Quantity::Radiance);
        assert_eq!(s.output.precision, Precision::Float);
        assert_eq!(s.import.scene.as_deref(), Some("2"));
        assert_eq!(s.audit, Effort::Auto);
        assert_eq!(s.light, LightPart::Combined);
        assert_eq!(settings(&["--light", "indirect"]).light, LightPart::Indirect);
        assert_eq!(settings(&["--audit", "off"]).audit, Effort::Off);
        assert_eq!(settings(&["--audit", "thorough"]).audit, Effort::Thorough);
    }
}
