//! What can be wrong with a solution and its tiles, each with its remedy.

use super::tile_set::TileSet;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a solution or tiles of it cannot be used.
#[derive(Debug, Error)]
pub enum PartError {
    /// There is no solution.
    #[error("there is no solution in `{}`; `lightkiln solve SCENE --out {}` writes one", .0.display(), .0.display())]
    NoSolution(PathBuf),
    /// A solution of something else is where one should be written.
    #[error("`{}` {other}; pass --force to replace it and its tiles, or choose another folder with --out", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
        /// In what it differs.
        other: String,
    },
    /// A file cannot be read.
    #[error("cannot read `{}`", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file is not what was written.
    #[error("`{}` is damaged; {remedy}", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What to do.
        remedy: &'static str,
    },
    /// It was written by another version of the baker.
    #[error("`{}` is from lightkiln {found}, and this is {own}; use the same version on all machines, or solve again with --force", .path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
        /// That of this program.
        own: String,
    },
    /// The scene is not where it was.
    #[error("there is no `{}`, the scene of the solution; say with --scene where it is", .0.display())]
    NoScene(PathBuf),
    /// The scene is not what it was.
    #[error("`{}` is not the scene that was solved, or it has changed; name the right file with --scene, or solve it again with --force", .0.display())]
    OtherScene(PathBuf),
    /// The lightmap is laid out in another way than on the machine that solved.
    #[error("the lightmap of `{}` is laid out in another way here than where it was solved; use the same build of lightkiln on all machines, or solve again with --force", .0.display())]
    Layout(PathBuf),
    /// Two solutions where one is wanted.
    #[error("`{}` and `{}` are different solutions; merge the tiles of one", .0.display(), .1.display())]
    TwoSolutions(PathBuf, PathBuf),
    /// Tiles of another solution.
    #[error("`{}` (tiles {tiles}) {other}; remove it and gather these tiles again", .path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it holds.
        tiles: TileSet,
        /// What it is from.
        other: String,
    },
    /// Tiles of one solution that cannot both be right.
    #[error("`{}` (tiles {}) and `{}` (tiles {}) disagree about the same texels; remove both and gather these tiles again", .0.0.display(), .0.1, .1.0.display(), .1.1)]
    Conflict((PathBuf, TileSet), (PathBuf, TileSet)),
    /// Not all tiles are there.
    #[error("tiles {missing} of {count} are missing; `lightkiln gather {} --tiles {missing}` bakes them", .folder.display())]
    Missing {
        /// Where the solution is.
        folder: PathBuf,
        /// Those that are.
        missing: TileSet,
        /// All there are.
        count: u32,
    },
    /// Tiles that the solution does not have.
    #[error("there are no tiles {asked}: the solution has {count}, from 0 to {}", .count.saturating_sub(1))]
    NoSuchTiles {
        /// What was asked for.
        asked: TileSet,
        /// How many there are.
        count: u32,
    },
    /// Too many runs of tiles for a file name.
    #[error("these are too many runs of tiles for the name of a file; name one with --out")]
    LongName,
    /// There is no such file or folder to merge.
    #[error("there is no `{}`", .0.display())]
    Nothing(PathBuf),
}

impl PartError {
    /// True if the machine or the program on it is at fault rather than the input or the command line.
    pub fn is_environment(&self) -> bool {
        matches!(self, Self::Read { .. } | Self::Version { .. } | Self::Layout(_))
    }
}
