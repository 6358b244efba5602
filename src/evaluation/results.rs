//! What an evaluation finds: the fields of its JSON.
//!
//! Distances are in the mesh's own unit (squared for `variance` and `mse`) unless they are
//! under `percent_of_diagonal`, where they are in percent of the diagonal of frame k's bounding
//! box (and of its square).

use serde::Serialize;
use steadymesh_proto::metrics::{Consistency, Registration, Statistics, Tracking};

use crate::pipeline::TargetSize;

use super::snapshots::Snapshot;

/// Frames in a second for which bit rates are stated.
pub const FRAMES_PER_SECOND: f64 = 30.0;

/// Everything that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// The version of Steadymesh.
    pub version: String,
    /// The command that made it, quoted for a shell.
    pub command: String,
    /// One for each sequence of frames, in the order in which they were asked for.
    pub sequences: Vec<Sequence>,
}

impl Evaluation {
    /// All of it. `command` is what the user typed.
    #[must_use]
    pub fn new(command: String, sequences: Vec<Sequence>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command,
            sequences,
        }
    }
}

/// What was found in one sequence of frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sequence {
    /// What it is called; no other one is called the same.
    pub name: String,
    /// The frame files, in order; a frame's number `seq` counts them from 0.
    pub frames: Vec<String>,
    /// Consecutive frames.
    pub pairs: Vec<FramePair>,
    /// One for each size that was asked for.
    pub targets: Vec<TargetEvaluation>,
}

/// A frame and its predecessor, registered onto it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FramePair {
    /// The number of frame k.
    pub seq: u64,
    /// Faces of frame k, after repair.
    pub faces: usize,
    /// The diagonal of frame k's bounding box: the peak of every PSNR.
    pub bbox_diagonal: f64,
    /// √3 times the longest side of that box: the peak that MPEG's software takes if the voxels
    /// just hold the frame.
    pub mpeg_peak: f64,
    /// How well frame k-1 was registered; none if it was not.
    pub registration: Option<Registration>,
    /// Why it was not.
    pub registration_error: Option<String>,
    /// Why frame k was treated as a first one, if it was.
    pub reset: Option<String>,
}

/// The results for one size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetEvaluation {
    /// How many faces were asked for.
    #[serde(flatten)]
    pub target: Target,
    /// How many pairs were registered and measured in every run; the averages and the best
    /// pairs are among these.
    pub compared_pairs: usize,
    /// The original QEM, then the tracking modes in the order in which they were asked for.
    pub runs: Vec<Run>,
}

/// How many faces were asked for: one of the two fields is there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Target {
    /// This many.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_faces: Option<usize>,
    /// This share of the frame's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_ratio: Option<f64>,
}

impl From<TargetSize> for Target {
    fn from(size: TargetSize) -> Self {
        let (target_faces, target_ratio) = match size {
            TargetSize::Faces(faces) => (Some(faces), None),
            TargetSize::Ratio(ratio) => (None, Some(ratio)),
        };
        Self {
            target_faces,
            target_ratio,
        }
    }
}

impl std::fmt::Display for Target {
    /// As in "to 4000 faces".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.target_faces, self.target_ratio) {
            (Some(faces), _) => write!(f, "{faces} faces"),
            (None, ratio) => write!(f, "{} % of the faces", percent(ratio.unwrap_or(1.0))),
        }
    }
}

/// Without the digits that a share of, say, 0.07 gets in binary.
pub(super) fn percent(share: f64) -> f64 {
    (share * 1e8).round() / 1e6
}

/// The results of one algorithm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// The algorithm.
    pub tracking: Tracking,
    /// One for each pair.
    pub outputs: Vec<Output>,
    /// Averages over the compared pairs; none if there are no such pairs.
    pub average: Option<Averages>,
    /// Averages over the last ten of them, which show whether errors add up; none unless there
    /// are four times as many.
    pub average_of_last_ten: Option<Averages>,
    /// The compared pair with the smallest distances, for each kind of distance on its own.
    pub best: Option<ByMeasure<Best>>,
    /// `average` against that of `off`; none for `off` itself.
    pub average_change_percent: Option<ByMeasure<ByFrame<Change>>>,
    /// `best` against that of `off`; none for `off` itself.
    pub best_change_percent: Option<ByMeasure<ByFrame<Change>>>,
    /// How the distances of all compared pairs are distributed: points of the cumulative
    /// distribution, each a distance in percent of the diagonal and the share (0 to 1) of the
    /// distances that are not above it.
    pub distribution: ByMeasure<ByFrame<Vec<[f64; 2]>>>,
    /// The frames that are pictured; not in the JSON.
    #[serde(skip)]
    pub snapshots: Vec<Snapshot>,
}

/// One simplified frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Output {
    /// The number of frame k.
    pub seq: u64,
    /// How it was simplified: `off` where there is no registered frame.
    pub tracking: Tracking,
    /// Its vertices.
    pub vertices: usize,
    /// Its faces.
    pub faces: usize,
    /// Whether it has the asked number of faces (or one more where the topology leaves no
    /// choice).
    pub target_reached: bool,
    /// Its length in Draco.
    pub bytes: usize,
    /// The bit rate of such frames at 30 frames a second, in 10⁶ bit/s.
    pub mbit_per_second: f64,
    /// Edges with more than two faces.
    pub non_manifold_edges: usize,
    /// Its distances; none if no faces are left.
    pub distances: Option<ByMeasure<ByFrame<Statistics>>>,
    /// The symmetric Hausdorff distance to frame k: the largest distance from any vertex of
    /// either mesh, or even sample of this one, to the surface of the other.
    pub hausdorff: Option<f64>,
    /// Its errors against frame k, as in point-cloud coding; none if no faces are left.
    pub psnr: Option<Psnr>,
    /// What has come back of this run's result for frame k-1, carried along by the registration;
    /// none without a registration.
    pub consistency: Option<Consistency>,
    /// The same, carried along by the true motion; none where that is not known.
    pub known_motion_consistency: Option<Consistency>,
}

