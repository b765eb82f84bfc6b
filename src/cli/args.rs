//! What was typed. What it means is [`lightkiln::config::Settings`].

use super::options::{
    AuditChoice, FormArguments, LightArguments, SourceArguments, SpeechArguments, ThreadArguments, parse_seconds,
};
use clap::{Args, Parser, Subcommand};
use lightkiln::audit::Effort;
use lightkiln::bake::{GatherSettings, MergeSettings, RelightSettings};
use lightkiln::config::Settings;
use lightkiln::output::{OutputSettings, TileSet};
use lightkiln::relight::Assignment;
use std::path::PathBuf;
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
    /// Show what a glTF scene or a solution holds.
    Info(InfoArguments),
    /// Do the part of a bake that comes before its tiles, which any machine can then gather.
    Solve(SolveArguments),
    /// Gather tiles of a solution.
    Gather(GatherArguments),
    /// Make the results of a bake from the tiles of a solution.
    Merge(MergeArguments),
}

/// `lightkiln bake`.
#[derive(Debug, Args)]
pub(crate) struct BakeArguments {
    /// Scene, .glb or .gltf.
    pub(crate) scene: PathBuf,
    /// Folder for the results [default: lightmaps/<name of the scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    light: LightArguments,
    /// Bake roughly, within seconds; the error is not aimed for.
    #[arg(long, conflicts_with_all = ["progressive", "checkpoint", "resume", "groups"])]
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
    #[command(flatten)]
    form: FormArguments,
    #[command(flatten)]
    threads: ThreadArguments,
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
    #[command(flatten)]
    threads: ThreadArguments,
    /// Replace results that exist.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    speech: SpeechArguments,
}

/// `lightkiln solve`.
#[derive(Debug, Args)]
pub(crate) struct SolveArguments {
    /// Scene, .glb or .gltf.
    pub(crate) scene: PathBuf,
    /// Folder for the solution and its tiles.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    light: LightArguments,
    #[command(flatten)]
    threads: ThreadArguments,
    /// Replace another solution, and remove its tiles.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    speech: SpeechArguments,
}

/// `lightkiln gather`.
#[derive(Debug, Args)]
pub(crate) struct GatherArguments {
    /// Folder of the solution.
    folder: PathBuf,
    /// Tiles to gather, as 0-15, 3 or 0-3,8; those that are there already are left out [default: all].
    #[arg(long, value_name = "A-B")]
    tiles: Option<TileSet>,
    /// File for the tiles [default: one in the folder of the solution].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Scene, if it is not where it was solved.
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Keep unfinished tiles at most every so many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    checkpoint: Option<Duration>,
    #[command(flatten)]
    threads: ThreadArguments,
    #[command(flatten)]
    speech: SpeechArguments,
}

/// `lightkiln merge`.
#[derive(Debug, Args)]
pub(crate) struct MergeArguments {
    /// Folders of the solution and its tiles, and files of tiles.
    #[arg(required = true, value_name = "DIR|FILE")]
    parts: Vec<PathBuf>,
    /// Folder for the results [default: lightmaps/<name of the scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Scene, if it is not where it was solved.
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// How much to spend on finding out whether the error was met.
    #[arg(long, value_enum, default_value_t = AuditChoice::Auto)]
    audit: AuditChoice,
    #[command(flatten)]
    form: FormArguments,
    #[command(flatten)]
    threads: ThreadArguments,
    /// Replace results that exist.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    speech: SpeechArguments,
}

/// `lightkiln info`.
#[derive(Debug, Args)]
pub(crate) struct InfoArguments {
    /// Scene, .glb or .gltf, or the folder of a solution.
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) source: SourceArguments,
    #[command(flatten)]
    pub(crate) speech: SpeechArguments,
}

impl Command {
    /// What is shown.
    pub(crate) fn speech(&self) -> SpeechArguments {
        match self {
            Command::Bake(bake) => bake.speech,
            Command::Relight(relight) => relight.speech,
            Command::Info(info) => info.speech,
            Command::Solve(solve) => solve.speech,
            Command::Gather(gather) => gather.speech,
            Command::Merge(merge) => merge.speech,
        }
    }

    /// Threads that were asked for.
    pub(crate) fn threads(&self) -> Option<usize> {
        match self {
            Command::Bake(bake) => bake.threads.count(),
            Command::Relight(relight) => relight.threads.count(),
            Command::Info(_) => None,
            Command::Solve(solve) => solve.threads.count(),
            Command::Gather(gather) => gather.threads.count(),
            Command::Merge(merge) => merge.threads.count(),
        }
    }
}

impl BakeArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> Settings {
        let settings = self.light.apply(Settings::default());
        Settings {
            output: OutputSettings {
                folder: self.out.clone().unwrap_or_else(|| OutputSettings::default_folder(&self.scene)),
                force: self.force,
                quantity: self.form.quantity(),
                precision: self.form.precision(),
                ..settings.output
            },
            preview: self.preview,
            progressive: self.progressive,
            checkpoint: self.checkpoint.or(self.resume.then_some(CHECKPOINT)),
            resume: self.resume,
            audit: match self.audit {
                None if self.preview => Effort::Off,
                None => Effort::Auto,
                Some(choice) => choice.effort(),
            },
            ..settings
        }
    }
}

impl SolveArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> Settings {
        let settings = self.light.apply(Settings::default());
        let output = OutputSettings { folder: self.out.clone(), force: self.force, ..settings.output };
        Settings { output, ..settings }
    }
}

impl GatherArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> GatherSettings {
        GatherSettings {
            folder: self.folder.clone(),
            tiles: self.tiles.clone(),
            out: self.out.clone(),
            scene: self.scene.clone(),
            keep_every: self.checkpoint,
        }
    }
}

impl MergeArguments {
    /// What the options mean.
    pub(crate) fn settings(&self) -> MergeSettings {
        MergeSettings {
            parts: self.parts.clone(),
            out: self.out.clone(),
            scene: self.scene.clone(),
            quantity: self.form.quantity(),
            precision: self.form.precision(),
            audit: self.audit.effort(),
            force: self.force,
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

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use lightkiln::atlas::UvMode;
    use lightkiln::config::LightPart;
    use lightkiln::output::Precision;
    use lightkiln::units::Quantity;
    use std::path::Path;

    fn settings(options: &[&str]) -> Settings {
        let typed = ["lightkiln", "bake", "rooms/hall.glb"].iter().chain(options);
        match Arguments::try_parse_from(typed).expect("valid options").command {
            Command::Bake(bake) => bake.settings(),
            _ => panic!("bake was typed"),
        }
    }

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
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
