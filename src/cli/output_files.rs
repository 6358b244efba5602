//! Files and folders that commands write, with errors that name them.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// Writes a whole file.
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("{} cannot be written", path.display()))
}

/// Makes a folder, and those above it, unless they are there.
pub(super) fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("the folder {} cannot be made", folder.display()))
}

/// Makes a file to be written piece by piece.
pub(super) fn create(path: &Path) -> anyhow::Result<BufWriter<File>> {
    let file = File::create(path).with_context(|| format!("{} cannot be made", path.display()))?;
    Ok(BufWriter::new(file))
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
            let (first, second) = (first.display(), file.display());
            bail!("{first} and {second} would both be written to {name}: rename one of them");
        }
        names.push(name);
    }
    Ok(names)
}
