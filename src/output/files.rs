//! A set of result files that appears whole or not at all.
//!
//! Every file is written beside its final name under a temporary one. [`OutputSet::commit`] renames them once all are
//! complete and on the disk; the set may then be written again, and the next commit replaces what the last one left.
//! A set that is dropped before, and [`abandon`] when the process is told to stop, remove
//! the temporary files and the folders that were made for them.

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use thiserror::Error;

/// Why results could not be written.
#[derive(Debug, Error)]
pub enum OutputError {
    /// A result of an earlier bake is in the way.
    #[error("`{}` already exists; pass --force to replace it, or choose another folder with --out", .0.display())]
    Exists(PathBuf),
    /// The name that the folder should have belongs to something else.
    #[error("`{}` is not a folder; choose another one with --out", .0.display())]
    NotAFolder(PathBuf),
    /// The folder refuses new files.
    #[error("cannot write to the folder `{}`; choose a writable one with --out", .folder.display())]
    NotWritable {
        /// Folder of the results.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The disk is full, or the user's share of it.
    #[error("no space left for `{}`; free some or choose a folder on another disk with --out", .path.display())]
    Full {
        /// The file that did not fit.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Anything else that went wrong with a file.
    #[error("cannot write `{}`", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A result of an earlier bake cannot be read.
    #[error("cannot read `{}`", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl OutputError {
    /// The error that `source` means for `path`.
    fn writing(path: &Path, source: io::Error) -> Self {
        let path = path.to_path_buf();
        if lacks_space(&source) { Self::Full { path, source } } else { Self::Write { path, source } }
    }

    /// Stable, machine-readable kind.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Exists(_) => "output_exists",
            Self::NotAFolder(_) => "output_not_a_folder",
            Self::NotWritable { .. } => "output_not_writable",
            Self::Full { .. } => "disk_full",
            Self::Write { .. } => "output_write",
            Self::Read { .. } => "output_read",
        }
    }

    /// True if the machine is at fault rather than the input or the command line.
    pub fn is_environment(&self) -> bool {
        !matches!(self, Self::Exists(_))
    }
}

/// True if there is no room for more bytes: on the disk, or within a limit of the user's.
fn lacks_space(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge)
}

/// What a file's content is written to.
pub trait Sink: Write + Seek {}
impl<T: Write + Seek> Sink for T {}

/// Files and folders on the disk that are not results yet, oldest first.
///
/// Process-wide, because a signal must be able to remove them while another thread is in the middle of a write.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    // The list stays meaningful after a panic elsewhere: every push and removal is a single step.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes `path`, a file or an empty folder. A folder with something else in it stays.
fn remove(path: &Path) {
    // There is nobody to tell if this fails: the caller is already giving up for another reason.
    let _ = fs::remove_file(path).or_else(|_| fs::remove_dir(path));
}

/// Removes everything unfinished and keeps every thread from writing more results. Only for a process that is about
/// to exit.
pub fn abandon() {
    let mut list = unfinished();
    for path in list.drain(..).rev() {
        remove(&path);
    }
    // Whoever wants to create or rename a file from here on waits for the exit.
    std::mem::forget(list);
}

/// A file of the set, complete but under its temporary name.
#[derive(Debug)]
struct Written {
    target: PathBuf,
    temporary: PathBuf,
}

/// The results of one bake on their way to the disk.
#[derive(Debug)]
pub struct OutputSet {
    folder: PathBuf,
    force: bool,
    /// Folders that this set made, outermost first.
    created: Vec<PathBuf>,
    written: Vec<Written>,
    /// Files that are not stale although they are not written.
    kept: Vec<PathBuf>,
}

impl OutputSet {
    /// Prepares `folder` before the long computation: it exists afterwards, takes new files, and holds none of `names`
    /// and no lightmap page. `force` permits both, and pages that the new bake lacks go away with the commit.
    pub fn open(folder: &Path, names: &[&str], force: bool) -> Result<Self, OutputError> {
        let mut set =
            Self { folder: folder.to_path_buf(), force, created: Vec::new(), written: Vec::new(), kept: Vec::new() };
        set.create_folder()?;
        for name in names {
            set.check_free(&folder.join(name))?;
        }
        if !force && let Some(page) = set.pages_on_disk().into_iter().next() {
            return Err(OutputError::Exists(page));
        }
        set.probe()?;
        Ok(set)
    }

