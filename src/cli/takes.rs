//! The sequences that `evaluate` compares on: frame files, and the synthetic rig.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, bail};
use steadymesh_geometry::TriangleMesh;
use steadymesh_synthetic_rig::Options;

use crate::evaluation::{KnownFrame, KnownMotion, file_words};
use crate::pipeline::PreparedFrame;

use super::frame_files::{expand, read_geometry};
use super::output_files::output_names;

/// A sequence of frames.
#[derive(Debug)]
pub(super) struct Take {
    name: String,
    source: Source,
}

#[derive(Debug)]
enum Source {
    Files(Vec<PathBuf>),
    Synthetic { motion: KnownMotion, frames: u64 },
}

/// A frame of a take.
#[derive(Debug)]
pub(super) struct TakenFrame {
    pub prepared: PreparedFrame,
    known: Option<KnownFrame>,
}

/// What `--synthetic` says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SyntheticOptions {
    rig: Options,
    frames: u64,
}

/// The takes that the arguments name: each folder, all files together, each synthetic one.
///
/// # Errors
///
/// A path that does not exist, a folder without frame files, a take of less than two frames, or a
/// rig that cannot be had.
pub(super) fn takes(
    paths: &[PathBuf],
    synthetic: &[SyntheticOptions],
) -> anyhow::Result<Vec<Take>> {
    let mut takes: Vec<Take> = Vec::new();
    let mut add = |name: String, source| {
        let is_taken = |name: &str| {
            let words = file_words(name);
            takes.iter().any(|take| file_words(&take.name) == words)
        };
        let numbered = (2..).map(|number| format!("{name} ({number})"));
        let name = std::iter::once(name.clone())
            .chain(numbered)
            .find(|name| !is_taken(name))
            .unwrap_or(name);
        takes.push(Take { name, source });
    };
    let is_folder = |path: &&PathBuf| path.is_dir();
    let files: Vec<PathBuf> = paths.iter().filter(|p| !is_folder(p)).cloned().collect();
    for file in &files {
        // Known now, and not when the turn of its sequence comes.
        std::fs::metadata(file).with_context(|| format!("{} cannot be read", file.display()))?;
    }
    if !files.is_empty() {
        add("files".to_owned(), Source::Files(files));
    }
    for folder in paths.iter().filter(is_folder) {
        let files = expand(std::slice::from_ref(folder))?;
        add(folder_name(folder), Source::Files(files));
    }
    for options in synthetic {
        let motion = KnownMotion::new(&options.rig)?;
        let frames = options.frames;
        add(options.name(), Source::Synthetic { motion, frames });
    }
    for take in &takes {
        let (name, count) = (&take.name, take.frame_count());
        if count < 2 {
            bail!(
                "consecutive frames are compared, which takes at least two frames; {name}: \
                 found {count}"
            );
        }
    }
    Ok(takes)
}

/// The folder's own name, without what would mean something in a table of Markdown.
fn folder_name(folder: &Path) -> String {
    let canonical = folder.canonicalize().ok();
    let name = folder
        .file_name()
        .or(canonical.as_deref().and_then(Path::file_name))
        .map_or_else(|| "frames".into(), |name| name.to_string_lossy());
    let special = |c: char| c.is_control() || "|<>[]`*\\".contains(c);
    name.replace(special, "_")
}

