//! Files and folders that commands write, with errors that name them.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// Writes a whole file, or none: one that is cut short would look whole.
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let written = std::fs::write(path, bytes);
    if written.is_err() && path.is_file() {
        // What went wrong first is what the user is told.
        std::fs::remove_file(path).ok();
    }
    written.with_context(|| format!("{} cannot be written", path.display()))
}

/// Makes a folder, and those above it, unless they are there.
pub(super) fn make_folder(folder: &Path) -> anyhow::Result<()> {
    if folder.is_file() {
        bail!("{} is a file, where a folder is expected", folder.display());
    }
    std::fs::create_dir_all(folder)
        .with_context(|| format!("the folder {} cannot be made", folder.display()))
}

/// A file that is written piece by piece, whose errors name it.
#[derive(Debug)]
pub(super) struct OutputFile {
    path: PathBuf,
    file: BufWriter<File>,
}

/// Makes a file to be written piece by piece.
pub(super) fn create(path: &Path) -> anyhow::Result<OutputFile> {
    let file = File::create(path).with_context(|| format!("{} cannot be made", path.display()))?;
    Ok(OutputFile {
        path: path.to_owned(),
        file: BufWriter::new(file),
    })
}

impl OutputFile {
    fn named<T>(&self, written: io::Result<T>) -> io::Result<T> {
        written.map_err(|error| {
            let message = format!("{} cannot be written: {error}", self.path.display());
            io::Error::new(error.kind(), message)
        })
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes);
        self.named(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.file.flush();
        self.named(flushed)
    }
}

/// A name for what is made of each of `files`: its own with another extension.
///
/// # Errors
///
/// Two files of one name, since one would overwrite the other.
pub(super) fn output_names(files: &[PathBuf], extension: &str) -> anyhow::Result<Vec<String>> {
    let mut seen = std::collections::HashMap::new();
    let mut names = Vec::with_capacity(files.len());
    for file in files {
        let stem = file
            .file_stem()
            .with_context(|| format!("{} does not name a file", file.display()))?
            .to_string_lossy();
        let name = format!("{stem}.{extension}");
        if let Some(first) = seen.insert(name.clone(), file) {
            if first == file {
                bail!("{} is named twice", file.display());
            }
            let (first, second) = (first.display(), file.display());
            bail!("{first} and {second} would both be written to {name}: rename one of them");
        }
        names.push(name);
    }
    Ok(names)
}

/// Makes sure that no input is overwritten by an output.
pub(super) fn refuse_to_overwrite(
    inputs: &[PathBuf],
    folder: &Path,
    names: &[String],
) -> anyhow::Result<()> {
    // An output that does not exist yet is nobody's input.
    let outputs = names
        .iter()
        .filter_map(|name| folder.join(name).canonicalize().ok());
    let outputs: HashSet<PathBuf> = outputs.collect();
    for input in inputs {
        if input
            .canonicalize()
            .is_ok_and(|input| outputs.contains(&input))
        {
            bail!(
                "{} would be overwritten by its result: choose another folder",
                input.display()
            );
        }
    }
    Ok(())
}

/// Whether two names are of one folder.
pub(super) fn is_same_folder(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}