/// D1 and D2 against frame k; see `metrics::point_errors` in the geometry crate.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Psnr {
    /// On the vertices of both meshes.
    pub vertices: ByError,
    /// On 100,000 even samples of each surface.
    pub samples: ByError,
}

/// Both errors of point-cloud coding.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ByError {
    /// Point to point.
    pub d1: Directions,
    /// Point to plane.
    pub d2: Directions,
}

/// In dB; none where there is no error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Directions {
    /// Of the direction with the larger error, as MPEG states it.
    pub worse: Option<f64>,
    /// Of the direction with the smaller error, as some papers state it.
    pub better: Option<f64>,
}

/// Means over pairs.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Averages {
    /// Of the distances.
    #[serde(flatten)]
    pub distances: ByMeasure<ByFrame<Summary>>,
    /// Of the symmetric Hausdorff distance, in percent of the diagonal.
    pub hausdorff_percent_of_diagonal: f64,
    /// Of the dB, as MPEG averages frames.
    pub psnr: Psnr,
    /// With the registration as the motion.
    pub consistency: Option<ConsistencySummary>,
    /// With the true motion; none where that is not known.
    pub known_motion_consistency: Option<ConsistencySummary>,
    /// Draco bytes of a frame.
    pub bytes: f64,
    /// At 30 frames a second, in 10⁶ bit/s.
    pub mbit_per_second: f64,
}

/// What comes back from one result to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ConsistencySummary {
    /// The share of the vertices that were there before, 0 to 1.
    pub vertex_persistence: f64,
    /// The share of the previous edges that are there again, 0 to 1.
    pub edge_persistence: f64,
    /// The mean distance of the two surfaces, in percent of the diagonal.
    pub flicker_percent_of_diagonal: f64,
}

/// A kind of distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// See [`ByMeasure::surface_distance`].
    Surface,
    /// See [`ByMeasure::vertex_distance`].
    Vertex,
    /// See [`ByMeasure::sample_distance`].
    Sample,
    /// See [`ByMeasure::to_output`].
    ToOutput,
}

impl Measure {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Surface, Self::Vertex, Self::Sample, Self::ToOutput];
}

/// Something for each kind of distance.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ByMeasure<T> {
    /// From each vertex of the simplified mesh to the surface of the frame.
    pub surface_distance: T,
    /// From each vertex of the simplified mesh to the nearest vertex of the frame.
    pub vertex_distance: T,
    /// From each of 20,000 samples, spread evenly over the simplified surface, to the surface
    /// of the frame.
    pub sample_distance: T,
    /// The other direction: from each vertex of the frame to the simplified surface.
    pub to_output: T,
}

impl<T> ByMeasure<T> {
    /// Makes it from what `of` says of each kind.
    pub fn from_fn(mut of: impl FnMut(Measure) -> T) -> Self {
        Self {
            surface_distance: of(Measure::Surface),
            vertex_distance: of(Measure::Vertex),
            sample_distance: of(Measure::Sample),
            to_output: of(Measure::ToOutput),
        }
    }

    /// That of one kind.
    #[must_use]
    pub fn get(&self, measure: Measure) -> &T {
        match measure {
            Measure::Surface => &self.surface_distance,
            Measure::Vertex => &self.vertex_distance,
            Measure::Sample => &self.sample_distance,
            Measure::ToOutput => &self.to_output,
        }
    }

    /// That of one kind, to be changed.
    pub fn get_mut(&mut self, measure: Measure) -> &mut T {
        match measure {
            Measure::Surface => &mut self.surface_distance,
            Measure::Vertex => &mut self.vertex_distance,
            Measure::Sample => &mut self.sample_distance,
            Measure::ToOutput => &mut self.to_output,
        }
    }
}

/// Something for each of the two frames that a result is measured against.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ByFrame<T> {
    /// For the registered frame k-1; none without one.
    pub previous: Option<T>,
    /// For frame k.
    pub current: T,
}

impl<T> ByFrame<T> {
    /// Makes another one of it.
    pub fn map<U>(&self, of: impl Fn(&T) -> U) -> ByFrame<U> {
        ByFrame {
            previous: self.previous.as_ref().map(&of),
            current: of(&self.current),
        }
    }

    /// The two, each with its name in the paper.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &T)> {
        let previous = self.previous.iter().map(|t| ("(k-1)-th", t));
        previous.chain(std::iter::once(("k-th", &self.current)))
    }
}

/// Statistics in both units.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Summary {
    /// In the mesh's own unit.
    pub own_unit: Statistics,
    /// In percent of the diagonal.
    pub percent_of_diagonal: Statistics,
}

/// The pair with the smallest distances.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Best {
    /// The number of its frame k.
    pub seq: u64,
    /// Its figures.
    pub summary: ByFrame<Summary>,
}

/// By how many percent each figure (in the mesh's own unit) is above that of the original QEM;
/// none where that is 0.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Change {
    /// Of the mean.
    pub mean: Option<f64>,
    /// Of the variance.
    pub variance: Option<f64>,
    /// Of the standard deviation.
    pub std: Option<f64>,
    /// Of the mean square.
    pub mse: Option<f64>,
    /// Of the root mean square.
    pub rmse: Option<f64>,
    /// Of the maximum.
    pub max: Option<f64>,
}