impl Take {
    /// What it is called; no other one is called the same, not even as part of a file's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn frame_count(&self) -> u64 {
        match &self.source {
            Source::Files(files) => files.len() as u64,
            Source::Synthetic { frames, .. } => *frames,
        }
    }

    /// What frame `seq` is called: its file without the folder.
    pub fn frame_name(&self, seq: u64) -> String {
        let file = match &self.source {
            Source::Files(files) => files.get(seq as usize),
            Source::Synthetic { .. } => None,
        };
        match file.and_then(|file| file.file_name()) {
            Some(name) => name.to_string_lossy().into_owned(),
            None => format!("frame{seq}"),
        }
    }

    /// The PLY files that are named after the frames.
    ///
    /// # Errors
    ///
    /// Two frames of one name.
    pub fn registered_names(&self) -> anyhow::Result<Vec<String>> {
        match &self.source {
            Source::Files(files) => output_names(files, "ply"),
            Source::Synthetic { frames, .. } => {
                Ok((0..*frames).map(|seq| format!("frame{seq}.ply")).collect())
            }
        }
    }

    /// Frame `seq`, below [`Take::frame_count`].
    ///
    /// # Errors
    ///
    /// What is wrong with its file, and where.
    pub fn frame(&self, seq: u64) -> anyhow::Result<TakenFrame> {
        match &self.source {
            Source::Files(files) => {
                let file = files.get(seq as usize).context("there is no such frame")?;
                let prepared = PreparedFrame::new(read_geometry(file)?, &mut ())
                    .with_context(|| file.display().to_string())?;
                let known = None;
                Ok(TakenFrame { prepared, known })
            }
            Source::Synthetic { motion, .. } => {
                let (known, prepared) = motion.frame(seq)?;
                let known = Some(known);
                Ok(TakenFrame { prepared, known })
            }
        }
    }

    pub fn has_known_motion(&self) -> bool {
        matches!(self.source, Source::Synthetic { .. })
    }

    /// Carries the result for `frame` along the true motion to frame `to`; none if it is not
    /// known.
    pub fn carry(
        &self,
        frame: &TakenFrame,
        output: &TriangleMesh,
        to: u64,
    ) -> Option<TriangleMesh> {
        match &self.source {
            Source::Files(_) => None,
            Source::Synthetic { motion, .. } => motion.carry(frame.known.as_ref()?, output, to),
        }
    }
}

/// One second of frames.
const DEFAULT_FRAMES: u64 = 30;

impl SyntheticOptions {
    fn name(&self) -> String {
        let Options {
            vertex_count,
            speed,
            noise,
            seed,
            ..
        } = &self.rig;
        // A length of 0.0003 m has digits in millimetres that it does not have in metres.
        let millimetres = (noise * 1e9).round() / 1e6;
        let mut name = format!("rig, speed {speed}, noise {millimetres} mm");
        if *vertex_count != Options::default().vertex_count {
            name.push_str(&format!(", {vertex_count} vertices"));
        }
        if *seed != Options::default().seed {
            name.push_str(&format!(", seed {seed}"));
        }
        name
    }
}

impl FromStr for SyntheticOptions {
    type Err = String;

    /// Reads `speed=2,noise=0.001`; nothing at all is the default.
    fn from_str(text: &str) -> Result<Self, String> {
        let (mut rig, mut frames) = (Options::default(), DEFAULT_FRAMES);
        for setting in text.split(',').filter(|setting| !setting.is_empty()) {
            let (key, value) = setting
                .split_once('=')
                .ok_or_else(|| format!("\"{setting}\" is not of the form name=value"))?;
            let not_a_number = format!("{key}: \"{value}\" is not a number of its kind");
            let wrong = || not_a_number.clone();
            match key {
                "speed" => rig.speed = value.parse().map_err(|_| wrong())?,
                "noise" => rig.noise = value.parse().map_err(|_| wrong())?,
                "vertices" => rig.vertex_count = value.parse().map_err(|_| wrong())?,
                "seed" => rig.seed = value.parse().map_err(|_| wrong())?,
                "frames" => frames = value.parse().map_err(|_| wrong())?,
                _ => {
                    return Err(format!(
                        "\"{key}\" is none of speed, noise, vertices, frames and seed"
                    ));
                }
            }
        }
        Ok(Self { rig, frames })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn synthetic(text: &str) -> SyntheticOptions {
        text.parse().unwrap()
    }

    #[test]
    fn a_synthetic_take_is_named_after_what_sets_it_apart() {
        assert_eq!(synthetic("").name(), "rig, speed 1, noise 0.3 mm");
        assert_eq!(synthetic("").frames, 30);
        let options = synthetic("speed=0.5,noise=0,vertices=5000,frames=3");
        assert_eq!(options.name(), "rig, speed 0.5, noise 0 mm, 5000 vertices");
        assert_eq!(options.frames, 3);
    }

    #[test]
    fn what_a_rig_does_not_have_is_named() {
        for (text, named) in [
            ("colour=1", "colour"),
            ("speed", "speed"),
            ("noise=x", "\"x\""),
        ] {
            let error = text.parse::<SyntheticOptions>().unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn takes_of_one_name_are_told_apart() {
        let twice = ["vertices=1000,frames=2", "vertices=1000,frames=3"].map(synthetic);
        let takes = takes(&[], &twice).unwrap();
        let names: Vec<&str> = takes.iter().map(Take::name).collect();
        assert_eq!(
            names,
            [
                "rig, speed 1, noise 0.3 mm, 1000 vertices",
                "rig, speed 1, noise 0.3 mm, 1000 vertices (2)"
            ]
        );
    }
}