    /// Removes what a bake that was killed has left half written. Only where no other bake can be at work.
    pub fn sweep(&self) {
        let own = partial();
        let is_left = |name: &str| name.starts_with('.') && name.contains(".partial-") && !name.ends_with(&own);
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        entries.filter(|e| e.file_name().to_str().is_some_and(is_left)).for_each(|e| remove(&e.path()));
    }

    /// Name of lightmap page `index`.
    pub fn page_name(index: usize) -> String {
        format!("lightmap_{index}.exr")
    }

    /// Name of page `index` of the light group that `label` stands for.
    pub fn group_page_name(index: usize, label: &str) -> String {
        format!("lightmap_{index}.{label}.exr")
    }

    /// Lets a file of the folder outlive the commit although this set does not replace it.
    pub fn keep(&mut self, name: &str) {
        self.kept.push(self.folder.join(name));
    }

    /// Names of the files that were written, in that order.
    pub fn names(&self) -> Vec<String> {
        let name = |w: &Written| w.target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.written.iter().map(name).collect()
    }

    /// Folder of the results.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes file `name` through `content` under a temporary name, and waits until it is on the disk.
    pub fn write(
        &mut self,
        name: &str,
        content: impl FnOnce(&mut dyn Sink) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let target = self.folder.join(name);
        let temporary = temporary(&target);
        self.written.push(Written { target: target.clone(), temporary: temporary.clone() });
        fill(&temporary, content).map_err(|e| OutputError::writing(&target, e))
    }

    /// As [`OutputSet::write`], but if that fails the set goes on without the file.
    pub fn write_if_possible(
        &mut self,
        name: &str,
        content: impl FnOnce(&mut dyn Sink) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let before = self.written.len();
        let result = self.write(name, content);
        if result.is_err() {
            self.written.drain(before..).for_each(|w| discard(&w.temporary));
        }
        result
    }

    /// Gives all files their names and returns their paths, in the order in which they were written. Pages of an
    /// earlier bake that this one does not replace are removed, and its solution: they would pass for its own.
    pub fn commit(&mut self) -> Result<Vec<PathBuf>, OutputError> {
        // Held throughout, so that a signal finds either none or all of the results.
        let mut list = unfinished();
        for w in &self.written {
            self.check_free(&w.target)?;
        }
        let written = std::mem::take(&mut self.written);
        for (i, w) in written.iter().enumerate() {
            if let Err(e) = fs::rename(&w.temporary, &w.target) {
                written[..i].iter().for_each(|w| remove(&w.target));
                let error = OutputError::writing(&w.target, e);
                self.written = written;
                return Err(error);
            }
        }
        list.retain(|p| !self.created.contains(p) && !written.iter().any(|w| w.temporary == *p));
        self.created.clear();
        let outputs: Vec<PathBuf> = written.into_iter().map(|w| w.target).collect();
        self.pages_on_disk().iter().filter(|p| !outputs.contains(p) && !self.kept.contains(p)).for_each(|p| remove(p));
        // From now on these names are its own.
        self.force = true;
        Ok(outputs)
    }

    fn check_free(&self, path: &Path) -> Result<(), OutputError> {
        match fs::symlink_metadata(path) {
            Ok(m) if !self.force || m.is_dir() => Err(OutputError::Exists(path.to_path_buf())),
            _ => Ok(()),
        }
    }

