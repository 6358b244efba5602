//! What an evaluation finds: the fields of its JSON.
//!
//! Distances are in the mesh's own unit (squared for `variance` and `mse`) unless they are
//! under `percent_of_diagonal`, where they are in percent of the diagonal of frame k's bounding
//! box (and of its square).

use serde::Serialize;
use steadymesh_proto::metrics::{Consistency, Registration, Statistics, Tracking};

/// Frames in a second for which bit rates are stated.
pub const FRAMES_PER_SECOND: f64 = 30.0;

/// Everything that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// The version of Steadymesh.
    pub version: String,
    /// The command that made it, quoted for a shell.
    pub command: String,
    /// The frame files, in order; a frame's number `seq` counts them from 0.
    pub frames: Vec<String>,
    /// Consecutive frames.
    pub pairs: Vec<FramePair>,
    /// One for each number of faces that was asked for.
    pub targets: Vec<TargetEvaluation>,
}

/// A frame and its predecessor, registered onto it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FramePair {
    /// The number of frame k.
    pub seq: u64,
    /// Faces of frame k, after repair.
    pub faces: usize,
    /// The diagonal of frame k's bounding box.
    pub bbox_diagonal: f64,
    /// How well frame k-1 was registered; none if it was not.
    pub registration: Option<Registration>,
    /// Why it was not.
    pub registration_error: Option<String>,
}

/// The results for one number of faces.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetEvaluation {
    /// The number of faces that was asked for.
    pub target_faces: usize,
    /// How many pairs were registered and measured in every run; the averages and the best
    /// pairs are among these.
    pub compared_pairs: usize,
    /// The original QEM, then the tracking modes in the order in which they were asked for.
    pub runs: Vec<Run>,
}

/// The results of one algorithm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// The algorithm.
    pub tracking: Tracking,
    /// One for each pair.
    pub outputs: Vec<Output>,
    /// The mean of the compared pairs' consistency; none if there are no such pairs.
    pub consistency: Option<Consistency>,
    /// Averages over the compared pairs; none if there are no such pairs.
    pub average: Option<ByMeasure<ByFrame<Summary>>>,
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
}

/// One simplified frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
    /// What has come back of this run's result for frame k-1, carried along by the registration;
    /// none without a registration.
    pub consistency: Option<Consistency>,
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
