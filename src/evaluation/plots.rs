//! The plots of a report.

use steadymesh_proto::metrics::Tracking;

use super::chart::{Chart, Line, PlotFailed, Scale, svg};
use super::results::{ByFrame, Evaluation, Measure, Run, TargetEvaluation};
use super::tables::name;

/// A plot and the file it goes into.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// The name of the file.
    pub file_name: String,
    /// What the plot shows.
    pub title: String,
    /// The content of the file.
    pub svg: String,
}

/// The plots of every target: the mean of each kind of distance over the frames, and how the
/// distances from vertices and from samples are distributed.
///
/// # Errors
///
/// [`PlotFailed`] names the plot that could not be drawn.
pub fn plots(evaluation: &Evaluation) -> Result<Vec<Plot>, PlotFailed> {
    let mut plots = Vec::new();
    for target in &evaluation.targets {
        for measure in Measure::ALL {
            let chart = over_frames(evaluation, target, measure);
            plots.push(plot(over_frames_file(target, measure), &chart)?);
        }
        for measure in DISTRIBUTIONS {
            let chart = distribution(target, measure);
            plots.push(plot(distribution_file(target, measure), &chart)?);
        }
    }
    Ok(plots)
}

/// The kinds of distance whose distribution is plotted.
pub(super) const DISTRIBUTIONS: [Measure; 2] = [Measure::Surface, Measure::Sample];

/// Below this share, in percent, a curve is flat for decades: it is not drawn.
const SMALLEST_SHARE: f64 = 1.0;

/// The file of the plot over the frames.
pub(super) fn over_frames_file(target: &TargetEvaluation, measure: Measure) -> String {
    format!("{}-{}.svg", file_word(measure), target.target_faces)
}

/// The file of the plot of the distribution.
pub(super) fn distribution_file(target: &TargetEvaluation, measure: Measure) -> String {
    let word = file_word(measure);
    format!("{word}-distribution-{}.svg", target.target_faces)
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

fn plot(file_name: String, chart: &Chart) -> Result<Plot, PlotFailed> {
    Ok(Plot {
        file_name,
        title: chart.title.clone(),
        svg: svg(chart)?,
    })
}

fn over_frames(evaluation: &Evaluation, target: &TargetEvaluation, measure: Measure) -> Chart {
    let diagonals = || evaluation.pairs.iter().map(|pair| pair.bbox_diagonal);
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
        title: format!("{}, {} faces", title(measure), target.target_faces),
        x: ("frame k", Scale::Counting),
        y: "mean, % of the diagonal",
        lines,
    }
}

fn distribution(target: &TargetEvaluation, measure: Measure) -> Chart {
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
        title: format!(
            "{}, {} faces: cumulative distribution",
            title(measure),
            target.target_faces
        ),
        x: ("distance, % of the diagonal", Scale::Logarithmic),
        y: "share not above it, %",
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