    /// Lightmap pages and solution in the folder, by name.
    fn pages_on_disk(&self) -> Vec<PathBuf> {
        let is_page = |name: &str| {
            let label = name.strip_prefix("lightmap_").and_then(|n| n.strip_suffix(".exr"));
            // Batches put `lightmap_0.mip.exr` beside, which is theirs.
            let parts = label.map(|l| l.split_once('.').unwrap_or((l, "")));
            parts.is_some_and(|(n, group)| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()) && group != "mip")
                || name == "solution.lk"
        };
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let mut pages: Vec<PathBuf> =
            entries.filter(|e| e.file_name().to_str().is_some_and(is_page)).map(|e| e.path()).collect();
        pages.sort();
        pages
    }

    /// Makes the folder and those above it that are missing.
    fn create_folder(&mut self) -> Result<(), OutputError> {
        let missing: Vec<PathBuf> = self
            .folder
            .ancestors()
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .map(Path::to_path_buf)
            .collect();
        for path in missing.into_iter().rev() {
            let mut list = unfinished();
            match fs::create_dir(&path) {
                Ok(()) => {
                    list.push(path.clone());
                    self.created.push(path);
                }
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
                Err(e) if e.kind() == ErrorKind::NotADirectory => {
                    return Err(OutputError::NotAFolder(self.folder.clone()));
                }
                Err(e) if lacks_space(&e) => return Err(OutputError::writing(&path, e)),
                Err(source) => return Err(OutputError::NotWritable { folder: self.folder.clone(), source }),
            }
        }
        if self.folder.is_dir() { Ok(()) } else { Err(OutputError::NotAFolder(self.folder.clone())) }
    }

    /// Fails if the folder takes no new file.
    fn probe(&self) -> Result<(), OutputError> {
        let path = self.folder.join(format!(".lightkiln{}", partial()));
        let created = create(&path).map_err(|e| {
            if lacks_space(&e) {
                OutputError::writing(&path, e)
            } else {
                OutputError::NotWritable { folder: self.folder.clone(), source: e }
            }
        });
        discard(&path);
        created.map(|_| ())
    }
}

impl Drop for OutputSet {
    fn drop(&mut self) {
        self.written.iter().for_each(|w| discard(&w.temporary));
        self.created.iter().rev().for_each(|folder| discard(folder));
    }
}

/// A result of an earlier bake for reading, none if there is no such file.
pub fn open_result(path: &Path) -> Result<Option<BufReader<File>>, OutputError> {
    match File::open(path) {
        Ok(file) => Ok(Some(BufReader::with_capacity(1 << 18, file))),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(source) => Err(OutputError::Read { path: path.to_path_buf(), source }),
    }
}

/// The content of a result of an earlier bake, none if there is no such file.
pub fn read_result(path: &Path) -> Result<Option<Vec<u8>>, OutputError> {
    let Some(mut file) = open_result(path)? else { return Ok(None) };
    let mut content = Vec::new();
    let read = file.read_to_end(&mut content).map_err(|source| OutputError::Read { path: path.to_path_buf(), source });
    read.map(|_| Some(content))
}

/// Writes a single file whole, in place of an earlier one of that name.
pub(super) fn replace(target: &Path, content: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> Result<(), OutputError> {
    let temporary = temporary(target);
    let result = fill(&temporary, content).and_then(|()| {
        let mut list = unfinished();
        fs::rename(&temporary, target)?;
        list.retain(|p| *p != temporary);
        Ok(())
    });
    result.map_err(|e| {
        discard(&temporary);
        OutputError::writing(target, e)
    })
}

/// The name of a file beside `target` that is to become it.
fn temporary(target: &Path) -> PathBuf {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!(".{name}{}", partial()))
}

/// How temporary names of this process end. Processes on other machines may have the same number, and write to the same
/// folder.
fn partial() -> String {
    static START: LazyLock<u128> =
        LazyLock::new(|| SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos());
    format!(".partial-{}-{:x}", std::process::id(), *START)
}

/// Writes a file that is not a result yet, and waits until it is on the disk.
fn fill(path: &Path, content: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> io::Result<()> {
    let mut sink = BufWriter::with_capacity(1 << 18, create(path)?);
    content(&mut sink)?;
    sink.flush()?;
    sink.get_ref().sync_all()
}

/// Creates a file that is not a result yet.
fn create(path: &Path) -> io::Result<File> {
    let mut list = unfinished();
    let file = File::create(path)?;
    list.push(path.to_path_buf());
    Ok(file)
}

/// Removes a file or folder that will not become a result.
fn discard(path: &Path) {
    let mut list = unfinished();
    if let Some(i) = list.iter().position(|p| p == path) {
        list.swap_remove(i);
        remove(path);
    }
}
