//! The images of a report: plots and pictures.

use steadymesh_proto::metrics::{Consistency, Tracking};

use super::chart::{Chart, Line, PlotFailed, Scale, svg};
use super::pictures;
use super::results::{
    ByFrame, Evaluation, Measure, Output, Run, Sequence, Target, TargetEvaluation, percent,
};
use super::tables::name;

/// A plot or picture and the file it goes into.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// The name of the file.
    pub file_name: String,
    /// What it shows.
    pub title: String,
    /// The content of the file.
    pub svg: String,
}

/// What an image of a sequence at one size shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Image {
    /// The means of one kind of distance over the frames.
    OverFrames(Measure),
    /// How the distances of one kind are distributed.
    Distribution(Measure),
    /// What comes back, over the frames.
    Persistence,
    /// Consecutive wireframes of every mode.
    ContactSheet,
    /// One result of every mode, coloured by its distances.
    HeatMap,
}

/// The images of every sequence and size.
///
/// # Errors
///
/// [`PlotFailed`] names the plot that could not be drawn.
pub fn plots(evaluation: &Evaluation) -> Result<Vec<Plot>, PlotFailed> {
    let mut plots = Vec::new();
    for sequence in &evaluation.sequences {
        for target in &sequence.targets {
            for image in images(target) {
                let title = image.title(target.target);
                plots.push(Plot {
                    file_name: image.file(sequence, target),
                    svg: draw(image, sequence, target, title.clone())?,
                    title,
                });
            }
        }
    }
    Ok(plots)
}

/// The images that there are of a sequence at one size.
fn images(target: &TargetEvaluation) -> Vec<Image> {
    let mut images: Vec<Image> = Measure::ALL.map(Image::OverFrames).to_vec();
    images.extend(DISTRIBUTIONS.map(Image::Distribution));
    images.push(Image::Persistence);
    if has_pictures(target) {
        images.extend([Image::ContactSheet, Image::HeatMap]);
    }
    images
}

/// Whether there are pictures of the results, and not plots alone.
pub(super) fn has_pictures(target: &TargetEvaluation) -> bool {
    target.runs.iter().all(|run| !run.snapshots.is_empty())
}

/// The kinds of distance whose distribution is plotted.
pub(super) const DISTRIBUTIONS: [Measure; 2] = [Measure::Surface, Measure::Sample];

/// Below this share, in percent, a curve is flat for decades: it is not drawn.
const SMALLEST_SHARE: f64 = 1.0;

impl Image {
    /// What it shows, at this size.
    pub fn title(self, target: Target) -> String {
        match self {
            Self::OverFrames(measure) => format!("{}, {target}", title(measure)),
            Self::Distribution(measure) => {
                format!("{}, {target}: cumulative distribution", title(measure))
            }
            Self::Persistence => format!("What comes back from the frame before, {target}"),
            Self::ContactSheet => format!("Consecutive frames, {target}"),
            Self::HeatMap => format!("Distances to the two frames, {target}"),
        }
    }

    /// The name of its file.
    pub fn file(self, sequence: &Sequence, target: &TargetEvaluation) -> String {
        let word = match self {
            Self::OverFrames(measure) => file_word(measure).to_owned(),
            Self::Distribution(measure) => format!("{}-distribution", file_word(measure)),
            Self::Persistence => "persistence".to_owned(),
            Self::ContactSheet => "contact-sheet".to_owned(),
            Self::HeatMap => "heat-map".to_owned(),
        };
        let size = match (target.target.target_faces, target.target.target_ratio) {
            (None, Some(ratio)) => format!("{}-percent", percent(ratio)),
            (faces, _) => faces.unwrap_or(0).to_string(),
        };
        format!("{}-{size}-{word}.svg", file_words(&sequence.name))
    }
}

/// `name` as part of a file's name that needs no quotes anywhere; never empty.
#[must_use]
pub fn file_words(name: &str) -> String {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let words: Vec<String> = name
        .split(|c| !allowed(c))
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect();
    if words.is_empty() {
        return "sequence".to_owned();
    }
    words.join("-")
}

fn draw(
    image: Image,
    sequence: &Sequence,
    target: &TargetEvaluation,
    title: String,
) -> Result<String, PlotFailed> {
    match image {
        Image::OverFrames(measure) => svg(&over_frames(sequence, target, measure, title)),
        Image::Distribution(measure) => svg(&distribution(target, measure, title)),
        Image::Persistence => svg(&persistence(target, title)),
        Image::ContactSheet => Ok(pictures::contact_sheet(target)),
        Image::HeatMap => Ok(pictures::heat_map(target)),
    }
}

