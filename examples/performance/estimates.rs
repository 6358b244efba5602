//! The estimates that Criterion wrote.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use serde::Deserialize;

/// One stage on one frame.
#[derive(Debug, Clone, Copy)]
pub struct Estimate {
    pub faces: f64,
    /// The median.
    pub seconds: f64,
}

/// By stage and by frame: a number of faces, or a capture's name.
pub struct Estimates(BTreeMap<(String, String), Estimate>);

#[derive(Deserialize)]
struct Benchmark {
    group_id: String,
    value_str: String,
    throughput: Throughput,
}

#[derive(Deserialize)]
struct Throughput {
    #[serde(rename = "Elements")]
    elements: u64,
}

#[derive(Deserialize)]
struct Figures {
    median: Median,
}

#[derive(Deserialize)]
struct Median {
    /// Nanoseconds.
    point_estimate: f64,
}

impl Estimates {
    /// Reads what is in `folder/*/*/new`.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let mut found = BTreeMap::new();
        for group in folders_in(folder)? {
            for frame in folders_in(&group)? {
                let new = frame.join("new");
                if !new.join("estimates.json").is_file() {
                    continue;
                }
                let benchmark: Benchmark = parse(&new.join("benchmark.json"))?;
                let figures: Figures = parse(&new.join("estimates.json"))?;
                let estimate = Estimate {
                    faces: benchmark.throughput.elements as f64,
                    seconds: figures.median.point_estimate * 1e-9,
                };
                found.insert((benchmark.group_id, benchmark.value_str), estimate);
            }
        }
        anyhow::ensure!(!found.is_empty(), "no estimates in {}", folder.display());
        Ok(Self(found))
    }

    pub fn of(&self, stage: &str, frame: &str) -> Option<Estimate> {
        self.0.get(&(stage.to_owned(), frame.to_owned())).copied()
    }

    /// The names of the captures that were measured.
    pub fn captures(&self) -> Vec<String> {
        let is_repair = |(stage, _): &&(String, String)| stage == "repair";
        let frames = self.0.keys().filter(is_repair).map(|(_, frame)| frame);
        frames
            .filter(|frame| frame.parse::<usize>().is_err())
            .cloned()
            .collect()
    }

    /// A column's head: a capture comes with its number of faces.
    pub fn head(&self, frame: &str) -> String {
        match self.of("repair", frame) {
            Some(found) if frame.parse::<usize>().is_err() => {
                format!("{frame}, {} faces", found.faces)
            }
            _ => frame.to_owned(),
        }
    }
}

fn folders_in(folder: &Path) -> anyhow::Result<Vec<std::path::PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let paths = entries.map(|entry| Ok(entry?.path()));
    let mut paths: Vec<_> = paths.collect::<std::io::Result<_>>()?;
    paths.retain(|path| path.is_dir());
    Ok(paths)
}

fn parse<T: serde::de::DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let text = std::fs::read(path).with_context(|| path.display().to_string())?;
    serde_json::from_slice(&text).with_context(|| path.display().to_string())
}

/// The slope of the line through the logarithms of faces and times; none for fewer than two.
pub fn exponent(estimates: &[Estimate]) -> Option<f64> {
    if estimates.len() < 2 {
        return None;
    }
    let count = estimates.len() as f64;
    let x = |e: &Estimate| e.faces.ln();
    let y = |e: &Estimate| e.seconds.ln();
    let (mean_x, mean_y) = (
        estimates.iter().map(x).sum::<f64>() / count,
        estimates.iter().map(y).sum::<f64>() / count,
    );
    let square: f64 = estimates.iter().map(|e| (x(e) - mean_x).powi(2)).sum();
    let product: f64 = estimates
        .iter()
        .map(|e| (x(e) - mean_x) * (y(e) - mean_y))
        .sum();
    Some(product / square)
}
