//! The figures that come with every frame, in the terms of the public contract.
//!
//! Distances are in the mesh's own unit. Unknown fields are ignored on reading, so that a
//! player goes on working with a newer server.

use serde::{Deserialize, Serialize};

/// How a frame was simplified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tracking {
    /// The original QEM.
    #[default]
    Off,
    /// The formulas of the Tracked QEM paper to the letter.
    Paper,
    /// The previous result, carried along, anchors the new one.
    Robust,
}

/// How much of the processing that was asked for a frame got. A live stream under load leaves out
/// some before it drops frames; each step leaves out what the one before does, too.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// All of it.
    #[default]
    Full,
    /// Surface distances and flicker of some points only, no vertex distances, and without tracking
    /// no registration.
    Sampled,
    /// A coarser registration, and a result that is not fitted to its frame.
    Quick,
    /// No registration, and so no tracking.
    Untracked,
}

impl Quality {
    /// All of them, the cheapest last.
    pub const ALL: [Self; 4] = [Self::Full, Self::Sampled, Self::Quick, Self::Untracked];

    /// The name in JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Sampled => "sampled",
            Self::Quick => "quick",
            Self::Untracked => "untracked",
        }
    }
}

/// One frame's metrics.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FrameMetrics {
    /// The frame's number in its stream.
    pub seq: u64,
    /// When it was captured, in microseconds since 1970, if the rig said so.
    pub capture_time_us: Option<u64>,
    /// How it was simplified: `off` where nothing of the frame before took part, as for a first
    /// frame, after a reset, and if the frame before was lost.
    pub tracking: Tracking,
    /// What was left out because frames came too fast.
    #[serde(default)]
    pub quality: Quality,
    /// The frame that was registered onto it; none where none was, and after a reset.
    pub reference_seq: Option<u64>,
    /// What came in.
    pub input: Input,
    /// What went out.
    pub output: Output,
    /// The image that lies on the frame; none if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<Texture>,
    /// Why the image that came with the frame is not delivered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture_error: Option<String>,
    /// How well the previous frame was registered; none where it was not. After a reset it says
    /// how badly.
    pub registration: Option<Registration>,
    /// Why there is no registration although there is a previous frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration_error: Option<String>,
    /// Why the frame was treated as a first one although there is a previous frame: registration
    /// failed, or what it found is another scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reset: Option<String>,
    /// From each vertex of the simplified mesh to the surface of the frames.
    pub surface_distance: Option<DistancePair>,
    /// From each vertex of the simplified mesh to the nearest vertex of the frames.
    pub vertex_distance: Option<DistancePair>,
    /// From each vertex of the frame to the surface of the simplified mesh.
    pub current_to_output: Option<Statistics>,
    /// What has come back of the previous result, with the registration as the motion; none
    /// without both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<Consistency>,
    /// The diagonal of the frame's bounding box.
    pub bbox_diagonal: f64,
    /// How long each stage took, in microseconds.
    pub stage_us: StageTimes,
    /// From the arrival of the whole frame to its delivery, in microseconds.
    pub latency_us: u64,
}

/// What came in, and what repair did to it.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Input {
    /// Vertices as received.
    pub vertices: usize,
    /// Faces as received, polygons fanned.
    pub faces: usize,
    /// The body's length.
    pub bytes: usize,
    /// Vertices merged into another one at exactly the same position.
    pub welded_vertices: usize,
    /// Faces dropped as degenerate, duplicate or non-manifold.
    pub removed_faces: usize,
    /// Edges found with more than two faces.
    #[serde(default)]
    pub non_manifold_edges: usize,
    /// Vertices dropped because no face refers to them.
    #[serde(default)]
    pub unreferenced_vertices: usize,
}

/// What went out.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Output {
    /// Vertices of the simplified mesh.
    pub vertices: usize,
    /// Its faces.
    pub faces: usize,
    /// Its length in Draco.
    pub bytes: usize,
    /// Whether it has the asked number of faces (or one more where the topology leaves no
    /// choice).
    #[serde(default)]
    pub target_reached: bool,
    /// Points as delivered: where a texture has a seam, a vertex has one for each side of it.
    #[serde(default)]
    pub points: usize,
}

/// The image that lies on a frame, by the frame's texture coordinates.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Texture {
    /// Which image: 32 hexadecimal digits, the same for the same bytes.
    pub id: String,
    /// Its format: `image/jpeg`, `image/png`, `image/webp`, `image/avif` or `image/ktx2`.
    pub media_type: String,
    /// Its length.
    pub bytes: usize,
    /// Its width in pixels.
    pub width: u32,
    /// Its height in pixels.
    pub height: u32,
    /// Whether the server has made it smaller or another format of it; else it is as it came.
    #[serde(default)]
    pub encoded: bool,
}

/// How well the previous frame was registered.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Registration {
    /// Root mean square distance to the frame's surface after the rigid step.
    pub rigid_rmse: f64,
    /// Distances of the registered vertices to the frame's surface.
    pub residual: Residual,
    /// Nodes of the deformation graph.
    pub nodes: usize,
    /// Rounds of the non-rigid step.
    pub iterations: usize,
}

/// Distances of the registered vertices to the frame's surface.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Residual {
    /// Their mean.
    pub mean: f64,
    /// Their root mean square.
    pub rms: f64,
    /// The distance that 95 % of them are below.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

/// How much of the previous simplified mesh, carried along by the motion, is found again.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Consistency {
    /// The share of the simplified mesh's vertices that are within a tenth of its mean edge of
    /// a carried vertex, 0 to 1.
    pub vertex_persistence: f64,
    /// The share of the carried edges that are there again between the vertices that are nearest
    /// to their ends, 0 to 1.
    pub edge_persistence: f64,
    /// The mean distance of the carried surface and the simplified one.
    pub flicker: f64,
}

/// Distances to the registered previous frame and to the current one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DistancePair {
    /// To the registered frame k-1; none without one.
    pub previous: Option<Statistics>,
    /// To frame k.
    pub current: Statistics,
}

/// Summary of a set of distances: see `metrics` in the geometry crate for the formulas.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Statistics {
    /// (1/n) Σ d
    pub mean: f64,
    /// (1/n) Σ (d − mean)²
    pub variance: f64,
    /// √variance
    pub std: f64,
    /// (1/n) Σ d²
    pub mse: f64,
    /// √mse
    pub rmse: f64,
    /// max d
    pub max: f64,
    /// n
    pub count: usize,
}

/// How long each stage took, in microseconds.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct StageTimes {
    /// Bytes to arrays.
    pub parse: u64,
    /// Welding and the rest of the repair.
    pub repair: u64,
    /// Registration of the previous frame.
    pub register: u64,
    /// Edge collapses.
    pub simplify: u64,
    /// The distances.
    pub measure: u64,
    /// Draco.
    pub encode: u64,
}