/// What a kind of distance is called in titles.
pub(super) fn title(measure: Measure) -> &'static str {
    match measure {
        Measure::Surface => "Mesh surface distance",
        Measure::Vertex => "Nearest vertex distance",
        Measure::Sample => "Mesh surface distance from even samples",
        Measure::ToOutput => "Distance from the frames to the result",
    }
}

fn file_word(measure: Measure) -> &'static str {
    match measure {
        Measure::Surface => "surface",
        Measure::Vertex => "vertex",
        Measure::Sample => "samples",
        Measure::ToOutput => "to-output",
    }
}

fn over_frames(
    sequence: &Sequence,
    target: &TargetEvaluation,
    measure: Measure,
    title: String,
) -> Chart {
    let diagonals = || sequence.pairs.iter().map(|pair| pair.bbox_diagonal);
    let lines = lines(target, |run| {
        let mut points: ByFrame<Vec<(f64, f64)>> = ByFrame {
            previous: Some(Vec::new()),
            current: Vec::new(),
        };
        for (output, diagonal) in run.outputs.iter().zip(diagonals()) {
            let Some(distances) = &output.distances else {
                continue;
            };
            let mean = distances.get(measure).map(|s| 100.0 * s.mean / diagonal);
            if let (Some(points), Some(mean)) = (&mut points.previous, mean.previous) {
                points.push((output.seq as f64, mean));
            }
            points.current.push((output.seq as f64, mean.current));
        }
        points
    });
    Chart {
        title,
        x: ("frame k", Scale::Counting),
        y: "mean, % of the diagonal",
        lines,
    }
}

fn distribution(target: &TargetEvaluation, measure: Measure, title: String) -> Chart {
    let lines = lines(target, |run| {
        run.distribution.get(measure).map(|points| {
            let percent = points
                .iter()
                .map(|&[distance, share]| (distance, 100.0 * share));
            let visible = percent.filter(|&(_, share)| SMALLEST_SHARE <= share);
            visible.collect()
        })
    });
    Chart {
        title,
        x: ("distance, % of the diagonal", Scale::Logarithmic),
        y: "share not above it, %",
        lines,
    }
}

/// A share of what comes back.
type Share = fn(&Consistency) -> f64;

/// Vertices solid, edges dashed.
fn persistence(target: &TargetEvaluation, title: String) -> Chart {
    let mut lines = Vec::new();
    let shares: [(&str, Share); 2] = [
        ("vertices", |c| c.vertex_persistence),
        ("edges", |c| c.edge_persistence),
    ];
    for run in &target.runs {
        for (index, (what, share)) in shares.into_iter().enumerate() {
            let point = |output: &Output| {
                let consistency = output.consistency.as_ref()?;
                Some((output.seq as f64, 100.0 * share(consistency)))
            };
            lines.push(Line {
                name: format!("{}, {what}", name(run.tracking)),
                color: color(run.tracking),
                is_dashed: index == 1,
                points: run.outputs.iter().filter_map(point).collect(),
            });
        }
    }
    Chart {
        title,
        x: ("frame k", Scale::Counting),
        y: "share, %",
        lines,
    }
}

/// Two lines a run, solid to frame k-1 and dashed to frame k.
fn lines(
    target: &TargetEvaluation,
    points: impl Fn(&Run) -> ByFrame<Vec<(f64, f64)>>,
) -> Vec<Line> {
    let mut lines = Vec::new();
    for run in &target.runs {
        let points = points(run);
        for ((_, points), (frame, is_dashed)) in points.named().zip([("k-1", false), ("k", true)]) {
            lines.push(Line {
                name: format!("{}, {frame}", name(run.tracking)),
                color: color(run.tracking),
                is_dashed,
                points: points.clone(),
            });
        }
    }
    lines
}

/// From the palette of Okabe and Ito, which colour-blind people can tell apart:
/// <https://jfly.uni-koeln.de/color/>.
fn color(tracking: Tracking) -> [u8; 3] {
    match tracking {
        Tracking::Off => [0x00, 0x72, 0xb2],
        Tracking::Paper => [0xd5, 0x5e, 0x00],
        Tracking::Robust => [0x00, 0x9e, 0x73],
    }
}
